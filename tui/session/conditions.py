"""The conditions that a session script can expect, and whether they hold. Pure.

    expect arm-1 listed                        a lookup service lists it: it is free
    expect teleop gone                         no agent of this name lives
    expect arm-1 enslaved by mover.arm
    expect mover.arm holds arm-1
    expect mover.arm empty
    expect mover idle                          no command runs or waits
    expect mover paused                        its commands wait before each step
    expect mover on host-2                     it lives there
    expect reading cell.lever_angle > 0.75     a view's or a robot's reading
    expect all of carriers idle                of each member of a group; `any of`: of one at least
    expect all of carriers reading battery > 30
    expect result.z >= 0.29                    of the last `call`; `result` alone for a single value
    expect result.points[0].x > 0.1            of what lies in it
    expect refused                             the last `try …` was refused; also with the error's name
    expect done                                the last `try …` was not

What is about the last `call` or `try` is over, and judged at once; the rest may come true within the time.
`=` compares numbers to within a thousandth of their size; texts exactly.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

from robotree.tui.errors import ValueRefused
from robotree.tui.line import values
from robotree.tui.seen import status, wording
from robotree.vr.base.readable import number

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import RobotDescription

NEAR = 1e-3
"""Relative difference up to which two numbers count as equal: readings have noise."""


def near(one: Any, other: Any) -> bool:
    """Whether two values are equal, numbers nearly."""
    if isinstance(one, int | float) and isinstance(other, int | float) and not isinstance(one, bool):
        return abs(one - other) <= NEAR * max(abs(one), abs(other), NEAR)
    return bool(one == other)


COMPARISONS: Mapping[str, Callable[[Any, Any], bool]] = {
    ">": operator.gt,
    ">=": operator.ge,
    "<": operator.lt,
    "<=": operator.le,
    "=": near,
    "==": near,
    "!=": lambda one, other: not near(one, other),
}


@dataclass(frozen=True, slots=True)
class Scene:
    """The data on which a condition is judged."""

    listed: frozenset[str] = frozenset()
    """Names that the lookup services list."""
    robots: Mapping[str, RobotDescription] = field(default_factory=dict[str, "RobotDescription"])
    """Descriptions of those robots that the condition wants to know and that answered."""
    readings: Mapping[str, Mapping[str, float]] = field(default_factory=dict[str, Mapping[str, float]])
    """Readings by name of view or robot."""
    groups: Mapping[str, Sequence[str]] = field(default_factory=dict[str, Sequence[str]])
    """Names of the members of groups, by name of the group; one that there is not is left out."""
    result: Any = None
    """Result of the last `call`."""
    refusal: str = ""
    """Name of the error of the last `try`; empty when it was done."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a condition holds, and what was seen."""

    holds: bool
    seen: str


@dataclass(frozen=True, slots=True)
class Condition:
    """One condition, understood."""

    text: str
    judge: Callable[[Scene], Verdict]
    robots: tuple[str, ...] = ()
    """The robots whose descriptions the scene must have."""
    readings: tuple[str, ...] = ()
    """The robots whose readings the scene must have."""
    group: str = ""
    """The group whose members, with their descriptions and readings, the scene must have."""
    settled: bool = False
    """It is about what is over: waiting does not change it."""


_FORMS: list[tuple[re.Pattern[str], Callable[[re.Match[str]], Condition]]] = []
_NAME = r"([A-Za-z0-9][\w-]*)"
_SLOT = rf"{_NAME}\.(\w+(?:\[\d+])?)"
_COMPARED = r"\s*(>=|<=|!=|==|=|>|<)\s*(.+)"

Reader = Callable[["re.Match[str]"], Condition]


def _form(pattern: str) -> Callable[[Reader], Reader]:
    def keep(reader: Reader) -> Reader:
        _FORMS.append((re.compile(pattern), reader))
        return reader

    return keep


def condition(text: str) -> Condition:
    """Understand a condition.

    Raises:
        ValueRefused: it is none.
    """
    for pattern, reader in _FORMS:
        if found := pattern.fullmatch(text.strip()):
            return reader(found)
    raise ValueRefused(
        "expect",
        f"{text!r} is no condition; use NAME listed|gone|idle, NAME on HOST, NAME enslaved by PARENT.SLOT, "
        "PARENT.SLOT empty|holds CHILD, reading NAME.READING > NUMBER, all of GROUP idle, result > VALUE,"
        " refused or done",
    )


@_form(rf"{_NAME}\s+listed")
def _listed(found: re.Match[str]) -> Condition:
    name = found[1]
    return Condition(
        found[0],
        lambda scene: Verdict(name in scene.listed, "listed" if name in scene.listed else "not listed"),
    )


@_form(rf"{_NAME}\s+gone")
def _gone(found: re.Match[str]) -> Condition:
    name = found[1]

    def judge(scene: Scene) -> Verdict:
        there = name in scene.listed or name in scene.robots
        return Verdict(not there, "there" if there else "gone")

    return Condition(found[0], judge, robots=(name,))


def _of_robot(found: re.Match[str], judge: Callable[[RobotDescription], Verdict]) -> Condition:
    """Return a condition of the robot that is named first."""
    name = found[1]

    def of_scene(scene: Scene) -> Verdict:
        robot = scene.robots.get(name)
        return Verdict(holds=False, seen=f"{name} does not answer") if robot is None else judge(robot)

    return Condition(found[0], of_scene, robots=(name,))


@_form(rf"{_NAME}\s+idle")
def _idle(found: re.Match[str]) -> Condition:
    return _of_robot(found, lambda robot: Verdict(not robot.busy and not robot.waiting, status.words(robot)))


@_form(rf"{_NAME}\s+paused")
def _paused(found: re.Match[str]) -> Condition:
    return _of_robot(found, lambda robot: Verdict(bool(robot.paused), status.words(robot)))


@_form(rf"{_NAME}\s+on\s+{_NAME}")
def _on_host(found: re.Match[str]) -> Condition:
    host = found[2]

    def judge(robot: RobotDescription) -> Verdict:
        seen = status.way(robot) if robot.on_way else f"on {robot.host or 'no host'}"
        return Verdict(robot.host == host and not robot.on_way, seen)

    return _of_robot(found, judge)


@_form(rf"{_NAME}\s+enslaved\s+by\s+{_SLOT}")
def _enslaved(found: re.Match[str]) -> Condition:
    _, parent, slot = found.groups()

    def judge(robot: RobotDescription) -> Verdict:
        bond = robot.bond
        if bond is None:
            return Verdict(holds=False, seen="free")
        seen = f"enslaved by {bond.parent.name}.{bond.slot}"
        return Verdict((bond.parent.name, bond.slot) == (parent, slot), seen)

    return _of_robot(found, judge)


@_form(rf"{_SLOT}\s+(?:empty|holds\s+{_NAME})")
def _slot(found: re.Match[str]) -> Condition:
    parent, slot, child = found.groups()

    def judge(robot: RobotDescription) -> Verdict:
        spec = robot.slot(slot)
        if spec is None:
            return Verdict(holds=False, seen=f"{parent} has no slot {slot}")
        held = inhabitant.name if (inhabitant := spec.child or spec.watched) else None
        return Verdict(held == child, f"holds {held}" if held else "empty")

    return _of_robot(found, judge)


@_form(rf"(all|any)\s+of\s+{_NAME}\s+(?:reading\s+(.+)|(.+))")
def _of_group(found: re.Match[str]) -> Condition:
    quantity, group, reading, rest = found.groups()

    def of(name: str) -> Condition:
        return condition(f"reading {name}.{reading}" if reading else f"{name} {rest}")

    of("member")  # what is no condition of one is none of a group
    wanted = all if quantity == "all" else any

    def judge(scene: Scene) -> Verdict:
        members = scene.groups.get(group)
        if members is None:
            return Verdict(holds=False, seen=f"there is no group {group}")
        verdicts = {name: of(name).judge(scene) for name in members}
        if not verdicts:
            return Verdict(holds=False, seen=f"nobody is in {group} now")
        seen = "; ".join(f"{name}: {verdict.seen}" for name, verdict in verdicts.items())
        return Verdict(wanted(verdict.holds for verdict in verdicts.values()), seen)

    return Condition(found[0], judge, group=group)


@_form(rf"reading\s+{_NAME}\.([\w.-]+?){_COMPARED}")
def _reading(found: re.Match[str]) -> Condition:
    name, reading, sign, text = found.groups()
    compare = COMPARISONS[sign]
    wanted = values.scalar(text.strip())
    if isinstance(wanted, str | bool):
        raise ValueRefused("expect", f"a reading is compared with a number, not with {text!r}")

    def judge(scene: Scene) -> Verdict:
        instruments = scene.readings.get(name)
        if instruments is None:
            return Verdict(holds=False, seen=f"{name} reports nothing")
        if reading not in instruments:
            known = ", ".join(sorted(instruments)) or "nothing"
            return Verdict(holds=False, seen=f"{name} has no reading {reading}; it has {known}")
        return Verdict(compare(instruments[reading], wanted), number(instruments[reading]))

    return Condition(found[0], judge, readings=(name,))


@_form(rf"result((?:\.\w+|\[\d+])*){_COMPARED}")
def _result(found: re.Match[str]) -> Condition:
    path, sign, text = found.groups()
    compare, wanted = COMPARISONS[sign], values.scalar(text.strip())

    def judge(scene: Scene) -> Verdict:
        thing = inside(scene.result, re.findall(r"\w+", path))
        if thing is None:
            return Verdict(holds=False, seen=f"the result is {wording.value(scene.result)}")
        try:
            return Verdict(compare(thing, wanted), wording.value(thing))
        except TypeError:
            return Verdict(holds=False, seen=f"{wording.value(thing)} cannot be compared with {text}")

    return Condition(found[0], judge, settled=True)


@_form(r"refused(?:\s+(\w+))?")
def _refused(found: re.Match[str]) -> Condition:
    error = found[1]

    def judge(scene: Scene) -> Verdict:
        holds = bool(scene.refusal) and error in {None, scene.refusal}
        return Verdict(holds, scene.refusal or "done")

    return Condition(found[0], judge, settled=True)


@_form(r"done")
def _done(found: re.Match[str]) -> Condition:
    return Condition(
        found[0], lambda scene: Verdict(not scene.refusal, scene.refusal or "done"), settled=True
    )


def inside(thing: Any, path: Sequence[str]) -> Any:
    """Return what lies in a result, by names and positions; None: nothing does."""
    for name in path:
        if isinstance(thing, Mapping):
            thing = cast("dict[str, Any]", thing).get(name)
        elif isinstance(thing, list) and name.isdigit():
            values = cast("Sequence[Any]", thing)
            thing = values[int(name)] if int(name) < len(values) else None
        else:
            return None
    return thing
