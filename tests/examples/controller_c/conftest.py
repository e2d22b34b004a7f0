"""The controller in C, compiled as its README says and with sanitizers, and who speaks to it."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Self, TypeVar

import pytest

from robotree.protocol.frame import encode
from robotree.protocol.messages import (
    AnyMessage,
    Goal,
    GoalCancel,
    GoalState,
    GoalStatus,
    LocalPositionNed,
    Message,
    Mode,
    ModeKind,
    Reason,
    SetMode,
    Verb,
)
from robotree.protocol.parser import Parser
from robotree.protocol.services.goal_client import padded
from tests.examples.controllers import started

OWN = os.environ.get("ROBOTREE_CONTROLLER")
"""A program that takes the same words, to be examined in place of the example."""
PATIENCE = 30.0
"""[s] after which what has not come will not come."""
T = TypeVar("T", bound=Message)


@pytest.fixture(scope="session")
def program(controller_c: Path) -> Path:
    return Path(OWN).resolve() if OWN else controller_c


@contextmanager
def powered(program: Path, port: int = 0) -> Iterator[int]:
    """The controller runs inside the block; its port. It must neither end nor complain by itself."""
    with started([program, str(port)]) as running:
        yield int(running.url.rpartition(":")[2])


@pytest.fixture(scope="session")
def power(program: Path) -> Callable[..., AbstractContextManager[int]]:
    return partial(powered, program)


@pytest.fixture
def port(program: Path) -> Iterator[int]:
    with powered(program) as port:
        yield port


class Operator:
    """Speaks with the controller in MAVLink, without a proxy."""

    def __init__(self, port: int, system: int = 255) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
        self.system, self._parser, self._heard = system, Parser(), list[Any]()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def say(self, message: AnyMessage) -> None:
        self.socket.sendall(encode(message, sequence=0, system=self.system, component=190))

    def next(self) -> AnyMessage:
        """The next message, whatever it is."""
        while not self._heard:
            data = self.socket.recv(65536)
            assert data, "the controller hung up"
            self._heard += [frame.message for frame in self._parser.feed(data)]
        message: AnyMessage = self._heard.pop(0)
        return message

    def hear(self, kind: type[T], such: Callable[[T], bool] = lambda _: True) -> T:
        """The next message of a kind that is such; what came before it is dropped."""
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            message = self.next()
            if isinstance(message, kind) and such(message):
                return message
        pytest.fail(f"no such {kind.__name__} came within {PATIENCE:g} s")

    def ask(self, key: int, *args: float, verb: int = Verb.MOVE, epoch: int = 1, ttl: int = 0) -> GoalStatus:
        """Send a goal; its next status."""
        self.say(Goal(key, epoch, ttl, padded(args), verb, 1, 1))
        return self.status(key)

    def cancel(self, key: int, epoch: int = 1) -> GoalStatus:
        self.say(GoalCancel(key, epoch, 1, 1))
        return self.status(key)

    def status(self, key: int, *states: GoalState) -> GoalStatus:
        return self.hear(
            GoalStatus,
            lambda it: (
                it.key == key and it.target_system == self.system and (not states or it.state in states)
            ),
        )

    def set_mode(self, mode: ModeKind, epoch: int = 1) -> Mode:
        self.say(SetMode(epoch, 1, 1, mode))
        return self.hear(Mode, lambda it: mode in {it.mode, ModeKind.READY} or it.reason > Reason.NONE)

    def place(self) -> tuple[float, float]:
        position = self.hear(LocalPositionNed)
        return position.x, -position.y


@pytest.fixture
def operator(port: int) -> Iterator[Operator]:
    with Operator(port) as operator:
        yield operator


@pytest.fixture
def make_operator() -> type[Operator]:
    return Operator
