"""A controller that obeys a later epoch than its proxy: the clock went back, or somebody else commands it."""

from __future__ import annotations

import asyncio
import contextlib
import random
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import pytest

from robotree.protocol.links.url import listen
from robotree.protocol.messages import Goal, GoalState, Verb
from robotree.protocol.services.fence import Fence
from robotree.protocol.services.goal_server import GoalServer
from robotree.proxy.agent import running_proxy
from robotree.proxy.arm import Arm
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.errors import CommandFailed, StaleEpoch
from robotree.vr.exchange.client import RobotClient
from robotree.vr.world.network import MemoryNetwork
from robotree.vr.world.testing import until


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
