"""Commands of common.xml: the requests, their answers, and the numbers of those that robotree knows."""

from __future__ import annotations

from enum import IntEnum

from robotree.protocol.messages.base import Message, wire


class MavCmd(IntEnum):
    """MAV_CMD, as far as we need it."""

    DO_SET_MODE = 176
    DO_FLIGHTTERMINATION = 185
    DO_SET_ACTUATOR = 187
    DO_PAUSE_CONTINUE = 193
    DO_GRIPPER = 211
    PREFLIGHT_REBOOT_SHUTDOWN = 246
    COMPONENT_ARM_DISARM = 400
    GET_MESSAGE_INTERVAL = 510
    SET_MESSAGE_INTERVAL = 511
    REQUEST_MESSAGE = 512
    REQUEST_PROTOCOL_VERSION = 519
    REQUEST_AUTOPILOT_CAPABILITIES = 520
    REQUEST_OPERATOR_CONTROL = 32100
    ROBOTREE_GO_TO = 57601
    ROBOTREE_GRIP = 57602
    ROBOTREE_MOVE = 57603
    ROBOTREE_HOLD = 57604


class MavResult(IntEnum):
    """MAV_RESULT."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6
    COMMAND_LONG_ONLY = 7
    COMMAND_INT_ONLY = 8
    NOT_IN_CONTROL = 10


class GripperActions(IntEnum):
    """GRIPPER_ACTIONS."""

    RELEASE = 0
    GRAB = 1
    HOLD = 2


@wire("COMMAND_LONG")
class CommandLong(Message, frozen=True, gc=False):
    """Asks for something, with seven numbers; NaN: the default."""

    target_system: int
    target_component: int
    command: int
    confirmation: int
    """How often it was sent before."""
    param1: float
    param2: float
    param3: float
    param4: float
    param5: float
    param6: float
    param7: float


@wire("COMMAND_INT")
class CommandInt(Message, frozen=True, gc=False):
    """Asks for something, with five numbers and two whole ones."""

    target_system: int
    target_component: int
    frame: int
    command: int
    current: int
    autocontinue: int
    param1: float
    param2: float
    param3: float
    param4: float
    x: int
    y: int
    z: float


@wire("COMMAND_ACK")
class CommandAck(Message, frozen=True, gc=False):
    """What became of a command."""

    command: int
    result: int
    progress: int = 0
    """[%] while IN_PROGRESS; 255: unknown."""
    result_param2: int = 0
    target_system: int = 0
    target_component: int = 0


@wire("COMMAND_CANCEL")
class CommandCancel(Message, frozen=True, gc=False):
    """Ends a command that takes long."""

    target_system: int
    target_component: int
    command: int
