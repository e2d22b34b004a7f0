"""Three sites and two hubs of real processes, on whatever ground the system allows."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import time
from collections.abc import AsyncIterator, Callable, Sequence
from pathlib import Path

import msgspec

from robotree.vr.base.errors import VrError
from robotree.vr.network.local import join
from robotree.vr.sites.invitations import Hub
from robotree.vr.sites.joining import ask_authority
from robotree.vr.sites.keys import RealmKeys, create
from robotree.vr.supervision.realm_client import RealmClient
from tests.laboratory.ground import Ground

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


class Process:
    """One program of a machine."""

    def __init__(self, laboratory: Laboratory, machine: str, *words: str) -> None:
        self.machine, self.words, self._laboratory = machine, words, laboratory
        self.name = f"{words[0]}-{machine}" if machine in SITES else machine
        self.log = laboratory.folder / f"{self.name}.err"
        self.address = ""

    async def start(self) -> None:
        """Start it (again), and return when it is ready."""
        folder = self._laboratory.folder / self.machine
        with self.log.open("ab") as log:
            self.process = await asyncio.create_subprocess_exec(
                *self._laboratory.ground.prefix(self.machine),
                *(sys.executable, "-m", "robotree.tui", *self.words, "--tether"),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=log,
                env={
                    **os.environ,
                    "ROBOTREE_REALM": REALM,
                    "XDG_RUNTIME_DIR": str(folder / "run"),
                    "XDG_STATE_HOME": str(folder / "state"),
                    "EFFECTS": str(self._laboratory.effects),
                },
            )
        assert self.process.stdout is not None
        async with asyncio.timeout(READY):
            word, _, rest = (await self.process.stdout.readline()).decode().strip().partition(" ")
        assert word == "ready", f"{self.name}: {self.log.read_text()[-500:]}"
        self.address = rest

    def send(self, number: signal.Signals) -> None:
        self.process.send_signal(number)

    async def end(self) -> None:
        if self.process.returncode is None:
            self.process.kill()
        await self.process.wait()
        assert self.process.stdin is not None
        self.process.stdin.close()


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
            self.clients[site] = await self._stack.enter_async_context(self._joined(site))
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
            await process.end()
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
    async def _joined(self, site: str) -> AsyncIterator[RealmClient]:
        transport = await join(REALM, root=self.folder / site / "run" / "robotree")
        try:
            client = RealmClient(transport, REALM)
            await client.start()
            try:
                yield client
            finally:
                with contextlib.suppress(VrError):
                    await client.close()
        finally:
            await transport.close()
