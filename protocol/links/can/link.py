"""One end of a link over CAN: MAVLink frames as ISO-TP payloads between a controller and a host.

A frame that fits one CAN frame goes at once; a longer one waits for the far end's flow control, and what
comes after it waits in the outbox, where telemetry is superseded. A transfer that gets no flow control is
tried again; one that must arrive and never does ends the link.
"""

from __future__ import annotations

import asyncio
from math import inf
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.errors import LinkBroken, LinkClosed, LinkError
from robotree.protocol.isotp import LARGEST, Channel
from robotree.protocol.isotp.frames import is_flow_control
from robotree.protocol.links.can.control import Code, Control, SilenceTimer
from robotree.protocol.links.can.identifiers import Kind, Priority, identifier
from robotree.protocol.links.link import handler_of
from robotree.protocol.links.outbox import BOUND, Outbox

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Sequence

    from can import Message

    from robotree.protocol.links.can.port import Port
    from robotree.protocol.links.link import Accept, Handler, LinkStatistics, Unsent

TRANSFER_TIMEOUT = 0.3
"""[s] that the far end may be silent in the middle of a transfer; well below `control.SILENCE`, so that a
transfer is tried again before the far end counts as gone."""
ATTEMPTS = 3
LATE = 0.1
"""[s] after its time at which a timer may fire on a machine that has much to do."""


class Ends(msgspec.Struct, frozen=True):
    """The two nodes of a link, as seen from one end."""

    own: int
    partner: int
    toward: Priority
    """Of what we send to the partner."""


class CanLink:
    """One end. Made by `connect` and by a listener.

    Args:
        port: to the bus.
        address: for people.
        ends: the two nodes.
        presence: of the partner.
        width: [bytes] of the longest data field to send: 8 or 64.
        broadcast: takes telemetry, and says whether it sent it to all.
        on_end: told when the link has ended, before its handler.
        bound: [bytes] that may wait.
    """

    def __init__(
        self,
        port: Port,
        address: str,
        ends: Ends,
        presence: SilenceTimer,
        width: int,
        *,
        broadcast: Callable[[CanLink, bytes, Hashable], bool] | None = None,
        on_end: Callable[[CanLink], None],
        bound: int = BOUND,
    ) -> None:
        self._port, self.address, self.ends, self.presence, self.width = port, address, ends, presence, width
        self.controller = address.partition("&")[0]  # bus and node: what follows is the host's
        self._broadcast, self._on_end = broadcast, on_end
        to_partner = {"target": ends.partner, "source": ends.own}
        self._data_id = identifier(ends.toward, Kind.ADDRESSED, **to_partner)
        self._flow_id = identifier(Priority.FLOW, Kind.ADDRESSED, **to_partner)
        self._control_id = identifier(Priority.FLOW, Kind.CONTROL, **to_partner)
        self._fd = width > 8
        self._channel = Channel(width, timeout=TRANSFER_TIMEOUT)
        self._outbox = Outbox(bound)
        self._under_way: tuple[bytes, Hashable | None] | None = None
        self._attempts = 0
        self._handler: Handler | None = None
        self._over = False
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._timer_due = inf

    def begin(self, accept: Accept) -> None:
        """Let somebody hear the link."""
        self._handler = handler_of(self, accept)
        self._schedule()

    @property
    def congested(self) -> bool:
        """Whether frames wait for the far end or for the bus."""
        return self._outbox.waiting > 0 or self._port.congested

    @property
    def statistics(self) -> LinkStatistics:
        """The gauges now."""
        return self._outbox.statistics()

    def send(self, frame: bytes | Unsent, topic: Hashable | None = None) -> None:
        """Send one whole frame, or queue it."""
        if self._over or not 0 < len(frame) <= LARGEST:
            self._outbox.dropped += 1
        elif self._channel.busy or self._outbox.waiting or self._port.congested:
            self._outbox.put(frame, topic)
            if (overrun := self._outbox.overrun(self.address)) is not None:
                self.end(overrun, say=True)
        else:
            self._transmit(self._outbox.leave(frame), topic)

    def close(self) -> None:
        """End the link."""
        self.end(LinkClosed(self.address, by_us=True), say=True)

    def end(self, reason: LinkError, *, say: bool = False) -> None:
        """End the link for some reason; harmless when repeated.

        Args:
            reason: for the handler.
            say: tell the partner.
        """
        if self._over:
            return
        self._over = True
        if self._timer is not None:
            self._timer.cancel()
        if say and self.presence.session is not None:
            self._control(Control(Code.CLOSE, self.presence.session))
        self._on_end(self)
        self._loop.call_soon(self._tell_the_end, reason)

    def heard(self, message: Message) -> None:
        """A data field came that the partner addressed to us."""
        if self._over:
            return
        now = self._loop.time()
        self.presence.heard = now
        heard = self._channel.feed(bytes(message.data), now)
        if heard.reply or self._under_way is not None:
            self._say(heard.reply)
            if self._under_way is not None and not self._channel.busy:
                self._finish(now)
            self._schedule()
        if heard.payload is not None:
            self.deliver(heard.payload)

    def deliver(self, payload: bytes) -> None:
        """A whole frame came."""
        if not self._over and self._handler is not None:
            self._outbox.received += len(payload)
            self._handler.received(payload)

    def alive(self) -> None:
        """The partner gave some other sign of life."""
        self.presence.heard = self._loop.time()

    def silence(self, now: float) -> float:
        """[s] for which the partner has been silent while we listened.

        While the system withholds the processor from us, nothing is heard of anybody: what passed from the
        moment at which we should have woken up says nothing about the partner.
        """
        return max(0.0, min(now, self._timer_due + LATE) - self.presence.heard)

    def pump(self) -> None:
        """Send what waits, as far as the bus and the far end take it."""
        while not (self._over or self._channel.busy or self._port.congested):
            frame = self._outbox.pop()
            if frame is None:
                return
            self._transmit(frame, None)

    def _transmit(self, frame: bytes, topic: Hashable | None) -> None:
        if topic is not None and self._broadcast is not None and self._broadcast(self, frame, topic):
            return
        self._say(self._channel.send(frame, self._loop.time()))
        if self._channel.busy:
            self._under_way, self._attempts = (frame, topic), 1
            self._schedule()

    def _finish(self, now: float) -> None:
        """The transfer under way has ended, well or not."""
        if self._under_way is None:
            return
        frame, topic = self._under_way
        failure = self._channel.failed
        if failure is not None and topic is None:
            if self._attempts >= ATTEMPTS:
                cause = f"{failure.value}, {ATTEMPTS} times in a row"
                self.end(LinkBroken(self.address, cause), say=True)
                return
            self._attempts += 1
            self._say(self._channel.send(frame, now))
            return
        self._outbox.dropped += failure is not None
        self._under_way = None
        self.pump()

    def _say(self, fields: Sequence[bytes]) -> None:
        for field in fields:
            self._port.send(self._flow_id if is_flow_control(field) else self._data_id, field, fd=self._fd)

    def _control(self, control: Control) -> None:
        self._port.send(self._control_id, control.encode(), fd=self._fd)

    def _schedule(self) -> None:
        """Wake up when something is due, unless we will anyway."""
        due = min(self.presence.due, self._channel.due)
        if due < self._timer_due and not self._over:
            if self._timer is not None:
                self._timer.cancel()
            self._timer_due = due
            self._timer = self._loop.call_at(due, self._wake)

    def _wake(self) -> None:
        now = self._loop.time()
        self.presence.heard = now - self.silence(now)
        self._timer, self._timer_due = None, inf
        if self.presence.gone(now):
            cause = f"nothing came for {self.presence.silence:g} s"
            self.end(LinkBroken(self.address, cause), say=True)
            return
        if (sign := self.presence.tick(now)) is not None:
            self._control(sign)
        self._say(self._channel.tick(now))
        if self._under_way is not None and not self._channel.busy:
            self._finish(now)
        self._schedule()

    def _tell_the_end(self, reason: LinkError) -> None:
        handler, self._handler = self._handler, None
        if handler is not None:
            handler.closed(reason)
