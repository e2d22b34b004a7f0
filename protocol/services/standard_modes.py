"""AVAILABLE_MODES and CURRENT_MODE: the modes of a controller by name, for ground stations that ask.

A station that asks for them (https://mavlink.io/en/services/standard_modes.html) shows the name of a mode
where it would show the number of HEARTBEAT.custom_mode. None of our modes is one of MAVLink's standard modes.

Pure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from robotree.protocol.messages import AvailableModes, CurrentMode, MavModeProperty, ModeKind

if TYPE_CHECKING:
    from collections.abc import Sequence

NAMES: Final = {
    ModeKind.READY: "Ready",
    ModeKind.ACTIVE: "Moving",
    ModeKind.HOLD: "Hold",
    ModeKind.SAFE_STOP: "Safe stop",
}
"""Every mode that a controller can be in."""
_NON_STANDARD: Final = 0
_FREELY: Final = MavModeProperty(0)


def available(number: int = 0) -> Sequence[AvailableModes]:
    """The modes as they are told.

    Args:
        number: of one of them, from 1; 0: all.

    Returns:
        None, if there is no such mode.
    """
    messages = [
        AvailableModes(
            number_modes=len(NAMES),
            mode_index=index,
            standard_mode=_NON_STANDARD,
            custom_mode=mode,
            # Nobody asks for ACTIVE: a robot is in it while something moves.
            properties=MavModeProperty.NOT_USER_SELECTABLE if mode is ModeKind.ACTIVE else _FREELY,
            mode_name=name,
        )
        for index, (mode, name) in enumerate(NAMES.items(), 1)
    ]
    return [each for each in messages if number in {0, each.mode_index}]


def current(mode: ModeKind) -> CurrentMode:
    """The mode in which a controller is; nobody asks for most of them, so the intended one is unknown."""
    return CurrentMode(_NON_STANDARD, mode, 0)
