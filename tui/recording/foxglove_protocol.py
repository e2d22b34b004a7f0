"""The messages of Foxglove's WebSocket protocol that `robotree foxglove` speaks. Pure.

Texts are JSON objects with `op`; binary messages begin with an opcode, and their numbers are little-endian:

    1 to the client    u32 subscription, u64 time [ns since 1970], payload
    2 from the client  u32 service, u32 call, u32 length of the encoding's name, its name, payload
    3 to the client    the same, with the answer

as https://github.com/foxglove/ws-protocol/blob/main/docs/spec.md has them (subprotocol
`foxglove.websocket.v1`, which newer programs call `foxglove.sdk.v1`).
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, NamedTuple

import msgspec

SUBPROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
"""The one that is wanted most comes first."""

DATA, CALL, ANSWER = 1, 2, 3
"""Opcodes."""

_DATA = struct.Struct("<BIQ")
_CALL = struct.Struct("<BIII")

LARGEST = 1 << 20
"""[bytes] of one message of a client."""


class BadMessage(ValueError):
    """Something that is no message of the protocol."""


class Channel(NamedTuple):
    """Something that can be subscribed to."""

    number: int
    topic: str
    schema_name: str
    schema: str
    """JSON schema."""

    def structure(self) -> dict[str, Any]:
        """Return it as it is advertised."""
        return {
            "id": self.number,
            "topic": self.topic,
            "encoding": "json",
            "schemaName": self.schema_name,
            "schema": self.schema,
            "schemaEncoding": "jsonschema",
        }


class CommandService(NamedTuple):
    """One command of a robot, as a service."""

    number: int
    robot: str
    command: str
    schema: str
    """JSON schema of its arguments."""

    @property
    def name(self) -> str:
        """Its name for people."""
        return f"/robots/{self.robot}/{self.command}"

    def structure(self) -> dict[str, Any]:
        """Return it as it is advertised."""
        kind = f"robotree.{self.robot}.{self.command}"
        request = _part(f"{kind}.request", self.schema)
        response = _part(f"{kind}.response", json.dumps({"type": "object", "properties": {"result": {}}}))
        return {"id": self.number, "name": self.name, "type": kind, "request": request, "response": response}


def _part(name: str, schema: str) -> dict[str, str]:
    return {"encoding": "json", "schemaName": name, "schemaEncoding": "jsonschema", "schema": schema}


class ServiceCall(NamedTuple):
    """A client calls a service."""

    service: int
    call: int
    payload: bytes


def server_info(name: str, session: str, *, services: bool) -> str:
    """Return the first message to each client."""
    said: dict[str, Any] = {
        "op": "serverInfo",
        "name": name,
        "capabilities": ["services"] if services else [],
        "supportedEncodings": ["json"],
        "metadata": {},
        "sessionId": session,
    }
    return json.dumps(said)


def advertise(channels: Iterable[Channel]) -> str:
    """Return that these channels are there."""
    return json.dumps({"op": "advertise", "channels": [each.structure() for each in channels]})


def advertise_services(services: Iterable[CommandService]) -> str:
    """Return that these services are there."""
    return json.dumps({"op": "advertiseServices", "services": [each.structure() for each in services]})


def unadvertise_services(numbers: Sequence[int]) -> str:
    """Return that these services are there no more."""
    return json.dumps({"op": "unadvertiseServices", "serviceIds": list(numbers)})


def failure(call: ServiceCall, reason: str) -> str:
    """Return that a call has failed."""
    said = {"op": "serviceCallFailure", "serviceId": call.service, "callId": call.call, "message": reason}
    return json.dumps(said)


def data(subscription: int, unix: float, payload: bytes) -> bytes:
    """Return one message of a channel."""
    return _DATA.pack(DATA, subscription, round(unix * 1e9)) + payload


def answered(call: ServiceCall, payload: bytes) -> bytes:
    """Return the answer to a call."""
    encoding = b"json"
    return _CALL.pack(ANSWER, call.service, call.call, len(encoding)) + encoding + payload


def service_call(message: bytes) -> ServiceCall:
    """Read a binary message of a client.

    Raises:
        BadMessage: it is no call of a service with JSON.
    """
    if len(message) < _CALL.size or message[0] != CALL:
        raise BadMessage("it is no call of a service")
    _, service, call, length = _CALL.unpack_from(message)
    encoding, payload = message[_CALL.size : _CALL.size + length], message[_CALL.size + length :]
    if encoding != b"json":
        raise BadMessage("its encoding is not json")
    return ServiceCall(service, call, payload)


class _Op(msgspec.Struct):
    op: str


class _Subscription(msgspec.Struct, rename="camel"):
    id: Annotated[int, msgspec.Meta(ge=0, lt=2**32)]
    channel_id: int


class _Subscribe(msgspec.Struct):
    subscriptions: list[_Subscription]


class _Unsubscribe(msgspec.Struct, rename="camel"):
    subscription_ids: list[int]


def wanted(message: str) -> tuple[Mapping[int, int], Sequence[int]]:
    """Read a text of a client; returns new subscriptions with their channels, and those that end.

    What else clients may say is taken, and nothing follows.

    Raises:
        BadMessage: it is none of the protocol.
    """
    try:
        match msgspec.json.decode(message, type=_Op).op:
            case "subscribe":
                new = msgspec.json.decode(message, type=_Subscribe).subscriptions
                return {each.id: each.channel_id for each in new}, ()
            case "unsubscribe":
                return {}, msgspec.json.decode(message, type=_Unsubscribe).subscription_ids
            case _:
                return {}, ()
    except (msgspec.MsgspecError, RecursionError) as error:
        raise BadMessage(str(error)) from None
