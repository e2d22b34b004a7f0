"""Where agents keep what must survive a restart: `$XDG_STATE_HOME/robotree/REALM/space.sqlite`.

All agents of a realm share one space (docs/decisions/0009): what is kept of a robot goes by its name, and the
name may come back in another process.
"""

from __future__ import annotations

import os
from pathlib import Path

from robotree.tui.terminal import note

NOWHERE = "none"
"""What is given instead of a file by who wants nothing kept."""


SPACE_FILE = "space.sqlite"


def space_file(given: str, realm: str) -> Path | None:
    """Return the file of a realm's space.

    Args:
        given: on the command line: a file, `none`, or nothing.
        realm: of the agent.

    Returns:
        The file; None: nothing can or shall be kept.
    """
    if given == NOWHERE:
        return None
    if given:
        return Path(given)
    path = state_file(realm, SPACE_FILE)
    if path is None:
        note("calls are not counted over restarts: the folder for them cannot be made; give --space FILE")
    return path


def state_file(realm: str, name: str) -> Path | None:
    """Return a file of this name in the realm's folder, which is there then; None: it cannot be made."""
    folder = _home() / "robotree" / realm
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder / name


def _home() -> Path:
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
