"""Places as arguments: `@NAME` stands for the coordinates of a place wherever a command asks for a pose.

A command asks for a pose if its parameters are named x and y, in metres, and a repetition of it ends the same
(`effect="repeat"`): what adds up, such as the move of a rover, wants a distance and no place.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from robotree.tui.errors import ValueRefused
from robotree.tui.line import values
from robotree.tui.processes.place_files import COORDINATES, NamedPlace, places_beside
from robotree.tui.seen.frames import frames_below

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import CommandSpec, RobotDescription
    from robotree.vr.supervision.realm_client import RealmClient

MARK = values.PLACE_MARK
PREVIEWED = "preview_go_to"
"""The command that tells the way of `go_to`: it takes the same point, and moves nothing."""


def asks_for_pose(spec: CommandSpec) -> bool:
    """Whether a command's coordinates are those of a place, so that a named place may stand for them."""
    by_name = spec.by_name
    return spec.effect == "repeat" and all(
        name in by_name and by_name[name].unit == COORDINATES[name] for name in ("x", "y")
    )


async def arguments(
    realm_client: RealmClient, robot: str, command: str, texts: Sequence[str]
) -> dict[str, Any]:
    """Return the arguments of a command, with the coordinates of `@PLACE` where one is among them.

    Raises:
        ValueRefused: there is no such place, it is of another frame, or the command asks for no pose.
    """
    named = [text[1:] for text in texts if text.startswith(MARK)]
    given: dict[str, Any] = dict(values.assignments(text for text in texts if not text.startswith(MARK)))
    if not named:
        return given
    described = await realm_client.describe(robot)
    spec = described.command(command)
    if spec is None or not (asks_for_pose(spec) or spec.name == PREVIEWED):
        why = f"{robot}.{command} asks for no pose, so {MARK}{named[0]} means nothing to it"
        raise ValueRefused("PLACE", why)
    if len(named) > 1:
        raise ValueRefused("PLACE", f"{MARK}{named[0]} and {MARK}{named[1]}: a robot goes to one place")
    place = await place_for(realm_client, described, named[0])
    known = {name: value for name, value in place.at.items() if name in spec.by_name}
    if twice := sorted(known.keys() & given.keys()):
        known = {name: value for name, value in known.items() if name not in twice}  # what is said counts
    return {**known, **given}


async def place_for(realm_client: RealmClient, robot: RobotDescription, name: str) -> NamedPlace:
    """Return a place that is in the frame of a robot.

    Raises:
        ValueRefused: there is no such place, or it is of another frame.
    """
    place = places_beside(realm_client.gate).find(name)
    robots = {one.name: one for one in await realm_client.tree()} if robot.slots else {}
    frames = frames_below(robot, robots)
    if place.frame and frames and place.frame not in frames:
        theirs = ", ".join(sorted(frames))
        raise ValueRefused(
            "PLACE", f"{MARK}{name} is a place of {place.frame}, and {robot.name} moves in {theirs}"
        )
    return place
