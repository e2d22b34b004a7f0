"""How long a stop waits behind a flood of commands, between real processes.

A flooder sends many small requests to one agent and waits for none of them. Meanwhile the same agent is asked
two things at the same moment: one that is urgent and one that is not, which is what the urgent one would take
without its mark. Prints the median and the worst of some floods.

    python bench/urgent.py [FLOODS]
"""

from __future__ import annotations

import asyncio
import statistics
import sys
import time

from measuring import apart, count_given, heard, started, stay

from robotree.vr.base.transport import Respond, on_loop
from robotree.vr.network.local import LocalTransport, join

FLOOD = 20_000
"""Requests in one flood."""
AGENT = "robot/echo/1"
MOMENT = 0.8
"""[s] from the beginning of a flood to the questions."""
LONGEST = 60.0
"""[s] for one flood to be answered."""


async def ask(transport: LocalTransport, *, urgent: bool) -> float:
    """Return how long one answer took [s]."""
    begin = time.perf_counter()
    async for _ in transport.request(AGENT, bytes(64), timeout=LONGEST, urgent=urgent):
        pass
    return time.perf_counter() - begin


async def echo(transport: LocalTransport) -> None:
    """Answer requests with what they say, until the standard input closes."""

    async def handler(body: bytes, respond: Respond) -> None:
        respond(body)

    await transport.serve(AGENT, on_loop(handler))
    await asyncio.to_thread(stay)


async def flood(transport: LocalTransport) -> None:
    """Flood the agent for each line on the standard input, and say when all is answered."""
    print("ready", flush=True)
    while await asyncio.to_thread(sys.stdin.readline):
        replies = [transport.request(AGENT, bytes(64), timeout=LONGEST) for _ in range(FLOOD)]
        for reply in replies:
            async for _ in reply:
                pass
        print("over", flush=True)


async def be(word: str) -> None:
    """Be a member."""
    await (echo if word == "echo" else flood)(await join())


def show(what: str, seconds: list[float]) -> None:
    """Print one line of the table."""
    print(
        f"{what:44} {statistics.median(seconds) * 1e3:8.1f} {max(seconds) * 1e3:8.1f}  ms  n={len(seconds)}"
    )


async def main(floods: int) -> None:
    """Measure."""
    idle, urgent, ordinary = list[float](), list[float](), list[float]()
    with started((__file__, "echo"), (__file__, "flood")) as (_, flooder):
        transport = await join()
        for _ in range(floods):
            idle.append(await ask(transport, urgent=True))
            if flooder.stdin is not None:
                flooder.stdin.write("go\n")
                flooder.stdin.flush()
            await asyncio.sleep(MOMENT)
            first, second = await asyncio.gather(ask(transport, urgent=True), ask(transport, urgent=False))
            urgent.append(first)
            ordinary.append(second)
            await asyncio.to_thread(heard, flooder)
        await transport.close()
    show("urgent, nothing else going on", idle)
    show(f"urgent, in a flood of {FLOOD:,}", urgent)
    show("ordinary, at the same moments", ordinary)


if __name__ == "__main__":
    if len(sys.argv) > 1 and not sys.argv[1].isdigit():
        asyncio.run(be(sys.argv[1]))
    else:
        with apart():
            asyncio.run(main(count_given(1, 7)))
