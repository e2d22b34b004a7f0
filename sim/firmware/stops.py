"""Every form in which the wire can ask for the protective stop; the only place that knows them. Pure."""

from collections.abc import Sequence
from math import isnan
from typing import Final

from robotree.protocol.messages import (
    AnyMessage,
    CommandInt,
    CommandLong,
    LegacySetMode,
    MavCmd,
    ModeKind,
    SetMode,
)

PX4_HOLD: Final = (4, 3)
"""MAVSDK's "hold": main mode and sub-mode (auto, loiter) of PX4 in DO_SET_MODE, whatever the autopilot. It is
no stop, although its main mode has the number of ours: who holds may be asked to go on by the next goal.
PX4's other sub-modes of 4 (take off, mission, return, land) are no stops either: they ask for something that
these robots cannot do, and are refused."""
_COMMANDS: Final = (CommandLong, CommandInt)
_STOPPING: Final = frozenset({SetMode, LegacySetMode, *_COMMANDS})
_PX4_MAIN, _PX4_SUB = 16, 24
"""[bit] Where PX4 keeps main mode and sub-mode in the custom mode of HEARTBEAT and SET_MODE."""


def modes_of(wish: LegacySetMode) -> tuple[int, int]:
    """Return the main mode and the sub-mode that a SET_MODE asks for: ours, or PX4's in the upper half."""
    if wish.custom_mode >> _PX4_MAIN:
        return wish.custom_mode >> _PX4_MAIN & 0xFF, wish.custom_mode >> _PX4_SUB
    return wish.custom_mode, 0


def stop_asked_by(message: AnyMessage) -> bool:
    """Whether a message asks for the stop."""
    if type(message) not in _STOPPING:  # as most are
        return False
    if isinstance(message, SetMode):
        return message.mode == ModeKind.SAFE_STOP
    if isinstance(message, LegacySetMode):
        return modes_of(message) == (ModeKind.SAFE_STOP, 0)
    if isinstance(message, _COMMANDS):
        return stop_commanded(message.command, (message.param1, message.param2, message.param3))
    return False


def stop_commanded(command: int, params: Sequence[float]) -> bool:
    """Whether a command asks for the stop.

    Args:
        command: number of a MAV_CMD.
        params: at least the first three of its parameters; NaN: not given.
    """
    match command:
        case MavCmd.COMPONENT_ARM_DISARM:
            return params[0] == 0.0
        case MavCmd.DO_FLIGHTTERMINATION:
            return params[0] > 0.5  # as MAVLink defines it
        case MavCmd.DO_SET_MODE:
            return params[1] == ModeKind.SAFE_STOP and (params[2] == 0.0 or isnan(params[2]))
        case _:
            return False
