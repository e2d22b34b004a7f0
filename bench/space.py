"""How long a write and a take in a space last, for each store and what an answer survives.

    python bench/space.py [--rounds N]

`store`: an operation in the process that owns the store. `page`: from the thread of another process, as a
page asks, over the sockets of the realm; beside it a request and a reply of 64 bytes that are answered in the
reading thread. In each round every store and every process has its turn. 1,000 other entries of the same
class are there. PostgreSQL is started here if it is installed, with its usual settings. Times in us: the
median of all, and the fastest round.

Outrigger is the JavaSpaces service of Apache River 2.2.3, measured earlier on the same kind of machine:
write 164 us, take 156 us, from another process; they survive the end of a process, not loss of power.
"""

# ruff: noqa: S101

from __future__ import annotations

import asyncio
import contextlib
import statistics
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

from measuring import apart, clock, options, started, stay

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))  # the server is started as the tests do

from robotree.vr.base.entry import Entry
from robotree.vr.base.requests import (
    FOR_EVER,
    AnyRequest,
    EntriesFound,
    EntryLeased,
    FindEntries,
    Raised,
    Reply,
    WriteEntry,
)
from robotree.vr.base.transport import Incoming
from robotree.vr.exchange.asking import send_request
from robotree.vr.network.local import LocalTransport, join
from robotree.vr.space.run import open_store, run_space
from robotree.vr.space.store import SpaceStore
from tests.vr.space.postgres import lacking, server

REALM = "bench-space"
OTHERS = 1000
"""Entries that are there."""
PORTION = 200
"""Operations in one turn."""
OUTRIGGER = {"write": 164.0, "take": 156.0}
"""[us]"""
ECHO = "robot/echo/1"


def entry(place: str) -> Entry:
    """Return an entry of about 120 bytes."""
    fields = {"place": place, "robot": "porter-1", "weight": 2.5, "note": "to the second door on the left"}
    return Entry(("Delivery", "Job"), fields)


Operation = Callable[[str], None]
"""Writes or takes one entry of a place."""


class Clock:
    """Times of one line of the table."""

    def __init__(self) -> None:
        """Begin without any."""
        self.times: dict[str, list[list[float]]] = {}

    def measure(self, what: str, operation: Operation, places: list[str]) -> None:
        """Do it for each place; keep the times [us]."""
        left = iter(places)
        self.times.setdefault(what, []).append(clock(lambda: operation(next(left)), len(places)))

    def show(self, name: str) -> None:
        """Print a line."""
        cells = []
        for what, rounds in self.times.items():
            median = statistics.median(one for each in rounds for one in each)
            best = min(statistics.median(each) for each in rounds)
            ratio = f" ({median / OUTRIGGER[what]:4.2f} x)" if what in OUTRIGGER else ""
            cells.append(f"{what} {median:7.1f}{ratio}, best {best:7.1f}")
        print(f"{name:34s} {'   '.join(cells)}", flush=True)


def direct(store: SpaceStore) -> tuple[Operation, Operation]:
    """Return how to write and take in the process that owns a store."""

    def write(place: str) -> None:
        with store.together():
            store.write(entry(place), FOR_EVER, "", "")

    def take(place: str) -> None:
        with store.together():
            assert store.find("Delivery", {"place": place}, "", take=True, most=1)

    return write, take


def asked(transport: LocalTransport, key: str, sender: str) -> tuple[Operation, Operation]:
    """Return how to write and take from the thread of another process."""

    def ask(request: AnyRequest) -> Reply:
        news = threading.Lock()
        news.acquire()
        replies: list[Reply | None] = []

        def take(reply: Reply | None) -> None:
            replies.append(reply)
            if news.locked():
                news.release()

        send_request(transport, key, request, take, now=time.monotonic(), within=5.0, sender=sender)
        news.acquire()
        reply = replies[0]
        assert reply is not None
        assert not isinstance(reply, Raised), reply
        return reply

    def write(place: str) -> None:
        assert isinstance(ask(WriteEntry(entry=entry(place))), EntryLeased)

    def take(place: str) -> None:
        found = ask(FindEntries(kind="Delivery", fields={"place": place}, take=True))
        assert isinstance(found, EntriesFound)
        assert found.entries

    return write, take


def round_trip(transport: LocalTransport) -> Operation:
    """Return how to ask for 64 bytes."""

    def ask(_: str) -> None:
        news = threading.Lock()
        news.acquire()
        transport.ask(ECHO, bytes(64), on_reply=lambda body: news.release() if body else None)
        news.acquire()

    return ask


async def be(words: list[str]) -> None:
    """Be a process that serves a space, or answers with 64 bytes."""
    if words[0] != "echo":
        name, store, durability = words
        await run_space(
            name, store, durability=durability, realm=REALM, ready=lambda _: print("ready", flush=True)
        )
    transport = await join(REALM)

    def answer(incoming: Incoming) -> None:
        incoming.end(incoming.body)

    await transport.serve(ECHO, answer)
    await transport.announce(ECHO)
    await asyncio.to_thread(stay)


def stores(folder: Path, url: str) -> dict[str, tuple[str, str]]:
    """Return where each store is and what its answers survive, by a name for people."""
    found = {
        "memory": ("memory", "process"),
        "SQLite, process": (str(folder / "process.db"), "process"),
        "SQLite, power": (str(folder / "power.db"), "power"),
    }
    if url:
        found |= {"PostgreSQL, process": (url, "process"), "PostgreSQL, power": (url, "power")}
    return found


def measure(lines: dict[str, tuple[Operation, Operation]], rounds: int, extra: dict[str, Operation]) -> None:
    """Measure all in turns, and print them."""
    clocks = {name: Clock() for name in (*extra, *lines)}
    for name, (write, _) in lines.items():
        for number in range(OTHERS if "PostgreSQL, power" not in name else 0):
            write(f"other-{number}")
    for number in range(rounds + 1):
        for name, operation in extra.items():
            clocks[name].measure("round trip", operation, [""] * PORTION)
        for name, (write, take) in lines.items():
            places = [f"{name} {number} {one}" for one in range(PORTION)]
            clocks[name].measure("write", write, places)
            clocks[name].measure("take", take, places)
    for name, line in clocks.items():
        for times in line.times.values():
            del times[0]  # it warms up
        line.show(name)


async def measure_pages(folder: Path, url: str, rounds: int) -> None:
    """Measure from another process."""
    found = stores(folder, url)
    words = [(__file__, f"s{number}", *where) for number, where in enumerate(found.values())]
    with started((__file__, "echo"), *words):
        transport = await join(REALM)
        await transport.announce("caller/bench")
        for number in range(len(found)):
            assert await transport.presence.until(f"space/s{number}/*", there=True, within=5)
        lines = {
            name: asked(transport, transport.presence.keys(f"space/s{number}/*")[0], "caller/bench")
            for number, name in enumerate(found)
        }
        await asyncio.to_thread(measure, lines, rounds, {"64 bytes": round_trip(transport)})
        await transport.close()


def main() -> None:
    """Measure all stores."""
    rounds = options(__doc__, rounds=10).rounds
    with contextlib.ExitStack() as stack:
        url = ""
        if reason := lacking():
            print(f"without PostgreSQL: {reason}")
        else:
            url = stack.enter_context(server()).url
        print("store")
        with apart(REALM) as folder:
            opened = {name: open_store("bench", *where) for name, where in stores(folder, url).items()}
            measure({name: direct(store) for name, store in opened.items()}, rounds, {})
            for store in opened.values():
                store.close()
        print("page")
        with apart(REALM) as folder:
            asyncio.run(measure_pages(folder, url, rounds))


if __name__ == "__main__":
    if sys.argv[1:2] == ["echo"] or len(sys.argv) == 4:
        asyncio.run(be(sys.argv[1:]))
    else:
        main()
