"""The proxy of a rover before the controller in C: what a caller sees of it."""

from __future__ import annotations

import asyncio
import random
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractContextManager, asynccontextmanager
from typing import Any

import pytest

from robotree.protocol.messages import Claim, ClaimWish, GoalState, Mode, ModeKind, Reason
from robotree.proxy.agent import running_proxy
from robotree.proxy.guard import Span
from robotree.proxy.rover import Rover
from robotree.vr.base.errors import CommandCancelled, CommandFailed, CommandInDoubt, DeadlineExceeded, Stopped
from robotree.vr.exchange.client import RobotClient
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import until

Operator = Any
Power = Callable[..., AbstractContextManager[int]]


class Drive:
    """A rover's proxy among agents, and the programs that command it."""

    def __init__(self, robot: Rover, client: RobotClient) -> None:
        self.robot, self.client = robot, client

    def begin(self, x: float, y: float, speed: float = 0.2, **options: Any) -> asyncio.Task[Any]:
        return asyncio.create_task(self.client.call("move", {"x": x, "y": y, "speed": speed}, **options))

    async def online(self, *, online: bool = True) -> None:
        await until(lambda: self.robot.online is online, f"online becomes {online}")

    async def moving(self) -> None:
        await until(lambda: abs(self.robot.readings().get("vx", 0.0)) > 0.05, "it moves")

    async def place(self) -> list[float]:
        info = await self.client.call("get_info", {})
        return [info["x"], info["y"]]


@asynccontextmanager
async def driving(port: int, **limits: Span) -> AsyncIterator[Drive]:
    rover = Rover("rover-1", f"tcp:127.0.0.1:{port}", limits, chance=random.Random(1))
    network = MemoryNetwork()
    async with running_proxy(rover, network.join("proxy")) as agent:
        drive = Drive(rover, RobotClient(network.join("caller"), agent.address))
        await drive.online()
        yield drive


async def test_a_proxy_moves_it_and_passes_its_progress_up(port: int) -> None:
    seen: list[float] = []
    async with driving(port) as drive:
        assert await drive.begin(0.3, -0.2, 0.2, on_progress=lambda part, _: seen.append(part)) is None
        assert await drive.place() == pytest.approx([0.3, -0.2], abs=1e-6)
    assert len(set(seen)) >= 3
    assert seen == sorted(seen)


async def test_its_refusal_reaches_the_caller_as_its_own_sentence(port: int) -> None:
    async with driving(port, arena_x=Span(-9.0, 9.0, "m")) as drive:
        with pytest.raises(
            CommandFailed, match=r"rover-1\.move failed: The floor ends 1\.5 m from its middle"
        ):
            await drive.begin(2.0, 0.0)
        assert await drive.place() == [0.0, 0.0]


async def test_a_cancelled_or_late_move_ends_where_it_is(port: int) -> None:
    async with driving(port) as drive:
        call = drive.begin(1.0, 0.0, key="long")
        await drive.moving()
        await drive.client.cancel("long", reason="enough")
        with pytest.raises(CommandCancelled, match="enough"):
            await call
        with pytest.raises(DeadlineExceeded):
            await drive.begin(-1.0, 0.0, deadline=0.4)
        here = await drive.place()
        assert -0.2 < here[0] < 1.0
        await asyncio.sleep(0.1)
        assert await drive.place() == here


async def test_a_safe_stop_ends_a_move_and_the_release_lets_it_go_on(
    port: int, make_operator: type[Operator]
) -> None:
    async with driving(port) as drive:
        call = drive.begin(1.0, 0.0)
        await drive.moving()
        await drive.client.safe_stop("a hand in the cell")
        with pytest.raises((CommandCancelled, Stopped)):
            await call
        await until(lambda: not drive.robot.readings()["vx"], "it stands")
        with make_operator(port, system=254) as passer_by:
            mode = await asyncio.to_thread(passer_by.hear, Mode)
            assert (mode.mode, mode.reason) == (ModeKind.SAFE_STOP, Reason.OPERATOR)
        with pytest.raises(Stopped):
            await drive.begin(0.1, 0.0)
        await drive.client.resume()
        await drive.begin(0.0, 0.1)


async def test_a_newer_epoch_fences_an_older_lease_off(port: int, make_operator: type[Operator]) -> None:
    async with driving(port) as drive:
        await drive.begin(0.05, 0.0)
        with make_operator(port, system=254) as successor:
            refused = await asyncio.to_thread(successor.ask, 1, 0.0, 0.05, epoch=0)
            assert (refused.state, refused.reason) == (GoalState.REFUSED, Reason.NOT_IN_CONTROL)
            assert "holds this robot" in refused.text
            ours = drive.robot.controller_epoch
            successor.say(Claim(6, ours + 10, 9000, 0, 1, 1, ClaimWish.TAKE_OVER, "successor"))
            await until(lambda: drive.robot.controller_epoch == ours + 10, "it has taken over")
            with pytest.raises(CommandFailed, match="'successor' holds its controller; end that program, or"):
                await drive.begin(0.05, 0.0)
            old = await asyncio.to_thread(successor.ask, 2, 0.0, 0.05, epoch=ours + 9)
            assert (old.state, old.reason) == (GoalState.REFUSED, Reason.STALE_EPOCH)
            new = await asyncio.to_thread(successor.ask, 3, 0.0, 0.05, epoch=ours + 10)
            assert new.state == GoalState.ACTIVE
            successor.say(Claim(6, ours + 10, 9000, 0, 1, 1, ClaimWish.RELEASE, "successor"))
            await until(lambda: not drive.robot.denied, "the robot is free again")
        await drive.begin(0.05, 0.0)


async def test_it_may_be_restarted_under_a_proxy(power: Power) -> None:
    with power() as port:
        stack = driving(port)
        drive = await stack.__aenter__()
        call = drive.begin(1.0, 0.0, 0.1)
        await drive.moving()
    try:
        await drive.online(online=False)
        with power(port):
            await drive.online()
            with pytest.raises(CommandInDoubt, match=r"has restarted meanwhile\. Look where the robot is"):
                await call
            assert await drive.place() == [0.0, 0.0]
            await drive.begin(0.1, 0.0)
            assert await drive.place() == pytest.approx([0.1, 0.0], abs=1e-6)
    finally:
        await stack.__aexit__(None, None, None)
