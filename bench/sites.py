"""Calls between machines: through a hub and two gateways, against a bare Zenoh query through the same hub.

    python bench/sites.py [--rounds 6] [--robots 10,100,1000] [--lan]

With --lan each site and the hub are machines of their own at one bridge, where namespaces are allowed (as
root); without it all is on loopback.

Prints medians in turns of: a call on one machine, one through both gateways and the hub, a bare Zenoh query
of 200 bytes through the hub; how long a site needs to join; and, for numbers of robots on
10 sites, what an idle gateway takes in memory and on the line. What 100 sites with 1,000 robots each would
take is calculated from these.
"""

from __future__ import annotations

import asyncio
import datetime as dt
import logging
import os
import statistics
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import zenoh
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from measuring import apart, clock, end, memory, options, quantile, start, stay

from robotree.vr.base.envelope import seal
from robotree.vr.base.requests import Call
from robotree.vr.network.local import join
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.sites.frames import SiteStopped
from robotree.vr.sites.gateway import Gateway
from robotree.vr.sites.hub import address_of, certificate_in, configured, open_hub
from robotree.vr.sites.invitations import Hub, read_token, request_to_join, token_of
from robotree.vr.sites.joining import ask_authority
from robotree.vr.sites.keys import RealmKeys, create
from robotree.vr.sites.keys import join as join_realm_keys
from robotree.vr.sites.zenoh_pipe import ZenohPipe

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.laboratory.laboratory import Ground, Loopback, best
from tests.vr.sites.site import MemoryHub, MemoryPipe

BODY = bytes(200)
CALL = Call(key="k" * 18, command="step", arguments={"x": 1.0}, epoch=1, deadline=60.0)
KEY = "robot/echo/1"
WARM = 50
TURN = 200
"""Round trips of each way in a round."""
LONGEST = 60.0
"""[s] for anything here."""


def be_hub(address: str, folder: str) -> None:
    """Be a hub."""
    found = certificate_in(Path(folder), dt.datetime.now(dt.UTC))
    _session = open_hub(address_of(address), found)
    stay()


def be_gateway(root: str, keys: str) -> None:
    """Be the gateway of a site."""

    async def run() -> None:
        transport = await join("plant", root=Path(root))
        known = RealmKeys(Path(keys))
        gateway = Gateway(
            transport, ZenohPipe(known.hubs), known, ground=transport.mesh, stop_here=stop_nothing
        )
        await gateway.open()
        await asyncio.to_thread(stay)

    asyncio.run(run())


async def stop_nothing(order: str, reason: str) -> SiteStopped:
    """Stop the robots of a site that has none."""
    del order, reason
    return SiteStopped(0, [], [], [])


def be_robots(root: str, count: str) -> None:
    """Be present under some keys; the first one echoes."""
    mesh = Mesh(Rendezvous("plant", Path(root)))
    mesh.open()
    mesh.serve(KEY, lambda body, _sender, _urgent, _respond, end: end(body))
    for number in range(int(count)):
        mesh.announce(KEY if number == 0 else f"robot/r{number}/{os.getpid()}")
    stay()


def client(address: str, certificate: Path) -> zenoh.Session:
    """Open a bare client of the hub."""
    return zenoh.open(
        configured(
            {
                "mode": "client",
                "connect/endpoints": [address_of(address).endpoint],
                "scouting/multicast/enabled": False,
                "scouting/gossip/enabled": False,
                "transport/shared_memory/enabled": False,
                "transport/link/tls/root_ca_certificate": str(certificate),
                "transport/link/tls/verify_name_on_connect": False,
            }
        )
    )


def be_bare(address: str, certificate: str) -> None:
    """Answer a bare Zenoh query."""
    session = client(address, Path(certificate))
    session.declare_queryable(
        "bare/echo", zenoh.handlers.Callback(lambda query: query.reply("bare/echo", BODY), indirect=False)
    )
    stay()


def query(session: zenoh.Session) -> None:
    """Ask it."""
    over = threading.Event()
    handler = zenoh.handlers.Callback(lambda _: None, over.set, indirect=False)
    session.get("bare/echo", handler, payload=BODY, consolidation=zenoh.ConsolidationMode.NONE)
    if not over.wait(LONGEST):
        raise TimeoutError


def ask(mesh: Mesh) -> None:
    """Have a call answered by the echo."""
    over, got = threading.Event(), list[bytes]()
    sealed = seal(CALL, now=time.monotonic(), within=5.0)

    def hear(body: bytes | None) -> None:
        if body is None:
            over.set()
        else:
            got.append(body)

    mesh.ask(KEY, sealed.body, void_at=sealed.void_at, urgent=False, on_reply=hear)
    if not over.wait(LONGEST) or not got:
        raise TimeoutError


def until(holds: Callable[[], bool]) -> float:
    """Wait; returns how long it took [s]."""
    begin = time.perf_counter()
    while not holds():
        if time.perf_counter() - begin > LONGEST:
            raise TimeoutError
        time.sleep(0.002)
    return time.perf_counter() - begin


def realm_of(folder: Path, hubs: tuple[Hub, ...], names: list[str]) -> list[RealmKeys]:
    """Make the keys of a realm without a line."""
    now = time.time()
    found = [create(folder / names[0] / "keys", "plant", names[0], hubs, now=now)]
    for name in names[1:]:
        invitation = read_token(token_of(found[0].invite(name, "site", now=now)), now)
        key = Ed25519PrivateKey.generate()
        certificate = found[0].admit(request_to_join(invitation, key), now)
        found.append(join_realm_keys(folder / name / "keys", invitation, key, certificate, now=now))
    return found


def trips(folder: Path, rounds: int, ground: Ground) -> None:
    """Measure calls, and a join."""
    on = ground.prefix
    address = f"tls:{ground.listens('hub')}"
    certificate = certificate_in(folder / "tls", dt.datetime.now(dt.UTC))
    running = [start(__file__, "hub", address, folder / "tls", on=on("hub"))]
    hub = Hub(address, certificate.fingerprint)
    keys = realm_of(folder, (hub,), ["lab", "hall"])
    roots = {name: folder / f"run-{name}" for name in ("lab", "hall")}
    for root in roots.values():
        root.mkdir(mode=0o700)
    running += [
        start(__file__, "robots", roots["hall"], 1, on=on("hall")),
        start(__file__, "bare", address, certificate.certificate, on=on("hall")),
    ]
    running += [start(__file__, "gateway", roots[site.name], site.folder, on=on(site.name)) for site in keys]
    near, far = (Mesh(Rendezvous("plant", roots[name])) for name in ("hall", "lab"))
    for mesh in (near, far):
        mesh.open()
        until(lambda mesh=mesh: mesh.presence.there(KEY))
    session = client(address, certificate.certificate)
    ways: dict[str, Callable[[], object]] = {
        "call on one machine": lambda: ask(near),
        "call through gateways and hub": lambda: ask(far),
        "bare Zenoh query through the hub": lambda: query(session),
    }
    found = {name: list[float]() for name in ways}
    for turn in range(rounds + 1):
        for name, way in ways.items():
            times = clock(way, TURN)
            if turn:
                found[name] += times
    base = statistics.median(found["bare Zenoh query through the hub"])
    for name, times in found.items():
        p90, middle = quantile(times, 0.9), statistics.median(times)
        print(f"{name:36} p50 {middle:7.0f}  p90 {p90:7.0f} us   {middle / base:5.2f} x bare query")
    joins = list[float]()
    for number in range(5):
        invitation = keys[0].invite(f"new-{number}", "site", now=time.time())
        begin = time.perf_counter()
        ask_authority(folder / f"new-{number}" / "keys", invitation, now=time.time())
        joins.append(time.perf_counter() - begin)
    print(f"join, from the token to the certificate: median {statistics.median(joins):.2f} s")
    session.close()
    for mesh in (near, far):
        mesh.close().result(LONGEST)
    end(running[::-1])


async def on_ground(folder: Path, rounds: int, *, lan: bool) -> None:
    """Lay the ground, and measure on it."""
    ground = best(0.0, 0.0) if lan else Loopback(0.0, 0.0, 0.0)
    await ground.open(("lab", "hall"), ("hub",))
    print(f"on {ground.name}:")
    try:
        await asyncio.to_thread(trips, folder, rounds, ground)
    finally:
        await ground.close()


async def crowd(folder: Path, robots: int, sites: int) -> None:
    """Measure sites that know many robots: 10 gateways and 10 meshes in one process, over memory."""
    hub, names = MemoryHub(), [f"site-{number}" for number in range(sites)]
    keys = await asyncio.to_thread(realm_of, folder, (), names)
    sent = 0

    def count(_topic: str, body: bytes) -> list[bytes]:
        nonlocal sent
        sent += len(body)
        return [body]

    transports, gateways, members = [], [], []
    for one in keys:
        root = folder / f"run-{one.name}"
        root.mkdir(mode=0o700)
        transports.append(await join("plant", root=root))
        members.append(await join("plant", root=root))
        pipe, near = MemoryPipe(hub), transports[-1]
        gateways.append(Gateway(near, pipe, one, ground=near.mesh, stop_here=stop_nothing))
        await gateways[-1].open()
    await asyncio.to_thread(until, lambda: all(linked(one) == sites - 1 for one in gateways))
    before, process_before, begin = memory(os.getpid()), time.process_time(), time.perf_counter()
    for number in range(robots):
        members[number % sites].mesh.announce(f"robot/r{number}/1")
    await asyncio.to_thread(
        until, lambda: all(len(member.presence.keys("robot/**")) == robots for member in members)
    )
    took, grown = time.perf_counter() - begin, memory(os.getpid()) - before
    busy = time.process_time() - process_before
    hub.on_way = count
    await asyncio.sleep(2)
    sent, begin, process_before = 0, time.perf_counter(), time.process_time()
    await asyncio.sleep(10)
    seconds = time.perf_counter() - begin
    idle = (time.process_time() - process_before) / seconds / sites
    pairs = sites * (sites - 1)
    news = robots * (sites - 1)
    print(
        f"{robots:5} robots on {sites} sites: all see all after {took:.2f} s, "
        f"{news / took:.0f} registrations/s, "
        f"{busy / news * 1e6:.0f} us of processor each; {grown / 1e6 / sites:.1f} MB a site"
    )
    print(
        f"      idle: {sent / seconds / sites:.0f} B/s and {idle * 100:.1f} % of a core a site, "
        f"{sent / seconds / pairs:.0f} B/s from a site to another one"
    )
    for one in gateways:
        await one.close()
    for transport in (*members, *transports):
        await transport.close()


def linked(gateway: Gateway) -> int:
    """Return how many sites a gateway has a session with."""
    return sum(site.stream is not None for site in list(gateway.sites.values()))


BE = {"hub": be_hub, "gateway": be_gateway, "robots": be_robots, "bare": be_bare}


def main() -> None:
    """Print the figures."""
    given = options(__doc__, rounds=6, robots="10,100,1000", lan=False)
    logging.disable()  # that sites are linked is no news here
    with apart() as folder:
        if given.rounds:
            (folder / "trips").mkdir()
            asyncio.run(on_ground(folder / "trips", given.rounds, lan=given.lan))
        for robots in map(int, filter(None, given.robots.split(","))):
            place = folder / f"crowd-{robots}"
            place.mkdir()
            asyncio.run(crowd(place, robots, 10))


if __name__ == "__main__":
    if len(sys.argv) > 2 and sys.argv[1] in BE:
        BE[sys.argv[1]](*sys.argv[2:])
    else:
        main()
