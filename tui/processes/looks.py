"""How the screen looks and in which language it speaks, as its user chose it last; also after a restart."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any, cast

from robotree import files

FILE = "looks.json"
"""In `$XDG_STATE_HOME/robotree/REALM`."""
LARGEST = 10_000
"""Bytes of the file that are read."""

log = logging.getLogger(__name__)


class Looks:
    """What was chosen: `theme` and `language`, by name."""

    def __init__(self, path: Path | None = None) -> None:
        """Read what was kept in a file; None, or a file that cannot be read: nothing."""
        self._path = path
        self._chosen: dict[str, str] = {}
        if path is None:
            return
        try:
            found: Any = json.loads(files.read(path, LARGEST))
        except (OSError, ValueError):
            return
        if isinstance(found, dict):
            kept = cast("dict[str, Any]", found).items()
            self._chosen = {what: name for what, name in kept if isinstance(name, str)}

    def get(self, what: str) -> str:
        """Return what was chosen; empty: nothing."""
        return self._chosen.get(what, "")

    def keep_nothing(self) -> None:
        """Keep nothing from now on: who may only look writes no file of somebody else."""
        self._path = None

    def choose(self, what: str, name: str) -> None:
        """Keep what is chosen now."""
        self._chosen[what] = name
        if self._path is None:
            return
        try:
            files.overwrite(self._path, json.dumps(self._chosen).encode())
        except OSError as error:
            log.warning("the %s is forgotten at the end: %s", what, error)
