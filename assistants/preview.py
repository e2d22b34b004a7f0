"""What a call would do, for the person who is asked: who moves, how far, and the way as a rehearsal took it.

The way of a call that was rehearsed (`robotree mcp --rehearse`) is kept by what was called; else that of a
robot that tells its position, and takes one, is drawn as a straight line: no promise, and it says so.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from robotree.assistants.marking import said
from robotree.assistants.meter import AXES, Point, position_of
from robotree.files import private_folder, read, replace
from robotree.vr.base.description import CommandSpec, RobotDescription
from robotree.vr.base.foreign import bounded

FOLDER: Final = "rehearsed"
LARGEST: Final = 1 << 18
"""[B] of one file."""
WIDTH, HEIGHT = 36, 12
"""[characters] of a drawing."""
STEPS: Final = 9
"""Points of a straight line."""


class Rehearsal(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A call as it went in the twin of the cell."""

    call: str
    ok: bool
    outcome: str
    seconds: float
    metres: float
    robot: str = ""
    """The robot whose way it is."""
    path: tuple[Point, ...] = ()
    unix: float


class Preview(NamedTuple):
    """What a person is shown of a call before it begins."""

    lines: tuple[str, ...]
    path: tuple[Point, ...]


def digest_of(robot: RobotDescription, command: str, arguments: Mapping[str, Any]) -> str:
    """Return under which name the rehearsal of a call is kept: by its robot, its kind, and what is called."""
    content = msgspec.json.Encoder(order="deterministic").encode(
        [robot.name, robot.kind, command, dict(arguments)]
    )
    return hashlib.sha256(content).hexdigest()[:32]


def keep(folder: Path, digest: str, rehearsal: Rehearsal) -> None:
    """Keep how a call went in the twin.

    Args:
        folder: in which the real realm keeps its things.
        digest: of the call.
        rehearsal: how it went.

    Raises:
        OSError: it cannot be kept.
    """
    private_folder(folder / FOLDER)
    replace(folder / FOLDER / f"{digest}.json", msgspec.json.encode(rehearsal))


def rehearsed(folder: Path, digest: str) -> Rehearsal | None:
    """Return how a call went in the twin; None: it was not rehearsed."""
    try:
        return msgspec.json.decode(read(folder / FOLDER / f"{digest}.json", LARGEST), type=Rehearsal)
    except (OSError, msgspec.MsgspecError):
        return None


def preview_of(
    robot: RobotDescription,
    spec: CommandSpec,
    arguments: Mapping[str, Any],
    below: Sequence[str],
    rehearsal: Rehearsal | None,
) -> Preview:
    """Return what a call would do, for people.

    Args:
        robot: that is called, as it is now.
        spec: its command.
        arguments: as the command takes them.
        below: names of the robots that it commands, and that may move with it.
        rehearsal: how it went in the twin; None: it was not rehearsed.
    """
    lines = [f"{spec.name}: {said(spec.doc)}"] if spec.doc else []
    if below:
        lines.append(f"may move {', '.join(map(bounded, (robot.name, *below)))}")
    if rehearsal is not None:
        how = "it went well" if rehearsal.ok else f"it failed: {said(rehearsal.outcome)}"
        lines.append(
            f"rehearsed in the twin of the cell: {how}, {rehearsal.seconds:.1f} s, {rehearsal.metres:.2f} m"
        )
        return Preview((*lines, *drawn(rehearsal.path)), rehearsal.path)
    path = straight(robot, arguments)
    if path:
        way = math.dist(path[0], path[-1])
        lines.append(f"{way:.2f} m as the crow flies, from {_at(path[0])} to {_at(path[-1])}; not rehearsed")
    else:
        lines.append("its way is not known: it was not rehearsed (`robotree mcp --rehearse`)")
    return Preview((*lines, *drawn(path)), path)


def straight(robot: RobotDescription, arguments: Mapping[str, Any]) -> tuple[Point, ...]:
    """Return the straight line from where a robot is to the position in the arguments; empty: it has none."""
    here = position_of(robot.readings)
    there = [arguments.get(axis) for axis in AXES]
    if here is None or not any(isinstance(each, int | float) for each in there):
        return ()
    ways = [
        [now + ((float(given) if isinstance(given, int | float) else now) - now) * step / (STEPS - 1)
         for step in range(STEPS)]
        for given, now in zip(there, here, strict=True)
    ]  # fmt: skip
    return tuple(zip(*ways, strict=True))


def drawn(path: Sequence[Point]) -> list[str]:
    """Draw a way from above, in characters: `o` where it begins, `x` where it ends; x to the right, y up."""
    if len(path) < 2:
        return []
    xs, ys = [point[0] for point in path], [point[1] for point in path]
    span = max(max(xs) - min(xs), (max(ys) - min(ys)) * WIDTH / HEIGHT / 2, 1e-6)
    scale = (WIDTH - 1) / span
    rows = min(HEIGHT, max(1, round((max(ys) - min(ys)) * scale / 2) + 1))
    grid = [[" "] * WIDTH for _ in range(rows)]
    for mark, points in (("·", path[1:-1]), ("o", path[:1]), ("x", path[-1:])):  # the end hides what is below
        for x, y, _ in points:
            column = min(WIDTH - 1, round((x - min(xs)) * scale))
            row = min(rows - 1, round((max(ys) - y) * scale / 2))
            grid[row][column] = mark
    head = (
        f"from above, {span:.2f} m wide, z {min(p[2] for p in path):.2f} to {max(p[2] for p in path):.2f} m:"
    )
    return [head, *("".join(row).rstrip() for row in grid)]


def _at(point: Point) -> str:
    return f"({', '.join(f'{value:.2f}' for value in point)})"
