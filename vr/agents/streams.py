"""The streams of one robot on their way to those who listen: nothing is sent while nobody does.

A stream has a key of its own on the transport. Who listens subscribes to it, and the transport keeps for each
listener what fits: one that is too slow misses values, and no other notices.
"""

from __future__ import annotations

from typing import Any

import msgspec

from robotree.vr.author.robot import Robot
from robotree.vr.author.stream import streams_of
from robotree.vr.base.address import Address
from robotree.vr.base.arguments import check_argument
from robotree.vr.base.description import StreamSpec
from robotree.vr.base.errors import BadArgument, TransportError
from robotree.vr.base.plain import to_plain
from robotree.vr.base.requests import StreamSample, encode
from robotree.vr.base.transport import Transport
from robotree.vr.running.runner import Runner

LARGEST = 512_000
"""[bytes] of one value, encoded."""
SECOND = 1.0
"""[s] over which what is sent is counted."""


class _Meter:
    """How much one stream sends. Under the lock of its streams."""

    __slots__ = ("_bytes", "_latest", "_second", "due", "left_out")

    def __init__(self) -> None:
        self.due = 0.0
        """[s] before which no further value is sent."""
        self.left_out = 0
        self._second: int = 0
        self._latest: int = 0
        self._bytes: int = 0

    def count(self, now: float, size: int) -> None:
        self._turn(now)
        self._bytes += size

    def sent(self, now: float) -> int:
        """Return how many bytes were sent in the last whole second."""
        self._turn(now)
        return self._latest

    def _turn(self, now: float) -> None:
        second: int = int(now / SECOND)
        if second != self._second:
            self._latest = self._bytes if second == self._second + 1 else 0
            self._second = second
            self._bytes = 0


class Streams:
    """Sends what one robot has for its listeners. Its methods may be called in any thread."""

    def __init__(self, robot: Robot, address: Address, transport: Transport, runner: Runner) -> None:
        """Begin to take what the robot sends.

        Args:
            robot: whose streams they are.
            address: of the robot.
            transport: the way to the listeners.
            runner: has the clock, and locks.

        Raises:
            TypeError: a stream has a type that cannot travel.
        """
        self._address, self._transport, self._now = address, transport, runner.now
        self._lock = runner.lock()
        self._meters: dict[str, _Meter] = {}
        self.become(robot)

    def become(self, robot: Robot) -> None:
        """Take what another page of the robot sends, from now on.

        Raises:
            TypeError: a stream has a type that cannot travel.
        """
        self._specs = {name: stream.spec() for name, stream in streams_of(type(robot)).items()}
        robot.stream_outlet = self

    def wanted(self, stream: str) -> bool:
        return self._transport.listeners(self._key(stream)) > 0

    def send(self, stream: str, value: Any) -> None:
        listeners = self._transport.listeners(self._key(stream))
        if not listeners:
            return
        spec, now = self._specs[stream], self._now()
        with self._lock:
            meter = self._meters.setdefault(stream, _Meter())
            if spec.rate:
                if now < meter.due:
                    meter.left_out += 1
                    return
                meter.due = max(meter.due + 1.0 / spec.rate, now)
        label = f"{self._address.name}.{stream}.send"
        given = msgspec.to_builtins(value, builtin_types=(bytes,), enc_hook=to_plain)
        plain = check_argument(spec.value, given, command=label)
        body = encode(StreamSample(value=plain))
        if len(body) > LARGEST:
            reason = f"it has {len(body)} bytes; at most {LARGEST} can be sent"
            raise BadArgument(command=label, parameter=stream, reason=reason)
        with self._lock:
            meter.count(now, len(body) * listeners)
        try:
            self._transport.publish(self._key(stream), body)
        except TransportError:  # it is closed: nobody listens any more
            return

    def specs(self) -> tuple[StreamSpec, ...]:
        """Describe the streams, with who listens and how much is sent now."""
        now = self._now()
        return tuple(self._spec(name, spec, now) for name, spec in self._specs.items())

    def _spec(self, name: str, spec: StreamSpec, now: float) -> StreamSpec:
        listeners = self._transport.listeners(self._key(name))
        with self._lock:
            meter = self._meters.get(name)
            sent, left_out = (0, 0) if meter is None else (meter.sent(now), meter.left_out)
        return msgspec.structs.replace(spec, listeners=listeners, sent=sent, left_out=left_out)

    def _key(self, stream: str) -> str:
        return f"{self._address.key}/stream/{stream}"
