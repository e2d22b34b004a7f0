"""What a laboratory stands on: machines with lines between them that delay, lose, and can be cut.

Where the system allows it, each machine is a network namespace of its own at one bridge, and a cut takes a
port of the bridge down. `tc netem` delays there, if the kernel has it; else relays on the bridge do. Where
namespaces are not allowed, the machines are folders of one, on loopback, and relays do both.
"""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import socket
import subprocess
from collections.abc import Sequence
from typing import Protocol

from robotree.tui.sites.slow_line import SlowLine
from tests import apart

ROAD = "10.77.0"
"""Addresses of the machines, without their last number; they are seen in these namespaces alone."""

CARRIES_WITHIN = 30.0
"""[s] for a port of a bridge to carry again: usually up to one."""


class Ground(Protocol):
    """Machines, and lines between each site and each hub."""

    name: str

    async def open(self, sites: Sequence[str], hubs: Sequence[str]) -> None:
        """Make the machines."""
        ...

    def prefix(self, machine: str) -> list[str]:
        """Return the words that start a process on a machine."""
        ...

    def listens(self, hub: str) -> str:
        """Return where a hub listens, as HOST:PORT."""
        ...

    async def dials(self, site: str, hub: str) -> str:
        """Return where a site reaches a hub, as HOST:PORT."""
        ...

    async def cut(self, site: str) -> None:
        """Have nothing reach a site or leave it any more."""
        ...

    async def mend(self, site: str) -> None:
        """Carry again; returns when it does."""
        ...

    async def close(self) -> None:
        """End what was made."""
        ...


class Loopback:
    """One machine, with relays."""

    name = "loopback"

    def __init__(self, delay: float, loss: float, rate: float) -> None:
        self._delay, self._loss, self._rate = delay, loss, rate
        self._ports: dict[str, str] = {}
        self._lines: dict[tuple[str, str], SlowLine] = {}

    async def open(self, sites: Sequence[str], hubs: Sequence[str]) -> None:
        del sites
        for hub in hubs:
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                self._ports[hub] = f"127.0.0.1:{free.getsockname()[1]}"

    def prefix(self, machine: str) -> list[str]:
        del machine
        return []

    def listens(self, hub: str) -> str:
        return self._ports[hub]

    async def dials(self, site: str, hub: str) -> str:
        host, _, port = self._ports[hub].partition(":")
        line = SlowLine(host, int(port), delay=self._delay, loss=self._loss, rate=self._rate)
        self._lines[site, hub] = line
        return f"127.0.0.1:{await line.open()}"

    async def cut(self, site: str) -> None:
        for (one, _), line in self._lines.items():
            if one == site:
                line.cut()

    async def mend(self, site: str) -> None:
        for (one, _), line in self._lines.items():
            if one == site:
                line.mend()

    async def close(self) -> None:
        for line in self._lines.values():
            await line.close()


class Namespaces:
    """A network namespace for each machine, at one bridge; this process must be apart (`tests.apart`)."""

    name = "namespaces"

    def __init__(self, delay: float, loss: float, rate: float) -> None:
        self._delay, self._loss, self._rate = delay, loss, rate
        self._holders: dict[str, subprocess.Popen[bytes]] = {}
        self._addresses: dict[str, str] = {}
        self._lines: list[SlowLine] = []
        self.netem = False

    async def open(self, sites: Sequence[str], hubs: Sequence[str]) -> None:
        for words in ("link add road type bridge", f"addr add {ROAD}.254/24 dev road", "link set road up"):
            await asyncio.to_thread(_ip, words)
        for number, name in enumerate((*sites, *hubs), 1):
            self._addresses[name] = f"{ROAD}.{number}"
            await asyncio.to_thread(self._make, name)
        for name in self._holders:
            await _carries(name)
        self.netem = await asyncio.to_thread(self._try_netem, sites)

    def _make(self, name: str) -> None:
        """Make a machine with a network of its own, and lay its line to the road."""
        holder = subprocess.Popen(  # it says so when its network is its own
            [_tool("unshare"), "--net", "sh", "-c", "echo; exec cat"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        self._holders[name] = holder
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"\n"
        _ip(f"link add to-{name} type veth peer name line netns {holder.pid}")
        _ip(f"link set to-{name} master road up")
        for words in (f"addr add {self._addresses[name]}/24 dev line", "link set line up", "link set lo up"):
            subprocess.run([*self.prefix(name), _tool("ip"), *words.split()], check=True)

    def prefix(self, machine: str) -> list[str]:
        return [_tool("nsenter"), f"--net=/proc/{self._holders[machine].pid}/ns/net", "--"]

    def listens(self, hub: str) -> str:
        return f"{self._addresses[hub]}:7447"

    async def dials(self, site: str, hub: str) -> str:
        del site
        if self.netem:
            return self.listens(hub)
        line = SlowLine(self._addresses[hub], 7447, delay=self._delay, loss=self._loss, rate=self._rate)
        self._lines.append(line)
        return f"{ROAD}.254:{await line.open(f'{ROAD}.254')}"

    async def cut(self, site: str) -> None:
        await asyncio.to_thread(_ip, f"link set to-{site} down")

    async def mend(self, site: str) -> None:
        await asyncio.to_thread(_ip, f"link set to-{site} up")
        await _carries(site)

    async def close(self) -> None:
        for line in self._lines:
            await line.close()
        for holder in self._holders.values():
            holder.kill()
            await asyncio.to_thread(holder.communicate)

    def _try_netem(self, sites: Sequence[str]) -> bool:
        """Have the kernel delay, where it can."""
        how = f"delay {self._delay * 1e3:g}ms loss {self._loss * 100:g}%"
        how += f" rate {self._rate:g}bit" if self._rate else ""
        for site in sites:
            for inside, device in (([], f"to-{site}"), (self.prefix(site), "line")):
                words = [*inside, _tool("tc"), "qdisc", "add", "dev", device, "root", "netem", *how.split()]
                if subprocess.run(words, capture_output=True, check=False).returncode != 0:
                    return False
        return True


def best(delay: float, loss: float, rate: float = 0.0) -> Ground:
    """Return the ground that this system allows; this process may be in namespaces of its own after it."""
    tools = all(map(shutil.which, ("ip", "tc", "nsenter", "unshare")))
    if os.geteuid() == 0 and tools:
        try:
            apart.enter(network=True)
            _ip("link add trial type bridge")
            _ip("link add trial-1 type veth peer name trial-2")
            _ip("link del trial-1")
            _ip("link del trial")
        except (OSError, subprocess.CalledProcessError):
            pass
        else:
            return Namespaces(delay, loss, rate)
    return Loopback(delay, loss, rate)


def _ip(words: str) -> None:
    subprocess.run([_tool("ip"), *words.split()], check=True, capture_output=True)


def _tool(name: str) -> str:
    """Return the path of a program of the system."""
    found = shutil.which(name)
    assert found is not None, name
    return found


async def _carries(name: str) -> None:
    """Wait until a port of the bridge forwards."""

    def forwards() -> bool:
        shown = subprocess.run(
            [_tool("ip"), "-d", "-j", "link", "show", f"to-{name}"],
            capture_output=True,
            check=True,
            text=True,
        )
        return json.loads(shown.stdout)[0]["linkinfo"]["info_slave_data"]["state"] == "forwarding"

    latest = asyncio.get_running_loop().time() + CARRIES_WITHIN
    while not await asyncio.to_thread(forwards):
        assert asyncio.get_running_loop().time() < latest, f"the port of {name} does not forward"
        await asyncio.sleep(0.05)
