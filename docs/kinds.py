"""Writes the interfaces in `kinds/` anew, from the commands that the proxies and the examples really have.

python docs/kinds.py
"""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec

from robotree.proxy.kinds import KINDS
from robotree.vr import VirtualRobot
from robotree.vr.author.command import commands_of
from robotree.vr.author.stream import streams_of
from robotree.vr.author.stubs import interface
from robotree.vr.author.virtual_robot import exposures_of
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from robotree.vr.bundle import Bundle

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "kinds"
PAGES = ("move_to.py", "teleop.py", "two_arms.py", "companion/companion.py")
PREVIEW = "preview_"
LATER = {"Rover": frozenset({"go_to"}), "Base": frozenset({"go_to"})}
"""Commands that came, as previews did, when people had robots of these kinds without them: not promised."""
ORIGIN = "Written by `python docs/kinds.py`."


def classes() -> dict[str, type[Any]]:
    """Return the classes whose interfaces are shipped, by the name of their kind."""
    pages = [Bundle.read(ROOT / "examples" / page).load() for page in PAGES]
    return {cls.__name__: cls for cls in (*KINDS.values(), *pages)}


def described(cls: type[Any], known: dict[str, type[Any]]) -> RobotDescription:
    """Describe a robot of a class as if its slots were filled."""
    later = LATER.get(cls.__name__, frozenset())
    specs = [
        command.spec
        for name, command in commands_of(cls).items()
        if name not in later and not name.startswith(PREVIEW)
    ]
    for name, exposed in exposures_of(cls).items() if issubclass(cls, VirtualRobot) else ():
        spec = commands_of(known[exposed.child.kind])[exposed.command].spec
        specs.append(
            msgspec.structs.replace(spec, name=name, through=f"{exposed.child.name}.{exposed.command}")
        )
    doc = inspect.cleandoc(cls.__doc__ or "")
    return RobotDescription(
        address=Address("robot", "any", "1"), kinds=cls.kinds(), doc=doc, commands=tuple(specs)
    )


def formatted(source: str) -> str:
    """Return a source as ruff writes it."""
    command = [str(Path(sys.executable).with_name("ruff")), "format", "--stdin-filename", "kinds/any.py", "-"]
    return subprocess.run(command, input=source, capture_output=True, text=True, check=True, cwd=ROOT).stdout


def modules() -> dict[str, str]:
    """Return the source of each file of the folder."""
    known = classes()
    names = {cls.__name__: cls.__name__.lower() for cls in known.values()}
    found = {
        f"{names[kind]}.py": interface(described(cls, known), origin=ORIGIN) for kind, cls in known.items()
    }
    lines = ['"""The kinds of robots that come with robotree, as interfaces: `arm = Child(Arm)`.\n']
    lines.append(f'{ORIGIN}\n"""\n')
    lines += [f"from robotree.kinds.{names[kind]} import {kind}" for kind in sorted(known)]
    lines.append(f"\n__all__ = {sorted(known)!r}\n")
    streams = {kind: tuple(sorted(streams_of(known[kind]))) for kind in sorted(known)}
    lines.append(f"STREAMS = { {kind: names for kind, names in streams.items() if names}!r}")
    lines.append('"""Names of the streams of each kind, which are no readings."""\n')
    return {name: formatted(text) for name, text in {**found, "__init__.py": "\n".join(lines)}.items()}


if __name__ == "__main__":
    for name, text in modules().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
