"""What was shown once, as steps with names and parameters. Pure.

What a person did by hand is many small moves. Three things make few steps of them:

* It is cut where the gripper acts: what changes the state of the hand begins and ends a segment (as
  manipulation is cut for learning at changes of the gripper and at standstill: James and Davison,
  "Q-attention: enabling efficient learning for vision-based robotic manipulation", IEEE RA-L 7 (2022); Fod,
  Mataric and Jenkins, "Automated derivation of primitives for movement classification", Autonomous Robots 12
  (2002)).
* The way between two cuts is simplified: points that lie within a tolerance of the line between those that
  stay are left out (Ramer, "An iterative procedure for the polygonal approximation of plane curves", Computer
  Graphics and Image Processing 1 (1972); Douglas and Peucker, "Algorithms for the reduction of the number of
  points required to represent a digitized line or its caricature", Cartographica 10 (1973)), here in four
  dimensions: place [m], and twist [rad] times `ARM_OF_TWIST` [m].
* Where something was taken or let go is a place, with a name and parameters; moves right before and after it
  that lie above it or beside it are said relative to it, so that they go along when it is changed. So each
  segment is said in the frame of the thing that it is about (as in Mandlekar et al., "MimicGen", CoRL 2023).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import msgspec

from robotree.tui.composing.steps import (
    Comparison,
    ComposedCall,
    ComposedExpectation,
    ComposedPart,
    ComposedStep,
    Composition,
    Value,
    Variable,
    walk,
)
from robotree.tui.errors import BadComposition
from robotree.vr.base.description import CommandSpec, FieldSpec
from robotree.vr.base.readable import typed

AXES: Final = ("x", "y", "z", "twist")
GO_TO, GRIP, GET_INFO = "go_to", "grip", "get_info"
TOLERANCE: Final = 0.01
"""[m] by which the simplified way may differ from the one that was shown, unless a person says otherwise."""
ARM_OF_TWIST: Final = 0.05
"""[m] of way that a turn by one radian counts: half of what an open hand with its fingers spans."""
NEAR: Final = 0.08
"""[m] beside a place: moves so near, right before and after it, go along with it. The hand is as wide."""
STANDS: Final = 0.004
"""[m] between two places that count as the same one: what a goal that was reached may miss."""
ABOUT: Final = "What was shown once, in steps with names."
MOST: Final = 20_000
"""Commands of one demonstration."""
PLACES: Final = ("from", "to", "third", "fourth", "fifth", "sixth", "seventh", "eighth")
"""Names of the places, in the order in which they were visited."""


class Shown(NamedTuple):
    """One command that a robot carried out while a person showed something."""

    robot: str
    command: str
    arguments: Mapping[str, Any]
    holding: bool | None = None
    """Whether something was between the fingers after it; None: not known."""


class ShownRobot(NamedTuple):
    """A robot with which something was shown."""

    name: str
    kind: str
    commands: Mapping[str, CommandSpec]

    @property
    def by_hand(self) -> bool:
        """Whether it goes to points and grips."""
        go_to, grip = self.commands.get(GO_TO), self.commands.get(GRIP)
        return go_to is not None and grip is not None and set(AXES) <= set(go_to.by_name)


Pose = tuple[float, float, float, float]


class _Stretch(NamedTuple):
    """Points on a way, and what the arm did at its end without moving."""

    way: list[Pose]
    acts: list[Shown]
    start: Pose | None
    """Where it began; None: not known."""


def composed(
    name: str,
    robots: Sequence[ShownRobot],
    shown: Sequence[Shown],
    tolerance: float = TOLERANCE,
    starts: Mapping[str, Pose] | None = None,
    before: Composition | None = None,
    filled: Mapping[str, str] | None = None,
) -> Composition:
    """Return what was shown as a composition.

    Args:
        name: of the page.
        robots: with which it was shown.
        shown: their commands that ended well, in the order in which they began.
        tolerance: [m] by which a way may be simplified.
        starts: where each robot was at first, if that is known.
        before: steps behind which these come; None: none.
        filled: the slots that robots have in those steps already, by the names of robots.

    Raises:
        BadComposition: nothing was shown, or too much.
    """
    known = {robot.name: robot for robot in robots}
    shown = [one for one in shown if one.robot in known and _can(known[one.robot], one)]
    if not shown:
        raise BadComposition("nothing was shown: no robot was commanded meanwhile, or each command failed")
    if len(shown) > MOST:
        raise BadComposition(f"{len(shown)} commands were shown, and at most {MOST} become steps; show less")
    old = before or Composition(name, doc=ABOUT, does="Do what was shown.", command="carry_out")
    slots = _slots(known, shown, dict(filled or {}))
    parameters: dict[str, Any] = dict(old.parameters)
    steps: list[ComposedStep] = []
    begun: set[str] = set()
    for robot, run in _runs(shown):
        if known[robot].by_hand:
            start = None if robot in begun else (starts or {}).get(robot)
            steps += _by_hand(slots[robot], known[robot], _stretches(run, start), tolerance, parameters)
            begun.add(robot)
        else:
            steps += [_call(slots[robot], known[robot], call.command, call.arguments) for call in run]
    parts = {step.name for _, step in walk(old.steps) if isinstance(step, ComposedPart)}
    kinds = dict(old.slots) | {slots[robot]: known[robot].kind for robot in slots if robot in known}
    return msgspec.structs.replace(
        old,
        name=name,
        slots=tuple(kinds.items()),
        steps=(*old.steps, *_named(steps, parts)),
        parameters=tuple(parameters.items()),
    )


def _can(robot: ShownRobot, shown: Shown) -> bool:
    """Whether a command changes something: what only reads was no part of what was shown."""
    spec = robot.commands.get(shown.command)
    return spec is not None and spec.effect != "read" and not spec.beside


def _slots(known: Mapping[str, ShownRobot], shown: Iterable[Shown], slots: dict[str, str]) -> dict[str, str]:
    """Return a slot for each robot: its kind in small letters, and a number from the second one on."""
    for robot in dict.fromkeys(one.robot for one in shown):
        if robot not in slots:
            slots[robot] = slot_for(known[robot].kind, slots.values())
    return slots


def slot_for(kind: str, taken: Iterable[str]) -> str:
    """Return the name of a slot for a robot of a kind."""
    stem = "".join(each for each in kind.lower() if each.isascii() and each.isalnum())
    stem = stem[:20] if stem[:1].isalpha() else "robot"
    return free(stem, set(taken))


def free(stem: str, taken: Collection[str]) -> str:
    """Return a name that is not taken: this one, else with a number."""
    numbered = (f"{stem}{number}" for number in range(2, len(taken) + 3))
    return next(name for name in (stem, *numbered) if name not in taken)


def _runs(shown: Iterable[Shown]) -> list[tuple[str, list[Shown]]]:
    """Return what was shown, cut where another robot begins."""
    runs: list[tuple[str, list[Shown]]] = []
    for one in shown:
        if not runs or runs[-1][0] != one.robot:
            runs.append((one.robot, []))
        runs[-1][1].append(one)
    return runs


# -- an arm that was led by hand -------------------------------------------------------------------


def _by_hand(
    slot: str,
    robot: ShownRobot,
    stretches: Sequence[_Stretch],
    tolerance: float,
    parameters: dict[str, float],
) -> list[ComposedStep]:
    """Return what was shown with an arm: a part for each place where its gripper did something.

    Args:
        slot: of the arm.
        robot: which it is.
        stretches: its commands.
        tolerance: [m] of its ways.
        parameters: of the page; those of the new places are added.
    """
    ways = [_way(stretch, tolerance) for stretch in stretches]
    leaving = [*(_leaving(stretches, ways, number) for number in range(len(ways))), 0]
    feels = GET_INFO in robot.commands and "holding" in {
        part.name for part in robot.commands[GET_INFO].result
    }
    steps: list[ComposedStep] = []
    full = False
    for number, (stretch, way) in enumerate(zip(stretches, ways, strict=True)):
        arriving = way[leaving[number] :]
        acts = [_call(slot, robot, act.command, act.arguments) for act in stretch.acts]
        if not _is_place(stretch):
            steps += [*(_move(slot, robot, point) for point in arriving), *acts]
            continue
        centre = stretch.way[-1]
        place = _place(parameters, centre)  # which keeps its height when it is visited again at another one
        centre = (*centre[:2], parameters.get(f"{place}_z", centre[2]), centre[3])
        far = len(arriving) - _beside(arriving[::-1], centre)
        inside = [_move(slot, robot, point) for point in arriving[:far]]
        inside += [_move(slot, robot, point, centre, place) for point in arriving[far:]]
        inside += acts
        took = stretch.acts[-1].arguments.get("action") == "close"
        if took and feels and stretch.acts[-1].holding is not False:
            that = Comparison(slot, GET_INFO, "holding", "is", value=True)
            inside.append(ComposedExpectation(that, "nothing is there"))
        if number + 1 < len(ways):
            inside += [
                _move(slot, robot, point, centre, place) for point in ways[number + 1][: leaving[number + 1]]
            ]
        word = "take" if took else "put" if full else "visit"
        full = took
        steps.append(ComposedPart(word, tuple(inside)))
    return steps


def _stretches(run: Sequence[Shown], start: Pose | None) -> list[_Stretch]:
    """Cut the way of an arm where it does something else; what repeats the act before changes nothing."""
    found = [_Stretch([], [], start)]
    state: Mapping[str, Any] = {}
    for one in run:
        if one.command == GO_TO:
            if found[-1].acts:
                found.append(_Stretch([], [], found[-1].way[-1] if found[-1].way else start))
            found[-1].way.append(_pose(one.arguments))
        elif one.command != GRIP or one.arguments != state:
            found[-1].acts.append(one)
            state = one.arguments if one.command == GRIP else state
    return found


def _pose(arguments: Mapping[str, Any]) -> Pose:
    x, y, z, twist = (float(arguments.get(axis, 0.0)) for axis in AXES)
    return x, y, z, twist


def _is_place(stretch: _Stretch) -> bool:
    """Whether something was taken or let go at the end of a way."""
    return bool(stretch.way) and any(act.command == GRIP for act in stretch.acts)


def _way(stretch: _Stretch, tolerance: float) -> list[Pose]:
    """Return the points that a stretch needs, without that from where it begins."""
    if stretch.start is None:
        return simplified(stretch.way, tolerance)
    return simplified([stretch.start, *stretch.way], tolerance)[1:] or stretch.way[-1:]


def simplified(way: Sequence[Pose], tolerance: float) -> list[Pose]:
    """Return a way without the points that lie within a tolerance of the lines between the others.

    Args:
        way: points; the first and the last one stay.
        tolerance: [m]; a turn counts by `ARM_OF_TWIST`.
    """
    if len(way) < 3:
        return list(way)
    keep = {0, len(way) - 1}
    waiting = [(0, len(way) - 1)]  # a stack in place of a recursion as deep as the way is long
    while waiting:
        first, last = waiting.pop()
        far, at = 0.0, first
        for index in range(first + 1, last):
            distance = _off(way[index], way[first], way[last])
            if distance > far:
                far, at = distance, index
        if far > tolerance:
            keep.add(at)
            waiting += [(first, at), (at, last)]
    kept = [way[index] for index in sorted(keep)]
    return [point for index, point in enumerate(kept) if not index or point != kept[index - 1]]


def _weighed(point: Pose) -> Pose:
    return point[0], point[1], point[2], ARM_OF_TWIST * point[3]


def _off(point: Pose, first: Pose, last: Pose) -> float:
    """[m] from a point to the line between two others, within its ends."""
    p, a, b = _weighed(point), _weighed(first), _weighed(last)
    along = [end - begin for begin, end in zip(a, b, strict=True)]
    length = sum(each * each for each in along)
    share = sum((at - begin) * each for at, begin, each in zip(p, a, along, strict=True))
    share = min(1.0, max(0.0, share / length)) if length else 0.0
    return math.dist(p, [begin + share * each for begin, each in zip(a, along, strict=True)])


def _level(one: Pose, other: Pose) -> float:
    """[m] between two points, seen from above."""
    return math.dist(one[:2], other[:2])


def _beside(way: Sequence[Pose], place: Pose) -> int:
    """Return how many points at the beginning of a way lie above a place, or beside it."""
    far = (index for index, point in enumerate(way) if _level(point, place) > NEAR)
    return next(far, len(way))


def _leaving(stretches: Sequence[_Stretch], ways: Sequence[Sequence[Pose]], number: int) -> int:
    """Return how many points at the beginning of a way belong to the place before it."""
    if not number or not _is_place(stretches[number - 1]):
        return 0
    before, way, ahead = stretches[number - 1].way[-1], ways[number], stretches[number]
    count = _beside(way, before)
    if _is_place(ahead):  # it has at least its own point, and those that are nearer to it
        end = ahead.way[-1]
        nearer = (i for i, point in enumerate(way) if _level(point, end) < _level(point, before))
        count = min(count, next(nearer, count), len(way) - 1)
    return count


def _place(parameters: dict[str, float], centre: Pose) -> str:
    """Return the name of a place; one that was visited before keeps its own."""
    for name in PLACES:
        x, y = (parameters.get(f"{name}_{axis}") for axis in "xy")
        if x is None or y is None or math.dist((x, y), centre[:2]) <= STANDS:
            for axis, value in zip("xyz", centre, strict=False):
                parameters.setdefault(f"{name}_{axis}", _rounded(value))
            return name
    return ""


def _rounded(value: float, field: FieldSpec | None = None) -> float:
    """Return a number without noise; one that this would put out of its range stays as it was shown."""
    rounded = round(value, 4) + 0.0  # no -0.0
    lower, upper = (field.lower, field.upper) if field else (None, None)
    kept = (lower is None or rounded >= lower) and (upper is None or rounded <= upper)
    return rounded if kept else value


def _move(
    slot: str, robot: ShownRobot, point: Pose, centre: Pose | None = None, place: str = ""
) -> ComposedStep:
    """Return the step to a point: relative to a place, if that has a name."""
    fields = robot.commands[GO_TO].by_name
    values: list[Value] = [_rounded(each, fields[axis]) for axis, each in zip(AXES, point, strict=True)]
    if centre is not None and place:
        for index, (axis, stands) in enumerate((("x", STANDS), ("y", STANDS), ("z", 0.0))):
            plus = point[index] - centre[index]
            values[index] = Variable(f"{place}_{axis}", 0.0 if abs(plus) < stands else _rounded(plus))
    return _call(slot, robot, GO_TO, dict(zip(AXES, values, strict=True)))


def _call(slot: str, robot: ShownRobot, command: str, arguments: Mapping[str, Any]) -> ComposedStep:
    """Return the step of a call, its angles in degrees."""
    fields = robot.commands[command].by_name
    return ComposedCall(
        slot, command, tuple((name, typed(fields[name], value)) for name, value in arguments.items())
    )


def _named(steps: Iterable[ComposedStep], taken: set[str]) -> Iterable[ComposedStep]:
    """Give parts of the same name numbers from the second one on."""
    for step in steps:
        if isinstance(step, ComposedPart):
            name = free(step.name, taken)
            taken.add(name)
            yield ComposedPart(name, step.steps)
        else:
            yield step
