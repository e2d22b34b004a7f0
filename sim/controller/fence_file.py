"""The memory of a controller over a restart, in a file and its copy: epoch fence, holder, number of its life.

Both are replaced, never changed in place, before the new epoch is obeyed: a process that is killed at any
time leaves the old or the new one. A thread then syncs them to the disk, so that the physics does not wait; a
power cut within those milliseconds may lose the newest epoch, but it ends the motion, too.

Each has a checksum. A damaged or missing one is reported, and replaced by the other one. If neither is left
the controller does not start: only a person can know which leases were obeyed. A marker beside them tells a
first start from one whose files were deleted.
"""

from __future__ import annotations

import hashlib
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
from robotree.sim.errors import MemoryLost

if TYPE_CHECKING:
    from collections.abc import Sequence
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
    count: Annotated[int, msgspec.Meta(ge=0)] = 0
    """How often it was written; of two copies the newer one counts."""

    def __post_init__(self) -> None:
        if self.holder >= _HOLDERS:
            raise ValueError("`holder` has more than 64 bits")


def _encoded(kept: _Kept) -> bytes:
    body = msgspec.json.encode(kept)
    return hashlib.sha256(body).hexdigest()[:16].encode() + b" " + body + b"\n"


def _decoded(data: bytes) -> _Kept:
    """Take a copy apart.

    Raises:
        ValueError: it is damaged.
    """
    try:
        kept = msgspec.json.decode(data[17:], type=_Kept)
    except (msgspec.MsgspecError, ValueError):
        raise ValueError("is damaged") from None
    if _encoded(kept) != data:
        raise ValueError("is damaged")
    return kept


class FenceFile:
    """The memory of one controller.

    Args:
        path: of the file; None: nothing is kept.
        reset: forget what it says, and obey any honest epoch.

    Raises:
        MemoryLost: the file and its copy are damaged or were deleted.
    """

    def __init__(self, path: Path | None, *, reset: bool = False) -> None:
        self._path, self._reset = path, reset
        self._parts: list[FenceFile] = []
        self._syncing = ThreadPoolExecutor(1, thread_name_prefix="fence") if path else None
        self._sync: Future[None] | None = None
        """Asked for last; a flood of epochs must not make a queue."""
        self.trouble = ""
        """Why the file could not be understood, or be written, as one sentence; empty: all is well."""
        self._count = 0
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

    @property
    def _copies(self) -> tuple[Path, ...]:
        return () if self._path is None else (self._path, self._path.with_name(f"{self._path.name}.copy"))

    def _read(self) -> _Kept:
        if self._path is None:
            return _NOTHING
        intact, problems = list[_Kept](), list[str]()
        for path in self._copies:
            try:
                intact.append(_decoded(read(path, LARGEST)))
            except FileNotFoundError:
                problems.append(f"{path} is missing")
            except OSError as error:
                problems.append(f"{path} cannot be read ({error.strerror})")
            except ValueError as error:
                problems.append(f"{path} {error}")
        marker = self._path.with_name(f".{self._path.name}.known")
        known = marker.exists()
        if not intact and not known:
            kept = self._read_first()
        elif intact:
            kept = max(intact, key=lambda each: each.count)
            for problem in problems:
                self._complain(f"{problem}; its copy is intact, and is used")
        elif self._reset:
            kept = _NOTHING
            self._complain(f"{' and '.join(problems)}; any lease is obeyed now")
        else:
            raise MemoryLost(problems)
        self._count = kept.count
        self._mark(marker)
        return kept

    def _read_first(self) -> _Kept:
        """A file of an earlier version, which had neither checksum nor copy; or none, at the first start."""
        assert self._path is not None  # noqa: S101  asked before
        try:
            return msgspec.json.decode(read(self._path, LARGEST), type=_Kept)
        except FileNotFoundError:
            return _NOTHING
        except (OSError, msgspec.MsgspecError, ValueError) as error:
            why = (error.strerror if isinstance(error, OSError) else "") or str(error)
            self._complain(f"{self._path} cannot be used ({why}); leases from before now are refused")
            return msgspec.structs.replace(_NOTHING, epoch=min(int(time.time()), LAST_EPOCH))

    def _mark(self, marker: Path) -> None:
        try:
            os.close(os.open(marker, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW, _OURS))
        except OSError as error:
            self._complain(f"{marker} cannot be made ({error})")

    def _write(self, fence: Fence) -> None:
        if self._path is None:
            return
        self._count += 1
        kept = _Kept(fence.epoch, fence.holder, fence.name, self.life, self._count)
        for path in self._copies:
            fresh = path.with_name(f"{path.name}.new")
            try:
                fresh.unlink(missing_ok=True)
                with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_EXCL, _OURS), "wb") as file:
                    file.write(_encoded(kept))
                fresh.replace(path)
            except OSError as error:
                self._complain(f"{path} cannot be written ({error}); a restart forgets epoch {fence.epoch}")
                return
        waits = self._sync is not None and not (self._sync.running() or self._sync.done())
        if self._syncing is not None and not waits:  # one that waits will find these files
            self._sync = self._syncing.submit(_sync, self._copies)

    def _complain(self, trouble: str) -> None:
        if trouble != self.trouble:
            self.trouble = trouble
            _log.warning("%s", trouble)


_NOTHING: Final = _Kept(0, 0, "", 0)


def _sync(paths: Sequence[Path]) -> None:
    for each in (*paths, paths[0].parent):
        try:
            handle = os.open(each, os.O_RDONLY)
        except OSError:  # replaced or removed meanwhile
            continue
        try:
            os.fsync(handle)
        except OSError as error:
            _log.warning("%s may not survive a power cut (%s)", each, error)
        finally:
            os.close(handle)
