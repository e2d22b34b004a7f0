"""How soon a screen shows that a process does not answer: from SIGSTOP to `late` or `HANGS`.

    python bench/late.py [--times N]

A real proxy of a simulated arm is stopped at moments spread over its beat; the full screen runs in a terminal
of its own (a pty), as a person sees it.
"""

from __future__ import annotations

import asyncio
import os
import signal
import statistics
import time

from measuring import Terminal, apart, options

from robotree.tui.processes.crew import Crew

REALM = "late"
SHOWN = 30.0
"""[s] within which everything must be there."""
AWAKE = 2.5
"""[s] after which a woken process is shown as it was."""
SPREAD = 0.037
"""[s] by which each stop is later within the beat than the one before."""


def until(screen: Terminal, *words: bytes) -> float:
    """Read until one of the words is drawn; returns how long that took [s].

    Raises:
        TimeoutError: none was.
    """
    began, heard = time.monotonic(), b""
    while not any(word in heard for word in words):
        if time.monotonic() > began + SHOWN:
            raise TimeoutError(words)
        heard = heard[-4096:] + screen.read(0.05)
    return time.monotonic() - began


def measure(proxy: int, times: int) -> list[float]:
    """Stop and wake the proxy of a robot; return how long each stop was not to be seen [s]."""
    screen, took = Terminal(("-m", "robotree.tui"), (160, 48)), list[float]()
    try:
        until(screen, b"arm-1")
        screen.drain(3.0)
        for number in range(times):
            screen.drain(SPREAD * (number % 7))
            os.kill(proxy, signal.SIGSTOP)
            try:
                took.append(until(screen, b"late", b"HANGS"))
            finally:
                os.kill(proxy, signal.SIGCONT)
            screen.drain(AWAKE)
    finally:
        screen.end()
    return sorted(took)


async def main() -> None:
    """Start a cell, and print the figures."""
    times = options(__doc__, times=20).times
    with apart(REALM) as folder:
        async with Crew(REALM, folder) as crew:
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
