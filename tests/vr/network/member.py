"""One process of a realm, for tests that kill, stop and interrupt real ones.

Run as `member.py WORD NAME`; says `ready` when it is up, and ends when its standard input closes.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable, Callable, Coroutine

from robotree.vr import Robot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.agents.run import run_host, run_lookup
from robotree.vr.base.transport import Respond, on_loop
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.network.local import LocalTransport, join

TETHER = sys.stdin
"""Kept here, because in the process of a host pages get no input."""


async def echo(body: bytes, respond: Respond) -> None:
    respond(b"ack")
    if body == b"long":
        await asyncio.sleep(60)
    respond(body)


def say(word: str) -> None:
    sys.stdout.write(f"{word}\n")
    sys.stdout.flush()


async def until_the_end() -> None:
    await asyncio.get_running_loop().run_in_executor(None, TETHER.read)


async def serve(transport: LocalTransport, name: str) -> None:
    """Serve and announce one robot."""
    await transport.serve(f"robot/{name}/1", on_loop(echo))
    await transport.announce(f"robot/{name}/1")
    say("ready")
    await until_the_end()
    await transport.close()


async def leave_open(transport: LocalTransport, name: str) -> None:
    """End without closing anything, in the middle of traffic."""
    await transport.subscribe("**", lambda _key, _body: None)
    await transport.serve(f"robot/{name}/1", on_loop(echo))
    await transport.announce(f"robot/{name}/1")
    say("ready")
    for _ in range(200):
        transport.publish("robot/noise", bytes(100))
        await asyncio.sleep(0.001)


async def wait_for_interrupt(transport: LocalTransport, name: str) -> None:
    """Be interrupted in the middle of traffic; close on the way out, as every agent does."""
    try:
        await transport.subscribe("**", lambda _key, _body: None)
        await transport.announce(f"robot/{name}/1")
        say("ready")
        while True:
            transport.publish("robot/noise", bytes(100))
            await asyncio.sleep(0.001)
    finally:
        await transport.close()


class Rover(Robot):
    """A rover without wheels."""

    @command
    def move(self, x: float) -> float:
        return x

    @command
    def wait(self) -> None:
        self.sleep(60)


async def robot(transport: LocalTransport, name: str) -> None:
    """Be a robot with an agent."""
    registrar = Registrar(transport)
    agent = RobotAgent(Rover(name), transport, registrar=registrar)
    await agent.start()
    say("ready")
    await until_the_end()
    await agent.close()
    await registrar.close()
    await transport.close()


async def while_tethered(work: Coroutine[None, None, None]) -> None:
    """Do something until the standard input closes."""
    task = asyncio.ensure_future(work)
    end = asyncio.ensure_future(until_the_end())
    await asyncio.wait((task, end), return_when=asyncio.FIRST_COMPLETED)
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


MEMBERS: dict[str, Callable[[LocalTransport, str], Awaitable[None]]] = {
    "serve": serve,
    "leave-open": leave_open,
    "wait-for-interrupt": wait_for_interrupt,
    "robot": robot,
}
SERVICES: dict[str, Callable[..., Coroutine[None, None, None]]] = {
    "lookup": run_lookup,
    "host": run_host,
}


async def main(word: str, name: str) -> None:
    if word in SERVICES:
        await while_tethered(SERVICES[word](name, ready=lambda _: say("ready")))
    else:
        await MEMBERS[word](await join(), name)


if __name__ == "__main__":
    try:
        asyncio.run(main(*sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(130)
