"""The alarms of a realm, in a file of this user's: they outlive the screens that watch them.

`$XDG_STATE_HOME/robotree/REALM/alarms.json`. Screens and verbs change it under a lock, so that an alarm which
two screens see is raised once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from robotree.files import alone, private_folder, read, replace
from robotree.tui.errors import AlarmsUnusable
from robotree.tui.seen.watched import Alarm
from robotree.vr.network.realms import state_home

FILE = "alarms.json"
LARGEST = 1_000_000
"""[bytes] of the file."""
MOST = 500
"""Alarms of one realm."""

Change = Callable[[dict[str, Alarm]], None]
"""Changes alarms by name."""


class AlarmFile:
    """The alarms of one realm. None of it waits for a robot."""

    def __init__(self, path: Path | None) -> None:
        """Keep alarms in a file; None: only as long as this object lives."""
        self._path = path
        self._held: tuple[Alarm, ...] = ()
        self._read_at: tuple[int, int] = (-1, -1)
        """The time and the size that the file had when it was read."""

    def all(self) -> tuple[Alarm, ...]:
        """Return the alarms, by name; the file is read only where it has changed.

        Raises:
            AlarmsUnusable: it cannot be read.
        """
        if self._path is None:
            return self._held
        try:
            found = self._path.stat()
        except OSError:
            return ()
        at = found.st_mtime_ns, found.st_size
        if at != self._read_at:
            self._held, self._read_at = self._read(self._path), at
        return self._held

    def change(self, change: Change) -> tuple[Alarm, ...]:
        """Change alarms; returns them as they are then.

        Raises:
            AlarmsUnusable: the file cannot be read or written, or there would be too many.
        """
        if self._path is None:
            self._held = _changed(self._held, change)
            return self._held
        try:
            private_folder(self._path.parent.parent)
            private_folder(self._path.parent)
            with alone(self._path.with_name(f".{FILE}.lock")):
                before = self._read(self._path) if self._path.exists() else ()
                after = _changed(before, change)
                if after != before:
                    replace(self._path, msgspec.json.format(msgspec.json.encode(after), indent=1))
        except OSError as error:
            raise AlarmsUnusable(str(self._path), error.strerror or str(error)) from None
        return self.all()

    def _read(self, path: Path) -> tuple[Alarm, ...]:
        try:
            return msgspec.json.decode(read(path, LARGEST), type=tuple[Alarm, ...])
        except (OSError, msgspec.MsgspecError) as error:
            raise AlarmsUnusable(str(path), str(error)) from None


def alarms_of(realm: str) -> AlarmFile:
    """Return the alarms of a realm that this user has set."""
    return AlarmFile(state_home() / realm / FILE if realm else None)


def _changed(before: Sequence[Alarm], change: Change) -> tuple[Alarm, ...]:
    by_name = {alarm.name: alarm for alarm in before}
    change(by_name)
    if len(by_name) > MOST:
        raise AlarmsUnusable("the alarms of this realm", f"there are {MOST} already; clear some")
    return tuple(by_name[name] for name in sorted(by_name))
