"""Parameters of common.xml."""

from __future__ import annotations

from enum import IntEnum

from robotree.protocol.messages.base import Message, wire


class MavParamType(IntEnum):
    """MAV_PARAM_TYPE, as far as we need it: numbers of 32 bits, sent as they are."""

    REAL32 = 9


class MavParamError(IntEnum):
    """MAV_PARAM_ERROR."""

    NO_ERROR = 0
    DOES_NOT_EXIST = 1
    VALUE_OUT_OF_RANGE = 2
    PERMISSION_DENIED = 3
    COMPONENT_NOT_FOUND = 4
    READ_ONLY = 5
    TYPE_MISMATCH = 7


@wire("PARAM_REQUEST_READ")
class ParamRequestRead(Message, frozen=True, gc=False):
    """Asks for one parameter."""

    target_system: int
    target_component: int
    param_id: str
    """At most 16 bytes."""
    param_index: int
    """-1: by name."""


@wire("PARAM_REQUEST_LIST")
class ParamRequestList(Message, frozen=True, gc=False):
    """Asks for all parameters."""

    target_system: int
    target_component: int


@wire("PARAM_VALUE")
class ParamValue(Message, frozen=True, gc=False):
    """The value of one parameter."""

    param_id: str
    param_value: float
    param_type: int
    param_count: int
    param_index: int


@wire("PARAM_SET")
class ParamSet(Message, frozen=True, gc=False):
    """Sets one parameter."""

    target_system: int
    target_component: int
    param_id: str
    param_value: float
    param_type: int


@wire("PARAM_ERROR")
class ParamError(Message, frozen=True, gc=False):
    """Why a parameter was not read or set."""

    target_system: int
    target_component: int
    param_id: str
    param_index: int
    error: int
