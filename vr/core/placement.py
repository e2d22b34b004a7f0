"""Where a robot should run: what its calls cost in each host, and when that is worth a move.

A call takes the way to the one who is called and back, and the time that a process needs for it, which grows
with what the process has to do already (as the wait before a single server does, M/M/1: 1/(1 - load)). So of
each second a robot spends

    sum over its partners of  calls a second x (round trip from the host + SERVICE / (1 - load))

and a host where that sum is less is a better place. Partners are the children, and the parent, which waits
for the robot in the same way. Those who are nobody's parent, people mostly, are taken to be where the robot
is now, so a move costs them the way between the two hosts.

A robot moves for a real gain only (`GAIN` of its time, and `SHARE` of what it spends), which must have been
there in `LOOKS` looks in a row, and not before it has been where it is for a while. That while doubles with
each move of late, so two hosts that are the better one in turns do not make a robot run to and fro. Pure.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import msgspec

from robotree.vr.base.description import HostLoad, Placement

SERVICE = 0.0003
"""[s] that a process needs for a call when it has nothing else to do."""
FULLEST = 0.95
"""Load above which a process is not taken to be any slower: the formula knows no end."""
GAIN = 0.05
"""Part of its time that a robot must save at least."""
SHARE = 0.3
"""Part of what it spends on its calls that it must save at least."""
LOOKS = 2
"""Looks in a row in which the same host must have been better."""
STAY = 10.0
"""[s] for which a robot stays where it has come to, at least."""
DOUBLINGS = 6
"""How often that time doubles at most: to about 10 min."""
CALM = 600.0
"""[s] without a move after which moves of before do not count any more."""
REFUSED_FOR = 30.0
"""[s] for which a host that has refused a robot is not asked again."""
RARE = 0.05
"""[1/s] Calls below this do not count: it is idle."""


class Placing(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """What a robot takes along about its place."""

    mode: Placement | None = None
    """As a person has set it; None: as its class says."""
    why: str = ""
    """Why it is where it is, as a sentence; empty: nobody but people has moved it."""
    moved: float = 0.0
    """[s] since 1970: when it was moved last for a better place; 0: never."""
    moves: int = 0
    """How often it was moved so of late."""

    def stay(self, unix: float) -> float:
        """Return for how long [s] it stays in a host at least.

        Args:
            unix: [s] since 1970.
        """
        recent = 0 if unix - self.moved > CALM else self.moves
        return STAY * float(1 << min(max(recent - 1, 0), DOUBLINGS))

    def moving(self, why: str, unix: float) -> Placing:
        """Return what it takes along when it moves for a reason."""
        recent = 0 if unix - self.moved > CALM else self.moves
        return msgspec.structs.replace(self, why=why, moved=unix, moves=recent + 1)


class Contact(NamedTuple):
    """One with whom a robot has to do."""

    key: str
    name: str
    calls: float
    """[1/s] to and fro."""


class HostSeen(NamedTuple):
    """A host as a place for a robot."""

    name: str
    key: str
    ways: Mapping[str, float]
    """[s] Round trips from it, by key of who is there; what is missing is not known."""
    load: HostLoad


class PlacedRobot(NamedTuple):
    """A robot that has a place."""

    name: str
    mode: Placement
    partners: Sequence[Contact]
    strangers: float = 0.0
    """[1/s] Calls of those who are not its parent."""
    pinned: bool = False
    """Whether its author has pinned it."""
    unfit: str = ""
    """Why it cannot travel, as a clause; empty: it can."""
    urgent: bool = False
    """Whether it carries something out."""
    stay: float = STAY
    """[s] for which it stays at least."""


class PlaceAdvice(NamedTuple):
    """What a look at the place of a robot has shown."""

    why: str
    """As a sentence."""
    target: str = ""
    """The host where it would be better off; empty: it is well where it is."""
    moves: bool = False
    """Whether it is to move there now."""
    saved: float = 0.0
    """Part of its time that it would save."""
    urgent: bool = False


def spent(robot: PlacedRobot, host: HostSeen, here: HostSeen) -> float | None:
    """Return which part of its time a robot spends on its calls in a host; None: a way is not known."""
    service = SERVICE / (1.0 - min(max(host.load.cpu, 0.0), FULLEST))
    total = robot.strangers * (0.0 if host is here else here.ways.get(host.key, 0.0))
    for partner in robot.partners:
        way = host.ways.get(partner.key)
        if way is None:
            return None
        total += partner.calls * (way + service)
    return total


class PlaceWatch:
    """The place of one robot in one host; see the module."""

    def __init__(self, since: float) -> None:
        """Begin; it has come here, or begun to be looked after, at `since` [s]."""
        self._since = since
        self._better, self._looks = "", 0
        self._refused: dict[str, float] = {}

    def look(self, robot: PlacedRobot, here: HostSeen, others: Sequence[HostSeen], now: float) -> PlaceAdvice:
        """Say where a robot should be.

        Args:
            robot: as it is now.
            here: the host where it is.
            others: those to which it could move.
            now: [s]
        """
        before = spent(robot, here, here)
        costs = [(cost, host) for host in others if (cost := spent(robot, host, here)) is not None]
        if left_alone := _left_alone(robot):
            return self._well(left_alone)
        if before is None:
            return self._well(f"the ways from {here.name} are not known yet")
        if not costs:
            return self._well("no other host is known to reach those with whom it has to do")
        after, best = min(costs, key=lambda one: (one[0], one[1].load.running, one[1].name))
        saved = before - after
        if saved < max(GAIN, SHARE * before):
            times = f"{before:.3f} s of each second go by on the way here, {after:.3f} s there"
            nobody = f"no host is clearly better than {here.name}, the next one is {best.name}"
            return self._well(f"{nobody}: {times}", saved)
        return self._better_at(best, robot, _reason(robot, here, best, before, after), saved, now)

    def refused(self, host: str, now: float) -> None:
        """Take note that a host has not taken it, at `now` [s]."""
        self._refused[host], self._looks = now, 0  # the next look may come after the refusal counts no more

    def _well(self, why: str, saved: float = 0.0) -> PlaceAdvice:
        self._better, self._looks = "", 0
        return PlaceAdvice(why, saved=max(saved, 0.0))

    def _better_at(
        self, best: HostSeen, robot: PlacedRobot, why: str, saved: float, now: float
    ) -> PlaceAdvice:
        self._looks = self._looks + 1 if best.name == self._better else 1
        self._better = best.name
        hindered = self._hindrance(best, robot, now)
        if robot.mode == "advise":
            hindered = robot.unfit and f"it cannot travel: {robot.unfit}"
        text = f"{why}; {hindered}" if hindered else why
        moves = robot.mode == "auto" and not hindered and self._looks >= LOOKS
        return PlaceAdvice(text, best.name, moves, saved, robot.urgent)

    def _hindrance(self, best: HostSeen, robot: PlacedRobot, now: float) -> str:
        """Return why it does not move there now, as a clause; empty: nothing is in the way."""
        if robot.unfit:
            return f"it cannot travel: {robot.unfit}"
        if best.load.room is not None and best.load.room <= 0:
            return f"but {best.name} is full"
        if now - self._refused.get(best.name, -REFUSED_FOR) < REFUSED_FOR:
            return f"but {best.name} has just refused it"
        if now - self._since < robot.stay:
            return f"it stays here for {robot.stay:.0f} s at least"
        return ""


def seated(advice: Mapping[str, PlaceAdvice], rooms: Mapping[str, int | None]) -> tuple[list[str], list[str]]:
    """Say who of those that are to move goes now; urgent robots go first, then those that gain most.

    Args:
        advice: by robot.
        rooms: how many each host still takes, by name; None: any number.

    Returns:
        Those that go, in this order, and those for whom there is no room.
    """
    left = dict(rooms)
    go, wait = list[str](), list[str]()
    wish = [(robot, one) for robot, one in advice.items() if one.moves]
    for robot, one in sorted(wish, key=lambda each: (not each[1].urgent, -each[1].saved, each[0])):
        room = left.get(one.target)
        if room is not None and room <= 0:
            wait.append(robot)
            continue
        if room is not None:
            left[one.target] = room - 1
        go.append(robot)
    return go, wait


def milliseconds(seconds: float) -> str:
    """Write a time as people read it: `0.4 ms`, `150 ms`."""
    value = seconds * 1000
    return f"{value:.1f} ms" if value < 10 else f"{value:.0f} ms"


def _reason(robot: PlacedRobot, here: HostSeen, best: HostSeen, before: float, after: float) -> str:
    """Return why a host is better, as a sentence: the partner that matters most, and what is saved."""
    nearer = {one.key: here.ways[one.key] - best.ways[one.key] for one in robot.partners}
    most = max(robot.partners, key=lambda one: one.calls * nearer[one.key])
    there, now = milliseconds(best.ways[most.key]), milliseconds(here.ways[most.key])
    calls = f"its {most.calls:.1f} calls a second with {most.name}"
    saving = f"of each second {min(before, 1.0):.2f} s go by on the way here, {min(after, 1.0):.2f} s there"
    if nearer[most.key] < SERVICE:
        return f"{best.name} has less to do than {here.name}: {saving}"
    return f"{best.name} is nearer than {here.name}: {calls} take {there} instead of {now}, so {saving}"


def _left_alone(robot: PlacedRobot) -> str:
    """Return why nobody looks for a better place, as a sentence; empty: it is looked for."""
    if robot.mode == "manual":
        return "only people move it"
    if robot.pinned:
        return "its author has pinned it"
    if sum(partner.calls for partner in robot.partners) < RARE:
        return "it has too little to do with others for a place to matter"
    return ""
