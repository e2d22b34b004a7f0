"""The network on one machine against a bare socket and against Zenoh, interleaved in one run.

Prints medians of: a round trip of 64 bytes (bare Unix socket, ours answered in the reading thread, ours
through two event loops, Zenoh), how long a killed process stays present, and how many of some freezes left
two processes apart.

    python bench/local_network.py [ROUNDS] [FREEZES]
"""

from __future__ import annotations

import asyncio
import os
import random
import signal
import socket
import statistics
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

import zenoh
from measuring import Process, apart, clock, count_given, end, start, started, stay, zenoh_peer

from robotree.vr.base.transport import on_loop
from robotree.vr.network.local import join
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.rendezvous import Rendezvous

BODY = bytes(64)
LONGEST = 10.0
"""[s] for anything here."""
WARM = 50
"""Round trips before those that are measured."""


def meshed(folder: str) -> Mesh:
    """Return an open mesh of this bench."""
    mesh = Mesh(Rendezvous("bench", Path(folder)))
    mesh.open()
    return mesh


def be_socket(folder: str) -> None:
    """Answer on a bare socket."""
    door = socket.socket(socket.AF_UNIX)
    door.bind(f"{folder}/bare")
    door.listen()
    print("ready", flush=True)
    line, _ = door.accept()
    while body := line.recv(4096):
        line.sendall(body)


def be_mesh(folder: str) -> None:
    """Answer in the thread that reads."""
    mesh = meshed(folder)

    mesh.serve(f"echo/{os.getpid()}", lambda body, _sender, _urgent, _respond, end: end(body))
    mesh.announce(f"echo/{os.getpid()}")
    stay()


def be_loop(folder: str) -> None:
    """Answer on an event loop, as agents do today."""

    async def serve() -> None:
        transport = await join("loop", root=Path(folder))

        async def handler(body: bytes, respond: Callable[[bytes], None]) -> None:
            respond(body)

        await transport.serve("echo/loop", on_loop(handler))
        await asyncio.to_thread(stay)

    asyncio.run(serve())


def be_zenoh(folder: str) -> None:
    """Answer a Zenoh query in its own thread."""
    with zenoh.open(zenoh_peer(folder, listen=True)) as session:
        session.declare_queryable(
            "echo/zenoh",
            zenoh.handlers.Callback(lambda query: query.reply("echo/zenoh", BODY), indirect=False),
        )
        stay()


def ask(mesh: Mesh, key: str, within: float = LONGEST) -> bool:
    """Ask once; return whether an answer came."""
    answered: Future[bool] = Future()
    got: list[bytes] = []

    def hear(body: bytes | None) -> None:
        if body is None:
            answered.set_result(bool(got))
        else:
            got.append(body)

    mesh.ask(key, BODY, urgent=True, on_reply=hear)
    try:
        return answered.result(within)
    except TimeoutError:
        return False


def round_trips(folder: str, rounds: int) -> None:
    """Measure all four ways in turns."""
    words = ("socket", "mesh", "loop", "zenoh")
    with started(*((__file__, word, folder) for word in words)):
        take_turns(folder, rounds)


def take_turns(folder: str, rounds: int) -> None:
    """See `round_trips`."""
    bare = socket.socket(socket.AF_UNIX)
    bare.connect(f"{folder}/bare")
    mesh = meshed(folder)
    (key,) = mesh.presence.keys("echo/*")
    loop = asyncio.new_event_loop()
    transport = loop.run_until_complete(join("loop", root=Path(folder)))
    session = zenoh.open(zenoh_peer(folder, listen=False))

    async def through_loop() -> None:
        async for _ in transport.request("echo/loop", BODY, timeout=LONGEST):
            pass

    def query() -> None:
        done = threading.Event()
        session.get("echo/zenoh", zenoh.handlers.Callback(lambda _: None, done.set, indirect=False))
        done.wait(LONGEST)

    def echo() -> None:
        bare.sendall(BODY)
        bare.recv(4096)

    ways: dict[str, Callable[[], object]] = {
        "bare Unix socket": echo,
        "ours, thread to thread": lambda: ask(mesh, key),
        "ours, loop to loop": lambda: loop.run_until_complete(through_loop()),
        "Zenoh query": query,
    }
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds + WARM):
        for name, way in ways.items():
            taken[name] += clock(way, 1)
    medians = {name: statistics.median(times[WARM:]) for name, times in taken.items()}
    for name, median in medians.items():
        print(
            f"round trip, {name:24} {median:8.0f} us   {median / medians['bare Unix socket']:5.1f} x socket"
        )
    bare.close()
    loop.run_until_complete(transport.close())
    mesh.close().result(LONGEST)
    session.close()


def kills(folder: str, times: int) -> None:
    """Measure how long a killed process is still present."""
    mesh = meshed(folder)
    seconds: list[float] = []
    for _ in range(times):
        other = start(__file__, "mesh", folder)
        gone = threading.Event()
        unwatch = mesh.presence.watch("echo/*", lambda _, there, gone=gone: None if there else gone.set())
        began = time.perf_counter()
        other.kill()
        if not gone.wait(LONGEST):
            print("a killed process is still present")
        seconds.append(time.perf_counter() - began)
        unwatch()
        end([other])
    print(
        f"kill -9 until known: median {statistics.median(seconds) * 1e3:.1f} ms, max {max(seconds) * 1e3:.1f}"
    )
    mesh.close().result(LONGEST)


def freezes(folder: str, times: int, seed: int = 1) -> None:
    """Freeze one of three processes for 1 to 6 s, often around a time limit, and see who is whole after."""
    with started(*[(__file__, "mesh", folder)] * 3) as others:
        freeze_all(folder, times, random.Random(seed), others)


def freeze_all(folder: str, times: int, chance: random.Random, others: list[Process]) -> None:
    """See `freezes`."""
    mesh = meshed(folder)
    left, slowest = 0, 0.0
    for _ in range(times):
        around = chance.choice((1.5, 2.0, 2.5, 3.0, 3.5))
        seconds = chance.choice((chance.uniform(1, 6), chance.gauss(around, 0.03)))
        frozen = chance.choice(others)
        frozen.send_signal(signal.SIGSTOP)
        time.sleep(max(0.5, seconds))  # this is the freeze
        frozen.send_signal(signal.SIGCONT)
        began = time.perf_counter()
        keys = [f"echo/{other.pid}" for other in others]
        while time.perf_counter() - began < LONGEST:
            if sorted(mesh.presence.keys("echo/*")) == sorted(keys) and all(
                ask(mesh, key, 1.0) for key in keys
            ):
                break
            time.sleep(0.01)  # not too often: asking takes processor time from those that answer
        took = time.perf_counter() - began
        slowest = max(slowest, took)
        left += took >= LONGEST
    print(f"{times} freezes: {left} left apart, the slowest whole again after {slowest:.2f} s")
    mesh.close().result(LONGEST)


BE = {"socket": be_socket, "mesh": be_mesh, "loop": be_loop, "zenoh": be_zenoh}

if __name__ == "__main__":
    if len(sys.argv) > 2 and sys.argv[1] in BE:
        BE[sys.argv[1]](sys.argv[2])
    else:
        with apart() as place:
            round_trips(str(place), count_given(1, 1000))
            kills(str(place), 20)
            freezes(str(place), count_given(2, 20))
