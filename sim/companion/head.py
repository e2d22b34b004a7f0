"""The head as a device: a neck that turns, a loudspeaker; what the cameras see is told by telemetry."""

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from robotree.protocol.messages import Reason, Speech, Verb
from robotree.sim.companion.tuning import HEAD_PARAMETERS, HeadTuning
from robotree.sim.errors import BadArgument
from robotree.sim.firmware.device import Device, Plan, Progress, Start, ended, or_now, require
from robotree.sim.motion.follower import Follower
from robotree.sim.motion.path import Limits, Line
from robotree.sim.physics.vectors import Vector

ACCELERATION, JERK = 8.0, 80.0
"""[rad/s2, rad/s3]"""
STIFFNESS, DAMPING = 40.0, 2.4
"""[N m/rad, N m s/rad] of the neck's servo."""
REACHED: Final = 0.03
"""[rad]"""
SETTLE_WITHIN: Final = 1.5
"""[s] after the end of a turn by which the head must be there, or something holds it."""
LARGEST_STOCK: Final = 16
"""Texts that wait to be spoken."""


class Head(Device):
    """The head in the body.

    Args:
        q: (2,) pan and tilt when it is switched on [rad].
        lower: (2,) least angles [rad].
        upper: (2,) greatest angles [rad].
        aloud: told what the loudspeaker says.
    """

    def __init__(self, q: Vector, lower: Vector, upper: Vector, aloud: Callable[[str], None]) -> None:
        self.tuning = HeadTuning()
        self._lower, self._upper, self._aloud = lower.tolist(), upper.tolist(), aloud
        self._follower = Follower(q)
        self._q = np.array(q)
        self._waited = 0.0
        self._texts: dict[int, str] = {}
        plans: Mapping[Verb, Plan] = {
            Verb.LOOK: self._look,
            Verb.SAY: self._say,
            Verb.HOLD: lambda _: self.hold,
        }
        super().__init__(self.tuning, HEAD_PARAMETERS, plans)

    def hold(self) -> None:
        """Stay."""
        self._follower.rest(self._q)
        self._running = ended

    def hear(self, speech: Speech) -> None:
        """Keep a text that is to be spoken when a goal asks for it."""
        self._texts.pop(speech.number, None)
        self._texts[speech.number] = speech.text
        if len(self._texts) > LARGEST_STOCK:
            del self._texts[next(iter(self._texts))]

    @property
    def q(self) -> Vector:
        """(2,) pan and tilt now [rad]."""
        return self._q

    @property
    def led(self) -> Vector:
        """(2,) pan and tilt to which it is led [rad]."""
        return self._follower.reference.pose

    def control(self, dt: float, q: Vector, v: Vector, bias: Vector) -> Vector:
        """(2,) torques of the neck [N m] for the next `dt` [s]."""
        self._q = q
        reference = self._follower.advance(dt, 0.0)
        self._waited = 0.0 if self._follower.moving else self._waited + dt
        torque: Vector = STIFFNESS * (reference.pose - q) + DAMPING * (reference.velocity - v) + bias
        return torque

    def _look(self, args: tuple[float, ...]) -> Start:
        here = self.led.tolist()
        goal = [or_now(*each) for each in zip(("pan", "tilt"), args, here, strict=False)]
        for name, value, lower, upper in zip(("pan", "tilt"), goal, self._lower, self._upper, strict=True):
            require(name, value, lower, upper, "rad")
        rate = or_now("rate", args[2], self.tuning.rate)
        require("rate", rate, 0.05, 3.0, "rad/s")
        limits = Limits((rate, rate), (ACCELERATION,) * 2, (JERK,) * 2)
        path = Line(self._follower.reference, np.array(goal), limits)

        def begin() -> None:
            self._follower.follow(path)
            self._running = self._turning

        return begin

    def _say(self, args: tuple[float, ...]) -> Start:
        number = or_now("number", args[0], -1.0)
        text = self._texts.get(round(number))
        if text is None:
            raise BadArgument("number", number, "that of a SPEECH that has arrived; send it first")

        def begin() -> None:
            self._running = ended  # who has spoken may nod at once; the head goes on turning, too
            self._aloud(text)

        return begin

    def _turning(self) -> Progress:
        fraction = self._follower.progress
        if self._follower.moving:
            return Progress(min(fraction, 0.99))
        short = float(np.abs(self.led - self._q).max())
        if short < REACHED:
            return Progress(1.0, done=True)
        if self._waited > SETTLE_WITHIN:
            text = f"Something holds the head, {math.degrees(short):.0f} degrees short."
            return Progress(fraction, done=True, reason=Reason.BLOCKED, text=text)
        return Progress(0.99)
