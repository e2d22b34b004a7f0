"""Which step an operator chose last in the tele-operation of each robot; it is still so after a restart."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

from robotree import files

FILE = "steps.json"
"""In `$XDG_STATE_HOME/robotree/REALM`."""
LARGEST = 100_000
"""Bytes of the file that are read."""
KEPT = 200
"""Robots whose step is kept, those of the last choices."""

log = logging.getLogger(__name__)


class Steps:
    """Numbers of steps (an index of `jog.STEPS`) by the name of the robot."""

    def __init__(self, path: Path | None = None) -> None:
        """Read what was kept in a file; None, or a file that cannot be read: nothing."""
        self._path = path
        self._chosen: dict[str, int] = dict(_read(path)) if path else {}

    def get(self, robot: str, otherwise: int) -> int:
        """Return the step of a robot."""
        return self._chosen.get(robot, otherwise)

    def keep_nothing(self) -> None:
        """Keep nothing from now on: who may only look writes no file of somebody else."""
        self._path = None

    def choose(self, robot: str, step: int) -> None:
        """Keep the step of a robot."""
        self._chosen.pop(robot, None)
        self._chosen[robot] = step
        for oldest in list(self._chosen)[:-KEPT]:
            del self._chosen[oldest]
        if self._path is None:
            return
        try:
            files.overwrite(self._path, json.dumps(self._chosen).encode())
        except OSError as error:
            log.warning("the step of the tele-operation is forgotten at the end: %s", error)


def _read(path: Path) -> Iterator[tuple[str, int]]:
    try:
        found: Any = json.loads(files.read(path, LARGEST))
    except (OSError, ValueError):
        return
    if isinstance(found, dict):
        for robot, step in cast("dict[str, Any]", found).items():
            if isinstance(step, int) and step >= 0:
                yield robot, step
