"""A client of Foxglove's protocol, as the tests need it: of our server, and of Foxglove's own SDK."""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.typing import Subprotocol


class Foxglove:
    """Hears one server."""

    def __init__(self, connection: ClientConnection) -> None:
        self.connection = connection
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        self.services: dict[str, dict[str, Any]] = {}
        self.heard: dict[int, list[Any]] = {}
        """By subscription."""
        self.answers: dict[int, Any] = {}
        """Of calls: what came back, or the sentence of the failure."""
        self._task = asyncio.create_task(self._hear())

    async def _hear(self) -> None:
        async for message in self.connection:
            if isinstance(message, bytes):
                self._take(message)
                continue
            said = json.loads(message)
            match said["op"]:
                case "serverInfo":
                    self.info = said
                case "advertise":
                    self.channels.update({each["topic"]: each for each in said["channels"]})
                case "advertiseServices":
                    self.services.update({each["name"]: each for each in said["services"]})
                case "unadvertiseServices":
                    self.services = {
                        name: each
                        for name, each in self.services.items()
                        if each["id"] not in said["serviceIds"]
                    }
                case "serviceCallFailure":
                    self.answers[said["callId"]] = said["message"]
                case _:
                    pass

    def _take(self, message: bytes) -> None:
        if message[0] == 1:
            (subscription,) = struct.unpack_from("<I", message, 1)
            self.heard.setdefault(subscription, []).append(json.loads(message[13:]))
        elif message[0] == 3:
            _, _, call, length = struct.unpack_from("<BIII", message)
            self.answers[call] = json.loads(message[13 + length :])

    async def subscribe(self, topic: str, number: int) -> None:
        wanted = [{"id": number, "channelId": self.channels[topic]["id"]}]
        await self.connection.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    async def call(self, name: str, number: int, **arguments: Any) -> None:
        head = struct.pack("<BIII", 2, self.services[name]["id"], number, 4)
        await self.connection.send(head + b"json" + json.dumps(arguments).encode())

    async def close(self) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        await self.connection.close()


@asynccontextmanager
async def connected(address: str, origin: str | None = None) -> AsyncIterator[Foxglove]:
    wanted = [Subprotocol("foxglove.sdk.v1")]
    async with connect(address, subprotocols=wanted, origin=origin, max_size=None) as connection:  # type: ignore[arg-type]
        client = Foxglove(connection)
        try:
            yield client
        finally:
            await client.close()
