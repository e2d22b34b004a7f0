"""What a controller keeps over a restart, in one file: epoch fence, holder, and the number of its life.

The file is replaced, never changed in place, before the new epoch is obeyed: a process that is killed at any
time leaves the old or the new one. A thread then syncs it to the disk, so that the physics does not wait; a
power cut within those milliseconds may lose the newest epoch, but it ends the motion, too.

A file that cannot be understood is reported, and the fence starts from the present time: earlier leases are
refused, and the next holder is granted a larger epoch.
"""

from __future__ import annotations

import logging
import os
import secrets
import time
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Annotated, Final

import msgspec

from robotree.files import read
from robotree.protocol.services.claim_client import NAME_BYTES
from robotree.protocol.services.fence import LAST_EPOCH, Fence

if TYPE_CHECKING:
    from pathlib import Path

_log = logging.getLogger(__name__)

LIVES: Final = 0xFFFF
"""Numbers of lives that the wire knows: 1 to this one, then anew."""
_HOLDERS: Final = 2**64
LARGEST: Final = 4096
"""[bytes] of a file that can be one of ours."""
_OURS: Final = 0o600


class _Kept(msgspec.Struct, frozen=True):
    """The content of the file, as JSON."""

    epoch: Annotated[int, msgspec.Meta(ge=0, le=LAST_EPOCH)]
    holder: Annotated[int, msgspec.Meta(ge=0)]
    name: Annotated[str, msgspec.Meta(max_length=NAME_BYTES)]
    life: Annotated[int, msgspec.Meta(ge=0, le=LIVES)]

    def __post_init__(self) -> None:
        if self.holder >= _HOLDERS:
            raise ValueError("`holder` has more than 64 bits")


class FenceFile:
    """The memory of one controller.

    Args:
        path: of the file; None: nothing is kept.
        reset: forget what it says, and obey any honest epoch.
    """

    def __init__(self, path: Path | None, *, reset: bool = False) -> None:
        self._path, self._reset = path, reset
        self._parts: list[FenceFile] = []
        self._syncing = ThreadPoolExecutor(1, thread_name_prefix="fence") if path else None
        self._sync: Future[None] | None = None
        """Asked for last; a flood of epochs must not make a queue."""
        self.trouble = ""
        """Why the file could not be understood, or be written, as one sentence; empty: all is well."""
        kept = self._read()
        self.life = kept.life % LIVES + 1 if kept.life else secrets.randbelow(LIVES) + 1
        """Another number after each start."""
        known = _NOTHING if reset else kept
        self.fence = Fence(known.epoch, known.holder, known.name, clock=time.time, keep=self._write)
        self._write(self.fence)

    def of_component(self, component: int) -> FenceFile:
        """The memory of one more component of the same controller, in a file beside this one."""
        path = self._path and self._path.with_name(f"{self._path.name}.{component}")
        part = FenceFile(path, reset=self._reset)
        self._parts.append(part)
        return part

    def close(self) -> None:
        """Wait until what was written is on the disk."""
        for part in self._parts:
            part.close()
        syncing, self._syncing = self._syncing, None
        if syncing is not None:
            syncing.shutdown()

    # -- inside

    def _read(self) -> _Kept:
        if self._path is None:
            return _NOTHING
        try:
            return msgspec.json.decode(read(self._path, LARGEST), type=_Kept)
        except FileNotFoundError:
            return _NOTHING
        except (OSError, msgspec.DecodeError) as error:
            why = (error.strerror if isinstance(error, OSError) else "") or str(error)
            self._complain(f"{self._path} cannot be used ({why}); leases from before now are refused")
            return msgspec.structs.replace(_NOTHING, epoch=min(int(time.time()), LAST_EPOCH))

    def _write(self, fence: Fence) -> None:
        if self._path is None:
            return
        kept = _Kept(fence.epoch, fence.holder, fence.name, self.life)
        fresh = self._path.with_name(f"{self._path.name}.new")
        try:
            fresh.unlink(missing_ok=True)
            with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, _OURS), "wb") as file:
                file.write(msgspec.json.encode(kept))
            fresh.replace(self._path)
        except OSError as error:
            self._complain(f"{self._path} cannot be written ({error}); a restart forgets epoch {fence.epoch}")
            return
        waits = self._sync is not None and not (self._sync.running() or self._sync.done())
        if self._syncing is not None and not waits:  # one that waits will find this file
            self._sync = self._syncing.submit(_sync, self._path)

    def _complain(self, trouble: str) -> None:
        if trouble != self.trouble:
            self.trouble = trouble
            _log.warning("%s", trouble)


_NOTHING: Final = _Kept(0, 0, "", 0)


def _sync(path: Path) -> None:
    for each in (path, path.parent):
        try:
            handle = os.open(each, os.O_RDONLY)
        except OSError:  # replaced or removed meanwhile
            continue
        try:
            os.fsync(handle)
        except OSError as error:
            _log.warning("%s may not survive a power cut (%s)", path, error)
        finally:
            os.close(handle)
