"""The verbs about places: named points of a workspace, and how a robot is sent to one.

`@NAME` stands for the coordinates of a place wherever a command asks for a pose: `call arm-1.go_to @shelf`.
A command asks for a pose if its parameters are named x and y, in metres, and a repetition of it ends the same
(`effect="repeat"`).

Before a robot moves, it is asked itself: the command `preview_NAME` beside a command NAME is the robot's own
check, down to the planner of its controller. Nothing here knows reach or limits.
"""

from __future__ import annotations

import math
import os
from collections.abc import Container, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

from robotree.tui.errors import ValueRefused
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.line.poses import MARK, asks_for_pose, place_for
from robotree.tui.line.verbs import CALL_LIMIT, Outcome, Teller, plain
from robotree.tui.processes.place_files import COORDINATES, NamedPlace, coordinates_in_words, places_beside
from robotree.tui.seen import wording
from robotree.tui.seen.frames import frame_of, frames_below

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import CommandSpec, RobotDescription
    from robotree.vr.supervision.realm_client import RealmClient

PREVIEW = "preview_"
"""Begins the name of the command that previews another one."""
FIRST_CHOICES = ("go_to", "drive", "reach")
"""The commands that send a robot somewhere, the usual ones first."""
PREVIEW_WITHIN = 5.0
"""[s] for a preview: a question to the controller, and back."""


def pose_command(robot: RobotDescription) -> CommandSpec | None:
    """Return the command that sends a robot to a place; None: it has none."""
    found = {spec.name: spec for spec in robot.commands if asks_for_pose(spec)}
    usual = [found[name] for name in FIRST_CHOICES if name in found]
    return next(iter([*usual, *found.values()]), None)


class Trip(NamedTuple):
    """A robot that is to go somewhere: which command does it, and its arguments."""

    robot: str
    command: str
    arguments: dict[str, Any]
    previews: bool
    """Whether it can be previewed."""

    @property
    def goal(self) -> dict[str, float]:
        """Where it leads: the coordinates among the arguments."""
        numbers = {name: self.arguments[name] for name in COORDINATES if name in self.arguments}
        return {name: value for name, value in numbers.items() if isinstance(value, float | int)}

    @property
    def words(self) -> str:
        """What is to be done, for people."""
        return f"{self.robot}.{self.command}  {coordinates_in_words(self.goal)}"


def trip_to(robot: RobotDescription, at: Mapping[str, float], readings: Mapping[str, float]) -> Trip:
    """Return how a robot gets to a point.

    Args:
        robot: which.
        at: coordinates of the point [m, rad], in the robot's frame.
        readings: what the robot reads: a coordinate that is not given stays as it is.

    Raises:
        ValueRefused: it has no command for that, or nobody knows a coordinate that it needs.
    """
    spec = pose_command(robot)
    if spec is None:
        raise ValueRefused(
            "ROBOT", f"{robot.name} has no command that asks for a pose, so it is sent nowhere"
        )
    arguments: dict[str, Any] = {}
    for field in spec.parameters:
        if field.name not in COORDINATES:
            continue
        value = at.get(field.name, readings.get(field.name))
        if value is not None:
            arguments[field.name] = value
        elif field.required:
            why = f"{robot.name}.{spec.name} needs {field.name}, which is not given and not read"
            raise ValueRefused("COORDINATE", f"{why}; write for example {field.name}=0.3")
    return Trip(robot.name, spec.name, arguments, robot.command(f"{PREVIEW}{spec.name}") is not None)


def held_by_another(robot: RobotDescription) -> str:
    """Return the person who has control of a robot, unless it is who asks here; empty: it is, or nobody has.

    A robot of another site has another name for who asks here; it refuses by itself.
    """
    from robotree.vr.base.envelope import asking_person

    elsewhere = ":" in robot.name
    me = asking_person()
    return robot.operator if me and not elsewhere and robot.operator not in {"", me} else ""


async def preview(realm_client: RealmClient, trip: Trip) -> dict[str, Any] | None:
    """Ask the robot for the way of a trip; None: it cannot tell any.

    Raises:
        VrError: why it would be refused, in the words of whoever refuses it: the policy, the robot (its
            lease, who has control of it, its limits) or its controller (reach, way, stop).
    """
    from robotree.vr.base.errors import BadArgument, CommandFailed, HeldByOperator

    robot = await realm_client.describe(trip.robot)
    denied = realm_client.refused("command", robot.name, robot.kinds, trip.command)
    if denied is not None:
        raise denied
    if holder := held_by_another(robot):
        raise HeldByOperator(robot=robot.name, holder=holder)
    if not trip.previews:
        return None
    command = f"{PREVIEW}{trip.command}"
    try:
        told = await realm_client.call(trip.robot, command, trip.arguments, deadline=PREVIEW_WITHIN)
    except BadArgument as error:  # the parameters are those of the command itself
        data = {**error.data, "command": f"{trip.robot}.{trip.command}"}
        raise BadArgument(**data) from None
    way: dict[str, Any] = plain(told)
    if way.get("refusal"):
        raise CommandFailed(robot=trip.robot, command=trip.command, detail=way["refusal"])
    return way


def way_in_words(way: Mapping[str, Any] | None) -> str:
    """Return a preview for people, as one sentence."""
    if way is None:
        return "this robot tells no way beforehand"
    if not way["checked"]:
        return "its limits allow it; its controller tells no way beforehand"
    points = list(zip(way["x"], way["y"], way["z"], strict=True))
    length = sum(math.dist(one, other) for one, other in pairwise(points))
    duration = f", {way['duration']:.1f} s" if way["duration"] else ""
    return f"the robot would go {length:.2f} m{duration}" if points else "the robot would do it"


# -- verbs -----------------------------------------------------------------------------------------


async def go(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Send a robot to a place or a point, after its own preview."""
    robot = await realm_client.describe(line.text("ROBOT"))
    at = await _point(realm_client, robot, line.many("PLACE|COORDINATE=VALUE"))
    trip = trip_to(robot, at, robot.readings)
    way = await preview(realm_client, trip)
    data: dict[str, Any] = {"robot": trip.robot, "command": trip.command, "goal": trip.goal, "way": way}
    if line.flag("--preview"):
        return Outcome({**data, "done": False}, f"{trip.words}: {way_in_words(way)}")
    limit = values.duration(line.text("--within")) if line.text("--within") else CALL_LIMIT
    await realm_client.call(
        trip.robot, trip.command, trip.arguments, deadline=limit, on_progress=teller.progress
    )
    return Outcome({**data, "done": True}, f"{trip.robot} is at {coordinates_in_words(trip.goal)}")


async def _point(
    realm_client: RealmClient, robot: RobotDescription, texts: Sequence[str]
) -> dict[str, float]:
    places = [text for text in texts if text.startswith(MARK)]
    if len(places) > 1:
        raise ValueRefused("PLACE", f"{places[0]} and {places[1]}: a robot goes to one place")
    at: dict[str, float] = {}
    if places:
        at |= (await place_for(realm_client, robot, places[0][1:])).at
    return at | coordinates(text for text in texts if text not in places)


def coordinates(texts: Iterable[str]) -> dict[str, float]:
    """Read `x=0.3 y='10 cm'`, in metres and radians.

    Raises:
        ValueRefused: one is no coordinate, or no number of its unit.
    """
    from robotree.vr.base.units import read_quantity

    found: dict[str, float] = {}
    for name, text in values.assignments(texts).items():
        if name not in COORDINATES:
            raise ValueRefused("COORDINATE", f"{name} is none; they are {', '.join(COORDINATES)}")
        try:
            found[name] = read_quantity(text, COORDINATES[name])
        except ValueError as error:
            raise ValueRefused("COORDINATE", f"{name}: {error}") from None
        if not math.isfinite(found[name]):
            raise ValueRefused("COORDINATE", f"{name}={text} is no finite number")
    return found


async def places(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """List the named places, or those in the frame of a robot."""
    found = list(places_beside(realm_client.gate).all().values())
    if name := line.text("ROBOT"):
        robot = await realm_client.describe(name)
        frames = frames_below(robot, {one.name: one for one in await realm_client.tree()})
        found = [one for one in found if one.frame in frames]
    alive = {frame_of(robot) for robot in await realm_client.tree()}
    rows = [(f"{MARK}{one.name}", one.words, _frame_in_words(one.frame, alive), one.by) for one in found]
    text = wording.columns([("PLACE", "WHERE", "FRAME", "NAMED BY"), *rows]) if rows else "no place is named"
    return Outcome([{**plain(one), "reached": one.frame in {"", *alive}} for one in found], text)


def _frame_in_words(frame: str, alive: Container[str]) -> str:
    """Return the name of a frame; one in which no robot moves now says so."""
    return f"{frame}, where no robot is now" if frame and frame not in alive else frame or "-"


async def places_add(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Name a point, or where a robot is now."""
    robot = await realm_client.describe(line.text("ROBOT"))
    at = coordinates(line.many("COORDINATE=VALUE"))
    if not at:
        at = {name: value for name, value in robot.readings.items() if name in COORDINATES}
    if not {"x", "y"} <= at.keys():
        why = f"{robot.name} reads no x and y" if not line.many("COORDINATE=VALUE") else "x and y are needed"
        raise ValueRefused("COORDINATE", f"{why}; write for example x=0.3 y=0.1")
    place = name_place(realm_client, line.text("NEW"), frame_of(robot), at)
    return Outcome(plain(place), f"{MARK}{place.name} is {place.words}. {lifetime(place.frame)}")


def lifetime(frame: str) -> str:
    """Say as long as what a place of a frame means something."""
    if not frame:
        return "Its robot says no frame: the place is offered to each robot."
    return f"It is a place of {frame}, and means something until the controller listens somewhere else."


def name_place(realm_client: RealmClient, name: str, frame: str, at: Mapping[str, float]) -> NamedPlace:
    """Keep a place under a name.

    Raises:
        ValueRefused: it cannot be kept.
        BadName: that cannot be a name.
    """
    from robotree.vr.base.principal import user_name

    place = NamedPlace(name=name.removeprefix(MARK), frame=frame, at=dict(at), by=user_name(os.geteuid()))
    places_beside(realm_client.gate).write(place)
    return place


async def places_remove(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Forget a named place."""
    name = line.text("PLACE").removeprefix(MARK)
    places_beside(realm_client.gate).delete(name)
    return Outcome({"removed": name}, f"{MARK}{name} is forgotten")
