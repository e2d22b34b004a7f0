"""The network on one machine against a bare socket and against Zenoh, interleaved in one run.

Prints medians of: a round trip of 64 bytes (bare Unix socket, ours answered in the reading thread, ours
through two event loops, Zenoh), how long a killed process stays present, how long a number of processes that
start at once need until all know each other, and how many of some freezes left two processes apart.

    python bench/local_network.py [ROUNDS] [FREEZES]
"""

from __future__ import annotations

import asyncio
import os
import random
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

import zenoh

from robotree.vr.base.transport import End, Respond, on_loop
from robotree.vr.network.local import join
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.rendezvous import Rendezvous

BODY = bytes(64)
MANY = 24
"""Processes that start at once."""
LONGEST = 10.0
"""[s] for anything here."""


def member(word: str, folder: str) -> subprocess.Popen[str]:
    """Start this file as another process, and wait until it is up."""
    process = subprocess.Popen(
        [sys.executable, __file__, word, folder], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    if process.stdout is not None:
        process.stdout.readline()
    return process


def say_and_wait(word: str = "ready") -> None:
    """In the other process: it is up; wait for the end."""
    print(word, flush=True)
    sys.stdin.read()


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
    mesh = Mesh(Rendezvous("bench", Path(folder)))
    mesh.open()

    def answer(body: bytes, _: bool, respond: Respond, end: End) -> None:  # noqa: FBT001 # a TakeRequest
        del respond
        end(body)

    mesh.serve(f"echo/{os.getpid()}", answer)
    mesh.announce(f"echo/{os.getpid()}")
    say_and_wait()
    mesh.close().result(LONGEST)


def be_crowd(folder: str) -> None:
    """Say how long it took until all were seen."""
    began = time.perf_counter()
    mesh = Mesh(Rendezvous("crowd", Path(folder)))
    mesh.open()
    mesh.announce(f"echo/{os.getpid()}")
    while len(mesh.presence.keys("echo/*")) < MANY and time.perf_counter() - began < LONGEST:
        time.sleep(0.005)  # as an onlooker would: what is measured is when all are seen
    print(time.perf_counter() - began, flush=True)
    sys.stdin.read()
    mesh.close().result(LONGEST)


def be_loop(folder: str) -> None:
    """Answer on an event loop, as agents do today."""

    async def serve() -> None:
        transport = await join("loop", root=Path(folder))

        async def handler(body: bytes, respond: Callable[[bytes], None]) -> None:
            respond(body)

        await transport.serve("echo/loop", on_loop(handler))
        await asyncio.to_thread(say_and_wait)
        await transport.close()

    asyncio.run(serve())


def be_zenoh(folder: str) -> None:
    """Answer a Zenoh query in its own thread."""
    with zenoh.open(zenoh_config(folder, listen=True)) as session:
        session.declare_queryable(
            "echo/zenoh",
            zenoh.handlers.Callback(lambda query: query.reply("echo/zenoh", BODY), indirect=False),
        )
        say_and_wait()


def zenoh_config(folder: str, *, listen: bool) -> zenoh.Config:
    """Two peers over one Unix socket."""
    config = zenoh.Config()
    config.insert_json5("mode", '"peer"')
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    here = f'["unixsock-stream/{folder}/z"]'
    config.insert_json5("listen/endpoints", here if listen else "[]")
    config.insert_json5("connect/endpoints", "[]" if listen else here)
    return config


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


def timed(action: Callable[[], object]) -> float:
    """Return how long something takes [s]."""
    began = time.perf_counter()
    action()
    return time.perf_counter() - began


def round_trips(folder: str, rounds: int) -> None:
    """Measure all four ways in turns."""
    others = [member(word, folder) for word in ("socket", "mesh", "loop", "zenoh")]
    bare = socket.socket(socket.AF_UNIX)
    bare.connect(f"{folder}/bare")
    mesh = Mesh(Rendezvous("bench", Path(folder)))
    mesh.open()
    (key,) = mesh.presence.keys("echo/*")
    loop = asyncio.new_event_loop()
    transport = loop.run_until_complete(join("loop", root=Path(folder)))
    session = zenoh.open(zenoh_config(folder, listen=False))

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
    seconds: dict[str, list[float]] = {name: [] for name in ways}
    for turn in range(rounds + 50):
        for name, way in ways.items():
            took = timed(way)
            if turn >= 50:
                seconds[name].append(took)
    base = statistics.median(seconds["bare Unix socket"])
    for name, times in seconds.items():
        median = statistics.median(times)
        print(f"round trip, {name:24} {median * 1e6:8.0f} us   {median / base:5.1f} x socket")
    bare.close()
    loop.run_until_complete(transport.close())
    mesh.close().result(LONGEST)
    session.close()
    end(others)


def kills(folder: str, times: int) -> None:
    """Measure how long a killed process is still present."""
    mesh = Mesh(Rendezvous("bench", Path(folder)))
    mesh.open()
    seconds: list[float] = []
    for _ in range(times):
        other = member("mesh", folder)
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


def crowd(folder: str) -> None:
    """Measure how long processes that start at once need to know each other."""
    processes = [
        subprocess.Popen(
            [sys.executable, __file__, "crowd", folder],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        for _ in range(MANY)
    ]
    times = [float(process.stdout.readline()) for process in processes if process.stdout is not None]
    median = statistics.median(times)
    print(f"{MANY} at once, from joining until all are seen: median {median:.2f} s, max {max(times):.2f}")
    end(processes)


def freezes(folder: str, times: int, seed: int = 1) -> None:
    """Freeze one of three processes for 1 to 6 s, often around a time limit, and see who is whole after."""
    chance = random.Random(seed)
    others = [member("mesh", folder) for _ in range(3)]
    mesh = Mesh(Rendezvous("bench", Path(folder)))
    mesh.open()
    apart, slowest = 0, 0.0
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
        apart += took >= LONGEST
    print(f"{times} freezes: {apart} left apart, the slowest whole again after {slowest:.2f} s")
    mesh.close().result(LONGEST)
    end(others)


def end(processes: list[subprocess.Popen[str]]) -> None:
    """End processes that this program started."""
    for process in processes:
        process.kill()
        process.communicate()


BE = {"socket": be_socket, "mesh": be_mesh, "loop": be_loop, "zenoh": be_zenoh, "crowd": be_crowd}

if __name__ == "__main__":
    if len(sys.argv) > 2 and sys.argv[1] in BE:
        BE[sys.argv[1]](sys.argv[2])
    else:
        given = [int(word) for word in sys.argv[1:]]
        with tempfile.TemporaryDirectory(prefix="rt-") as place:
            round_trips(place, given[0] if given else 1000)
            kills(place, 20)
            crowd(place)
            freezes(place, given[1] if len(given) > 1 else 20)
