"""A controller that has started again, told by its clock, and one that obeys a later epoch than its proxy."""

from __future__ import annotations

import asyncio
import contextlib
import random
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st

from robotree.protocol.links.url import listen
from robotree.protocol.messages import Goal, GoalState, Verb
from robotree.protocol.services.fence import Fence
from robotree.protocol.services.goal_server import GoalServer
from robotree.proxy.agent import running_proxy
from robotree.proxy.arm import Arm
from robotree.proxy.restart import MAX_JITTER, Report, has_restarted, is_older
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.errors import CommandFailed, StaleEpoch
from robotree.vr.exchange.client import RobotClient
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import until

SECONDS = st.floats(0.0, 1e6)
DELAY = st.floats(0.0, 0.99 * MAX_JITTER)
BEGIN = 1000.0
"""[s] on our clock when the first life began."""


def report(began: float, said: float, delay: float, rate: float = 1.0) -> Report:
    """What a controller says at a moment [s] of our clock, which its own follows at a rate."""
    return Report(int(1000 * rate * (said - began)), said + delay)


@given(uptime=st.floats(MAX_JITTER, 1e6), down=SECONDS, age=SECONDS, delays=st.tuples(DELAY, DELAY))
@example(uptime=3.0, down=5.5, age=4.5, delays=(0.0, 0.0))
@example(uptime=60.0, down=30.0, age=90.0, delays=(0.0, 0.0))
def test_a_new_life_is_told_however_old_it_is_when_it_is_heard(
    uptime: float, down: float, age: float, delays: tuple[float, float]
) -> None:
    died = BEGIN + uptime
    before, after = report(BEGIN, died, delays[0]), report(died + down, died + down + age, delays[1])
    assume(
        uptime + down + delays[1] - delays[0] > MAX_JITTER + 0.01
    )  # else it could be the old one, heard late
    assert has_restarted(before, after)


@given(uptime=SECONDS, gap=SECONDS, delays=st.tuples(DELAY, DELAY))
def test_a_life_that_goes_on_is_not_taken_for_a_new_one_whatever_the_delays(
    uptime: float, gap: float, delays: tuple[float, float]
) -> None:
    said = BEGIN + uptime
    assert not has_restarted(report(BEGIN, said, delays[0]), report(BEGIN, said + gap, delays[1]))


@given(uptime=SECONDS, gap=SECONDS, rate=st.floats(0.05, 20.0), delays=st.tuples(DELAY, DELAY))
def test_nor_is_one_whose_clock_goes_wrong_if_it_is_older_than_it_was_not_heard(
    uptime: float, gap: float, rate: float, delays: tuple[float, float]
) -> None:
    assume(rate * (uptime + gap) > gap + 2 * MAX_JITTER)
    said = BEGIN + uptime
    assert not has_restarted(report(BEGIN, said, delays[0], rate), report(BEGIN, said + gap, delays[1], rate))


@pytest.mark.parametrize("rate", [0.1, 0.5, 0.9, 10.0])
def test_a_drift_that_grows_slowly_is_no_restart(rate: float) -> None:
    words = [report(BEGIN, BEGIN + 0.5 * count, 0.0, rate) for count in range(10_000)]
    assert not any(has_restarted(*pair) for pair in pairwise(words))


def test_a_clock_that_has_fallen_tells_a_restart_though_ours_stood_still() -> None:
    """Ours does while the computer sleeps."""
    assert has_restarted(Report(2_000_000, 50.0), Report(1_000_000, 55.0))
    assert not has_restarted(Report(2_000_000, 50.0), Report(5_600_000, 55.0))


@given(
    uptime=st.floats(MAX_JITTER, 1e6), gap=st.floats(0.01, 0.9 * MAX_JITTER), delays=st.tuples(DELAY, DELAY)
)
def test_of_one_life_the_word_that_was_said_first_is_overtaken_whichever_is_heard_first(
    uptime: float, gap: float, delays: tuple[float, float]
) -> None:
    first, second = report(BEGIN, BEGIN + uptime, delays[0]), report(BEGIN, BEGIN + uptime + gap, delays[1])
    assert not is_older(first, second)
    if first.heard_at >= second.heard_at:
        assert is_older(second, first)


@given(uptime=st.floats(0.0, 1e6), down=SECONDS, delays=st.tuples(DELAY, DELAY))
def test_a_new_life_is_heard_once_it_is_older_than_any_delay(
    uptime: float, down: float, delays: tuple[float, float]
) -> None:
    died = BEGIN + uptime
    before = report(BEGIN, died, delays[0])
    after = report(
        died + down, died + down + MAX_JITTER + max(0.0, delays[0] - delays[1]) + 0.002, delays[1]
    )  # the wire tells whole milliseconds
    assume(after.heard_at > before.heard_at)
    assert not is_older(before, after)


@asynccontextmanager
async def proxy_of(controller: Any) -> AsyncIterator[tuple[Arm, RobotAgent, RobotClient]]:
    listener = await listen("tcp:127.0.0.1:0", controller.accept)
    robot = Arm("arm-1", listener.address, chance=random.Random(1))
    network = MemoryNetwork()
    living = asyncio.create_task(controller.live())
    async with contextlib.AsyncExitStack() as stack:
        stack.push_async_callback(listener.close)
        stack.callback(living.cancel)
        agent = await stack.enter_async_context(running_proxy(robot, network.join("proxy")))
        yield robot, agent, RobotClient(network.join("operator"), agent.address)


async def test_a_proxy_whose_clock_was_set_back_is_obeyed_all_the_same(make_controller: type[Any]) -> None:
    controller = make_controller()
    ahead = int(time.time()) + 3600
    controller.goals.fence(ahead)
    async with proxy_of(controller) as (robot, agent, client):
        await until(lambda: robot.controller_epoch == ahead, "the controller tells its epoch")
        call = asyncio.create_task(client.call("hold", {}))
        await until(lambda: bool(controller.begun) or call.done(), "the goal arrives")
        if controller.begun:
            controller.finish(GoalState.SUCCEEDED)
        await call
        goals = [one for one in controller.heard if isinstance(one, Goal) and one.verb != Verb.STATUS]
        assert {goal.epoch for goal in goals} == {agent.description().epoch}
        assert goals[0].epoch > ahead


async def test_a_proxy_beside_another_one_goes_not_above_the_lease_that_was_granted_there(
    make_controller: type[Any],
) -> None:
    controller = make_controller()
    async with proxy_of(controller) as (robot, agent, client):
        controller.goals.fence(1)
        await until(lambda: robot.controller_epoch == 1, "the controller is heard")
        await client.describe()
        theirs = agent.description().epoch + 1000
        controller.goals.fence(theirs)
        await until(lambda: robot.controller_epoch == theirs, "somebody else has commanded it")
        with pytest.raises(CommandFailed, match=r"another proxy commands its controller.*; enslave arm-1 to"):
            await client.call("hold", {})
        assert agent.description().epoch < theirs
        assert controller.begun == []


async def test_an_epoch_with_no_room_above_it_is_left_alone(make_controller: type[Any]) -> None:
    controller = make_controller()
    controller.goals = GoalServer(set(Verb), lambda _: None, fence=Fence(2**32 - 1))
    async with proxy_of(controller) as (robot, agent, client):
        await until(lambda: robot.controller_epoch == 2**32 - 1, "the controller tells its epoch")
        with pytest.raises(StaleEpoch):
            await client.call("hold", {})
        assert agent.description().epoch < 2**31
        assert not [one for one in controller.heard if isinstance(one, Goal) and one.verb != Verb.STATUS]
