"""The base of all simulated devices: a table of verbs, and the movement that runs."""

from collections.abc import Callable, Collection, Mapping
from typing import Final

from robotree.protocol.messages import SetpointKind, Verb
from robotree.sim.errors import BadArgument
from robotree.sim.firmware.device import Plan, Progress, Start, Tunable, ended, planned


class Part:
    """One robot of a cell, or one part of its body, as a device; without more it follows no set-points.

    Args:
        name: for what is refused, with its article.
        parameters: what can be tuned on it.
        plans: what checks and plans each verb.
    """

    def __init__(self, name: str, parameters: Collection[Tunable], plans: Mapping[Verb, Plan]) -> None:
        self._name, self._plans = name, plans
        self.parameters: Final = parameters
        """The parameters that can be tuned."""
        self._running: Callable[[], Progress] = ended

    @property
    def verbs(self) -> Collection[Verb]:
        """The verbs that it carries out."""
        return self._plans.keys()

    @property
    def setpoint_kinds(self) -> Collection[SetpointKind]:
        """The set-points that it can follow."""
        return ()

    def prepare(self, verb: int, args: tuple[float, ...]) -> Start:
        """Check and plan one movement; nothing moves yet.

        Args:
            verb: one of `verbs`.
            args: (7,) as in robotree.xml.

        Returns:
            What begins the movement, in place of whatever runs.

        Raises:
            GoalRefused: with the reason; nothing has changed.
        """
        return planned(self._plans, verb, args)

    def follow(self, kind: int, args: tuple[float, ...]) -> Start:
        """Check one set-point; nothing changes yet.

        Args:
            kind: one of `setpoint_kinds`.
            args: (7,) as in robotree.xml.

        Returns:
            What follows it, within the limits of speed and place.

        Raises:
            GoalRefused: it cannot be followed; without `setpoint_kinds` always.
        """
        text = f"none with {len(args)} arguments: {self._name} follows no set-points"
        raise BadArgument("kind", kind, text)

    def progress(self) -> Progress:
        """How far the movement is that was begun last."""
        return self._running()
