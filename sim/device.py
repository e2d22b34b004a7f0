"""What the firmware and the cell expect of any simulated robot, and the values they exchange."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from robotree.protocol.messages import Reason, Verb

NAN_FREE: Final = "a finite number"


@dataclass(frozen=True, slots=True)
class Progress:
    """How far the running goal is.

    Attributes:
        fraction: 0 to 1.
        done: whether it has ended.
        reason: NONE when it ended well or still runs, else why it failed.
        text: the reason as one sentence.
    """

    fraction: float
    done: bool = False
    reason: Reason = Reason.NONE
    text: str = ""


class Device(Protocol):
    """One robot of a cell: a control law below, verbs above."""

    @property
    def verbs(self) -> Mapping[Verb, Any]:
        """What it can be asked to do."""
        ...

    def begin(self, verb: Verb, args: tuple[float, ...]) -> None:
        """Begin one movement in place of whatever runs.

        Args:
            verb: what to do.
            args: its arguments as in robotree.xml; NaN means "as it is now".

        Raises:
            GoalRefused: with the reason; nothing has changed.
        """
        ...

    def progress(self) -> Progress:
        """How far the movement is that was begun last."""
        ...

    def hold(self) -> None:
        """Drop the movement and rest where the robot is, compliantly."""
        ...

    def control(self, dt: float) -> None:
        """One step of the control law [s], before the world moves on."""
        ...
