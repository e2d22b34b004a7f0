"""A page carried out once in a twin of the cell: `python -m robotree.testing.trial`, in the page's folder.

It reads what is wanted from standard input as JSON, and writes how it went as one line of JSON:

    {"page": "cup.py", "command": "carry_out", "arguments": {}, "robots": {"arm": "Arm"},
     "things": {"arm": [0.3, -0.2]}}
    {"ok": true, "seconds": 41.2, "simulated": ["arm"], "thing": [0.3, -0.3, 0.02]}

A robot of a kind that is simulated is the simulated one, with its real proxy and firmware; another one is a
fake, of a kind of `robotree.kinds` or of a description in a file. `things`: where something to be taken lies
on the table of an arm, x and y [m].
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from robotree import kinds
from robotree.testing.fake import Fake
from robotree.testing.front import cell, rehearse
from robotree.testing.simulated import Simulated
from robotree.vr.base.errors import VrError
from robotree.vr.base.extras import lacks

WITHIN: Final = 900.0
"""[s] of virtual time that the command has."""
SETTLES: Final = 1.0
"""[s] in which a thing that was let go comes to rest."""
SIMULATED: Final = {"Arm": "arm", "Rover": "rover"}
"""The simulated robot of each kind."""


class Trial(msgspec.Struct):
    """What is wanted."""

    page: str
    command: str
    robots: dict[str, str]
    """By slot: the name of a kind, or of a file that describes the robot."""
    arguments: dict[str, Any] = {}
    things: dict[str, tuple[float, float]] = {}


def carry_out(trial: Trial) -> dict[str, Any]:
    """Carry a page out; returns how it went."""
    robots = {slot: _robot(kind) for slot, kind in trial.robots.items()}
    simulated = [slot for slot, robot in robots.items() if isinstance(robot, Simulated)]
    told: dict[str, Any] = {"ok": False, "simulated": simulated}
    parts: dict[str, Any] = dict(robots)
    with rehearse(trial.page, **parts) as team:
        things = _lay(robots, trial.things)
        began = team.now
        try:
            team.call(trial.command, within=WITHIN, **trial.arguments)
            told["ok"] = True
        except VrError as error:
            page = Path(trial.page.partition(":")[0]).name
            steps = [row.strip() for row in error.trace if row.startswith(f"  {page}, line ")]
            told["error"] = f"{error}{f' ({steps[-1]})' if steps else ''}"
        told["seconds"] = round(team.now - began, 2)
        if things:
            team.wait(SETTLES)
            told["thing"] = [round(each, 4) for each in things[0].block_place]
    return told


def _robot(kind: str) -> Fake | Simulated:
    if kind in SIMULATED and not any(lacks("sim")):
        return cell(SIMULATED[kind])
    return Fake(kind if Path(kind).suffix == ".json" else getattr(kinds, kind), **_agreeable(kind))


def _agreeable(kind: str) -> Mapping[str, Any]:
    """Return results with which what an arm expects of its hand comes true: a fake holds nothing else."""
    return {"get_info": {"holding": True}} if kind == "Arm" else {}


def _lay(robots: Mapping[str, Fake | Simulated], places: Mapping[str, tuple[float, float]]) -> list[Any]:
    """Lay the block of each cell where something is to be taken; returns the worlds."""
    worlds: list[Any] = []
    for slot, (x, y) in places.items():
        robot = robots.get(slot)
        if isinstance(robot, Simulated) and hasattr(robot.world, "block"):
            robot.world.block[:2] = (x, y)
            worlds.append(robot.world)
    return worlds


if __name__ == "__main__":
    outcome = carry_out(msgspec.json.decode(sys.stdin.buffer.read(), type=Trial))
    sys.stdout.write(msgspec.json.encode(outcome).decode() + "\n")
