"""Starting a process again that has gone: by systemd where it is a service, else as `apply` started it.

What `apply` starts is noted in `$XDG_STATE_HOME/robotree/REALM/started.json`. Only lines of processes are
taken from there, and they are read as a line of the shell is.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import threading
from collections.abc import Mapping, Sequence

import msgspec

from robotree import files
from robotree.tui.errors import CannotRestart
from robotree.tui.processes.detached import start_detached
from robotree.tui.processes.state_files import state_file
from robotree.vr.network.realms import state_home

FILE = "started.json"
LARGEST = 1_000_000
"""[bytes] of that file."""
VERBS = ("proxy", "host", "view", "lookup", "directory", "space serve")
"""Processes that are started again, by the verb of their line."""
UNITS: Mapping[str, str] = {verb: f"robotree-{verb.split()[0]}@" for verb in VERBS}
"""Beginning of the names of their services (`deploy/`)."""
ASKING = 5.0
"""[s] that systemd has for an answer."""


_NOTING = threading.Lock()


class StartedLine(msgspec.Struct, frozen=True):
    """How a process was started."""

    words: list[str]
    """Behind `robotree`."""
    environment: dict[str, str] = {}
    """Variables beside those of the user."""


def note_started(realm: str, verb: str, name: str, line: StartedLine) -> None:
    """Keep how a process was started; where nothing can be kept, a person starts it again."""
    path = state_file(realm, FILE)
    if path is None:
        return
    with _NOTING:  # `apply` starts several at once, in threads
        kept = {**_noted(realm), f"{verb} {name}": line}
        files.replace(path, msgspec.json.format(msgspec.json.encode(kept), indent=1))


def _noted(realm: str) -> dict[str, StartedLine]:
    try:
        found = files.read(state_home() / realm / FILE, LARGEST)
        return msgspec.json.decode(found, type=dict[str, StartedLine])
    except (OSError, msgspec.MsgspecError):
        return {}


async def start_again(realm: str, name: str) -> str:
    """Start the process of a proxy, a host or another agent again.

    Args:
        realm: whose.
        name: of the agent.

    Returns:
        How it was started, for people.

    Raises:
        CannotRestart: this machine does not know how.
        MemberFailed: it did not come up.
    """
    for verb in VERBS:
        unit = f"{UNITS[verb]}{name}.service"
        if await _is_enabled(unit):
            code, said = await _systemctl("restart", unit)
            if code:
                raise CannotRestart(name, f"systemd could not start {unit}: {said}")
            return f"{name} is started again by systemd ({unit})"
    for verb in VERBS:
        line = _noted(realm).get(f"{verb} {name}")
        if line is not None and _fits(line.words, verb, name):
            log = f"{verb}-{name}".replace(" ", "-")
            await asyncio.to_thread(start_detached, realm, log, line.words, line.environment)
            return f"{name} is started again, as `apply` started it"
    raise CannotRestart(name, "it is no service of systemd here, and `apply` has not started it")


def _fits(words: Sequence[str], verb: str, name: str) -> bool:
    """Whether a noted line starts what it is noted for, and nothing else."""
    return " ".join(words).startswith(f"{verb} ") and name in words


async def _is_enabled(unit: str) -> bool:
    socket = f"/run/user/{os.getuid()}/systemd/private"
    if shutil.which("systemctl") is None or not os.path.exists(socket):  # noqa: ASYNC240, PTH110 # at once
        return False
    code, _ = await _systemctl("is-enabled", "--quiet", unit)
    return code == 0


async def _systemctl(*words: str) -> tuple[int, str]:
    process = await asyncio.create_subprocess_exec(
        "systemctl",
        "--user",
        *words,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    try:
        async with asyncio.timeout(ASKING):
            said, _ = await process.communicate()
    except TimeoutError:
        process.kill()
        await process.wait()
        return 1, f"no answer within {ASKING:g} s"
    return process.returncode or 0, " ".join(said.decode(errors="replace").split())
