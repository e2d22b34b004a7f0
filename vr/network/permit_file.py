"""The permits of a realm, each in a file of its own beside what the realm keeps: `permits/ID.json`.

They are read by each robot that is called with one, by the verbs of people and by the screen: at once,
without a message and without a server, and they outlive all of these. Only the owner of the realm can write
into the folder. Whoever changes one holds the lock of the folder, so that a permit is answered once and used
once.
"""

from __future__ import annotations

import contextlib
import re
import time
from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec
from msgspec.structs import replace as changed

from robotree.files import alone, private_folder, read, replace
from robotree.vr.base.errors import NoSuchPermit, PermitRefused
from robotree.vr.base.permit import REMEMBERED, Permit, PermittedCall, is_same_call, unfit, unlike

FOLDER: Final = "permits"
LARGEST: Final = 256 * 1024
"""[B] of one file."""
LARGEST_ARGUMENTS: Final = 32 * 1024
"""[B] of the arguments of a call that a person is asked about."""
SETTLED: Final = 1_000_000_000
"""[ns] after which a change of the folder has another time than the one before."""
MOST_WAITING: Final = 20
"""Permits of one assistant that wait at the same time: a person reads each."""
_ID = re.compile(r"[a-z0-9]{6,16}")


class PermitFiles:
    """The permits of one realm. May be used in any thread."""

    def __init__(self, folder: Path, unix: Callable[[], float] = time.time) -> None:
        """Take the folder in which the realm keeps its things, and the clock [s since 1970]."""
        self.folder, self._unix = folder / FOLDER, unix
        self._waiting: tuple[int, list[Permit]] = (0, [])
        """What waited when the folder was changed then [ns since 1970]; 0: look again."""

    def all(self) -> list[Permit]:
        """Return all permits that can be read, the oldest first."""
        try:
            names = [path.stem for path in self.folder.iterdir() if path.suffix == ".json"]
        except OSError:
            return []
        found: list[Permit] = []
        for name in names:
            with contextlib.suppress(NoSuchPermit):
                found.append(self.find(name))
        return sorted(found, key=lambda one: one.asked)

    def waiting(self) -> list[Permit]:
        """Return those that wait for an answer and have not expired, the oldest first.

        A screen asks this all the time: the files are read only when the folder has been changed.
        """
        now = self._unix()
        try:
            changed_at = self.folder.stat().st_mtime_ns
        except OSError:
            return []
        if changed_at != self._waiting[0]:
            waiting = [one for one in self.all() if one.state == "waits"]
            settled = time.time_ns() - changed_at > SETTLED  # else one more change may have the same time
            self._waiting = changed_at if settled else 0, waiting
        return [one for one in self._waiting[1] if not one.expired(now)]

    def find(self, permit: str) -> Permit:
        """Return one permit.

        Raises:
            NoSuchPermit: there is none of this id, or it cannot be read.
        """
        if not _ID.fullmatch(permit):
            raise NoSuchPermit(permit=permit[:20])
        try:
            return msgspec.json.decode(read(self._path(permit), LARGEST), type=Permit)
        except (OSError, msgspec.MsgspecError):
            raise NoSuchPermit(permit=permit) from None

    def like(self, permit: Permit) -> Permit | None:
        """Return a permit for the same call that waits, or is allowed, already; None: there is none."""
        now = self._unix()
        return next(
            (each for each in self.all() if not each.expired(now) and is_same_call(each, permit)), None
        )

    def ask(self, permit: Permit, picture: bytes = b"") -> Permit:
        """Keep a permit that waits from now on, and forget those that are over for long.

        Returns:
            The permit; that for the same call, if there is one already: a person is asked once.

        Raises:
            PermitRefused: too many wait already.
            OSError: it cannot be kept.
        """
        with self._locked():
            if (before := self.like(permit)) is not None:
                return before
            now, waiting = self._unix(), 0
            for one in self.all():
                if now > one.asked + REMEMBERED:
                    self._path(one.id).unlink(missing_ok=True)
                    (self.folder / f"{one.id}.jpg").unlink(missing_ok=True)
                elif one.assistant == permit.assistant and one.state == "waits" and not one.expired(now):
                    waiting += 1
            if waiting >= MOST_WAITING:
                reason = f"{waiting} permits of {permit.assistant} wait already"
                raise PermitRefused(permit=permit.id, reason=reason)
            _encoded(permit)
            if picture:
                replace(self.folder / f"{permit.id}.jpg", picture)
                permit = changed(permit, picture=f"{permit.id}.jpg")
            return self._write(permit)

    def answer(self, permit: str, *, yes: bool, by: str) -> Permit:
        """Say yes or no to a permit that waits; a no may also take back a yes that was not used.

        Raises:
            NoSuchPermit: there is none.
            PermitRefused: it was answered already, or has expired.
        """
        with self._locked():
            found, now = self.find(permit), self._unix()
            open_for = ("waits",) if yes else ("waits", "allowed")
            if found.state not in open_for:
                raise PermitRefused(permit=permit, reason=f"it is {found.state} already")
            if found.expired(now):
                raise PermitRefused(permit=permit, reason="it has expired; the assistant has to ask again")
            state: Any = "allowed" if yes else "denied"
            return self._write(changed(found, state=state, by=by, answered=now))

    def begin(self, permit: str, assistant: str, call: PermittedCall) -> Permit:
        """Use a yes for one call, whose key it is bound to from now on: nobody else can use it.

        Raises:
            NoSuchPermit: there is none.
            PermitRefused: it does not allow this call, or was used.
        """
        with self._locked():
            found, now = self.find(permit), self._unix()
            reason = "" if found.assistant == assistant else f"it is {found.assistant}'s"
            if found.state != "allowed":
                reason = reason or _NOT_ALLOWED.get(found.state, found.state)
            reason = reason or unlike(found, call) or ("it has expired" if found.expired(now) else "")
            if reason:
                raise PermitRefused(permit=permit, reason=reason)
            return self._write(changed(found, state="begun", key=call.key))

    def settle(self, permit: str, outcome: str) -> None:
        """Note how a call has ended that had begun with a permit; one that is gone is left gone."""
        with self._locked(), contextlib.suppress(NoSuchPermit):
            found = self.find(permit)
            if found.state == "begun":
                self._write(changed(found, state="over", outcome=outcome))

    def withdraw(self, permit: str, assistant: str) -> Permit:
        """Note that an assistant does not want a call any more which has not begun.

        Raises:
            NoSuchPermit: it has none of this id.
            PermitRefused: it is answered or begun.
        """
        with self._locked():
            found = self.find(permit)
            if found.assistant != assistant:
                raise NoSuchPermit(permit=permit)
            if found.state not in ("waits", "allowed"):
                raise PermitRefused(permit=permit, reason=f"it is {found.state} already")
            return self._write(changed(found, state="withdrawn"))

    def expect(self, assistant: str, call: PermittedCall) -> None:
        """Check, where the robot is, that a call has begun with a yes to it.

        Raises:
            PermitRefused: it has not.
        """
        try:
            found = call.vouched or self.find(call.permit)
        except NoSuchPermit:
            raise PermitRefused(permit=call.permit or "none", reason="there is none") from None
        if reason := unfit(found, assistant, call, self._unix()):
            raise PermitRefused(permit=call.permit, reason=reason)

    # -- inside -----------------------------------------------------------------------------------

    def _path(self, permit: str) -> Path:
        return self.folder / f"{permit}.json"

    def _write(self, permit: Permit) -> Permit:
        replace(self._path(permit.id), _encoded(permit))
        return permit

    @contextlib.contextmanager
    def _locked(self) -> Generator[None]:
        private_folder(self.folder)
        with alone(self.folder / ".lock"):
            yield


def _encoded(permit: Permit) -> bytes:
    """Return a permit as it is kept: none that nobody could read again, and so neither count nor forget."""
    data = msgspec.json.format(msgspec.json.encode(permit))
    if len(msgspec.json.encode(permit.arguments)) > LARGEST_ARGUMENTS or len(data) > LARGEST:
        raise PermitRefused(permit=permit.id, reason=f"{len(data)} bytes are too much for a person to read")
    return data


_NOT_ALLOWED: Final[Mapping[str, str]] = {
    "waits": "nobody has said yes",
    "denied": "a person has said no",
    "begun": "it was used",
    "over": "it was used",
    "withdrawn": "it was withdrawn",
}


def permits_beside(gate: object) -> PermitFiles:
    """Return the permits of the realm of a policy.

    Raises:
        NoSuchPermit: this realm keeps nothing.
    """
    found = getattr(gate, "permits", None)
    if not isinstance(found, PermitFiles):
        raise NoSuchPermit(permit="(this realm keeps nothing)")
    return found
