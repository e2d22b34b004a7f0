"""A real terminal with a program in it: keys come as bytes, and what is drawn is read as it comes."""

from __future__ import annotations

import contextlib
import fcntl
import os
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from pathlib import Path

from robotree.vr.base.principal import user_name
from tests.command_line import ROBOTREE

ENTER, TAB, BACKSPACE, DOWN, RIGHT = "\r", "\t", "\x7f", "\x1b[B", "\x1b[C"
ESCAPE = "\x1b[27u"
"""As terminals with kitty's keyboard protocol say it, which the screen asks for. A bare escape is a key only
if nothing follows for 0.1 s: with the next key it is Alt and that key, where a busy machine reads both.
"""
CTRL_R, CTRL_S, CTRL_U = "\x12", "\x13", "\x15"

LEADER = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execvp(sys.argv[1], sys.argv[1:])
"""
"""Makes standard input the terminal of its session, and then runs the given program."""


class Terminal:
    """A terminal, and the session in it."""

    def __init__(self, *words: str, columns: int = 140, lines: int = 44) -> None:
        """Start a program as the leader of a session whose terminal this is."""
        self._master, inside = os.openpty()
        fcntl.ioctl(inside, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))
        self._leader = subprocess.Popen(
            [sys.executable, "-c", LEADER, *words],
            stdin=inside,
            stdout=inside,
            stderr=inside,
            start_new_session=True,
            env=dict(os.environ),  # readline has put COLUMNS and LINES of another terminal into that of C
        )
        self.pid = self._leader.pid
        self._inside = os.ttyname(inside)
        os.close(inside)
        self.shown: bytes = b""

    def shows(self, *texts: bytes, within: float = 60.0) -> None:
        """Read what is shown until one of these is there."""
        began = time.monotonic()
        while not any(text in self.shown for text in texts):
            assert time.monotonic() < began + within, self.shown[-2000:]
            if select.select([self._master], [], [], 0.1)[0]:
                self.shown += os.read(self._master, 65536)

    def stalls(self) -> None:
        """Take nothing more, as after Ctrl-S, or at the far end of a link that hangs."""
        inside = os.open(self._inside, os.O_RDWR | os.O_NOCTTY)
        termios.tcflow(inside, termios.TCOOFF)
        os.close(inside)

    def close(self) -> None:
        """Close it, as a window that closes without a question; a second time: nothing."""
        if self._master >= 0:
            os.close(self._master)
            self._master = -1

    def family(self) -> list[int]:
        """The leader and everything that it and its children have started."""
        found = [self.pid]
        for one in found:
            found += children(one)
        return found

    def wait(self) -> None:
        """Wait until the leader has ended."""
        self._leader.wait(60)

    def is_over(self) -> bool:
        """Whether the leader has ended."""
        return self._leader.poll() is not None


class Person(Terminal):
    """A person at a terminal with the full screen of a realm, or one line, in it."""

    def __init__(self, realm: str, *words: str, columns: int = 140, lines: int = 44) -> None:
        super().__init__(*ROBOTREE, "--realm", realm, *words, columns=columns, lines=lines)

    def types(self, keys: str, *, sees: str) -> None:
        """Press keys, all at once, and wait for words that are drawn after it."""
        self.shown = b""
        os.write(self._master, keys.encode())
        self.shows(sees.encode())

    @property
    def terminal(self) -> str:
        """Name of the device, as people's names have it: `pts/3`."""
        return self._inside.removeprefix("/dev/")

    def leave(self) -> None:
        """Close the terminal and wait for the end of the program."""
        self.close()
        if not self.is_over():
            os.kill(self.pid, signal.SIGTERM)
        self.wait()


class Sitting(Person):
    """A person whose terminal is read all the time: a screen that nobody reads soon hears nothing, either."""

    def __init__(self, *words: str) -> None:
        super().__init__(*words)
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()

    def _read(self) -> None:
        with contextlib.suppress(OSError):
            while data := os.read(self._master, 65536):
                self.shown += data

    def shows(self, *texts: bytes, within: float = 60.0) -> None:
        began = time.monotonic()
        while not any(text in self.shown for text in texts):
            assert time.monotonic() < began + within, self.shown[-3000:].decode(errors="replace")
            time.sleep(0.02)

    def presses(self, keys: str) -> None:
        os.write(self._master, keys.encode())

    @property
    def name(self) -> str:
        return f"{user_name(os.geteuid())}@{self.terminal}"


def living(pid: int) -> bool:
    """Whether a process exists and is not a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def children(pid: int) -> list[int]:
    """The processes that any thread of this one has started."""
    found = list[int]()
    for task in Path(f"/proc/{pid}/task").glob("*"):
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):
            found += [int(one) for one in (task / "children").read_text().split()]
    return found
