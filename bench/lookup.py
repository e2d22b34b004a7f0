"""How long lookup takes, between real processes; prints medians and 90th percentiles.

Comparable to Jini's lookup service on the same machine: register 252 us, renew 75, look up by name among
1,000 121, look up that returns 1,000 items 14,546, register until a listener hears of it 431, cancel until
it hears 261 (Apache River 2.2.3, warm JVM, transient).

    python bench/lookup.py [REPETITIONS]
"""

from __future__ import annotations

import asyncio
import os
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable

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
    ordered = sorted(seconds)
    ninth = ordered[int(len(ordered) * 0.9)]
    print(f"{what:48} {statistics.median(ordered) * 1e6:9.0f} {ninth * 1e6:9.0f}  us  n={len(ordered)}")


async def clocked(repetitions: int, action: Callable[[int], Awaitable[object]]) -> list[float]:
    """Return how long each repetition took [s]."""
    taken: list[float] = []
    for number in range(repetitions):
        begin = time.perf_counter()
        await action(number)
        taken.append(time.perf_counter() - begin)
    return taken


async def start(*words: str) -> asyncio.subprocess.Process:
    """Start this file as a member of the realm, and wait until it is up."""
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, __file__, *words),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
    )
    if process.stdout is not None:
        await process.stdout.readline()
    return process


async def be(word: str) -> None:
    """Be a member until the standard input closes."""
    if word == "lookup":
        work = asyncio.ensure_future(run_lookup("bench", ready=lambda _: print("ready", flush=True)))
    else:
        work = asyncio.ensure_future(echo())
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)
    work.cancel()
    await asyncio.gather(work, return_exceptions=True)


async def echo() -> None:
    """Answer requests with what they say."""

    async def handler(body: bytes, respond: Respond) -> None:
        respond(body)

    transport = await join()
    try:
        await transport.serve("robot/echo/1", on_loop(handler))
        await transport.announce("robot/echo/1")
        print("ready", flush=True)
        await asyncio.get_running_loop().create_future()
    finally:
        await transport.close()


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
        process = await start("echo")
        while not transport.presence.keys("robot/echo/*"):  # noqa: ASYNC110 # it is asked, not told
            await asyncio.sleep(0.005)
        gone.clear()
        begin = time.perf_counter()
        process.send_signal(signal.SIGKILL)
        await gone.wait()
        taken.append(time.perf_counter() - begin)
        await process.wait()
    show("kill -9 until it is missed", taken)


async def main(repetitions: int) -> None:
    """Measure everything."""
    processes = [await start("lookup"), await start("echo")]
    transport, other = await join(), await join()
    onlooker = Directory(other)
    try:
        await onlooker.start()
        (service,) = transport.presence.keys("lookup/*/*")
        await measure_events(transport, onlooker, repetitions // 4)
        await measure_requests(transport, service, repetitions)
        await onlooker.close()
        processes[1].kill()
        await measure_deaths(transport, 20)
    finally:
        await onlooker.close()
        await transport.close()
        await other.close()
        for process in processes:
            if process.returncode is None:
                process.kill()
            await process.wait()


if __name__ == "__main__":
    if len(sys.argv) > 1 and not sys.argv[1].isdigit():
        asyncio.run(be(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as runtime:
            os.environ["XDG_RUNTIME_DIR"] = runtime
            asyncio.run(main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000))
