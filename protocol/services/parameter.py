"""Parameters: numbers that can be read and set by name; the side that has them.

Every parameter is a REAL32, because MAVLink tools pack integers into the wire's float in different ways. A
request that fails is answered with PARAM_ERROR, so that no client has to wait for a timeout. The whole list
is sent a few parameters at a time.
"""

from __future__ import annotations

import struct
from math import inf, isfinite
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.errors import InvalidMessage
from robotree.protocol.messages import (
    MavParamError,
    MavParamType,
    ParamError,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
)
from robotree.protocol.services.peer import Peer, Send

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

LONGEST_NAME = 16
PACE = 0.02
"""[s] between two parameters of a list: about 2 kB/s, which leaves room on a slow link."""
MAX_PEERS = 32
"""Lists that are sent at a time; one more peer has to ask again."""


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """One parameter.

    Raises:
        InvalidMessage: its name does not fit the wire, or its value lies outside its range.
    """

    name: str
    """At most 16 bytes."""
    value: float
    lower: float = float("-inf")
    upper: float = float("inf")
    text: str = ""
    """The meaning of the parameter, with its unit."""

    def __post_init__(self) -> None:
        if not 0 < len(self.name.encode()) <= LONGEST_NAME:
            problem = f"holds 1 to {LONGEST_NAME} bytes, not {self.name!r}"
            raise InvalidMessage("PARAM_VALUE", "param_id", problem)
        if not self.lower <= self.value <= self.upper:
            problem = f"of {self.name} lies between {self.lower} and {self.upper}, not at {self.value}"
            raise InvalidMessage("PARAM_VALUE", "param_value", problem)


class Changed(msgspec.Struct, frozen=True):
    """A parameter has a new value."""

    name: str
    value: float


ParameterEffect = Send | Changed


class ParameterServer:
    """The parameters of one component.

    Args:
        parameters: in the order of their indices.
        may_set: whether a peer may set parameters now.
    """

    def __init__(
        self, parameters: Iterable[Parameter], may_set: Callable[[Peer], bool] = lambda _: True
    ) -> None:
        self._parameters = {each.name: each for each in parameters}
        self._names = list(self._parameters)
        self._may_set = may_set
        self._lists: dict[Peer, int] = {}
        self._due = float("-inf")

    def __getitem__(self, name: str) -> float:
        """The value of a parameter."""
        return self._parameters[name].value

    def receive(
        self, message: ParamRequestRead | ParamRequestList | ParamSet, peer: Peer, now: float
    ) -> list[ParameterEffect]:
        """Take a message that is addressed to this component."""
        if isinstance(message, ParamRequestList):
            if peer in self._lists or len(self._lists) < MAX_PEERS:
                self._lists[peer] = 0
            return self.tick(now)
        if isinstance(message, ParamSet):
            return self._set(message, peer)
        index = message.param_index
        if index < 0:
            known = message.param_id in self._parameters
            name = message.param_id
        else:
            known = index < len(self._names)
            name = self._names[index] if known else ""
        return [self._tell(name, peer) if known else _error(peer, name, MavParamError.DOES_NOT_EXIST, index)]

    @property
    def due(self) -> float:
        """When to call `tick` next, [s]."""
        return self._due if self._lists else inf

    def tick(self, now: float) -> list[ParameterEffect]:
        """The next parameter of every list that is being sent."""
        if not self._lists or now < self._due:
            return []
        self._due = now + PACE
        effects: list[ParameterEffect] = []
        for peer, index in list(self._lists.items()):
            if index < len(self._names):
                effects.append(self._tell(self._names[index], peer))
            if index + 1 < len(self._names):
                self._lists[peer] = index + 1
            else:
                del self._lists[peer]
        return effects

    def link_closed(self, via: object) -> None:
        """A link ended, and with it the lists that were sent on it."""
        self._lists = {peer: index for peer, index in self._lists.items() if peer.via != via}

    def _set(self, message: ParamSet, peer: Peer) -> list[ParameterEffect]:
        name = message.param_id
        parameter = self._parameters.get(name)
        if parameter is None:
            return [_error(peer, name, MavParamError.DOES_NOT_EXIST)]
        if (why_not := self._why_not(parameter, message, peer)) is not None:
            # The value too: that is the answer of old, and all that tools without PARAM_ERROR look at.
            return [_error(peer, name, why_not), self._tell(name, peer)]
        value = min(max(message.param_value, parameter.lower), parameter.upper)
        self._parameters[name] = msgspec.structs.replace(parameter, value=value)
        return [Changed(name, value), self._tell(name, peer)]

    def _why_not(self, parameter: Parameter, wish: ParamSet, peer: Peer) -> MavParamError | None:
        """Why a parameter cannot be set so; None: it can."""
        if not self._may_set(peer):
            return MavParamError.PERMISSION_DENIED
        if wish.param_type != MavParamType.REAL32:
            return MavParamError.TYPE_MISMATCH
        lower, upper = _on_the_wire(parameter.lower), _on_the_wire(parameter.upper)
        if not isfinite(wish.param_value) or not lower <= wish.param_value <= upper:
            return MavParamError.VALUE_OUT_OF_RANGE
        return None

    def value_message(self, name: str) -> ParamValue:
        """A parameter as it is told; for the others, when one peer has changed it."""
        index = self._names.index(name)
        return ParamValue(name, self[name], MavParamType.REAL32, len(self._names), index)

    def _tell(self, name: str, peer: Peer) -> Send:
        return Send(self.value_message(name), peer.via)


def _on_the_wire(value: float) -> float:
    """The nearest number of 32 bits: 0.1 comes back as a little more than 0.1."""
    (narrow,) = struct.unpack("<f", struct.pack("<f", value))
    return float(narrow)


def _error(peer: Peer, name: str, error: MavParamError, index: int = -1) -> Send:
    return Send(ParamError(peer.system, peer.component, name, index, error), peer.via)
