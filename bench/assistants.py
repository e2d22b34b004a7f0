"""What it costs that an assistant asks: the list of many robots' tools, and a call over a client's same call.

    python bench/assistants.py [--robots N] [--calls N] [--profile FILE]

The protocol's own client asks a server of this repository over stdio, in a process of its own; the robot is
in a third one, and the realm has a policy. The calls alternate with the same call by a client of robotree,
30 ms apart: of more than 50 requests in a second an assistant's server deals with none. The robots of the
list are one that described itself, so many times under other names; asking them is no part of a list. Times
in ms.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import statistics
import sys
import time
from typing import Annotated, Any

from mcp import Client
from mcp.client.stdio import StdioServerParameters
from measuring import apart, be_robot, cpu, middle, options, started
from msgspec.structs import replace

from robotree.assistants.keys import AssistantKeys
from robotree.assistants.serving import KEY, floor_of, over_stdio
from robotree.client.joining import joined
from robotree.vr import Range, Robot, Unit, command
from robotree.vr.base.address import Address
from robotree.vr.base.principal import user_name
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.local import join
from robotree.vr.network.policy_file import state_of

REALM = "assisted"
APART = 0.03
"""[s] between two calls."""
LISTS = 10
"""How often the list is asked for, after the first time."""
Place = Annotated[float, Unit("m"), Range(-1, 1), "a place"]


class Arm(Robot):
    """An arm with three commands."""

    def readings(self) -> dict[str, float]:
        """Tell where it is."""
        return {"x": 0.0, "y": 0.0}

    @command(effect="read")
    def look(self, x: Place = 0.0) -> float:
        """Return the argument."""
        return x

    @command(effect="repeat")
    def go_to(self, x: Place = 0.0, y: Place = 0.0) -> float:
        """Return an argument."""
        return x + y

    @command
    def halt(self) -> None:
        """Do nothing."""


async def far() -> None:
    """A process with a lookup service and a robot."""
    await LookupService(await join(), "lookup").start()
    await be_robot(Arm("far"), listed=True)


async def serve(robots: int) -> None:
    """Serve an assistant over stdio, with so many robots in its list."""
    async with joined(REALM) as realm_client:
        folder = state_of(REALM)
        async with floor_of(realm_client, folder) as floor:
            known = asyncio.Event()
            floor.catalogue.on_change(known.set)
            while "far" not in floor.catalogue.robots:
                known.clear()
                await known.wait()
            far_one = floor.catalogue.robots["far"]
            for number in range(robots - 1):
                address = Address("robot", f"arm-{number}", "bench")
                floor.catalogue.robots[address.name] = replace(far_one, address=address)
            floor.catalogue.version += 1
            await over_stdio(floor, AssistantKeys(folder), os.environ[KEY])


async def listed(client: Client) -> int:
    """Ask for the whole list of tools, page by page; returns how many there are."""
    count, cursor = 0, None
    while True:
        page = await client.list_tools(cursor=cursor, cache_mode="bypass")
        count, cursor = count + len(page.tools), page.next_cursor
        if cursor is None:
            return count


async def measure_alone(server: StdioServerParameters) -> None:
    """Print what a list costs the server, and how long a client waits that only reads JSON."""
    process = await asyncio.create_subprocess_exec(
        server.command, *server.args, env=server.env, limit=1 << 26,
        stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
    )  # fmt: skip
    assert process.stdin is not None and process.stdout is not None  # noqa: S101, PT018 # as asked for
    go, come = process.stdin, process.stdout

    async def asked(method: str, **given: Any) -> dict[str, Any]:
        go.write(json.dumps({"jsonrpc": "2.0", "id": 1, "method": method, "params": given}).encode() + b"\n")
        return json.loads(await come.readline())["result"]  # type: ignore[no-any-return] # JSON

    client = {"name": "bench", "version": "1"}
    await asked("initialize", protocolVersion="2025-06-18", capabilities={}, clientInfo=client)
    go.write(b'{"jsonrpc": "2.0", "method": "notifications/initialized"}\n')
    waits, works = list[float](), list[float]()
    for _ in range(LISTS + 1):
        began, before, page = time.perf_counter(), cpu(process.pid), await asked("tools/list")
        while cursor := page.get("nextCursor"):
            page = await asked("tools/list", cursor=cursor)
        waits.append((time.perf_counter() - began) * 1e3)
        works.append((cpu(process.pid) - before) * 1e3)
    first, then = f"{waits[0]:.0f} ms ({works[0]:.0f})", f"{statistics.median(waits[1:]):.0f} ms"
    print(f"list, by a client that only reads JSON (the server's processor): first {first},"
          f" then {then} ({statistics.mean(works[1:]):.0f})")  # fmt: skip
    process.terminate()
    await process.wait()


async def measure(key: str, given: argparse.Namespace) -> None:
    """Print the figures."""
    words = [__file__, "serve", str(given.robots)]
    if given.profile:
        words = ["-m", "cProfile", "-o", given.profile, *words]
    server = StdioServerParameters(command=sys.executable, args=words, env={**os.environ, KEY: key})
    async with joined(REALM) as realm_client, Client(server) as client:
        await measure_alone(server)
        times, works, count = list[float](), list[float](), 0
        for _ in range(LISTS + 1):
            began, before = time.perf_counter(), time.process_time()
            count = await listed(client)
            times.append((time.perf_counter() - began) * 1e3)
            works.append((time.process_time() - before) * 1e3)
        print(f"list of {count} tools of {given.robots} robots: first {times[0]:.0f} ms,"
              f" then {statistics.median(times[1:]):.0f} ms; of the protocol's own client's processor"
              f" {statistics.median(works[1:]):.0f} ms")  # fmt: skip
        for command_, what in (("look", "that reads"), ("go_to", "that moves")):
            direct, assisted = list[float](), list[float]()
            for _ in range(given.calls):
                began = time.perf_counter()
                await realm_client.call("far", command_, {"x": 0.5})
                direct.append((time.perf_counter() - began) * 1e3)
                await asyncio.sleep(APART)
                began = time.perf_counter()
                answer = await client.call_tool(f"far__{command_}", {"x": 0.5, "_why": "to measure"})
                assisted.append((time.perf_counter() - began) * 1e3)
                assert not answer.is_error, answer  # noqa: S101 # a refusal is quick
                await asyncio.sleep(APART)
            by_client = statistics.median(direct)
            more = statistics.median(assisted) - by_client
            print(f"a call {what}: by an assistant {middle(assisted, 'ms')}, by a client {by_client:.1f};"
                  f" overhead {more:.1f} ms, {given.calls} calls")  # fmt: skip
    print(f"load {os.getloadavg()[0]:.1f}")


def rules() -> str:
    """Return the policy."""
    return (
        f"realm: {REALM}\nversion: 1\npersons: {{'{user_name(os.geteuid())}': all}}\n"
        "assistants: {claude: {role: all, calls: 100000, metres: 1000, seconds: 3600}}\n"
        "roles: {all: {see: '*', command: '*'}}\n"
    )


def main() -> None:
    """Print the figures."""
    given = options(__doc__, robots=1000, calls=100, profile="")
    with apart(REALM):
        state = state_of(REALM)
        state.mkdir(parents=True, mode=0o700)
        (state / "policy.yaml").write_text(rules())
        key = AssistantKeys(state).invite("claude")
        with started((__file__, "far")):
            asyncio.run(measure(key, given))


if __name__ == "__main__":
    if sys.argv[1:2] == ["serve"]:
        asyncio.run(serve(int(sys.argv[2])))
    elif sys.argv[1:2] == ["far"]:
        asyncio.run(far())
    else:
        main()
