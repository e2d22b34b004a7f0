"""Finds the right place of the robots of a host: measures, lets `core/placement.py` judge, and moves.

The ways to other hosts are measured seldom, as long as there is another host. The rest costs nothing while no
robot is placed by `advise` or `auto`. Lives on the event loop.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import time
from collections.abc import Callable, Iterable
from typing import Protocol

from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.shared import loop_now
from robotree.vr.agents.unfit import unfit_reasons
from robotree.vr.agents.ways import Ways
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.address import Address, everyone
from robotree.vr.base.description import HostLoad
from robotree.vr.base.errors import TransportError, VrError
from robotree.vr.base.places import Places
from robotree.vr.base.requests import Reply
from robotree.vr.base.transport import Transport
from robotree.vr.core import events as on
from robotree.vr.core.machine import RobotState
from robotree.vr.core.placement import (
    Contact,
    HostSeen,
    PlaceAdvice,
    PlacedRobot,
    PlaceWatch,
    Placing,
    seated,
)
from robotree.vr.core.traffic import NO_FLOW

LOOK = 1.0
"""[s] between two looks at the places of robots."""
SURVEY = 10.0
"""[s] between two measurements of the ways to the other hosts, while no robot is looked after."""
METERED = 1.0
"""[s] over which the load of the process is taken, at least."""

_log = logging.getLogger(__name__)


class Placeable(Protocol):
    """A robot whose place is looked after: in the process of its host, or in one of its own."""

    @property
    def came(self) -> bool:
        """Whether it has come from another host."""
        ...

    @property
    def placed(self) -> PlacedRobot | None:
        """What matters for its place; None: people alone move it, or it is on its way."""
        ...

    def show(self, advice: PlaceAdvice, text: str) -> None:
        """Take what a look at its place has shown, and say it as `text`."""
        ...

    def begin_move(self, advice: PlaceAdvice) -> None:
        """Note that it moves now, and why, for itself and for its log."""
        ...

    def end_move(self, advice: PlaceAdvice, reason: str) -> None:
        """Note why it has not moved."""
        ...


class AgentPlace:
    """A robot in this process. Lives on the event loop."""

    def __init__(self, agent: RobotAgent, unix: Callable[[], float]) -> None:
        """Take the robot, and the clock [s since 1970]."""
        self._agent, self._unix = agent, unix
        self._before: Placing | None = None

    @property
    def came(self) -> bool:
        """See `Placeable`; so are the others."""
        return bool(self._agent.runtime.came)

    @property
    def placed(self) -> PlacedRobot | None:
        runtime, robot = self._agent.runtime, self._agent.robot
        if runtime.placement == "manual" or self._agent.gone or runtime.is_on_way:
            return None
        assert isinstance(robot, VirtualRobot)  # noqa: S101 # no other one has a placement
        flows = runtime.traffic.flows(runtime.process.runner.now())
        family, placing = runtime.look(lambda state: (_family(state), state.placing))
        partners = [
            Contact(key, name, calls)
            for key, name in family.items()
            if (calls := flows.get(key, NO_FLOW).calls)
        ]
        strangers = sum(flow.calls for key, flow in flows.items() if key not in family)
        return PlacedRobot(
            name=robot.name,
            mode=runtime.placement,
            partners=partners,
            strangers=strangers,
            pinned=robot.pinned,
            unfit="; ".join(unfit_reasons(runtime)),
            urgent=runtime.look(commands_running) > 0,
            stay=placing.stay(self._unix()),
        )

    def show(self, advice: PlaceAdvice, text: str) -> None:
        runtime, before = self._agent.runtime, self._agent.runtime.advice
        if runtime.placement == "manual":  # a person has just said so
            return
        runtime.advice = text
        if advice.target and advice.target != runtime.advised and runtime.placement == "advise":
            runtime.log.say("info", f"it would be better off on {advice.target}: {text}")
        runtime.advised = advice.target
        if before != text:
            runtime.changed()

    def begin_move(self, advice: PlaceAdvice) -> None:
        runtime = self._agent.runtime
        self._before = runtime.look(lambda state: state.placing)
        runtime.log.say("info", f"it moves to {advice.target}: {advice.why}")
        runtime.post(on.PlacingSet(placing=self._before.moving(advice.why, self._unix())))

    def end_move(self, advice: PlaceAdvice, reason: str) -> None:
        runtime = self._agent.runtime
        runtime.advice = f"{advice.why}; but {reason}"
        runtime.log.say("warning", f"it has not moved: {reason}")
        if self._before is not None:
            with contextlib.suppress(VrError):
                runtime.post(on.PlacingSet(placing=self._before))


class LoadMeter:
    """How busy this process is."""

    def __init__(self, now: Callable[[], float], used: Callable[[], float] = time.process_time) -> None:
        """Begin.

        Args:
            now: [s] on a monotonic clock.
            used: [s] of processor time that the process has had.
        """
        self._now, self._used = now, used
        self._before, self._cpu = (now(), used()), 0.0

    def cpu(self) -> float:
        """Return which part of one processor it has used of late; it may be more than 1."""
        now, used = self._now(), self._used()
        began, before = self._before
        if now - began >= METERED:
            self._cpu, self._before = (used - before) / (now - began), (now, used)
        return self._cpu


class PlacingHost(Protocol):
    """A host, as the places of its robots know it."""

    address: Address
    agents: dict[str, RobotAgent]

    def has_room(self) -> int | None:
        """How many robots it still takes; None: any number."""
        ...

    def placeables(self) -> dict[str, Placeable]:
        """Return its robots, by key, in this process and apart."""
        ...

    async def move(self, robot: str, host: str) -> Reply:
        """Have a robot go on in another host; see `Moves.migrate`."""
        ...


class PlaceFinder:
    """See the module."""

    def __init__(
        self,
        host: PlacingHost,
        transport: Transport,
        *,
        unix: Callable[[], float],
        used: Callable[[], float] = time.process_time,
    ) -> None:
        """Begin; `run` looks.

        Args:
            host: whose robots it looks after.
            transport: the way to the other hosts.
            unix: [s] since 1970.
            used: [s] of processor time that the process has had.
        """
        self._host, self._transport, self._unix = host, transport, unix
        self.ways = Ways(transport, host.address.key)
        self._meter = LoadMeter(asyncio.get_running_loop().time, used)
        self._watches: dict[str, PlaceWatch] = {}
        """By key of the robot."""
        self._surveyed = -SURVEY

    # -- what the host says of itself --------------------------------------------------------------

    def load(self) -> HostLoad:
        """Return what the host has to do."""
        agents = [agent for agent in self._host.agents.values() if not agent.gone]
        running = sum(agent.runtime.look(commands_running) for agent in agents)
        cpu = round(self._meter.cpu(), 2)
        return HostLoad(robots=len(agents), running=running, cpu=cpu, room=self._host.has_room())

    def distances(self) -> dict[str, float]:
        """Return the round trips [s] to the other hosts."""
        return self.ways.round_trips(self._other_keys())

    async def measured(self, keys: Iterable[str]) -> dict[str, float]:
        """Return the same, measured anew where that is needed; robots of the host are at no distance."""
        keys = list(keys)
        here = {agent.address.key: 0.0 for agent in self._host.agents.values()}
        far = await self.ways.measure([key for key in keys if key not in here])
        return {**self.distances(), **far, **{key: way for key, way in here.items() if key in keys}}

    def _other_keys(self) -> list[str]:
        return [
            key
            for key in self._transport.presence.keys(everyone("host", "*"))
            if key != self._host.address.key
        ]

    # -- looking ----------------------------------------------------------------------------------

    async def run(self) -> None:
        """Look again and again, until it is cancelled."""
        while True:
            await asyncio.sleep(LOOK)
            try:
                await self.look()
            except TransportError:  # it is closed: the process ends
                return
            except Exception:  # noqa: BLE001 # no robot's place is worth the host
                _log.exception("a look at the places of robots failed")

    async def look(self) -> None:
        """Look once: say where robots would be better off, and move those that are to move."""
        there = self._host.placeables()
        robots = {key: placed for key, one in there.items() if (placed := one.placed) is not None}
        self._watches = {key: watch for key, watch in self._watches.items() if key in robots}
        now = loop_now()
        if robots or now - self._surveyed > SURVEY:
            self._surveyed = now
            await asyncio.gather(*map(self.ways.ask, self._other_keys()))
        if not robots:
            return
        keys = {partner.key for robot in robots.values() for partner in robot.partners}
        here = HostSeen(
            self._host.address.name,
            self._host.address.key,
            await self.measured(sorted(keys)),
            self.load(),
        )
        others = await self._others(tuple(sorted(keys)))
        advice: dict[str, PlaceAdvice] = {}
        for key, robot in robots.items():
            since = loop_now() if there[key].came else float("-inf")  # long ago, if it was made here
            watch = self._watches.setdefault(key, PlaceWatch(since))
            advice[key] = watch.look(robot, here, others, loop_now())
        await self._follow(there, advice, {host.name: host.load.room for host in others})

    async def _others(self, keys: tuple[str, ...]) -> list[HostSeen]:
        """Return the hosts that take robots, with the ways from them."""
        asked = (self.ways.ask(key, keys) for key in self._other_keys())
        found = [one for one in await asyncio.gather(*asked) if one is not None]
        places = Places(self._transport.presence)
        return [
            HostSeen(_whole_name(places, one.address), one.address.key, one.ways, one.load)
            for one in found
            if one.load is not None and one.takes_robots
        ]

    async def _follow(
        self, there: dict[str, Placeable], advice: dict[str, PlaceAdvice], rooms: dict[str, int | None]
    ) -> None:
        """Say what was found, and move those that are to move, the most urgent first."""
        go, wait = seated(advice, rooms)
        for key, one in advice.items():
            full = f"; {one.target} is full, and others go first" if key in wait else ""
            there[key].show(one, one.why + full)
        for key in go:
            placed = there[key].placed
            if placed is not None and placed.mode == "auto":  # a person may have just said something else
                await self._move(key, placed.name, there[key], advice[key])

    async def _move(self, key: str, name: str, robot: Placeable, one: PlaceAdvice) -> None:
        try:
            robot.begin_move(one)
            await self._host.move(name, one.target)
        except VrError as error:
            robot.end_move(one, str(error))
            if (watch := self._watches.get(key)) is not None:
                watch.refused(one.target, loop_now())


def _whole_name(places: Places, host: Address) -> str:
    """Return the name of a host, with its site if that is another one."""
    site = places.site_of(host.key)
    return f"{site}:{host.name}" if site else host.name


def _family(state: RobotState) -> dict[str, str]:
    """Return children and parent of a robot: names by key."""
    lease = state.lease.current
    parent = {} if lease is None else {lease.parent.key: lease.parent.name}
    return {bond.child.key: bond.child.name for bond in state.slots.bonds().values()} | parent


def commands_running(state: RobotState) -> int:
    """Return how many commands of a robot run."""
    return sum(1 for call in state.calls.live.values() if call.running)
