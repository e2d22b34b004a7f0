"""A living realm for Foxglove: `robotree foxglove` serves readings, logs, pictures, transforms and commands.

It listens at loopback alone. A client needs the token that is printed, in the path of the address, so neither
another user nor a page in a browser can connect; browsers must also come from Foxglove's own site. The
commands of robots are services: they are called in the name of the person who has started this, under the
same leases and the same policy as on the command line, and end when the client that called them is gone.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import logging
import math
import secrets
import time
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from http import HTTPStatus
from typing import TYPE_CHECKING, Any

import msgspec

from robotree.assistants.tools import field_schema
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome, Teller, plain
from robotree.tui.recording import foxglove_messages as messages
from robotree.tui.recording import foxglove_protocol as protocol
from robotree.tui.recording.foxglove_protocol import BadMessage, Channel, CommandService, ServiceCall
from robotree.tui.recording.recorder import LOOK, PAUSE, PICTURES, SIZE, rate_of
from robotree.tui.wire.lasting import lasting
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from websockets.asyncio.server import Server, ServerConnection
    from websockets.http11 import Request, Response

    from robotree.vr.base.description import CommandSpec, RobotDescription
    from robotree.vr.base.requests import LoggedLine, State
    from robotree.vr.supervision.realm_client import RealmClient

PORT = 8765
"""Where Foxglove looks when nobody says another one."""

ORIGINS = frozenset({"https://app.foxglove.dev", "https://lichtblick-suite.github.io"})
"""The sites whose pages may connect; programs that are no browser say none."""

WITHIN = 120.0
"""[s] for a command that is called as a service."""

WAITING = 256
"""Messages that wait for a client that reads slowly; older ones are left out."""

BEAT, SILENCE = 2.0, 6.0
"""[s] from the answer to a ping to the next one; and after which a client without an answer is not there. A
ping waits for what is written before it, so this is also how long a client may read nothing."""

CLOSE = 1.0
"""[s] in which a client agrees that its connection ends."""


class Client:
    """One program that is connected."""

    def __init__(self, connection: ServerConnection) -> None:
        """Begin without subscriptions."""
        self.connection = connection
        self.subscriptions = dict[int, int]()
        """Channels by subscription."""
        self.waiting = asyncio.Queue[str | bytes](WAITING)
        self.calls = set[asyncio.Task[None]]()

    def send(self, message: str | bytes) -> None:
        """Send something when the client reads; of what is too much the oldest is left out."""
        if self.waiting.full():
            self.waiting.get_nowait()
        self.waiting.put_nowait(message)

    async def write(self) -> None:
        """Write what waits, until the connection ends."""
        while True:
            await self.connection.send(await self.waiting.get())

    async def watch(self) -> None:
        """Cut the connection when the client gives no sign of life; its commands end then."""
        while True:
            try:
                async with asyncio.timeout(SILENCE):
                    await (await self.connection.ping())
            except TimeoutError:
                self.connection.transport.abort()
                return
            await asyncio.sleep(BEAT)


class FoxgloveServer:
    """Serves one realm to all clients."""

    def __init__(
        self, realm_client: RealmClient, token: str, *, services: bool, rate: float = PICTURES
    ) -> None:
        """Prepare.

        Args:
            realm_client: of the realm.
            token: that a client must have in its path.
            services: whether robots can be commanded.
            rate: [1/s] of pictures of each camera that somebody looks at.
        """
        self._realm_client, self._token, self._with_services = realm_client, token, services
        self._rate = rate
        self._session = secrets.token_hex(4)
        self._clients = set[Client]()
        self._channels = dict[str, Channel]()
        self._services = dict[str, CommandService]()
        self._robots: Mapping[str, RobotDescription] = {}
        self._count = 0
        self._changed = asyncio.Event()

    def _number(self) -> int:
        self._count += 1
        return self._count

    # -- who may connect --------------------------------------------------------------------------

    def admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Refuse who has not the token, or is a page of another site (`process_request`)."""
        origin = request.headers.get("Origin")
        if origin is not None and origin not in ORIGINS:
            return connection.respond(HTTPStatus.FORBIDDEN, f"pages of {origin[:80]} may not connect\n")
        given = request.path.strip("/").encode()
        if not hmac.compare_digest(given, self._token.encode()):
            return connection.respond(HTTPStatus.UNAUTHORIZED, "the token is missing or wrong\n")
        return None

    async def serve(self, connection: ServerConnection) -> None:
        """Be there for one client until it goes; then its commands end."""
        client = Client(connection)
        client.send(protocol.server_info("robotree", self._session, services=self._with_services))
        client.send(protocol.advertise(self._channels.values()))
        client.send(protocol.advertise_services(self._services.values()))
        self._clients.add(client)
        from websockets.exceptions import ConnectionClosed

        works = [asyncio.create_task(work) for work in (client.write(), client.watch())]
        reason = ""
        try:
            async for message in connection:
                self._take(client, message)
        except BadMessage as error:
            reason = str(error)[:100]
        except ConnectionClosed:
            pass
        finally:
            self._clients.discard(client)
            for task in (*works, *client.calls):
                task.cancel()
            await asyncio.gather(*works, *client.calls, return_exceptions=True)
        await connection.close(1002 if reason else 1000, reason)

    def _take(self, client: Client, message: str | bytes) -> None:
        if isinstance(message, bytes):
            call = protocol.service_call(message)
            task = asyncio.create_task(self._call(client, call))
            client.calls.add(task)
            task.add_done_callback(client.calls.discard)
            return
        new, over = protocol.wanted(message)
        known = {channel.number for channel in self._channels.values()}
        client.subscriptions.update({each: channel for each, channel in new.items() if channel in known})
        for each in over:
            client.subscriptions.pop(each, None)

    async def _call(self, client: Client, call: ServiceCall) -> None:
        """Have a command carried out for a client; a cancel ends it."""
        service = next((each for each in self._services.values() if each.number == call.service), None)
        try:
            if service is None:
                raise BadMessage("there is no such service any more")
            given = msgspec.json.decode(call.payload or b"{}", type=dict[str, Any])
            result = await self._realm_client.call(service.robot, service.command, given, deadline=WITHIN)
            client.send(protocol.answered(call, json.dumps({"result": plain(result)}).encode()))
        except (VrError, ValueError, RecursionError, msgspec.MsgspecError) as error:
            client.send(protocol.failure(call, str(error)))

    # -- what there is ----------------------------------------------------------------------------

    def _channel(self, topic: str, schema_name: str, schema: str) -> Channel:
        if topic not in self._channels:
            channel = self._channels[topic] = Channel(self._number(), topic, schema_name, schema)
            for client in self._clients:
                client.send(protocol.advertise([channel]))
        return self._channels[topic]

    def _of_foxglove(self, topic: str, name: str) -> Channel:
        name = f"foxglove.{name}"
        return self._channel(topic, name, json.dumps(messages.SCHEMAS[name]))

    def _publish(self, channel: Channel, unix: float, payload: bytes) -> None:
        for client in self._clients:
            for subscription, number in client.subscriptions.items():
                if number == channel.number:
                    client.send(protocol.data(subscription, unix, payload))

    def _looked_at(self, channel: Channel) -> bool:
        return any(channel.number in client.subscriptions.values() for client in self._clients)

    def take_state(self, name: str, state: State) -> None:
        """Publish how a robot is, and where."""
        now = time.time()
        finite = {key: value for key, value in state.readings.items() if math.isfinite(value)}
        readings = self._channel(f"/robots/{name}/readings", "robotree.readings", '{"type": "object"}')
        self._publish(readings, now, msgspec.json.encode(finite))
        whole = self._channel(f"/robots/{name}/state", "robotree.State", '{"type": "object"}')
        self._publish(whole, now, msgspec.json.encode(msgspec.structs.replace(state, readings=finite)))
        if where := messages.transforms(name, finite, self._robots.get(name), now):
            self._publish(self._of_foxglove(messages.TRANSFORMS, "FrameTransforms"), now, _json(where))

    def take_lines(self, name: str, lines: Sequence[LoggedLine]) -> None:
        """Publish lines of a robot's log."""
        channel = self._of_foxglove("/log", "Log")
        for line in lines:
            self._publish(channel, line.unix, _json(messages.log(name, line)))

    async def look(self) -> None:
        """Look who is there, and which commands there are; say so where that is another list."""
        robots = await self._realm_client.tree()
        self._robots = {robot.name: robot for robot in robots}
        if not self._with_services:
            return
        there = {
            f"/robots/{robot.name}/{command.name}": (robot, command)
            for robot in robots
            for command in robot.commands
            if command.available
        }
        gone = [name for name in self._services if name not in there]
        new = [
            self._service(robot, command)
            for name, (robot, command) in there.items()
            if name not in self._services
        ]
        numbers = [self._services.pop(name).number for name in gone]
        self._services.update({service.name: service for service in new})
        for client in self._clients:
            if numbers:
                client.send(protocol.unadvertise_services(numbers))
            if new:
                client.send(protocol.advertise_services(new))

    def _service(self, robot: RobotDescription, command: CommandSpec) -> CommandService:
        properties = {field.name: field_schema(field) for field in command.parameters}
        required = [field.name for field in command.parameters if field.required]
        schema = {
            "type": "object",
            "properties": properties,
            "required": required,
            "description": command.doc,
        }
        return CommandService(self._number(), robot.name, command.name, json.dumps(schema))

    async def _pictures(self) -> None:
        """Fetch a picture of each camera that somebody looks at."""
        width, height = SIZE
        for view in self._realm_client.views():
            for camera in (await self._realm_client.describe_view(view.name)).cameras:
                channel = self._of_foxglove(f"/views/{view.name}/{camera}", "CompressedImage")
                if not self._looked_at(channel):
                    continue
                picture = await self._realm_client.look(view.name, camera=camera, width=width, height=height)
                now = time.time()
                self._publish(channel, now, _json(messages.image(now, picture)))

    async def follow(self) -> None:
        """Follow the realm until it is cancelled."""
        realm_client = self._realm_client
        forget = realm_client.on_change(self._changed.set)
        registrations = [
            await realm_client.watch_state(None, self.take_state),
            await realm_client.watch_log(None, self.take_lines),
        ]
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._repeat(self._look_after_changes, PAUSE))
                if self._rate:
                    group.create_task(self._repeat(self._pictures, 1.0 / self._rate))
        finally:
            forget()
            for each in registrations:
                await each.close()

    async def _look_after_changes(self) -> None:
        await self.look()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(LOOK):
                await self._changed.wait()
        self._changed.clear()

    async def _repeat(self, work: Callable[[], Any], pause: float) -> None:
        while True:
            with contextlib.suppress(VrError):  # nobody answers at the moment: the next time somebody will
                await work()
            await asyncio.sleep(pause)


def _json(said: Mapping[str, Any]) -> bytes:
    return json.dumps(said).encode()


@contextlib.asynccontextmanager
async def listening(server: FoxgloveServer, port: int) -> AsyncGenerator[Server]:
    """Listen at a port of loopback for the time of a block; 0: a free one."""
    from websockets.asyncio.server import serve
    from websockets.typing import Subprotocol

    quiet = logging.getLogger("robotree.tui.recording.socket")
    quiet.setLevel(logging.CRITICAL)  # strangers could fill the log
    async with serve(
        server.serve,
        "127.0.0.1",
        port,
        process_request=server.admit,
        subprotocols=[Subprotocol(each) for each in protocol.SUBPROTOCOLS],
        max_size=protocol.LARGEST,
        server_header=None,
        ping_interval=None,  # `Client.watch` also sees who reads nothing
        close_timeout=CLOSE,
        logger=quiet,
    ) as there:
        yield there


async def foxglove(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Serve a realm to Foxglove until Ctrl-C, or for a time."""
    token, refusal = secrets.token_urlsafe(16), "is no port; write a number from 0 (a free one) to 65535"
    port = values.whole("PORT", line.text("--port", str(PORT)), 0, 65535, refusal)
    server = FoxgloveServer(
        realm_client, token, services=not line.flag("--look-only"), rate=rate_of(line.text("--pictures"))
    )
    await server.look()
    async with lasting(line) as here, listening(server, port) as there:
        address = f"ws://127.0.0.1:{next(iter(there.sockets)).getsockname()[1]}/{token}"
        teller.outcome(Outcome({"address": address}, f"ready {address}"))
        teller.warn("open this address in Foxglove (Open connection, Foxglove WebSocket); Ctrl-C ends it")
        await here.until(server.follow())
    return Outcome(None)
