"""Machines of their own on one: folders and processes of two sites and a hub, as people start them."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import pytest

from robotree.client.blocking import Realm, connect
from robotree.tui.exit_codes import DONE
from robotree.vr.base.errors import VrError
from tests.command_line import ROBOTREE, ran
from tests.ports import free_port

EXAMPLES = Path(__file__).parents[1] / "examples"
LINKED = 60.0
"""[s] for two gateways to find each other on a busy machine."""


PARTS = (("XDG_RUNTIME_DIR", "run"), ("XDG_STATE_HOME", "state"), ("XDG_CONFIG_HOME", "config"))


class Machine:
    """A machine: a user's folders of its own, and what runs there."""

    def __init__(self, folder: Path, name: str) -> None:
        self.name, self.running = name, dict[str, subprocess.Popen[str]]()
        self.environment = {**os.environ, "ROBOTREE_REALM": "plant"}
        for variable, part in PARTS:
            path = folder / name / part
            path.mkdir(mode=0o700, parents=True)
            self.environment[variable] = str(path)

    def start(self, called: str, *words: str) -> str:
        """Start an agent; return what it says when it is ready."""
        process = subprocess.Popen(
            [*ROBOTREE, *words, "--tether"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=self.environment,
        )
        self.running[called] = process
        assert process.stdout
        word, _, rest = process.stdout.readline().strip().partition(" ")
        assert word == "ready", words
        return rest

    def end(self, called: str, sign: signal.Signals = signal.SIGTERM) -> None:
        process = self.running.pop(called)
        process.send_signal(sign)
        assert process.stdin
        assert process.stdout
        process.wait(60)
        process.stdin.close()
        process.stdout.close()

    def say(self, *words: str, code: int = DONE) -> Any:
        """Say a line; return the plain data that it prints last."""
        done = self._run(*words, "--json", within=60)
        assert done.returncode == code, (words, done.stdout, done.stderr)
        return json.loads(done.stdout.strip().splitlines()[-1])

    def text(self, *words: str) -> str:
        """Say a line; return what it prints for people, and nothing if it is refused."""
        done = self._run(*words, within=120)
        return done.stdout if done.returncode == DONE else ""

    def _run(self, *words: str, within: float) -> subprocess.CompletedProcess[str]:
        return ran([*ROBOTREE, *words], within=within, env=self.environment)

    @contextlib.contextmanager
    def joined(self) -> Generator[Realm]:
        """Be in its realm with this process: to ask often is cheaper so than by lines."""
        with pytest.MonkeyPatch.context() as environment:
            for variable, _ in PARTS:
                environment.setenv(variable, self.environment[variable])
            realm = connect(self.environment["ROBOTREE_REALM"])
        with realm:
            yield realm

    def until(self, holds: Callable[[Realm], object], sentence: str) -> None:
        """Wait until something is so in its realm; nothing is so while its question has no answer."""
        latest = time.monotonic() + 2 * LINKED
        with self.joined() as realm:
            while True:
                with contextlib.suppress(VrError):
                    if holds(realm):
                        return
                assert time.monotonic() < latest, f"in vain: {sentence}"
                time.sleep(0.1)

    def until_listed(self, name: str, *, there: bool = True) -> None:
        self.until(
            lambda realm: (name in {one.address.name for one in realm.ls()}) == there,
            f"{name} is listed: {there}",
        )


class Plant:
    """A hub, and the sites lab, where the realm was made, and hall."""

    def __init__(self, folder: Path) -> None:
        self.hub, self.lab, self.hall, self.desk = (
            Machine(folder, name) for name in ("hub", "lab", "hall", "desk")
        )
        self.port, self.token = free_port(), ""

    @property
    def machines(self) -> tuple[Machine, ...]:
        return self.hub, self.lab, self.hall, self.desk

    def start_hub(self) -> str:
        return self.hub.start("hub", "hub", "--listen", f"tls:127.0.0.1:{self.port}")
