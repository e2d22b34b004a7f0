"""What the benches share: a place apart, other processes, clocks, and what a process has used."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import fcntl
import os
import pty
import select
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import termios
import time
from collections.abc import Awaitable, Callable, Generator, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import zenoh

    from robotree.vr import Robot

Process = subprocess.Popen[str]
COUNTER = 9
"""Descriptor at which a program in a `Terminal` counts."""


@contextlib.contextmanager
def apart(realm: str = "bench") -> Generator[Path]:
    """Have a folder for all that the processes of a bench share, and its realm as the usual one."""
    with tempfile.TemporaryDirectory(prefix="rt-") as folder:
        os.environ.update(XDG_RUNTIME_DIR=folder, XDG_STATE_HOME=folder, ROBOTREE_REALM=realm)
        yield Path(folder)


def options(doc: str | None, **usual: float | str) -> argparse.Namespace:
    """Read the command line.

    Args:
        doc: of the bench, for its help.
        usual: the options, and what each is where it is not given.
    """
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, value in usual.items():
        option = f"--{name.replace('_', '-')}"
        if isinstance(value, bool):
            parser.add_argument(option, action="store_true")
        else:
            parser.add_argument(option, type=type(value), default=value)
    return parser.parse_args()


def count_given(place: int, usual: int) -> int:
    """Return a number of the command line, or what is usual where it does not stand."""
    return int(sys.argv[place]) if len(sys.argv) > place else usual


def start(*words: object, on: Iterable[str] = (), wait: bool = True) -> Process:
    """Start a program in Python as another process.

    Args:
        words: file and arguments.
        on: the words that start it somewhere else.
        wait: until it says that it is ready.
    """
    line = [*on, sys.executable, *map(str, words)]
    process = subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    if wait:
        heard(process)
    return process


def heard(process: Process) -> str:
    """Return the next line that another process says."""
    return "" if process.stdout is None else process.stdout.readline().strip()


def end(processes: Iterable[Process]) -> None:
    """End processes at once."""
    for process in processes:
        process.kill()
        process.communicate()


@contextlib.contextmanager
def started(*lines: tuple[object, ...]) -> Generator[list[Process]]:
    """Have other processes for the time of a block; see `start`."""
    processes = list[Process]()
    try:
        for words in lines:
            processes.append(start(*words))
        yield processes
    finally:
        end(processes)


def stay(word: str = "ready") -> None:
    """In another process: say that it is ready, and stay until its standard input ends."""
    print(word, flush=True)
    sys.stdin.read()


async def be_robot(robot: Robot, realm: str | None = None, *, listed: bool = False) -> None:
    """Be a process with one robot; with `listed` lookup services shall know it."""
    from robotree.vr.agents.agent import RobotAgent
    from robotree.vr.lookup.registrar import Registrar
    from robotree.vr.network.local import join

    transport = await join(realm)
    await RobotAgent(robot, transport, registrar=Registrar(transport) if listed else None).start()
    await asyncio.to_thread(stay)


def clock(call: Callable[[], object], repeats: int) -> list[float]:
    """Return how long each of many calls took [us]."""
    times = list[float]()
    for _ in range(repeats):
        began = time.perf_counter()
        call()
        times.append((time.perf_counter() - began) * 1e6)
    return times


async def clocked(repeats: int, call: Callable[[int], Awaitable[object]]) -> list[float]:
    """Return how long each of many calls took [s]; each has its number."""
    times = list[float]()
    for number in range(repeats):
        began = time.perf_counter()
        await call(number)
        times.append(time.perf_counter() - began)
    return times


async def until(holds: Callable[[], object]) -> None:
    """Wait until something holds that tells nobody, such as a table."""
    while not holds():  # noqa: ASYNC110 # as it says
        await asyncio.sleep(0.002)


def quantile(values: Iterable[float], share: float) -> float:
    """Return the value that such a share of all does not exceed."""
    ordered = sorted(values)
    return ordered[min(int(len(ordered) * share), len(ordered) - 1)]


def middle(values: Iterable[float], unit: str = "", digits: int = 1) -> str:
    """Return the text of a median, with the middle half and the most of all."""
    values = list(values)
    low, median, high = statistics.quantiles(values, n=4)
    return (
        f"{median:.{digits}f} {unit} ({low:.{digits}f} to {high:.{digits}f}, most {max(values):.{digits}f})"
    )


def tell(found: dict[str, float]) -> None:
    """Print figures by their names, and the load."""
    for name, value in {**found, "load": os.getloadavg()[0]}.items():
        print(f"{name:44} {value:12.3f}")


def imports(code: str, rounds: int) -> float:
    """Return the median processor time [s] of an import in a new process, beside Python's own start."""
    program = f"import time; began = time.process_time(); {code}; print(time.process_time() - began)"
    line = [sys.executable, "-c", program]
    took = (subprocess.run(line, capture_output=True, check=True).stdout for _ in range(rounds))
    return statistics.median(map(float, took))


def cpu(pid: int) -> float:
    """Return the processor time of a process so far [s]: utime and stime of proc_pid_stat(5)."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def ran(pid: int) -> float:
    """Return the time that the threads of a process have run so far [s], more exact than in ticks."""
    paths = Path(f"/proc/{pid}/task").glob("*/schedstat")
    return sum(int(path.read_text().split()[0]) for path in paths) / 1e9


def memory(pid: int) -> int:
    """Return the resident set of a process [bytes]: proc_pid_statm(5)."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


class Terminal:
    """A program in a terminal of its own."""

    def __init__(self, words: Iterable[str], size: tuple[int, int], *, counter: int = -1) -> None:
        """Start it.

        Args:
            words: what Python is given.
            size: columns and rows.
            counter: descriptor of a file that the program has as number `COUNTER`.
        """
        self.pid, self.fd = pty.fork()
        if self.pid == 0:
            if counter >= 0:
                os.dup2(counter, COUNTER)
                os.set_inheritable(COUNTER, True)  # dup2 does nothing where it has this number already
            os.environ.update(TERM="xterm-256color", COLORTERM="truecolor")
            os.execv(sys.executable, [sys.executable, *words])  # noqa: S606 # our own program
        fcntl.ioctl(self.fd, termios.TIOCSWINSZ, struct.pack("HHHH", size[1], size[0], 0, 0))

    def read(self, seconds: float) -> bytes:
        """Return what it writes next within a time; empty: nothing."""
        return os.read(self.fd, 1 << 16) if select.select([self.fd], [], [], max(seconds, 0.0))[0] else b""

    def drain(self, seconds: float, *, first: bool = False) -> tuple[int, float]:
        """Read for a while, or until the first bytes; returns how many came, and how long it took [s]."""
        began, count = time.monotonic(), 0
        while piece := self.read(began + seconds - time.monotonic()):
            count += len(piece)
            if first:
                break
        return count, time.monotonic() - began

    def end(self) -> None:
        """End it at once."""
        os.kill(self.pid, signal.SIGKILL)
        os.waitpid(self.pid, 0)
        os.close(self.fd)


def zenoh_peer(folder: str, *, listen: bool) -> zenoh.Config:
    """Return the settings of one of two peers over a Unix socket in a folder."""
    import zenoh

    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    here = f'["unixsock-stream/{folder}/zenoh"]'
    config.insert_json5("listen/endpoints", here if listen else "[]")
    config.insert_json5("connect/endpoints", "[]" if listen else here)
    return config
