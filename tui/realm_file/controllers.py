"""The simulated controllers that `apply` has started: they are in no realm, so nobody else knows them."""

from __future__ import annotations

from pathlib import Path

import msgspec

from robotree import files
from robotree.tui.processes.programs import program_of
from robotree.tui.processes.state_files import state_file
from robotree.tui.realm_file.content import NAMELESS
from robotree.vr.network.realms import state_home

FILE = "controllers.json"
"""In `$XDG_STATE_HOME/robotree/REALM`."""
LARGEST = 1_000_000
"""[bytes] of that file that are read."""


class Controller(msgspec.Struct, frozen=True):
    """One of them."""

    pid: int
    address: str
    """Where it listens."""


def controllers(realm: str) -> dict[str, Controller]:
    """Return those of a realm that live, by their names in its file."""
    return {name: one for name, one in _kept(state_home() / realm / FILE).items() if _lives(one)}


def keep(realm: str, name: str, controller: Controller | None) -> None:
    """Remember that one was started, or that it was ended (None)."""
    path = state_file(realm, FILE)
    if path is None:
        return
    known = controllers(realm)
    known.pop(name, None)
    if controller is not None:
        known[name] = controller
    files.overwrite(path, msgspec.json.encode(known))


def _kept(path: Path) -> dict[str, Controller]:
    try:
        return msgspec.json.decode(files.read(path, LARGEST), type=dict[str, Controller])
    except (OSError, msgspec.DecodeError):
        return {}


def _lives(controller: Controller) -> bool:
    program = program_of(controller.pid)
    return program is not None and program.words[:1] == (NAMELESS,)
