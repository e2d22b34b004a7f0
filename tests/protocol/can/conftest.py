"""A bus of its own for every test, addresses on it, and other processes."""

from __future__ import annotations

import os
import socket
import sys
from collections.abc import Callable, Iterator
from itertools import cycle
from subprocess import PIPE, Popen

import can
import pytest

from robotree.protocol.canbus import SEATS
from robotree.protocol.canbus.membership import HOST
from robotree.protocol.links.can import CanAddress
from robotree.protocol.links.can import host as can_host

_WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_WORKERS = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
_ROWS = cycle(range(10_000 + SEATS * _WORKER, 17_000 - SEATS, SEATS * _WORKERS))
"""Rows of ports that no other worker of the tests uses, below those of named channels."""
Spawn = Callable[..., "Popen[str]"]


@pytest.fixture
def channel() -> str:
    """A channel that nobody else uses: a row of ports, the first of which is free."""
    return str(next(first for first in _ROWS if _is_free(first)))


def _is_free(port: int) -> bool:
    try:
        with socket.create_server((HOST, port)):
            return True
    except OSError:
        return False


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
