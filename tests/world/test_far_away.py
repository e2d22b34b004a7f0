"""Delays up to those between Earth and Mars, in virtual time: what is far away stays safe.

An arm and the robot that knows its steps are on Mars, in one process; on Earth a person asks, and a robot
tries to command the arm itself. Light takes 177 s to 1337 s one way (33 to 249 million miles).

The laws at every delay: what begins has been asked for less than `FRESH` before; the arm obeys one commander
at a time, and its epochs only grow; the work of the robot beside the arm is not disturbed by the line; a stop
is carried out one way later, however late that is, and nothing begins after it. With time scaled down so that
Mars is a second away the same works by asking, too, and nothing is done twice.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from functools import partial
from itertools import pairwise

import pytest

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.address import Address, everyone
from robotree.vr.base.envelope import FRESH
from robotree.vr.base.errors import VrError
from robotree.vr.exchange.client import RobotClient
from robotree.vr.running.process import Process
from robotree.vr.world.world import SimulatedProcess, World

NEAREST, FARTHEST = 177.0, 1337.0
"""[s] One way between Earth and Mars."""
SCALE = 1000.0
"""By which time is scaled down where Mars is asked."""
SLACK = 0.1
"""[s] for what happens inside a process."""
WORK = 0.2
"""[s] that a step takes, at least."""


class Beyond:
    """What happens on both planets."""

    def __init__(self, world: World, delay: float) -> None:
        self.world, self.delay = world, delay
        self.work = max(WORK, delay / 100)
        self.asked: dict[str, float] = {}
        self.steps: list[tuple[float, str, int]] = []
        """When each step began, for whom, under which epoch."""
        self.said: dict[str, str] = {}
        """How what was asked from Earth has ended."""
        self.arm: RobotAgent
        self.late: list[str] = []

    def note_step(self, who: str, label: str, epoch: int) -> None:
        now = self.world.runner.now()
        self.steps.append((now, who, epoch))
        if label in self.asked and now > self.asked[label] + FRESH + SLACK:
            self.late.append(f"{label} began {now - self.asked[label]:.1f} s after it was asked for")


class Arm(Robot):
    """Takes a step."""

    beyond: Beyond

    @command
    def step(self, label: str) -> str:
        self.beyond.note_step(self.context.caller, label, self.context.epoch)
        self.sleep(self.beyond.work)
        return label


class Tour(VirtualRobot):
    """Knows the steps."""

    arm = Child("Arm")

    @command
    def go(self, label: str, steps: int) -> int:
        for _ in range(steps):
            self.arm.step(label=label)
        return steps


async def _mars(beyond: Beyond, process: SimulatedProcess) -> None:
    home = Process(process.runner, core=beyond.world.core)
    arm, tour = Arm("arm"), Tour("tour")
    arm.beyond = beyond
    agents = [RobotAgent(robot, process.transport, process=home) for robot in (arm, tour)]
    beyond.arm = agents[0]
    for agent in agents:
        await agent.start()
    await RobotClient(process.transport, agents[1].address).enslave("arm", agents[0].address)
    local = RobotClient(process.transport, agents[1].address)
    while beyond.delay > FRESH:  # its own work goes on; where Mars is asked, it waits for that
        try:
            await local.call("go", {"label": "own", "steps": 5}, deadline=1e4)
        except VrError:  # it is stopped
            break
    await asyncio.Event().wait()


async def _earth(beyond: Beyond, process: SimulatedProcess) -> None:
    presence, now = process.transport.presence, beyond.world.runner.now
    boss = RobotAgent(
        Tour("boss"), process.transport, process=Process(process.runner, core=beyond.world.core)
    )
    await boss.start()
    for name in ("arm", "tour"):
        while not presence.keys(everyone("robot", name)):  # noqa: ASYNC110 # time is virtual
            await asyncio.sleep(1.0)
    found = presence.keys(everyone("robot", "*"))
    there = {address.name: address for key in found if (address := Address.parse(key)) is not None}
    client = RobotClient(process.transport, there["tour"])

    async def ask(label: str, steps: int) -> None:
        beyond.asked[label] = now()
        try:
            done = await client.call("go", {"label": label, "steps": steps}, deadline=60.0)
        except VrError as error:
            beyond.said[label] = type(error).__name__
        else:
            beyond.said[label] = f"{done} steps"

    for number in range(3):
        await ask(f"asked-{number}", 3)
    try:
        await RobotClient(process.transport, boss.address).enslave("arm", there["arm"])
    except VrError as error:
        beyond.said["enslave"] = type(error).__name__
    beyond.asked["stop"] = now()
    try:
        beyond.said["stop"] = ", ".join(sorted(await client.safe_stop("enough")))
    except VrError as error:
        beyond.said["stop"] = type(error).__name__
    await asyncio.Event().wait()


def played(delay: float, until: float, seed: int = 1) -> Beyond:
    with World(seed, delay=delay, lease=max(2.0, 4 * delay)) as world:
        beyond = Beyond(world, delay)
        world.start("mars", partial(_mars, beyond))
        world.start("earth", partial(_earth, beyond))
        world.run(until)
        assert world.complaints == []
        epochs = [epoch for _, _, epoch in beyond.steps]
        assert epochs == sorted(epochs), "no older epoch is obeyed"
        assert beyond.late == []
        assert beyond.arm.runtime.look(lambda state: state.stop.in_force), "the stop was carried out"
    return beyond


@pytest.mark.parametrize("delay", [10.0, NEAREST, FARTHEST])
def test_what_is_far_away_is_safe_though_nobody_can_be_asked_in_time(delay: float) -> None:
    beyond = played(delay, 4 * delay + 120.0)  # the stop comes after two ways, its answer after three
    stopped = beyond.asked["stop"] + delay
    assert {who for _, who, _ in beyond.steps} == {"tour"}, "only the robot beside it commands the arm"
    assert all(when <= stopped + SLACK for when, _, _ in beyond.steps), "nothing begins after the stop"
    own = [when for when, _, _ in beyond.steps]
    assert max(later - earlier for earlier, later in pairwise(own)) < 2 * beyond.work
    assert own[-1] > stopped - 2 * beyond.work, "until it has come the robot beside the arm goes on"
    assert not any(said.endswith("steps") for said in beyond.said.values()), "nobody is told what is not so"


@pytest.mark.parametrize("delay", [NEAREST / SCALE, FARTHEST / SCALE])
def test_scaled_down_the_same_is_asked_carried_out_once_and_stopped(delay: float) -> None:
    beyond = played(delay, 60.0)
    asked = [f"asked-{number}" for number in range(3)]
    assert [beyond.said[label] for label in asked] == ["3 steps"] * 3
    assert beyond.said["enslave"] == "LeaseDenied"
    assert beyond.said["stop"] == "arm, tour"
    assert Counter(who for _, who, _ in beyond.steps) == {"tour": 9}
    first = [when for when, _, _ in beyond.steps][::3]
    ways = [when - beyond.asked[label] for when, label in zip(first, asked, strict=True)]
    assert all(abs(way - delay) < SLACK for way in ways), "a coarse command takes one way, whatever its steps"
