"""`robotree doctor [NAME]`: each check with its result and what to do. `robotree info`: facts."""

from __future__ import annotations

import asyncio
import os
import platform
import stat
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any, cast

import robotree.tui
from robotree.tui import exit_codes
from robotree.tui.diagnosis import agents, finding, machine, meeting
from robotree.tui.diagnosis.finding import Finding
from robotree.tui.line.grammar import Line
from robotree.tui.processes.realm import READONLY_VARIABLE, only_looking
from robotree.tui.seen import wording
from robotree.tui.terminal import answer
from robotree.tui.wire.security import NOTHING, REALM, REALM_KEY, VARIABLE, examined
from robotree.vr.base.errors import VrError
from robotree.vr.base.extras import MODULES
from robotree.vr.network.realms import REALM_VARIABLE, realm_folder, state_home


def doctor(line: Line, realm: str) -> int:
    """Carry out all checks and report what they have found.

    Returns:
        The exit code: 0 when nothing is bad, 1 else.
    """
    found = asyncio.run(diagnose(realm, line.text("NAME")))
    answer(finding.text(found), lambda: finding.structure(found))
    return exit_codes.DONE if finding.sound(found) else exit_codes.REFUSED


async def diagnose(realm: str, name: str = "") -> list[Finding]:
    """Return all findings, from the ground up: what comes later needs what comes before.

    Args:
        realm: whose agents are looked at.
        name: of a robot that is missing; empty: none.
    """
    found = [machine.python(), *machine.installed(), machine.clock(), *machine.terminal()]
    found += [machine.room(state_home() / realm), keys(realm)]
    folder = list(meeting.folder(realm))
    found += folder
    if not finding.sound(folder):
        elsewhere = meeting.whereabouts(name, realm) if name else None
        return [*found, elsewhere] if elsewhere else found
    entries = await asyncio.to_thread(meeting.entries, realm)
    found += [*meeting.processes(entries), *meeting.roles(entries), *meeting.links(entries)]
    try:
        return [*found, *await agents.agents(realm, name, entries)]
    except VrError as error:
        return [*found, Finding("robots", "bad", f"the realm cannot be joined: {error}")]


def keys(realm: str) -> Finding:
    """See that the signing keys of the environment can be used, and by nobody else."""
    given = os.environ.get(VARIABLE, "")
    if not given and (realm_folder(realm) / REALM_KEY).exists():
        result = (
            "the realm has a key of its own: what `robotree demo` starts is signed; other links need --key"
        )
        return Finding("keys", "good", result)
    if given in {"", NOTHING}:
        result = "no key is set ($ROBOTREE_KEY): links are open unless --key is given"
        return Finding(
            "keys", "doubt", result, "robotree wire key cell.key, then --key cell.key on both ends"
        )
    if given == REALM:
        return Finding("keys", "good", "links are signed with the realm's own key ($ROBOTREE_KEY=realm)")
    path = Path(given)
    if fault := examined(path):
        return Finding("keys", "bad", fault, "set $ROBOTREE_KEY to a file that `robotree wire key FILE` made")
    mode = stat.S_IMODE(path.stat().st_mode)
    if mode & 0o077:
        return Finding("keys", "bad", f"{path} has mode {mode:04o}: others can read it", f"chmod 600 {path}")
    return Finding("keys", "good", f"{path} holds keys, and only you can read it")


# -- `robotree info`: versions, paths, what the terminal can, and the realm -------------------------

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
