"""Three sites and two hubs of real processes, on whatever ground the system allows.

Where the system allows it, each machine is a network namespace of its own at one bridge, and a cut takes a
port of the bridge down. `tc netem` delays there, if the kernel has it; else relays on the bridge do. Where
namespaces are not allowed, the machines are folders of one, on loopback, and relays do both.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import subprocess
import time
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path

import msgspec

from robotree.tui.sites.slow_line import SlowLine
from robotree.vr.base.errors import VrError
from robotree.vr.network.local import join
from robotree.vr.sites.invitations import Hub
from robotree.vr.sites.joining import ask_authority
from robotree.vr.sites.keys import RealmKeys, create
from robotree.vr.supervision.realm_client import RealmClient
from tests import apart
from tests.command_line import ran
from tests.durability.stage import Program
from tests.ports import free_port

ROAD = "10.77.0"
"""Addresses of the machines, without their last number; they are seen in these namespaces alone."""

CARRIES_WITHIN = 30.0
"""[s] for a port of a bridge to carry again: usually up to one."""


class Loopback:
    """One machine, with relays."""

    name = "loopback"

    def __init__(self, delay: float, loss: float, rate: float) -> None:
        self._delay, self._loss, self._rate = delay, loss, rate
        self._ports: dict[str, str] = {}
        self._lines: dict[tuple[str, str], SlowLine] = {}

    async def open(self, sites: Sequence[str], hubs: Sequence[str]) -> None:
        """Make the machines."""
        del sites
        for hub in hubs:
            self._ports[hub] = f"127.0.0.1:{free_port()}"

    def prefix(self, machine: str) -> list[str]:
        """Return the words that start a process on a machine."""
        del machine
        return []

    def listens(self, hub: str) -> str:
        """Return where a hub listens, as HOST:PORT."""
        return self._ports[hub]

    async def dials(self, site: str, hub: str) -> str:
        """Return where a site reaches a hub, as HOST:PORT."""
        host, _, port = self._ports[hub].partition(":")
        line = SlowLine(host, int(port), delay=self._delay, loss=self._loss, rate=self._rate)
        self._lines[site, hub] = line
        return f"127.0.0.1:{await line.open()}"

    async def cut(self, site: str) -> None:
        """Have nothing reach a site or leave it any more."""
        for line in self._lines_of(site):
            line.cut()

    async def mend(self, site: str) -> None:
        """Carry again; returns when it does."""
        for line in self._lines_of(site):
            line.mend()

    def _lines_of(self, site: str) -> list[SlowLine]:
        return [line for (one, _), line in self._lines.items() if one == site]

    async def close(self) -> None:
        """End what was made."""
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


Ground = Loopback | Namespaces
"""Machines, and lines between each site and each hub."""


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
        shown = ran([_tool("ip"), "-d", "-j", "link", "show", f"to-{name}"], check=True)
        return json.loads(shown.stdout)[0]["linkinfo"]["info_slave_data"]["state"] == "forwarding"

    latest = asyncio.get_running_loop().time() + CARRIES_WITHIN
    while not await asyncio.to_thread(forwards):
        assert asyncio.get_running_loop().time() < latest, f"the port of {name} does not forward"
        await asyncio.sleep(0.05)


REALM = "laboratory"
SITES, HUBS = ("lab", "hall", "yard"), ("hub-1", "hub-2")
PAGES = Path(__file__).with_name("pages.py")
READY = 60.0
"""[s] for a process to come up, or for all to see all, on a busy machine."""

ROBOTS = {
    "lab": ("cell-lab", "leaf-lab", "chief", "open-lab"),
    "hall": ("cell-hall", "leaf-hall", "far"),
    "yard": ("cell-yard", "leaf-yard"),
}
"""`chief` of lab commands `far` of hall; a person at yard `open-lab`; each cell the leaf of its site."""


class Process(Program):
    """One program of a machine."""

    def __init__(self, laboratory: Laboratory, machine: str, *words: str) -> None:
        name = f"{words[0]}-{machine}" if machine in SITES else machine
        super().__init__(laboratory.folder, REALM, name, "-m", "robotree.tui", *words, "--tether")
        self.prefix = laboratory.ground.prefix(machine)
        folder = laboratory.folder / machine
        self.environment |= {
            "XDG_RUNTIME_DIR": str(folder / "run"),
            "XDG_STATE_HOME": str(folder / "state"),
            "EFFECTS": str(laboratory.effects),
        }


class Laboratory:
    """See the module."""

    def __init__(self, folder: Path, ground: Ground) -> None:
        self.folder, self.ground = folder, ground
        self.effects = folder / "effects"
        self.processes: dict[str, Process] = {}
        self.clients: dict[str, RealmClient] = {}
        """One at each site."""
        self._stack = contextlib.AsyncExitStack()

    async def open(self) -> None:
        """Start everything; all see all then, and the trees stand."""
        await self.ground.open(SITES, HUBS)
        for machine in (*SITES, *HUBS):
            for part in ("run", "state"):
                (self.folder / machine / part).mkdir(mode=0o700, parents=True)
        await self._all(
            [Process(self, hub, "hub", "--listen", f"tls:{self.ground.listens(hub)}") for hub in HUBS]
        )
        first = await asyncio.to_thread(self._create, await self._hubs(SITES[0]))
        await self._all([Process(self, SITES[0], "gateway")])
        for site in SITES[1:]:
            invitation = first.invite(site, "site", now=time.time())
            there = msgspec.structs.replace(invitation, hubs=await self._hubs(site))
            await asyncio.to_thread(self._join, site, there)
        await self._all(
            [Process(self, site, "gateway") for site in SITES[1:]]
            + [Process(self, site, "lookup", f"lookup-{site}") for site in SITES]
            + [Process(self, site, "host", f"host-{site}") for site in SITES]
        )
        for site in SITES:
            self.clients[site] = await self._stack.enter_async_context(
                joined_in(self.folder / site / "run", REALM)
            )
        await self.until(self.sees_hosts, "all hosts are seen")
        for site in SITES:
            client = self.clients[site]
            for robot in ROBOTS[site]:
                kind = "Cell" if robot.startswith(("cell", "chief")) else "Leaf"
                await client.create(str(PAGES), robot, f"host-{site}", kind)
            await client.enslave(f"cell-{site}", "leaf", f"leaf-{site}")
        await self.until(lambda: not self.missing(), "all see all robots")
        await self.clients["lab"].enslave("chief", "leaf", "far")

    async def close(self) -> None:
        await self._stack.aclose()
        for process in reversed(self.processes.values()):
            await process.kill()
        await self.ground.close()

    def missing(self) -> list[str]:
        """Return what is not seen where: `SITE ROBOT`."""
        return [
            f"{site} sees no {robot}"
            for site, client in self.clients.items()
            for robots in ROBOTS.values()
            for robot in robots
            if not client.directory.present("robot", robot)
        ]

    def sees_hosts(self) -> bool:
        return all(
            client.directory.present("host", f"host-{site}")
            for client in self.clients.values()
            for site in SITES
        )

    async def until(self, holds: Callable[[], bool], what: str, within: float = READY) -> float:
        """Wait until something is the case; returns how long it took [s]."""
        begin = time.monotonic()
        while not holds():
            assert time.monotonic() - begin < within, f"{what}: {self.missing()[:4]}"
            await asyncio.sleep(0.02)
        return time.monotonic() - begin

    # -- inside -----------------------------------------------------------------------------------

    async def _all(self, processes: Sequence[Process]) -> None:
        self.processes |= {process.name: process for process in processes}
        await asyncio.gather(*(process.start() for process in processes))

    async def _hubs(self, site: str) -> tuple[Hub, ...]:
        found = list[Hub]()
        for name in HUBS:
            fingerprint = self.processes[name].address.partition("#")[2]
            found.append(Hub(f"tls:{await self.ground.dials(site, name)}", fingerprint))
        return tuple(found)

    def _create(self, hubs: tuple[Hub, ...]) -> RealmKeys:
        return create(self._keys(SITES[0]), REALM, SITES[0], hubs, now=time.time())

    def _join(self, site: str, invitation: object) -> None:
        ask_authority(self._keys(site), invitation, now=time.time())  # type: ignore[arg-type]

    def _keys(self, site: str) -> Path:
        folder = self.folder / site / "state" / "robotree" / REALM
        folder.mkdir(mode=0o700, parents=True)
        folder.parent.chmod(0o700)
        return folder / "keys"


@contextlib.asynccontextmanager
async def joined_in(folder: Path, realm: str) -> AsyncIterator[RealmClient]:
    """Join a realm at a machine, whose runtime folder this is."""
    transport = await join(realm, root=folder / "robotree")
    client = RealmClient(transport, realm)
    try:
        await client.start()
        yield client
    finally:
        with contextlib.suppress(VrError):
            await client.close()
        await transport.close()
