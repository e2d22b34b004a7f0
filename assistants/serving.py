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
from typing import Any, Final, NamedTuple

import uvicorn
from mcp.server.stdio import stdio_server
from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
from mcp.server.transport_security import TransportSecuritySettings

from robotree.assistants import pipes
from robotree.assistants.catalogue import Catalogue
from robotree.assistants.keys import AssistantKeys
from robotree.assistants.pipes import BoundedLines, PatientTexts, own_stdio
from robotree.assistants.seat import Floor, Seat
from robotree.assistants.server import HUNG_UP, AssistantServer
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
LOOKS: Final = 0.5
"""[s] between two looks at the process of a client whose request waits."""
STOPPED: Final = 3.0
"""[s] for which that process may be stopped, until its client counts as gone."""

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
async def seated(name: str, floor: Floor, proof: str) -> AsyncGenerator[AssistantServer]:
    """Serve an assistant for the time of a block; its commands end with it, or do what the policy says."""
    seat = Seat(floor, name, proof)
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
    name, proof = keys.proved(key)
    with own_stdio() as (come, go):
        texts = PatientTexts(go)
        lines: Any = BoundedLines(come, LARGEST, texts)  # the library uses no more of a file
        out: Any = texts
        async with seated(name, floor, proof) as server, stdio_server(lines, out) as (read, write):
            watching = asyncio.create_task(watch_peer(pipes.of_descriptor(come), server.hung_up))
            try:
                await server.server.run(read, write, server.options())
            finally:
                watching.cancel()


async def watch_peer(client: pipes.Peer, hung_up: asyncio.Event) -> None:
    """Have a client count as gone while its process is stopped for long; runs until it is cancelled.

    Args:
        client: who is at the other end.
        hung_up: set while it counts as gone.
    """
    stopped_for = 0.0
    while True:
        await asyncio.sleep(LOOKS)
        stopped_for = stopped_for + LOOKS if await asyncio.to_thread(client.stopped) else 0.0
        if stopped_for >= STOPPED:
            hung_up.set()
        elif not stopped_for:
            hung_up.clear()


@contextlib.asynccontextmanager
async def heard(scope: _Scope, receive: _Receive) -> AsyncGenerator[_Receive]:
    """Note in a request when its connection ends (`HUNG_UP`), also while nobody reads from it.

    It counts as ended, too, while the process at its other end is stopped for long.

    Args:
        scope: of the request (ASGI 3); it gets an event.
        receive: reads from the connection.

    Yields:
        What reads from it instead.
    """
    ended = scope[HUNG_UP] = asyncio.Event()
    came: asyncio.Queue[MutableMapping[str, Any]] = asyncio.Queue(1)

    async def listen() -> None:
        while not ended.is_set():
            message = await receive()
            if message["type"] == "http.disconnect":
                ended.set()
            await came.put(message)

    async def hearing() -> MutableMapping[str, Any]:
        message = await came.get()
        if message["type"] == "http.disconnect":
            came.put_nowait(message)  # who receives again gets it again
        return message

    async def watch() -> None:
        await asyncio.sleep(LOOKS)  # most requests are over then
        (_, there), (_, here) = scope["client"], scope["server"]
        client, stopped = await asyncio.to_thread(pipes.of_connection, there, here), asyncio.Event()
        watching = asyncio.create_task(watch_peer(client, stopped))
        try:
            await stopped.wait()
            ended.set()
        finally:
            watching.cancel()

    tasks = [asyncio.create_task(listen()), asyncio.create_task(watch())]
    try:
        yield hearing
    finally:
        ended.set()
        for task in tasks:
            task.cancel()


class HttpFront:
    """The door for all assistants of a realm: it knows each by the key of its request."""

    def __init__(self, floor: Floor, keys: AssistantKeys) -> None:
        """Take the robots, and who may come in."""
        self._floor, self._keys = floor, keys
        self._served: dict[str, _Served] = {}
        """By what is kept of their keys: another key of an assistant is served anew."""
        self._seating = asyncio.Lock()
        self.refused = 0
        """Requests without a good key."""

    async def close(self) -> None:
        """End what all assistants have begun, as the policy says."""
        served = [*self._served.values()]
        for each in served:
            each.end.set()
        await asyncio.gather(*(each.task for each in served), return_exceptions=True)

    async def __call__(self, scope: _Scope, receive: _Receive, send: _Send) -> None:
        """Answer one request (ASGI 3)."""
        if scope["type"] != "http":
            return
        if scope["path"] != PATH:
            await _say(send, 404, "not found")
            return
        try:
            name, proof = self._keys.proved(_bearer(scope))
        except AssistantUnknown as error:
            self.refused += 1
            await _say(send, 401, str(error))
            return
        manager = await self._manager_of(name, proof)
        async with heard(scope, receive) as hearing:
            await manager.handle_request(scope, hearing, send)

    async def _manager_of(self, name: str, proof: str) -> StreamableHTTPSessionManager:
        async with self._seating:
            if proof not in self._served:
                ready: asyncio.Future[StreamableHTTPSessionManager] = (
                    asyncio.get_running_loop().create_future()
                )
                end = asyncio.Event()
                task = asyncio.create_task(self._serve(name, proof, ready, end))
                first: list[asyncio.Future[Any]] = [task, ready]
                await asyncio.wait(first, return_when=asyncio.FIRST_COMPLETED)
                if not ready.done():
                    await task  # it raises why it could not begin
                self._served[proof] = _Served(ready.result(), end, task)
            return self._served[proof].manager

    async def _serve(
        self, name: str, proof: str, ready: asyncio.Future[StreamableHTTPSessionManager], end: asyncio.Event
    ) -> None:
        """Serve one assistant until the end, or until its key is good no more."""
        async with seated(name, self._floor, proof) as server:
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
            async with manager.run():
                ready.set_result(manager)
                waits = [asyncio.create_task(each.wait()) for each in (end, server.seat.revoked)]
                await asyncio.wait(waits, return_when=asyncio.FIRST_COMPLETED)
                for each in waits:
                    each.cancel()
                self._served.pop(proof, None)


class _Served(NamedTuple):
    """One assistant with one key."""

    manager: StreamableHTTPSessionManager
    end: asyncio.Event
    task: asyncio.Task[None]


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
