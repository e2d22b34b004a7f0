"""How soon a screen shows that a process does not answer: from SIGSTOP to `late` or `HANGS`.

    python bench/late.py [--times N]

A real proxy of a simulated arm is stopped at moments spread over its beat; the full screen runs in a terminal
of its own (a pty), as a person sees it.
"""

from __future__ import annotations

import argparse
import asyncio
import fcntl
import os
import pty
import select
import signal
import statistics
import struct
import sys
import tempfile
import termios
import time
from pathlib import Path

from robotree.tui.processes.crew import Crew

REALM = "late"
SHOWN = 30.0
"""[s] within which everything must be there."""
AWAKE = 2.5
"""[s] after which a woken process is shown as it was."""
SPREAD = 0.037
"""[s] by which each stop is later within the beat than the one before."""


class Screen:
    """The full screen in a terminal."""

    def __init__(self) -> None:
        """Start it."""
        self.pid, self.fd = pty.fork()
        if self.pid == 0:
            os.environ.update(TERM="xterm-256color", COLORTERM="truecolor")
            words = [sys.executable, "-m", "robotree.tui", "--realm", REALM]
            os.execv(sys.executable, words)  # noqa: S606 # our own program
        fcntl.ioctl(self.fd, termios.TIOCSWINSZ, struct.pack("HHHH", 48, 160, 0, 0))

    def until(self, *words: bytes) -> float:
        """Read until one of the words is drawn; returns how long that took [s].

        Raises:
            TimeoutError: none was.
        """
        began, heard = time.monotonic(), b""
        while not any(word in heard for word in words):
            if time.monotonic() > began + SHOWN:
                raise TimeoutError(words)
            if select.select([self.fd], [], [], 0.05)[0]:
                heard = heard[-4096:] + os.read(self.fd, 1 << 16)
        return time.monotonic() - began

    def rest(self, seconds: float) -> None:
        """Read on for a while."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            if select.select([self.fd], [], [], left)[0]:
                os.read(self.fd, 1 << 16)

    def end(self) -> None:
        """End it."""
        os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)
        os.close(self.fd)


def measure(proxy: int, times: int) -> list[float]:
    """Stop and wake the proxy of a robot; return how long each stop was not to be seen [s]."""
    screen, took = Screen(), list[float]()
    try:
        screen.until(b"arm-1")
        screen.rest(3.0)
        for number in range(times):
            screen.rest(SPREAD * (number % 7))
            os.kill(proxy, signal.SIGSTOP)
            try:
                took.append(screen.until(b"late", b"HANGS"))
            finally:
                os.kill(proxy, signal.SIGCONT)
            screen.rest(AWAKE)
    finally:
        screen.end()
    return sorted(took)


async def main() -> None:
    """Start a cell, and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--times", type=int, default=20)
    times = parser.parse_args().times
    with tempfile.TemporaryDirectory(prefix="rt-") as apart:
        os.environ.update(XDG_RUNTIME_DIR=apart, XDG_STATE_HOME=apart)
        async with Crew(REALM, Path(apart)) as crew:
            arm = await crew.start("sim", "arm", "--listen", "tcp:127.0.0.1:0", "--open")
            line = ("proxy", "arm", "arm-1", "--connect", arm.address, "--open")
            _, proxy = await crew.start_all(("lookup", "lookup-1"), line)
            took = await asyncio.to_thread(measure, proxy.pid, times)
    print(
        f"load {os.getloadavg()[0]:.1f}, {len(took)} stops: median {statistics.median(took):.2f} s, "
        f"at most {took[-1]:.2f} s, within 1 s {sum(seconds <= 1.0 for seconds in took)}"
    )


if __name__ == "__main__":
    asyncio.run(main())
