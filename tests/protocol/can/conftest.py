"""A bus of its own for every test, addresses on it, and other processes."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from itertools import count
from subprocess import PIPE, Popen

import can
import pytest

from robotree.protocol.links.can import CanAddress
from robotree.protocol.links.can import host as can_host

_COUNT = count()
Spawn = Callable[..., "Popen[str]"]


@pytest.fixture
def channel() -> str:
    """The name of a channel that nobody else uses."""
    return f"test-{os.getpid()}-{next(_COUNT)}"


@pytest.fixture
def spawn() -> Iterator[Spawn]:
    """Starts Python processes that end with the test: `spawn("-c", source, *arguments)`."""
    started: list[Popen[str]] = []

    def start(*words: str) -> Popen[str]:
        process = Popen([sys.executable, *words], stdin=PIPE, stdout=PIPE, text=True)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def buses(channel: str) -> Iterator[Callable[..., can.BusABC]]:
    """Opens members of the test's channel, which leave at its end."""
    opened: list[can.BusABC] = []

    def open_bus(**options: object) -> can.BusABC:
        bus = can.Bus(interface="robotree", channel=channel, **options)  # type: ignore[arg-type]  # passed on
        opened.append(bus)
        return bus

    yield open_bus
    for bus in opened:
        bus.shutdown()


@pytest.fixture(params=["robotree, fd", "robotree, classic", "virtual, fd", "virtual, classic"])
def address(request: pytest.FixtureRequest, channel: str) -> CanAddress:
    """An interface that is used from the event loop, and one that needs threads."""
    interface, _, kind = request.param.partition(", ")
    return CanAddress(interface=interface, channel=channel, fd=kind == "fd")


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody will answer: who connects does not wait for long."""
    monkeypatch.setattr(can_host, "CONNECT_TIMEOUT", 0.3)


@pytest.fixture
def here(channel: str) -> CanAddress:
    return CanAddress(interface="robotree", channel=channel)
