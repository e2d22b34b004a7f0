"""What a person chose last on the screen, by name; it is still so after a restart."""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from robotree import files

STEPS, LOOKS = "steps.json", "looks.json"
"""In `$XDG_STATE_HOME/robotree/REALM`: an index of `jog.STEPS` by robot; `theme` and `language`."""
LARGEST = 100_000
"""Bytes of a file that are read."""
KEPT = 200
"""Choices that are kept, the last ones."""

Choice = TypeVar("Choice", int, str)

log = logging.getLogger(__name__)


class Choices:
    """Numbers and words by name."""

    def __init__(self, path: Path | None = None) -> None:
        """Read what was kept in a file, but for bad entries; None, or a file that cannot be read: nothing."""
        self._path = path
        self._chosen: dict[str, int | str] = {}
        if path is not None:
            with contextlib.suppress(OSError, ValueError, msgspec.MsgspecError):
                kept = msgspec.json.decode(files.read(path, LARGEST), type=dict[str, Any]).items()
                self._chosen = {
                    name: each
                    for name, each in kept
                    if isinstance(each, str) or (type(each) is int and each >= 0)
                }

    def get(self, name: str, usual: Choice) -> Choice:
        """Return what was chosen; what is usual where nothing was."""
        chosen: Any = self._chosen.get(name)
        return chosen if type(chosen) is type(usual) else usual

    def keep_nothing(self) -> None:
        """Keep nothing from now on: who may only look writes no file of somebody else."""
        self._path = None

    def choose(self, name: str, choice: Choice) -> None:
        """Keep what is chosen now."""
        self._chosen.pop(name, None)
        self._chosen[name] = choice
        for oldest in list(self._chosen)[:-KEPT]:
            del self._chosen[oldest]
        if self._path is None:
            return
        try:
            files.overwrite(self._path, msgspec.json.encode(self._chosen))
        except OSError as error:
            log.warning("what is chosen for %s is forgotten at the end: %s", name, error)
