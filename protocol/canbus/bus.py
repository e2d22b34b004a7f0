"""The bus itself, as python-can wants it."""

from __future__ import annotations

import contextlib
import os
import select
import threading
from collections import deque
from copy import copy
from time import time
from typing import TYPE_CHECKING

import msgspec
from can import BusABC, BusState, CanOperationError, CanProtocol, CanTimeoutError, Message

from robotree.files import forks
from robotree.protocol.canbus.membership import DEFAULT, Membership
from robotree.protocol.canbus.records import encode

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from can.typechecking import AutoDetectedConfig, CanFilters


class BusStatistics(msgspec.Struct, frozen=True):
    """One reading of a member's gauges."""

    members: int
    """Others on the bus."""
    sent: int
    """Frames that we sent, also when no other member was there."""
    received: int
    """Frames that came, before any filter."""
    dropped: int
    """Frames of ours that a member did not get because it reads nothing."""
    malformed: int
    """Connections that were cut because of bytes that mean nothing."""
    incompatible: int
    """CAN FD frames that came although this member speaks classic CAN."""


class LoopbackBus(BusABC):
    """A CAN bus that joins processes of one machine over 127.0.0.1.

    A frame reaches every member there is when it is sent, in the order of its sender. The bus has no
    bit rate: `bitrate` and its relatives are accepted and mean nothing. A sender is held up while a member
    has no room but reads; one that reads nothing is left out after `wire.STALLED_AFTER` seconds.

    Args:
        channel: a port (the first of `seats.SEATS` in a row), or a name; None: the channel "robotree".
        can_filters: see `BusABC.set_filters`.
        fd: whether CAN FD frames can be sent and are handed out.
        receive_own_messages: whether `recv` also hands out what this bus sends.
        **kwargs: what other interfaces understand.

    Raises:
        CanInitializationError: all seats of the channel are taken.
        ValueError: the channel is no port and no name.
    """

    def __init__(
        self,
        channel: int | str | None = None,
        can_filters: CanFilters | None = None,
        *,
        fd: bool = True,
        receive_own_messages: bool = False,
        **kwargs: object,
    ) -> None:
        self.channel = str(DEFAULT if channel is None else channel)
        self._can_protocol = CanProtocol.CAN_FD if fd else CanProtocol.CAN_20
        self._own = receive_own_messages
        self._state = BusState.ACTIVE
        self._inbox: deque[Message] = deque()
        self._sent = self._received = self._incompatible = 0
        self._membership = Membership(self.channel)
        self._bell = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._rung = self._left = False
        forks.owns(self)
        self._reading = threading.Lock()
        self._membership.inlet.register(self._bell, select.EPOLLIN)
        self.channel_info = f"robotree bus {self.channel!r} (port {self._membership.port})"
        super().__init__(self.channel, can_filters, **kwargs)

    def in_child(self) -> Iterable[int]:
        return () if self._left else (self._bell,)

    @property
    def statistics(self) -> BusStatistics:
        """The gauges now."""
        membership = self._membership
        with membership.lock:
            return BusStatistics(
                members=len(membership.outlets),
                sent=self._sent,
                received=self._received,
                dropped=membership.dropped + sum(wire.dropped for wire in membership.outlets),
                malformed=membership.malformed,
                incompatible=self._incompatible,
            )

    @property
    def pending(self) -> int:
        """Frames that have been taken from the system already; `recv` hands them out without asking it."""
        return len(self._inbox)

    @property
    def state(self) -> BusState:
        """ACTIVE, or PASSIVE: listens and sends nothing."""
        return self._state

    @state.setter
    def state(self, new_state: BusState) -> None:
        if new_state is BusState.ERROR:
            raise ValueError("a bus cannot be put into the state ERROR; choose ACTIVE or PASSIVE")
        self._state = new_state

    def send(self, msg: Message, timeout: float | None = None) -> None:
        """Send a frame to all members.

        Args:
            msg: the frame.
            timeout: [s] to wait at most until every member that reads has room; None: as long as it takes.

        Raises:
            CanTimeoutError: a member had no room in time; nobody got the frame.
            CanOperationError: the bus was shut down, is passive, or the frame is not of its kind.
            ValueError: the frame contradicts itself.
        """
        if msg.is_fd and self._can_protocol is not CanProtocol.CAN_FD:
            raise CanOperationError("this bus speaks classic CAN; open it with fd=True to send CAN FD frames")
        if self._state is BusState.PASSIVE:
            raise CanOperationError("this bus is passive; set its state to ACTIVE to send")
        moment = time()
        record = encode(msg, moment)
        membership = self._membership
        with membership.lock:
            if self._is_shutdown:
                raise CanOperationError("the bus was shut down")
            if membership.crowded and not membership.lock.wait_for(
                lambda: self._is_shutdown or not membership.crowded, timeout
            ):
                raise CanTimeoutError("a member of the bus has no room; send later, or with a longer timeout")
            membership.say(record)
            self._sent += 1
        if self._own:
            self._echo(msg, moment)

    def _echo(self, msg: Message, moment: float) -> None:
        own = copy(msg)
        own.timestamp, own.channel, own.is_rx = moment, self.channel, False
        self._inbox.append(own)
        self._tell_of_rest()

    def _recv_internal(self, timeout: float | None) -> tuple[Message | None, bool]:
        inbox = self._inbox
        if not inbox:
            self._read(timeout)
            if not inbox:
                return None, False
        message = inbox.popleft()
        if bool(inbox) is not self._rung:
            self._tell_of_rest()
        return message, False

    def _read(self, timeout: float | None) -> None:
        """Wait for something to come, and take what is there."""
        membership = self._membership
        with self._reading:
            if self._is_shutdown:
                raise CanOperationError("the bus was shut down")
            for descriptor, _ in membership.inlet.poll(timeout):
                if descriptor == self._bell:
                    self._silence_bell()
                elif (wire := membership.wire(descriptor)) is not None:
                    messages = wire.read()
                    if messages is None or not wire.intact:
                        membership.lose(wire, malformed=not wire.intact)
                    if messages:
                        self._take(messages)

    def _take(self, messages: Sequence[Message]) -> None:
        self._received += len(messages)
        if self._can_protocol is CanProtocol.CAN_FD:
            self._inbox.extend(messages)
            return
        for message in messages:
            if message.is_fd:
                self._incompatible += 1
            else:
                self._inbox.append(message)

    def _tell_of_rest(self) -> None:
        """Keep `fileno` readable as long as the inbox is not empty, and the bus not left."""
        with self._membership.lock:
            if self._left:
                return
            if self._inbox:
                self._rung = True
                os.eventfd_write(self._bell, 1)
            else:
                self._silence_bell()

    def _silence_bell(self) -> None:
        self._rung = False
        with contextlib.suppress(BlockingIOError):
            os.eventfd_read(self._bell)

    def flush_tx_buffer(self) -> None:
        """Do nothing: what was sent is on its way."""

    def fileno(self) -> int:
        """A descriptor that is readable while `recv(0)` has something to hand out."""
        return self._membership.inlet.fileno()

    def shutdown(self) -> None:
        """Leave the bus. Harmless when repeated."""
        if self._is_shutdown:
            return
        super().shutdown()
        os.eventfd_write(self._bell, 1)  # wakes a thread that waits in `recv`
        with self._reading:
            self._membership.leave()
            with self._membership.lock:
                self._left = True
                os.close(self._bell)

    @staticmethod
    def _detect_available_configs() -> list[AutoDetectedConfig]:
        return [{"interface": "robotree", "channel": DEFAULT}]
