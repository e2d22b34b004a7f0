"""A page that does its worst."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import socket
import threading
from pathlib import Path

from robotree.vr import Child, VirtualRobot, command


class Guest(VirtualRobot):
    """A guest whom nobody knows."""

    helper = Child("Guest")

    @command
    def add(self, a: int, b: int) -> int:
        """Add."""
        return a + b

    @command
    def add_by_helper(self, a: int, b: int) -> int:
        """Have the child add."""
        return int(self.helper.add(a=a, b=b))

    @command
    def crash(self) -> None:
        """End the process as a fault in a library does."""
        self._die(signal.SIGSEGV)

    @command
    def crash_once(self, mark: str) -> str:
        """Crash the first time, and go on after that."""
        file = Path(mark)
        if not file.exists():
            file.write_text("here")
            self._die(signal.SIGKILL)
        return "done"

    @command
    def hold(self, seconds: int) -> None:
        """Hold the interpreter."""
        ctypes.PyDLL(None).sleep(seconds)

    @command
    def crash_and_go_on(self, mark: str) -> None:
        """Crash the first time, and leave a mark after the next step."""
        file = Path(mark)
        if not file.exists():
            file.write_text("begun")
            self._die(signal.SIGKILL)
        self.sleep(0.01)
        file.write_text("went on")

    @command
    def defy(self, mark: str) -> None:
        """Swallow every exception in an endless loop."""
        Path(mark).write_text("begun")
        while True:
            with contextlib.suppress(BaseException):
                threading.Event().wait(0.1)

    @command
    def pid(self) -> int:
        """Return the number of its process."""
        return os.getpid()

    @command
    def attempt(self, what: str, where: str = "") -> str:
        """Try what a guest may not; returns how that went."""
        try:
            return str(getattr(self, f"_{what}")(where))
        except (OSError, MemoryError) as error:
            return type(error).__name__

    def _die(self, number: signal.Signals) -> None:
        os.kill(os.getpid(), number)
        threading.Event().wait()  # any thread may be the one that takes the signal

    def _fork(self, _: str) -> int:
        return os.fork()

    def _execute(self, _: str) -> int:
        return os.posix_spawn("/bin/true", ["true"], {})

    def _dial(self, _: str) -> socket.socket:
        return socket.socket(socket.AF_UNIX)

    def _signal(self, where: str) -> None:
        os.kill(int(where), 0)

    def _read(self, where: str) -> str:
        return Path(where).read_text()

    def _write(self, where: str) -> int:
        return Path(where).write_text("mine")

    def _memory(self, _: str) -> int:
        return os.memfd_create("mine")

    def _slow(self, where: str) -> None:
        os.setpriority(os.PRIO_PROCESS, int(where), 19)

    def _open_up(self, where: str) -> None:
        Path(where).chmod(0o777)

    def _date(self, where: str) -> None:
        os.utime(where, (0, 0))

    def _date_through(self, where: str) -> None:
        with Path(where).open() as file:
            os.utime(file.fileno(), (0, 0))

    def _open_up_through(self, where: str) -> None:
        with Path(where).open() as file:
            os.fchmod(file.fileno(), 0o666)

    def _freeze(self, where: str) -> None:
        import fcntl

        with Path(where).open() as file:
            fcntl.ioctl(file, 0x40086602, b"\x40" + bytes(7))  # FS_IOC_SETFLAGS, FS_NODUMP_FL

    def _environment(self, _: str) -> str:
        return repr(dict(os.environ)) + Path("/proc/self/environ").read_text()

    def _stay(self, _: str) -> None:
        if ctypes.CDLL(None, use_errno=True).prctl(1, 0, 0, 0, 0):
            raise OSError(ctypes.get_errno(), "prctl")

    def _attach(self, where: str) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        libc.shmat.restype = ctypes.c_ssize_t
        if libc.shmat(int(where), None, 0) == -1:
            raise OSError(ctypes.get_errno(), "shmat")

    def _look_on(self, _: str) -> None:
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.inotify_init1(0) == -1:
            raise OSError(ctypes.get_errno(), "inotify_init1")

    def _send(self, where: str) -> None:
        near, _ = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        near.sendto(b"mine", where)

    def _eat(self, _: str) -> int:
        return len(bytearray(3_000_000_000))

    def _thread(self, _: str) -> str:
        said: list[str] = []
        thread = threading.Thread(target=lambda: said.append("ran"))
        thread.start()
        thread.join()
        return said[0]
