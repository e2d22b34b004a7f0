"""`robotree info`: versions, paths, what the terminal can, and the realm, to be pasted into a report."""

from __future__ import annotations

import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import robotree.tui
from robotree.tui import exit_codes
from robotree.tui.diagnosis import machine, meeting
from robotree.tui.line.grammar import Line
from robotree.tui.processes.realm import READONLY_VARIABLE, only_looking
from robotree.tui.seen import wording
from robotree.tui.terminal import answer
from robotree.tui.wire.security import REALM_KEY, VARIABLE
from robotree.vr.base.extras import MODULES
from robotree.vr.network.realms import REALM_VARIABLE, realm_folder, state_home

_VARIABLES = (
    REALM_VARIABLE, READONLY_VARIABLE, VARIABLE, "XDG_RUNTIME_DIR", "XDG_STATE_HOME", "XDG_CONFIG_HOME",
    "TEXTUAL_THEME", "NO_COLOR", "LANG",
)  # fmt: skip
"""The environment variables that decide something here; values are paths and names, never keys."""


def info(line: Line, realm: str) -> int:
    """Print what is installed and set here.

    Returns:
        The exit code.
    """
    data = gather(realm, readonly=only_looking(given=line.flag("--readonly")))
    answer(text(data), lambda: data)
    return exit_codes.DONE


def gather(realm: str, *, readonly: bool) -> dict[str, Any]:
    """Return everything by group and name."""
    return {
        "versions": {
            "robotree": version("robotree"),
            "python": platform.python_version(),
            "system": platform.platform(),
            "packages": {
                package.name: package.have
                for extra in ("", *MODULES)
                for package in machine.packages(extra)
                if package.have
            },
        },
        "realm": {"name": realm, "readonly": readonly, "realms here": meeting.realms()},
        "paths": {
            "program": str(Path(robotree.tui.__file__).parent),
            "python": sys.executable,
            "realm": str(realm_folder(realm)),
            "realm key": str(realm_folder(realm) / REALM_KEY),
            "log": str(state_home() / realm / "supervisor.log"),
        },
        "terminal": machine.abilities(),
        "environment": {name: os.environ[name] for name in _VARIABLES if name in os.environ},
    }


def text(data: dict[str, Any]) -> str:
    """Return the same for people."""
    lines: list[str] = []
    for group, values in data.items():
        rows = [(f"  {name}", _written(value)) for name, value in values.items()]
        lines += [group, wording.columns(rows), ""] if rows else []
    return "\n".join(lines[:-1])


def _written(value: Any) -> str:
    match value:
        case dict():
            packages = cast("dict[str, str]", value)
            return ", ".join(f"{name} {have}".rstrip() for name, have in packages.items())
        case list():
            return ", ".join(cast("list[str]", value)) or "none"
        case bool():
            return "yes" if value else "no"
        case _:
            return str(value)
