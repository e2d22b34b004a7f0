"""Tele-operation by key: small steps that add up to a target, never far ahead of the robot. Pure.

A key press moves the *target* by one step; one `go_to` runs at a time and the newest target is the next one,
so that presses never queue up. The target is never further ahead of the robot than `lead_limit`: a robot that
is held back by what it touches is not asked for more and more. What a press could not add to the target is
counted (`press` returns it), so that the operator can be told.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import dist, inf, radians

from robotree.vr.base.description import CommandSpec, RobotDescription

AXES = ("x", "y", "z", "twist")

STEPS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05)
"""[m] Steps to choose from; the largest one is 50 mm."""

TURNS = tuple(radians(degrees) for degrees in (1, 2, 5, 10, 15, 30))
"""[rad] Steps of the twist, changed together with the others."""

FIRST = 3
"""Index of the step at the beginning: 10 mm and 10 degrees."""

LEAST = 1e-6
"""[m] or [rad] below which a difference is rounding."""

LEAD_STEPS = 3
"""Steps that the target may always be ahead of the robot."""

QUICK = 2 * LEAD_STEPS
"""Steps that it may be ahead as long as that is no more than `NEAR`: so many quick presses are not lost."""

NEAR = 0.06
"""[m] 60 mm: six quick steps of 10 mm."""

NEAR_TURN = radians(60)
"""[rad] The same for the twist: six quick steps of 10 degrees."""


def lead_limit(axis: str, step: float) -> float:
    """Return how far the target may be ahead of the robot along an axis, for a step; all in [m] or [rad]."""
    near = NEAR_TURN if axis == "twist" else NEAR
    return max(LEAD_STEPS * step, min(QUICK * step, near))


Pose = Mapping[str, float]
"""Value by axis: x, y, z [m], twist [rad], in the robot's frame."""

Bounds = Mapping[str, tuple[float, float]]
"""Lowest and highest value by axis, as the robot's `go_to` declares them."""


@dataclass(slots=True)
class Jog:
    """The target of one operator for one robot."""

    bounds: Bounds
    choice: int = FIRST
    target: dict[str, float] | None = None
    """Where the robot shall be; None: wherever it is."""
    sent: dict[str, float] | None = field(default=None, init=False)
    """The target that is being carried out."""
    fulfilled: dict[str, float] | None = field(default=None, init=False)
    """The last target that was carried out: the next step starts there, so that steps add up exactly."""

    def step(self, axis: str) -> float:
        """Return the present step of an axis, [m] or [rad]."""
        return TURNS[self.choice] if axis == "twist" else STEPS[self.choice]

    def resize(self, by: int) -> None:
        """Choose a larger (+1) or smaller (-1) step."""
        self.choice = min(max(self.choice + by, 0), len(STEPS) - 1)

    def press(self, axis: str, direction: int, actual: Pose) -> float:
        """Move the target by one step; it never moves against the direction that was pressed.

        Args:
            axis: one of `AXES`.
            direction: +1 or -1.
            actual: where the robot is.

        Returns:
            What of the step was dropped, [m] or [rad]: the limit of the lead or a bound has been reached.
        """
        target = dict(self.target) if self.target else {one: actual[one] for one in AXES}
        step = self.step(axis)
        before, furthest = target[axis], actual[axis] + direction * lead_limit(axis, step)
        after = min(before + step, furthest) if direction > 0 else max(before - step, furthest)
        after = max(after, before) if direction > 0 else min(after, before)
        target[axis] = self._bounded(axis, before, after)
        self.target = target
        dropped = step - abs(target[axis] - before)
        return dropped if dropped > LEAST else 0.0

    def short(self, actual: Pose) -> float:
        """Return how far the robot is from the target, along a straight line [m]; the twist is left out."""
        if self.target is None:
            return 0.0
        return dist(*([pose[axis] for axis in "xyz"] for pose in (self.target, actual)))

    def _bounded(self, axis: str, before: float, after: float) -> float:
        """Stay inside the bounds, or where it was if that is outside already."""
        lower, upper = self.bounds.get(axis, (-inf, inf))
        return min(max(after, min(lower, before)), max(upper, before))

    @property
    def moving(self) -> bool:
        """Whether a target is being carried out."""
        return self.sent is not None

    def take(self) -> dict[str, float] | None:
        """Return the target of the next `go_to`, or None when one runs or nothing new is wanted."""
        if self.sent is not None or self.target is None or self.target == self.fulfilled:
            return None
        self.sent = dict(self.target)
        return dict(self.sent)

    def arrived(self) -> None:
        """The `go_to` has ended well."""
        self.fulfilled, self.sent = self.sent, None

    def drop(self) -> None:
        """Forget all targets: after a refusal, a cancel, a stop, or when another program moved the robot."""
        self.target = self.sent = self.fulfilled = None


GO_TO, GET_INFO, GRIP = "go_to", "get_info", "grip"


def bounds(robot: RobotDescription) -> Bounds | None:
    """Return the bounds of tele-operation by axis, or None when the robot cannot be tele-operated.

    It can when it has `get_info` and a `go_to` that takes x, y, z and twist and that needs nothing else.
    """
    go_to, get_info = robot.command(GO_TO), robot.command(GET_INFO)
    if not (go_to and get_info and go_to.available and get_info.available):
        return None
    fields = {spec.name: spec for spec in go_to.parameters}
    if not set(AXES) <= set(fields) or any(
        spec.required for name, spec in fields.items() if name not in AXES
    ):
        return None
    return {axis: _range(go_to, axis) for axis in AXES}


def _range(command: CommandSpec, axis: str) -> tuple[float, float]:
    spec = next(parameter for parameter in command.parameters if parameter.name == axis)
    return (-inf if spec.lower is None else spec.lower, inf if spec.upper is None else spec.upper)
