"""How long lookup takes, between real processes; prints medians and 90th percentiles.

Comparable to Jini's lookup service on the same machine: register 252 us, renew 75, look up by name among
1,000 121, look up that returns 1,000 items 14,546, register until a listener hears of it 431, cancel until
it hears 261 (Apache River 2.2.3, warm JVM, transient).

    python bench/lookup.py [REPETITIONS]
"""

from __future__ import annotations

import asyncio
import statistics
import sys
import time

from measuring import Process, apart, clocked, count_given, end, quantile, start, started, stay, until

from robotree.vr.agents.run import run_lookup
from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing, Template
from robotree.vr.base.requests import Found, Query, Register, Registered
from robotree.vr.base.transport import Respond, on_loop
from robotree.vr.exchange.asking import ask
from robotree.vr.lookup.directory import Directory
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.network.local import LocalTransport, join

CROWD = 1000


def listing(name: str, revision: int = 1) -> Listing:
    """Return a listing of ordinary size."""
    return Listing(
        address=Address("robot", name, "1"),
        kinds=("Arm", "RobotProxy", "Robot"),
        doc="A compliant arm with seven joints and a gripper.",
        host="bench",
        commands=("go_to", "get_info", "grip", "halt", "hold"),
        attributes={"place": "bench"},
        revision=revision,
    )


def show(what: str, seconds: list[float]) -> None:
    """Print one line of the table."""
    median, ninth = statistics.median(seconds) * 1e6, quantile(seconds, 0.9) * 1e6
    print(f"{what:48} {median:9.0f} {ninth:9.0f}  us  n={len(seconds)}")


def told(_: object) -> None:
    """Say that the lookup service is there."""
    print("ready", flush=True)


async def echo() -> None:
    """Answer requests with what they say."""

    async def handler(body: bytes, respond: Respond) -> None:
        respond(body)

    transport = await join()
    await transport.serve("robot/echo/1", on_loop(handler))
    await transport.announce("robot/echo/1")
    await asyncio.to_thread(stay)


async def measure_requests(transport: LocalTransport, service: str, repetitions: int) -> None:
    """Measure what agents and supervisors ask of one service."""

    async def round_trip(_: int) -> None:
        async for _ in transport.request("robot/echo/1", bytes(64), timeout=5):
            pass

    async def send(request: Register) -> None:
        await ask(transport, service, request, Registered, timeout=5)

    async def register(entry: Listing) -> None:
        await send(Register(holder="bench", term=60.0, listings=(entry,)))

    async def find(template: Template) -> None:
        await ask(transport, service, Query(template=template), Found, timeout=5)

    async def withdraw(number: int) -> None:
        gone = (Address("robot", f"new-{number}", "1"), 2)
        await send(Register(holder="bench", term=60.0, withdrawn=(gone,)))

    await clocked(200, round_trip)
    show("request and reply of 64 bytes", await clocked(repetitions, round_trip))
    for number in range(CROWD):
        await register(listing(f"robot-{number}"))
    show("register (1,000 are there)", await clocked(repetitions, lambda n: register(listing(f"new-{n}"))))
    show("withdraw", await clocked(repetitions, withdraw))
    renewal = Register(holder="bench", term=60.0)
    show("renew the lease of all 1,000", await clocked(repetitions, lambda _: send(renewal)))
    show(
        "look up by name, asking the service (1,000)",
        await clocked(repetitions, lambda n: find(Template(name=f"robot-{n % CROWD}"))),
    )
    show("look up returning 1,000 items", await clocked(30, lambda _: find(Template())))


async def measure_events(transport: LocalTransport, onlooker: Directory, repetitions: int) -> None:
    """Measure from an agent's wish to the onlooker's knowledge, in another session."""
    heard: asyncio.Queue[str] = asyncio.Queue()
    onlooker.on_change(lambda change: change.listing and heard.put_nowait(change.kind))
    registrar = Registrar(transport)
    arrivals: list[float] = []
    departures: list[float] = []
    for number in range(repetitions):
        entry = listing(f"seen-{number}")
        presence = await transport.announce(entry.address.key)
        await asyncio.sleep(0.002)
        for wish, taken in ((registrar.enter(entry), arrivals), (registrar.leave(entry.address), departures)):
            begin = time.perf_counter()
            work = asyncio.ensure_future(wish)
            await heard.get()
            taken.append(time.perf_counter() - begin)
            await work
        await presence.close()
    show("register until a directory knows", arrivals)
    show("withdraw until a directory knows", departures)
    await registrar.close()
    names = [onlooker.listings[0].name] if onlooker.listings else ["echo"]
    show("resolve a name in the directory", await clocked(repetitions, lambda _: onlooker.resolve(names[0])))


async def measure_deaths(transport: LocalTransport, repetitions: int) -> None:
    """Measure from `kill -9` to the news of it, the wait for a return included."""
    taken: list[float] = []
    gone = asyncio.Event()
    transport.presence.watch("robot/echo/*", lambda _, there: None if there else gone.set())
    for _ in range(repetitions):
        process = await asyncio.to_thread(start, __file__, "echo")
        await until(lambda: transport.presence.keys("robot/echo/*"))
        gone.clear()
        begin = time.perf_counter()
        process.kill()
        await gone.wait()
        taken.append(time.perf_counter() - begin)
        end([process])
    show("kill -9 until it is missed", taken)


async def main(repetitions: int, echoing: Process) -> None:
    """Measure everything."""
    transport, other = await join(), await join()
    onlooker = Directory(other)
    await onlooker.start()
    (service,) = transport.presence.keys("lookup/*/*")
    await measure_events(transport, onlooker, repetitions // 4)
    await measure_requests(transport, service, repetitions)
    await onlooker.close()
    echoing.kill()
    await measure_deaths(transport, 20)
    await transport.close()
    await other.close()


if __name__ == "__main__":
    if sys.argv[1:] == ["lookup"]:
        asyncio.run(run_lookup("bench", ready=told))
    elif sys.argv[1:] == ["echo"]:
        asyncio.run(echo())
    else:
        with apart(), started((__file__, "lookup"), (__file__, "echo")) as (_, echoing):
            asyncio.run(main(count_given(1, 1000), echoing))
