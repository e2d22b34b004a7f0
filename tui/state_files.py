"""Where agents keep what must survive a restart: `$XDG_STATE_HOME/robotree/REALM/NAME.sqlite`."""

from __future__ import annotations

import os
from pathlib import Path

from robotree.tui.terminal import note

NOWHERE = "none"
"""What is given instead of a file by who wants nothing kept."""


def space_file(given: str, realm: str, name: str) -> Path | None:
    """Return the file of an agent's space.

    Args:
        given: on the command line: a file, `none`, or nothing.
        realm: of the agent.
        name: of the agent.

    Returns:
        The file, in a folder that is there; None: nothing can or shall be kept.
    """
    if given == NOWHERE:
        return None
    path = Path(given) if given else _home() / "robotree" / realm / f"{name}.sqlite"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        note(f"calls are not counted over restarts: cannot make {path.parent}: {error.strerror}")
        return None
    return path


def _home() -> Path:
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
