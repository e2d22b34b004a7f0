"""How long a call takes, seen from an author's page: nested, handed over, chains, and between two processes.

    python bench/calls.py [--rounds N]

All are measured in turns, in one run, against two threads that pass a token (`SimpleQueue`); the calls
between processes against bare Unix sockets and a bare Zenoh query with the same bytes, and against Pyro5 and
gRPC if they can be imported (`pip install --target FOLDER Pyro5 msgpack grpcio`; then `PYTHONPATH=FOLDER`;
they are no dependencies). Times in us: the fastest and the median.
"""

from __future__ import annotations

import asyncio
import cProfile
import os
import pstats
import queue
import socket
import statistics
import sys
import threading
from collections import Counter
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from typing import Any

import zenoh
from measuring import apart, be_robot, clock, options, started, stay, zenoh_peer

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.address import Address
from robotree.vr.base.envelope import seal
from robotree.vr.base.requests import Call
from robotree.vr.exchange.client import RobotClient
from robotree.vr.network.local import join
from robotree.vr.running.process import Process

REPEATS = 300
"""Calls in one measurement."""


class Leaf(Robot):
    """The end of a chain."""

    @command(effect="repeat")
    def step(self, x: float = 0.0) -> float:
        """Return the argument."""
        return x


class IsolatedLeaf(Leaf):
    """The same on a worker of its own, as a proxy is."""

    isolated = True


class Chained(VirtualRobot):
    """One level of a chain."""

    below = Child("Robot")

    @command(effect="repeat")
    def step(self, x: float = 0.0) -> Any:
        """Call the child."""
        return self.below.step(x=x)

    @command
    def measure(self, repeats: int) -> Any:
        """Call the child many times; the times of all calls [us]."""
        return clock(lambda: self.below.step(x=1.0), repeats)

    @command
    def profile(self) -> Any:
        """How many functions and files of ours most calls pass."""
        counts: Counter[tuple[int, int]] = Counter()
        for _ in range(50):
            profiler = cProfile.Profile()
            profiler.enable()
            self.below.step(x=1.0)
            profiler.disable()
            rows = pstats.Stats(profiler).stats  # type: ignore[attr-defined] # not in the stubs
            ours = [where for where in rows if "/vr/" in where[0]]
            counts[sum(rows[where][1] for where in ours), len({where[0] for where in ours})] += 1
        return list(counts.most_common(1)[0][0])


async def chain(transport: Any, process: Process | None, depth: int, leaf: type[Leaf], prefix: str) -> Any:
    """Start a chain of robots; returns a client of its top."""
    below = RobotAgent(leaf(f"{prefix}-leaf"), transport, process=process)
    await below.start()
    agents = [below]
    for level in range(depth):
        agent = RobotAgent(Chained(f"{prefix}-{level}"), transport, process=process)
        await agent.start()
        client = RobotClient(transport, agent.address)
        await client.enslave("below", agents[-1].address)
        agents.append(agent)
    return client, agents


def token_passing() -> list[float]:
    """Two threads that pass a token there and back, the least that handing over can cost."""
    there: queue.SimpleQueue[int] = queue.SimpleQueue()
    back: queue.SimpleQueue[int] = queue.SimpleQueue()

    def echo() -> None:
        while there.get():
            back.put(1)

    thread = threading.Thread(target=echo)
    thread.start()

    def trip() -> None:
        there.put(1)
        back.get()

    times = clock(trip, REPEATS)
    there.put(0)
    thread.join()
    return times


def bare_sockets(size: int) -> list[float]:
    """Two processes that send `size` bytes there and as many back over a Unix stream socket."""
    ours, theirs = socket.socketpair()
    if os.fork() == 0:
        ours.close()
        while data := theirs.recv(65536):
            theirs.sendall(data)
        os._exit(0)
    theirs.close()
    body = bytes(size)

    def trip() -> None:
        ours.sendall(body)
        got = 0
        while got < size:
            got += len(ours.recv(65536))

    times = clock(trip, REPEATS)
    ours.close()
    os.wait()
    return times


def be_zenoh(root: str) -> None:
    """A process that answers Zenoh queries in Zenoh's own thread."""
    with zenoh.open(zenoh_peer(root, listen=True)) as session:
        answer = zenoh.handlers.Callback(lambda query: query.reply("far", query.payload), indirect=False)
        session.declare_queryable("far", answer)
        stay()


def be_pyro(root: str) -> None:
    """A process with one Pyro5 object, on a Unix socket."""
    import Pyro5.api

    Pyro5.config.SERIALIZER = "msgpack"

    @Pyro5.api.expose  # type: ignore[misc] # has no stubs
    class Echo:
        def step(self, x: float) -> float:
            return x

    daemon = Pyro5.api.Daemon(unixsocket=f"{root}/pyro")
    daemon.register(Echo(), "far")
    print("ready", flush=True)
    daemon.requestLoop()


def be_grpc(root: str) -> None:
    """A process with one gRPC method that takes and gives bytes, on a Unix socket."""
    from concurrent.futures import ThreadPoolExecutor

    import grpc

    server = grpc.server(ThreadPoolExecutor(4))
    method = grpc.unary_unary_rpc_method_handler(lambda body, _: body)
    server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler("far", {"step": method}),))
    server.add_insecure_port(f"unix:{root}/grpc")
    server.start()
    stay()


def peers(root: str, size: int) -> dict[str, Callable[[], object]]:
    """Connect to those of the others that are there; returns one round trip of each."""
    body = bytes(size)
    session = zenoh.open(zenoh_peer(root, listen=False))

    def query() -> None:
        done = threading.Event()
        answers = zenoh.handlers.Callback(lambda _: None, done.set, indirect=False)
        session.get("far", answers, payload=body)
        done.wait()

    trips: dict[str, Callable[[], object]] = {"bare Zenoh query, two processes": query}
    if find_spec("Pyro5"):
        import Pyro5.api

        Pyro5.config.SERIALIZER = "msgpack"
        proxy = Pyro5.api.Proxy(f"PYRO:far@./u:{root}/pyro")
        trips["Pyro5 (msgpack), two processes"] = lambda: (proxy._pyroClaimOwnership(), proxy.step(1.0))  # noqa: SLF001 # its way
    if find_spec("grpc"):
        import grpc

        trips["gRPC (bytes), two processes"] = partial(
            grpc.insecure_channel(f"unix:{root}/grpc").unary_unary("/far/step"), body
        )
    return trips


BE: dict[str, Callable[[str], None]] = {
    "far": lambda _: asyncio.run(be_robot(Leaf("far"))),
    "zenoh": be_zenoh,
    "Pyro5": be_pyro,
    "grpc": be_grpc,
}
"""What runs in another process, by the word that starts it; the last two if they are installed."""


async def measure(rounds: int, root: str) -> dict[str, list[float]]:
    """Measure all in turns."""
    transport = await join()
    process = Process()
    results: dict[str, list[float]] = {}
    tops: dict[str, Any] = {}
    for name, depth, leaf in (
        ("nested child call", 1, Leaf),
        ("child call handed to a worker", 1, IsolatedLeaf),
        ("chain of 8, nested", 8, Leaf),
    ):
        tops[name], _ = await chain(transport, process, depth, leaf, name.split()[0] + str(depth))
    (key,) = transport.presence.keys("robot/far/*")
    far = Address("robot", "far", key.rpartition("/")[2])
    agent = RobotAgent(Chained("near"), transport, process=process)
    await agent.start()
    near = RobotClient(transport, agent.address)
    await near.enslave("below", far)
    tops["call of a child in another process"] = near
    call = Call(key="k" * 18, command="step", arguments={"x": 1.0}, epoch=1, deadline=60.0)
    size = len(seal(call, now=0.0, within=5.0, sender=far.key).body)

    others = peers(root, size)

    def note(name: str, times: list[float]) -> None:
        results.setdefault(name, []).extend(times)

    for _ in range(rounds):
        note("two threads pass a token", await asyncio.to_thread(token_passing))
        note("bare sockets, two processes", await asyncio.to_thread(bare_sockets, size))
        for name, trip in others.items():
            note(name, await asyncio.to_thread(clock, trip, REPEATS))
        for name, client in tops.items():
            note(name, await client.call("measure", {"repeats": REPEATS}))
    functions, files = await tops["nested child call"].call("profile", {})
    results["functions on the way of a nested call"] = [functions]
    results["files on the way"] = [files]
    process.close()
    await transport.close()
    return results


def main() -> None:
    """Print the table."""
    rounds = options(__doc__, rounds=10).rounds
    with apart() as folder:
        root = str(folder)
        others = [word for word in BE if word in {"far", "zenoh"} or find_spec(word)]
        with started(*((__file__, word, root) for word in others)):
            results = asyncio.run(measure(rounds, root))
    medians = {name: statistics.median(times) for name, times in results.items()}
    for name, times in results.items():
        if len(times) == 1:
            print(f"{name:<42} {times[0]:8.0f}")
        else:
            print(f"{name:<42} {min(times):8.1f} {medians[name]:8.1f} us")
    nested = medians["nested child call"]
    print(f"chain of 8 / one call: {medians['chain of 8, nested'] / nested:.1f}")
    far = medians["call of a child in another process"]
    for name, median in medians.items():
        if name.endswith("two processes"):
            print(f"another process / {name}: {far / median:.2f}")


if __name__ == "__main__":
    if sys.argv[1:2] and sys.argv[1] in BE:
        BE[sys.argv[1]](sys.argv[2])
    else:
        main()
