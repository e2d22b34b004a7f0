"""Serving assistants: one over stdio, or many over streamable HTTP on loopback.

Who asks proves it by a key, and by nothing else: over stdio the variable `ROBOTREE_MCP_KEY` has it, over HTTP
each request (`Authorization: Bearer KEY`). The port is on loopback, and requests from web pages are refused.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncGenerator, Awaitable, Callable, Generator, MutableMapping
from pathlib import Path
from typing import Any, Final

import uvicorn
from mcp.server.stdio import stdio_server
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from mcp.server.transport_security import TransportSecuritySettings

from robotree.assistants.catalogue import Catalogue
from robotree.assistants.keys import AssistantKeys
from robotree.assistants.seat import Floor, Seat
from robotree.assistants.server import AssistantServer
from robotree.vr.base.errors import AssistantUnknown
from robotree.vr.network.permit_file import PermitFiles
from robotree.vr.supervision.realm_client import RealmClient

KEY: Final = "ROBOTREE_MCP_KEY"
"""The variable of the environment that has the key of the assistant over stdio."""
PATH: Final = "/mcp"
LARGEST: Final = 256 * 1024
"""[B] of one request."""
SESSIONS: Final = 16
"""Of clients of earlier versions of the protocol, by assistant."""
IDLE: Final = 300.0
"""[s] after which such a session is forgotten."""

_Scope = MutableMapping[str, Any]
_Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
_Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]


@contextlib.asynccontextmanager
async def floor_of(
    realm_client: RealmClient, folder: Path, pattern: str = "*", rehearses_for: Path | None = None
) -> AsyncGenerator[Floor]:
    """Look at the robots of a realm for the time of a block.

    Args:
        realm_client: the realm, joined.
        folder: in which it keeps its things.
        pattern: of the names of the robots that are served.
        rehearses_for: the folder of the real realm, if this one is its twin.
    """
    catalogue = Catalogue(realm_client, pattern)
    await catalogue.start()
    try:
        yield Floor(realm_client, catalogue, folder, PermitFiles(folder), rehearses_for)
    finally:
        await catalogue.close()


@contextlib.asynccontextmanager
async def seated(name: str, floor: Floor) -> AsyncGenerator[AssistantServer]:
    """Serve an assistant for the time of a block; its commands end with it, or do what the policy says."""
    seat = Seat(name, floor)
    await seat.start()
    seat.record.write("came")
    try:
        yield AssistantServer(seat)
    finally:
        await seat.close()


async def over_stdio(floor: Floor, keys: AssistantKeys, key: str) -> None:
    """Serve the assistant that has a key, until it closes its end.

    Raises:
        AssistantUnknown: nobody has it.
    """
    name = keys.name_of(key)
    async with seated(name, floor) as server, stdio_server() as (read, write):
        await server.server.run(read, write, server.options())


class HttpFront:
    """The door for all assistants of a realm: it knows each by the key of its request."""

    def __init__(self, floor: Floor, keys: AssistantKeys) -> None:
        """Take the robots, and who may come in."""
        self._floor, self._keys = floor, keys
        self._stack = contextlib.AsyncExitStack()
        self._managers: dict[str, StreamableHTTPSessionManager] = {}
        self._seating = asyncio.Lock()
        self.refused = 0
        """Requests without a good key."""

    async def close(self) -> None:
        """End what all assistants have begun, as the policy says."""
        await self._stack.aclose()

    async def __call__(self, scope: _Scope, receive: _Receive, send: _Send) -> None:
        """Answer one request (ASGI 3)."""
        if scope["type"] == "lifespan":
            await _live(receive, send)
            return
        if scope["type"] != "http":
            return
        if scope["path"] != PATH:
            await _say(send, 404, "not found")
            return
        try:
            name = self._keys.name_of(_bearer(scope))
        except AssistantUnknown as error:
            self.refused += 1
            await _say(send, 401, str(error))
            return
        manager = await self._manager_of(name)
        await manager.handle_request(scope, receive, send)

    async def _manager_of(self, name: str) -> StreamableHTTPSessionManager:
        async with self._seating:
            if name not in self._managers:
                server = await self._stack.enter_async_context(seated(name, self._floor))
                manager = StreamableHTTPSessionManager(
                    server.server,
                    security_settings=TransportSecuritySettings(
                        enable_dns_rebinding_protection=True,
                        allowed_hosts=["127.0.0.1:*", "localhost:*", "[::1]:*"],
                        allowed_origins=[],
                    ),
                    max_request_body_size=LARGEST,
                    session_idle_timeout=IDLE,
                    max_sessions=SESSIONS,
                )
                self._managers[name] = await self._running(manager)
            return self._managers[name]

    async def _running(self, manager: StreamableHTTPSessionManager) -> StreamableHTTPSessionManager:
        """Run a manager in a task of its own: its block must be left where it was entered."""
        ready, end = asyncio.Event(), asyncio.Event()

        async def run() -> None:
            async with manager.run():
                ready.set()
                await end.wait()

        task = asyncio.create_task(run())

        async def stop() -> None:
            end.set()
            await asyncio.gather(task, return_exceptions=True)

        self._stack.push_async_callback(stop)
        await ready.wait()
        return manager


class _Uvicorn(uvicorn.Server):
    """The web server, without handlers of signals: robotree has its own."""

    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None]:
        yield


async def over_http(floor: Floor, keys: AssistantKeys, port: int, ready: Callable[[str], object]) -> None:
    """Serve all assistants that have keys, on loopback, until this is cancelled.

    Args:
        floor: the robots.
        keys: who may come in.
        port: 0: any that is free.
        ready: told the address when it listens.

    Raises:
        OSError: the port cannot be had.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as door:
        door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        door.bind(("127.0.0.1", port))
        door.listen(64)
        front = HttpFront(floor, keys)
        config = uvicorn.Config(front, log_level="warning", lifespan="off", access_log=False, ws="none",
                                timeout_graceful_shutdown=3)  # fmt: skip
        server = _Uvicorn(config)
        ready(f"http://127.0.0.1:{door.getsockname()[1]}{PATH}")
        serving = asyncio.create_task(server.serve(sockets=[door]))
        try:
            await asyncio.shield(serving)
        finally:
            server.should_exit = True
            await front.close()
            await asyncio.gather(serving, return_exceptions=True)


def _bearer(scope: _Scope) -> str:
    for name, value in scope["headers"]:
        if name == b"authorization":
            kind, _, key = value.decode("latin-1").partition(" ")
            return key.strip() if kind.lower() == "bearer" else ""
    return ""


async def _say(send: _Send, status: int, text: str) -> None:
    headers = [(b"content-type", b"text/plain; charset=utf-8")]
    if status == 401:
        headers.append((b"www-authenticate", b'Bearer realm="robotree"'))
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": text.encode()})


async def _live(receive: _Receive, send: _Send) -> None:
    while True:
        message = await receive()
        await send({"type": f"{message['type']}.complete"})
        if message["type"] == "lifespan.shutdown":
            return
