"""One process of a realm, for tests that kill, stop and interrupt real ones.

Run as `member.py ROOT WORD…`; says `ready` when it is up, and ends when its standard input closes.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

from robotree.vr.host.zenoh import ZenohTransport, join
from robotree.vr.transport import Respond


async def echo(body: bytes, respond: Respond) -> None:
    respond(b"ack")
    if body == b"long":
        await asyncio.sleep(60)
    respond(body)


def say(word: str) -> None:
    sys.stdout.write(f"{word}\n")
    sys.stdout.flush()


async def until_the_end() -> None:
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.read)


async def serve(transport: ZenohTransport, name: str) -> None:
    """Serve and announce one robot."""
    await transport.serve(f"robot/{name}/1", echo)
    await transport.announce(f"robot/{name}/1")
    say("ready")
    await until_the_end()
    await transport.close()


async def leave_open(transport: ZenohTransport, name: str) -> None:
    """End without closing anything, in the middle of traffic."""
    await transport.subscribe("**", lambda _key, _body: None)
    await transport.serve(f"robot/{name}/1", echo)
    await transport.announce(f"robot/{name}/1")
    say("ready")
    for _ in range(200):
        transport.publish("robot/noise", bytes(100))
        await asyncio.sleep(0.001)


async def wait_for_interrupt(transport: ZenohTransport, name: str) -> None:
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


WORDS: dict[str, Callable[[ZenohTransport, str], Awaitable[None]]] = {
    "serve": serve,
    "leave-open": leave_open,
    "wait-for-interrupt": wait_for_interrupt,
}


async def main(root: str, word: str, name: str) -> None:
    await WORDS[word](await join("test", root=Path(root)), name)


if __name__ == "__main__":
    try:
        asyncio.run(main(*sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(130)
