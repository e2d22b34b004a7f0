"""Other users of this machine, for tests that run as root: real processes with numbers that nobody has.

The interpreter of the tests may lie where only root can read. So one process of root loads all modules, and
forks a child for each line, which becomes the user: it has no more rights than any other one.
"""

from __future__ import annotations

import codecs
import contextlib
import importlib
import itertools
import json
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest

from robotree.files import forks

ROOT = Path(__file__).parents[1]
only_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can play other users")
ROOMS = ("files", "vr", "client", "kinds", "tui")


class Machine:
    """Where they live: a folder that everybody can enter, and the process that becomes each of them."""

    def __init__(self, place: Path) -> None:
        """Begin with nobody."""
        self.place, self.running = place, set[int]()
        self._numbers = itertools.count()
        self._helper = subprocess.Popen(
            [sys.executable, "-m", "tests.users"],
            cwd=ROOT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ask(self, **request: Any) -> Any:
        """Have the helper do something."""
        assert self._helper.stdin is not None
        assert self._helper.stdout is not None
        self._helper.stdin.write(json.dumps(request) + "\n")
        self._helper.stdin.flush()
        return json.loads(self._helper.stdout.readline())

    def output(self) -> Path:
        """Return a new file for what a process says."""
        path = self.place / f"said-{next(self._numbers)}"
        path.touch()
        return path

    def close(self) -> None:
        """End all processes that still run."""
        for process in self.running:
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        self._helper.communicate()


class Running:
    """One process of a user."""

    def __init__(self, machine: Machine, process: int, output: Path) -> None:
        """Take the process."""
        self._machine, self.process, self._output = machine, process, output
        machine.running.add(process)

    @property
    def said(self) -> str:
        """What it has said so far."""
        return self._output.read_text()

    def wait(self) -> int:
        """Wait for its end; returns its exit code."""
        self._machine.running.discard(self.process)
        return int(self._machine.ask(wait=self.process))

    def end(self) -> int:
        """End it in order."""
        os.kill(self.process, signal.SIGTERM)
        return self.wait()


class MachineUser:
    """One user, with a home."""

    def __init__(self, machine: Machine, number: int, *groups: int) -> None:
        """Make the home.

        Args:
            machine: where it is.
            number: of the user; nobody has it.
            groups: of the user, beside its own.
        """
        self._machine, self.number, self.groups = machine, number, groups
        self.home = machine.place / str(number)
        self.home.mkdir(mode=0o700)
        os.chown(self.home, number, number)

    def start(self, *words: str, does: str = "robotree.tui.cli:main") -> Running:
        """Start a line, or something else that takes words."""
        output = self._machine.output()
        process = self._machine.ask(
            user=self.number,
            groups=self.groups,
            home=str(self.home),
            words=words,
            does=does,
            output=str(output),
        )
        return Running(self._machine, process, output)

    def say(self, *words: str, does: str = "robotree.tui.cli:main") -> tuple[int, str]:
        """Carry out a line; returns its exit code and what it said."""
        running = self.start(*words, does=does)
        return running.wait(), running.said


@contextlib.contextmanager
def machine_of_users(place: Path) -> Generator[Callable[..., MachineUser]]:
    """See what makes users, with numbers of their own.

    Args:
        place: a folder that everybody can enter.
    """
    machine = Machine(place)
    try:
        yield lambda number, *groups: MachineUser(machine, number, *groups)
    finally:
        machine.close()


# -- the helper ------------------------------------------------------------------------------------


def _load() -> None:
    """Load all modules, so that who cannot read them later need not."""
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            if "screen" in name or "__main__" in name:
                continue
            with contextlib.suppress(ImportError):  # what needs an extra
                importlib.import_module(f"robotree.{name}")


def _be(request: dict[str, Any]) -> None:
    """Be a user from now on, in a new process."""
    forks.be_process()
    home = request["home"]
    for name in [name for name in os.environ if name.startswith(("XDG_", "ROBOTREE"))]:
        del os.environ[name]
    os.environ |= {"HOME": home, "XDG_STATE_HOME": f"{home}/s", "XDG_RUNTIME_DIR": f"{home}/r"}
    output = os.open(request["output"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.setgroups(request["groups"])
    os.setresgid(request["user"], request["user"], request["user"])
    os.setresuid(request["user"], request["user"], request["user"])
    os.chdir(home)
    os.umask(0o077)


def main() -> None:
    """Take requests until nobody asks any more."""
    _load()
    for encoding in ("utf-8-sig", "ascii", "latin-1", "idna"):
        codecs.lookup(encoding)
    for line in sys.stdin:
        request = json.loads(line)
        if "wait" in request:
            _, status = os.waitpid(request["wait"], 0)
            sys.stdout.write(f"{os.waitstatus_to_exitcode(status)}\n")
            sys.stdout.flush()
            continue
        file, _, name = request["does"].partition(":")
        action = getattr(importlib.import_module(file), name)
        process = os.fork()
        if process:
            sys.stdout.write(f"{process}\n")
            sys.stdout.flush()
            continue
        code = 1
        try:
            _be(request)
            code = action(request["words"]) or 0
        except SystemExit as end:
            code = int(end.code or 0)
        except BaseException:  # noqa: BLE001 # it is said, and the process ends
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)


if __name__ == "__main__":
    main()
