"""How a person has arranged the full screen: the page in front, sizes, sorting, saved filters. It is kept.

The file is for people, too: `$XDG_STATE_HOME/robotree/screen.yaml`. One that cannot be read is left as it is,
and the screen has its usual arrangement.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import msgspec

from robotree import files
from robotree.vr.network.realms import state_home

FILE = "screen.yaml"
"""In `$XDG_STATE_HOME/robotree`: a person arranges all realms alike."""
LARGEST = 100_000
"""[bytes] of the file that are read."""
KEPT = 100
"""Filters, realms and ticked readings of one realm that are kept, at most."""

log = logging.getLogger(__name__)


class Layout(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True, forbid_unknown_fields=True):
    """The arrangement of the full screen."""

    page: str = "robots"
    """In front: robots, plan, views or log."""
    sort: str = "tree"
    """Of the list: tree, problems, name, kind, state, by or host."""
    divide: str = ""
    """By what the list is divided: site, kind, state; empty: it is not."""
    wide: bool = False
    """The list has the whole page, and more columns."""
    joints: bool = False
    """Each joint has a line of its own."""
    level: str = "good"
    """Of the log: good, warning, error."""
    share: int = 40
    """[%] of the page below the list."""
    picture: int = 50
    """[%] of that which the picture has."""
    filters: dict[str, str] = {}
    """Saved filters by name."""
    ticked: dict[str, list[str]] = {}
    """By realm: the readings that are drawn over time, `arm-1.fz`."""


CHOICES: dict[str, tuple[str, ...]] = {
    "page": ("robots", "plan", "views", "log"),
    "sort": ("tree", "problems", "name", "kind", "state", "by", "host"),
    "divide": ("", "site", "kind", "state"),
    "level": ("good", "warning", "error"),
}
"""The words that a part may have."""
LEAST, MOST = 20, 80
"""[%] of the page below the list, and of that which the picture has."""


class LayoutFile:
    """Keeps the arrangement of a person."""

    def __init__(self, path: Path | None = None) -> None:
        """Read what was kept in a file; None: nothing is kept."""
        self._path = path
        self.fault = ""
        """Why the file cannot be used, as a sentence; empty: it can, or is not there."""
        self.layout = Layout()
        if path is not None:
            self._read(path)

    def keep_nothing(self) -> None:
        """Keep nothing from now on: who may only look writes no file of somebody else."""
        self._path = None

    def change(self, **parts: Any) -> None:
        """Keep some parts of the arrangement; the others stay as they are in the file."""
        self.layout = msgspec.structs.replace(self.layout, **parts)
        if self._path is None or self.fault:
            return
        now = LayoutFile(self._path)  # another screen of this person may have changed it
        if now.fault:
            return
        kept = msgspec.structs.replace(now.layout, **parts)
        try:
            files.private_folder(self._path.parent)
            files.overwrite(self._path, _written(kept).encode())
        except OSError as error:
            log.warning("the arrangement of the screen is forgotten at the end: %s", error)

    def _read(self, path: Path) -> None:
        try:
            text = files.read(path, LARGEST)
        except FileNotFoundError:
            return
        except OSError as error:
            self.fault = f"{path} cannot be read ({error.strerror or error}): {AFTER}"
            return
        try:
            self.layout = _understood(text)
        except ValueError as error:
            self.fault = f"{path} is no layout of the screen ({error}): {AFTER}"


AFTER = "the usual one is used, and nothing is kept until you mend or delete it"


def layout_file() -> LayoutFile:
    """Return the arrangement of this user."""
    return LayoutFile(state_home() / FILE)


def _understood(text: bytes) -> Layout:
    """Read an arrangement.

    Raises:
        ValueError: it is none; the reason in a few words.
    """
    import yaml

    try:
        found: Any = yaml.safe_load(text)
    except (yaml.YAMLError, UnicodeError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        raise ValueError(f"no YAML in line {mark.line + 1}" if mark else "no YAML") from None
    try:
        layout = msgspec.convert(found or {}, Layout)
    except msgspec.ValidationError as error:
        raise ValueError(str(error)) from None
    for part, choices in CHOICES.items():
        if (word := getattr(layout, part)) not in choices:
            raise ValueError(f"{part}: {word!r} is none of {', '.join(filter(None, choices))}")
    for part in ("share", "picture"):
        if not LEAST <= (percent := getattr(layout, part)) <= MOST:
            raise ValueError(f"{part}: {percent} is not from {LEAST} to {MOST}")
    return layout


def _written(layout: Layout) -> str:
    import yaml

    filters = dict(list(layout.filters.items())[-KEPT:])
    ticked = {realm: names[-KEPT:] for realm, names in list(layout.ticked.items())[-KEPT:] if names}
    kept = msgspec.structs.replace(layout, filters=filters, ticked=ticked)
    return yaml.safe_dump(msgspec.to_builtins(kept), allow_unicode=True, sort_keys=False)
