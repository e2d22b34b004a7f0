"""A cup that was carried by hand, the robots of that, and recordings of it."""

from __future__ import annotations

import io
from collections.abc import Sequence

from robotree.tui.composing.demonstration import Shown, ShownRobot
from robotree.tui.composing.writing import KnownRobots
from robotree.tui.recording.tape import TapeWriter
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.requests import State

ROBOTS = KnownRobots.of()
KINDS = ROBOTS.kinds
ARM = ShownRobot("arm-1", "Arm", KINDS["Arm"])
ROVER = ShownRobot("rover-1", "Rover", KINDS["Rover"])
HOME = (0.2, 0.0, 0.5, 0.0)
NOON = 1_800_000_000.0


def go(x: float, y: float, z: float, twist: float = 0.0) -> Shown:
    return Shown("arm-1", "go_to", {"x": x, "y": y, "z": z, "twist": twist})


def grip(action: str, *, holding: bool | None = None) -> Shown:
    return Shown("arm-1", "grip", {"action": action}, holding)


CARRIED = [
    go(0.25, 0, 0.5), go(0.3, 0, 0.5), go(0.3, -0.1, 0.5),
    go(0.3, -0.2, 0.5), go(0.3, -0.2, 0.3), go(0.3, -0.2, 0.03),
    grip("close"),
    go(0.3, -0.2, 0.1), go(0.3, -0.2, 0.15), go(0.3, -0.25, 0.15), go(0.3, -0.3, 0.15), go(0.3, -0.3, 0.03),
    grip("open"),
    go(0.3, -0.3, 0.1), go(0.3, -0.3, 0.2),
]  # fmt: skip

STEPS = """\
robot cup 'What was shown once, in steps with names.'
slot arm Arm
parameter from_x = 0.3
parameter from_y = -0.2
parameter from_z = 0.03
parameter to_x = 0.3
parameter to_y = -0.3
parameter to_z = 0.03
command carry_out 'Do what was shown.'
do
  part take
    arm.go_to x=0.3 y=0.0 z=0.5 twist=0deg
    arm.go_to x=$from_x y=$from_y z=$from_z+0.47 twist=0deg
    arm.go_to x=$from_x y=$from_y z=$from_z twist=0deg
    arm.grip action=close
    expect arm.get_info.holding is true else 'nothing is there'
    arm.go_to x=$from_x y=$from_y z=$from_z+0.12 twist=0deg
  part put
    arm.go_to x=$to_x y=$to_y z=$to_z+0.12 twist=0deg
    arm.go_to x=$to_x y=$to_y z=$to_z twist=0deg
    arm.grip action=open
    arm.go_to x=$to_x y=$to_y z=$to_z+0.17 twist=0deg
"""


DESCRIBED = {
    "arm-1": RobotDescription(
        address=Address("robot", "arm-1", "a"), kinds=("Arm",), commands=tuple(KINDS["Arm"].values())
    )
}

# -- recordings in which a person has shown something ----------------------------------------------


def recording(shown: Sequence[Shown], width: float | None = None, caller: str = "anna@pts/1") -> bytes:
    """Return the bytes of a recording in which a person has shown something.

    Args:
        shown: it.
        width: [m] that is read half a second after each command; None: nothing is.
        caller: who asked.
    """
    file = io.BytesIO()
    writer = TapeWriter(file, {"realm": "hall", "began": repr(NOON)})
    writer.description(NOON, DESCRIBED["arm-1"])
    pose = dict(zip(("x", "y", "z", "twist"), HOME, strict=True))
    writer.state(NOON, "arm-1", State(readings=pose))
    for number, one in enumerate(shown):
        key, at = f"k{number}", NOON + 1 + 2 * number
        about = {"robot": one.robot, "key": key, "command": one.command}
        writer.event(
            HistoryEvent(kind="accepted", unix=at, arguments=dict(one.arguments), caller=caller, **about)
        )
        writer.event(HistoryEvent(kind="ended", unix=at + 1, **about))
        if width is not None:
            writer.state(at + 1.5, "arm-1", State(readings={"width": width}))
    writer.close()
    return file.getvalue()
