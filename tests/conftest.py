"""What tests of several rooms need: a cable between two serial ports."""

from __future__ import annotations

import asyncio
import contextlib
import os
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest


class Cable:
    """A null-modem cable between two serial ports: two pseudo-terminals, whose far sides are joined here."""

    def __init__(self, folder: Path) -> None:
        self._loop = asyncio.get_running_loop()
        pairs = [os.openpty(), os.openpty()]
        self._masters = [master for master, _ in pairs]
        # Held open, so that a port that is closed by its program is not unplugged.
        self._ports = [port for _, port in pairs]
        self.devices = [folder / "near", folder / "far"]
        for device, port in zip(self.devices, self._ports, strict=True):
            tty.setraw(port)
            device.symlink_to(os.ttyname(port))
        for here, there in (self._masters, self._masters[::-1]):
            os.set_blocking(here, False)
            self._loop.add_reader(here, self._carry, here, there)

    def url(self, end: int, options: str = "?baud=4000000") -> str:
        return f"serial:{self.devices[end]}{options}"

    def _carry(self, here: int, there: int) -> None:
        with contextlib.suppress(BlockingIOError):
            rest = os.read(here, 1024)
            while rest:  # a real line would not wait either, but the laws are about the link
                rest = rest[os.write(there, rest) :]

    def pull(self) -> None:
        """Unplug both adapters: their devices are gone. Twice is once."""
        if not self._masters:
            return
        for master in self._masters:
            self._loop.remove_reader(master)
        for descriptor in (*self._masters, *self._ports):
            os.close(descriptor)
        for device in self.devices:
            device.unlink()
        self._masters, self._ports = [], []


@pytest.fixture
def make_cable(tmp_path: Path) -> Iterator[Callable[[], Cable]]:
    """Lays a cable between the devices `near` and `far`; a new one after the old one was pulled."""
    cables: list[Cable] = []

    def make() -> Cable:
        cables.append(Cable(tmp_path))
        return cables[-1]

    yield make
    for cable in cables:
        cable.pull()
