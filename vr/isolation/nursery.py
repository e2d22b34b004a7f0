"""The host's side of the making of processes: the zygote, which it starts when the first one is wanted."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from robotree.vr.isolation.confine import environment, needed

STARTED, ENDED = struct.Struct("<I"), struct.Struct("<Ii")
"""What the zygote says: the number of a new process; that of one that has ended, and its exit code."""
WITHIN = 30.0
"""[s] for the zygote to load what robots need."""
BOX = shutil.which("bwrap")
"""The program of bubblewrap; None: it is not installed."""
_ZYGOTE, _INSIDE = "robotree.vr.agents.zygote", "robotree.vr.agents.inside"
_HIDDEN = ("/home", "/root", "/tmp", "/run", "/var", "/mnt", "/media", "/srv")  # noqa: S108 # hidden, not used
"""Folders that are empty in a box, but for what Python needs in them."""


class Nursery:
    """Starts processes for robots. On one event loop."""

    def __init__(self) -> None:
        """Begin without a zygote."""
        self._loop = asyncio.get_running_loop()
        self._zygote: subprocess.Popen[bytes] | None = None
        self._socket: socket.socket | None = None
        self._started: asyncio.Queue[int] = asyncio.Queue()
        self._on_end: dict[int, Callable[[int], None]] = {}
        self._one_at_a_time = asyncio.Lock()
        self._boxed: dict[asyncio.subprocess.Process, asyncio.Task[None]] = {}

    async def start(self, on_end: Callable[[int], None]) -> tuple[int, socket.socket]:
        """Start a process.

        Args:
            on_end: called with its exit code when it has ended; negative: the signal that has ended it.

        Returns:
            Its number, and the host's end of its pipe.

        Raises:
            OSError: no process can be made.
        """
        async with self._one_at_a_time:
            if self._socket is None:
                self._start_zygote()
            own, other = socket.socketpair()
            try:
                assert self._socket is not None  # noqa: S101 # just started
                socket.send_fds(self._socket, [b"robot"], [other.fileno()])
                async with asyncio.timeout(WITHIN):
                    number = await self._started.get()
            except BaseException:
                own.close()
                raise
            finally:
                other.close()
            if number == 0:
                own.close()
                raise OSError("the process that makes others has ended")
            self._on_end[number] = on_end
            return number, own

    async def start_boxed(self, folder: str, on_end: Callable[[int], None]) -> tuple[int, socket.socket]:
        """Start a process in a box of bubblewrap (bwrap(1)): namespaces of its own, and no home folders.

        Args:
            folder: in which it may write; empty: nowhere.
            on_end: as in `start`.

        Returns:
            As `start`.

        Raises:
            OSError: no process can be made.
        """
        own, other = socket.socketpair()
        try:
            process = await asyncio.create_subprocess_exec(
                *box(folder),
                *(sys.executable, "-P", "-m", _INSIDE, str(other.fileno())),
                pass_fds=[other.fileno()],
                stdin=asyncio.subprocess.DEVNULL,
                start_new_session=True,
                env=environment(),
            )
        except OSError:
            own.close()
            raise
        finally:
            other.close()
        self._boxed[process] = watcher = self._loop.create_task(_watch(process, on_end))
        watcher.add_done_callback(lambda _: self._boxed.pop(process, None))
        return process.pid, own

    def _start_zygote(self) -> None:
        own, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        arguments = [sys.executable, "-P", "-m", _ZYGOTE, str(other.fileno()), str(os.getpid())]
        try:
            self._zygote = subprocess.Popen(
                arguments,
                pass_fds=[other.fileno()],
                stdin=subprocess.DEVNULL,
                process_group=0,
                env=environment(),
            )
        except OSError:
            own.close()
            raise
        finally:
            other.close()
        own.setblocking(False)
        self._socket = own
        self._loop.add_reader(own, self._read)

    def _read(self) -> None:
        assert self._socket is not None  # noqa: S101 # it is read
        try:
            data = self._socket.recv(64)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if len(data) == STARTED.size:
            self._started.put_nowait(STARTED.unpack(data)[0])
        elif len(data) == ENDED.size:
            number, code = ENDED.unpack(data)
            if (on_end := self._on_end.pop(number, None)) is not None:
                on_end(code)
        else:
            self._lose()

    def _lose(self) -> None:
        """Note that the zygote has ended, and with it all processes that it has made."""
        self._drop()
        self._started.put_nowait(0)
        ended, self._on_end = self._on_end, {}
        for on_end in ended.values():
            on_end(-signal.SIGKILL)
        while not self._started.empty():
            self._started.get_nowait()

    def _drop(self) -> None:
        if self._socket is not None:
            self._loop.remove_reader(self._socket)
            self._socket.close()
            self._socket = None
        if self._zygote is not None:
            with contextlib.suppress(OSError):
                self._zygote.kill()
            self._zygote.wait()
            self._zygote = None

    def close(self) -> None:
        """End the zygote, and with it all processes that are left. Twice is once."""
        self._on_end.clear()
        self._drop()
        for process in list(self._boxed):
            with contextlib.suppress(ProcessLookupError):
                process.kill()


def box(folder: str) -> list[str]:
    """Return the command line of a box: everything can be read that is nobody's own, and nothing written.

    Args:
        folder: in which the process may write; empty: nowhere.
    """
    words = [BOX or "bwrap", "--unshare-all", "--die-with-parent", "--new-session", "--cap-drop", "ALL"]
    words += ["--ro-bind", "/", "/", "--dev", "/dev", "--proc", "/proc"]
    for hidden in _HIDDEN:
        words += ["--tmpfs", hidden] * Path(hidden).is_dir()
    for path in sorted(needed()):
        words += ["--ro-bind-try", path, path] * path.startswith(_HIDDEN)
    return [*words, *(("--bind", folder, folder) if folder else ()), "--"]


async def _watch(process: asyncio.subprocess.Process, on_end: Callable[[int], None]) -> None:
    on_end(await process.wait())
