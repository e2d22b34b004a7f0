"""What it costs that a host keeps its robots, and how soon a command goes on after `kill -9`.

    python bench/durable.py [--rounds N] [--restarts N] [--dbos]

Two hosts, one with a journal and one without, take the same calls in turns, in one run. An intent, which a
command keeps for good before it asks for something that adds up, is measured in turns with a bare write and
fdatasync of as many bytes; the folder is one of the system's for temporary files (`$TMPDIR`). Restarts are
measured from the start of the new process to the next effect in another process; beside it how long Python
takes to start with an empty script, and a host without robots to be ready.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import subprocess
import sys
import time
import venv
from pathlib import Path
from typing import Any

from hosts import REPEATS, HostProcess, bind, counters, next_effect
from measuring import apart, clock, memory, options, quantile, tell

from robotree.client.joining import joined
from robotree.vr.base.address import Address
from robotree.vr.core.bonds import GrantedLease, Slots
from robotree.vr.core.events import StepResult, StepTaken
from robotree.vr.core.machine import Calls, RobotState
from robotree.vr.core.stop import Stop
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.records import KeptPage
from robotree.vr.running.runner import Threads
from robotree.vr.supervision.realm_client import RealmClient

LONG = 10_000
"""Steps of the long command."""
CROWD = 50
"""Robots that take steps at the same time."""

DBOS_PROGRAM = """
import sys, time
from dbos import DBOS

DBOS(config={"name": "bench", "system_database_url": f"sqlite:///{sys.argv[1]}", "log_level": "ERROR"})

@DBOS.step()
def step(x):
    return x

@DBOS.step()
def effect():
    print("effect", flush=True)
    time.sleep(0.02)

@DBOS.workflow()
def measure(count):
    began = time.perf_counter()
    for _ in range(count):
        step(1.0)
    return (time.perf_counter() - began) / count * 1e6

@DBOS.workflow()
def patrol():
    while True:
        effect()

DBOS.launch()
if count := int(sys.argv[2]):
    print(measure(count), flush=True)
    patrol()
time.sleep(60)
"""
"""Times a step, then acts for ever; started again with 0, it goes on with that."""


async def calls(
    realm_client: RealmClient, kept: HostProcess, bare: HostProcess, rounds: int
) -> dict[str, Any]:
    """Measure calls with and without a journal, in turns."""
    times: dict[str, list[float]] = {}
    sizes: dict[str, int] = {}
    for host in (kept, bare):
        await bind(realm_client, host, f"near-{host.name}", f"bottom-{host.name}")
        await bind(realm_client, host, f"far-{host.name}", f"far-of-{host.name}")
    for _ in range(rounds):
        for way in ("near", "far"):
            for host in (kept, bare):
                before = host.size
                name = f"{way}-{host.name}"
                times.setdefault(name, []).extend(
                    await realm_client.call(name, "measure", {"repeats": REPEATS})
                )
                sizes[name] = host.size - before
    found: dict[str, Any] = {}
    for way in ("near", "far"):
        with_it, without = (statistics.median(times[f"{way}-{host.name}"]) for host in (kept, bare))
        found |= {f"{way} kept us": with_it, f"{way} bare us": without, f"{way} ratio": with_it / without}
        found[f"{way} bytes"] = sizes[f"{way}-{kept.name}"] / REPEATS
    return found


async def crowd(realm_client: RealmClient, host: HostProcess, steps: int = 400) -> dict[str, float]:
    """Have many robots of one host, each with a child there, call their children at the same time."""
    names = [f"crowd-{number}" for number in range(CROWD)]
    for name in names:
        await bind(realm_client, host, name, f"below-{name}")
    began = time.monotonic()
    await asyncio.gather(*(realm_client.call(name, "count", {"steps": steps}) for name in names))
    return {f"{CROWD} robots, steps/s": CROWD * steps / (time.monotonic() - began)}


def intents(folder: Path, count: int) -> dict[str, float]:
    """Measure what precedes a call of what adds up, and in turns as many bytes without a journal."""
    key, name = "robot/it/1", "it"
    state = RobotState(
        address=Address("robot", name, "1"), home="h", lease=GrantedLease.free(name, unix=0.0),
        slots=Slots(name), calls=Calls(), stop=Stop(),
    )  # fmt: skip
    journal = HostJournal(folder / "intents", Threads())
    journal.begin()
    journal.made(key, name, KeptPage("", ""), lambda query: query(state))
    path = folder / "bare.log"
    bare = os.open(path, os.O_CREAT | os.O_WRONLY | os.O_APPEND, 0o600)
    times: dict[str, list[float]] = {"journal": [], "bare": []}
    for number in range(count):
        step = StepResult("begun", None, "robot/arm-1/0123456789")
        intent = StepTaken(key="k", path=f"{number}~", step=step)
        before = journal.size
        times["journal"] += clock(lambda intent=intent: (journal.append(key, 1.0, intent), journal.sync()), 1)
        body = bytes(journal.size - before)
        times["bare"] += clock(lambda body=body: (os.write(bare, body), os.fdatasync(bare)), 1)
    os.close(bare)
    journal.close()
    kept, floor = (statistics.median(times[way]) for way in ("journal", "bare"))
    return {"intent us": kept, "bare fdatasync us": floor, "intent ratio": kept / floor}


async def restarts(realm_client: RealmClient, folder: Path, count: int) -> dict[str, Any]:
    """Kill a host again and again in the middle of a command."""
    host = HostProcess("again", folder / "again", past=True)
    host.start()
    try:
        return await killed(realm_client, host, count)
    finally:
        host.kill()


async def killed(realm_client: RealmClient, host: HostProcess, count: int) -> dict[str, Any]:
    """Kill a host that runs again and again, and measure; see `restarts`."""
    found: dict[str, Any] = {}
    for name, steps in (("short", 0), ("long", LONG)):
        await bind(realm_client, host, f"patrol-{name}", f"far-of-{name}")
        before, empty, began = host.size, memory(host.process.pid), time.monotonic()
        call = asyncio.ensure_future(
            realm_client.call(f"patrol-{name}", "patrol", {"steps": steps}, deadline=600.0)
        )
        await next_effect(began)
        if steps:
            found["step bytes"] = (host.size - before) / steps
            found["memory of a step, bytes"] = (memory(host.process.pid) - empty) / steps
        effects, ready, reading = [], [], []
        for _ in range(max(3, count // 3 if steps else count)):
            await asyncio.sleep(0.1)
            host.kill()
            reading.append(read_time(host.folder))
            began = time.monotonic()
            ready.append(await asyncio.to_thread(host.start))
            effects.append(await next_effect(began) - began)
        found |= {
            f"{name} effect p50 s": statistics.median(effects),
            f"{name} effect p95 s": quantile(effects, 0.95),
        }
        found |= {f"{name} ready s": statistics.median(ready), f"{name} read s": statistics.median(reading)}
        await realm_client.cancel(f"patrol-{name}")
        await asyncio.gather(call, return_exceptions=True)
    found["resume of 10,000 steps s"] = found["long effect p50 s"] - found["short effect p50 s"]
    found["read of a step us"] = (found["long read s"] - found["short read s"]) / LONG * 1e6
    return found


def beside_dbos(folder: Path) -> dict[str, float]:
    """Measure a step of DBOS with SQLite, as it is shipped, and its restart after `kill -9`."""
    environment = folder / "dbos"
    venv.create(environment, with_pip=True)
    python = environment / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", "-q", "dbos"], check=True)
    words = [python, "-c", DBOS_PROGRAM, folder / "dbos.sqlite"]
    with subprocess.Popen([*words, "300"], stdout=subprocess.PIPE) as first:
        assert first.stdout is not None  # noqa: S101 # started with a pipe
        found = {"DBOS step us": float(first.stdout.readline())}
        first.stdout.readline()  # the next workflow is at work
        first.kill()
    began = time.monotonic()
    with subprocess.Popen([*words, "0"], stdout=subprocess.PIPE) as second:
        assert second.stdout is not None  # noqa: S101 # as above
        second.stdout.readline()
        found["DBOS effect s"] = time.monotonic() - began
        second.kill()
    return found


def read_time(folder: Path | None) -> float:
    """Return how long it takes to read a log, without the start of a process [s]."""
    assert folder is not None  # noqa: S101 # of the host that keeps its robots
    began = time.perf_counter()
    HostJournal(folder, Threads()).close()
    return time.perf_counter() - began


def bare_starts() -> dict[str, float]:
    """Return how long Python, and a host without robots, take to start [s]."""
    python, host = [], []
    for _ in range(5):
        began = time.monotonic()
        subprocess.run([sys.executable, "-c", ""], check=True)
        python.append(time.monotonic() - began)
        empty = HostProcess("empty", None)
        host.append(empty.start())
        empty.kill()
    return {"python s": statistics.median(python), "empty host ready s": statistics.median(host)}


async def measure(folder: Path, rounds: int, count: int) -> dict[str, Any]:
    """Measure all."""
    found: dict[str, Any] = {**bare_starts(), **intents(folder, rounds * 50)}
    kept, bare = HostProcess("kept", folder / "kept", past=True), HostProcess("bare", None)
    far = [f"far-of-{name}" for name in ("kept", "bare", "short", "long")]
    async with counters(*far), joined("bench") as realm_client:
        for host in (kept, bare):
            host.start()
        try:
            found |= await calls(realm_client, kept, bare, rounds)
            found |= await crowd(realm_client, kept)
        finally:
            for host in (kept, bare):
                host.kill()
        found |= await restarts(realm_client, folder, count)
    return found


def main() -> None:
    """Print the figures."""
    given = options(__doc__, rounds=20, restarts=20, dbos=False)
    with apart() as folder:
        found = asyncio.run(measure(folder, given.rounds, given.restarts))
        if given.dbos:
            found |= beside_dbos(folder)
    tell(found)


if __name__ == "__main__":
    main()
