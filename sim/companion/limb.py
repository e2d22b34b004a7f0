"""One arm of the companion as a device: verbs above, the natural admittance of the cell's arm below.

Its frame is the body frame B: goals move with the base. It is led along a way of postures (`ways`); the hand
hangs on a spring whose far end is the hand of that posture, so the force that it exerts stays bounded.
"""

import math
from collections.abc import Mapping
from typing import Final, Protocol

import numpy as np

from robotree.protocol.messages import Verb
from robotree.sim.arm.compliance import Attractor, Gains, NaturalAdmittance
from robotree.sim.arm.hand import ArmState, Hand
from robotree.sim.arm.kinematics import Dynamics
from robotree.sim.arm.model import HandPorts
from robotree.sim.companion.figure import ARM_JOINTS, Pose
from robotree.sim.companion.planner import Goal, Way
from robotree.sim.companion.tuning import HAND_ACCELERATION, LIMB_PARAMETERS, SLOWEST, LimbTuning
from robotree.sim.errors import BadArgument
from robotree.sim.firmware.device import Device, Plan, Start, ended, or_now, speed_or
from robotree.sim.motion.follower import LEASH_SLACK, Follower
from robotree.sim.physics.vectors import Vector

REACHED: Final = 0.010
"""[m] between hand and goal that counts as reached."""
SETTLED: Final = 0.02
"""[rad/s] of the fastest joint that counts as standing."""
BRAKING: Final = 2.0
"""times the damping of the usual law while a hand is brought to a stand; at 2 ms, 5 times would shake."""
BRAKED_FOR: Final = 0.3
"""[s] of stronger damping after a hold."""
SMOOTHING: Final = 0.36
"""Share of a new reading of the wrist in the filtered one, at 2 ms: a time constant of 4.5 ms."""
GAINS: Final = Gains(
    stiffness=(500.0, 500.0, 500.0, 25.0, 25.0, 10.0),
    damping=(90.0, 90.0, 90.0, 2.6, 2.6, 0.9),
    posture_stiffness=(2.0, 2.0, 1.5, 2.0, 1.0, 1.0),
    posture_damping=(0.3, 0.3, 0.2, 0.3, 0.1, 0.1),
    beta=80.0,
    leak=8.0,
)
"""Of the law; the hand feels like 4 kg."""


class Thinking(Protocol):
    """The whole body, which plans for its arms and knows how fast they may be."""

    def reach(self, side: int, goal: Goal, speed: float, acceleration: float) -> Way:
        """A way of a hand to a pose."""
        ...

    def posture(self, side: int, end: Vector, speed: float, acceleration: float) -> Way:
        """A way of an arm to a posture."""
        ...

    def allow(self, side: int, goal: Vector | None, speed: float) -> None:
        """Refuse a speed [m/s] that is named and too fast beside a person."""
        ...

    def must_have_power(self) -> None:
        """Refuse to move with an empty battery."""
        ...

    def pace(self, side: int) -> float:
        """Share of the full pace that is allowed now, 0 to 1."""
        ...


class Limb(Device):
    """One arm in the body.

    Args:
        side: which.
        ports: of its hand.
        q: (6,) its posture when it is switched on.
        pose: of its hand then.
        body: plans for it.
    """

    def __init__(self, side: int, ports: HandPorts, q: Vector, pose: Pose, body: Thinking) -> None:
        self.side, self._body = side, body
        self.tuning = LimbTuning()
        self._law = NaturalAdmittance(GAINS)
        self._hand = Hand(ports, self._law, reached=REACHED, settled=SETTLED, smoothing=SMOOTHING)
        self._follower = Follower(q)
        self._way: Way | None = None
        self._q = np.array(q)
        self._pose = pose
        self._brake_left = 0.0
        plans: Mapping[Verb, Plan] = {
            Verb.GO_TO: self._go_to,
            Verb.REACH: self._reach,
            Verb.POSTURE: self._posture,
            Verb.GRIP: self._grip,
            Verb.HOLD: lambda _: self.hold,
        }
        super().__init__(self.tuning, LIMB_PARAMETERS, plans)

    def hold(self) -> None:
        """Drop the movement, brake, and rest here; the fingers keep what they hold."""
        self._follower.rest(self._q)
        self._law.braking, self._brake_left = BRAKING, BRAKED_FOR
        self._hand.halt_fingers()
        self._running, self._way = ended, None

    # -- for the body

    @property
    def led(self) -> Vector:
        """(6,) the posture to which it is led now [rad]."""
        return self._follower.reference.pose

    @property
    def moving(self) -> bool:
        """Whether it is on its way."""
        return self._follower.moving

    @property
    def speed(self) -> float:
        """[m/s] of the way that it is on."""
        return self._way.speed if self._way is not None else 0.0

    def ahead(self, time: float) -> Vector:
        """(6,) the posture to which it will be led `time` [s] from now."""
        if self._way is None or not self._follower.moving:
            return self.led
        return self._way.ahead(self._follower.progress * self._way.duration + time)

    def lead(self, dt: float) -> Vector:
        """(6,) lead on for `dt` [s], at the pace that the body allows and on the leash of the spring."""
        slow = 1.0 - (1.0 - LEASH_SLACK) * self._body.pace(self.side)
        self._reference = self._follower.advance(dt, max(self._hand.load, slow))
        return self._reference.pose

    def control(self, dt: float, dynamics: Dynamics, q: Vector, v: Vector, goal: Pose) -> None:
        """One period [s] of the control law.

        Args:
            dt: [s]
            dynamics: of the arm now.
            q: (6,) joints [rad].
            v: (6,) their velocities [rad/s].
            goal: the hand of the posture to which it is led.
        """
        self._q, self._pose = q, Pose(dynamics.position, dynamics.rotation)
        self._brake_left -= dt
        if self._brake_left <= 0.0:
            self._law.braking = 1.0
        self._law.tune(self._law.stiffness, self.tuning.force_limit, dt)
        led = self._reference
        attractor = Attractor(goal.position, goal.rotation, dynamics.jacobian @ led.velocity, led.pose)
        self._hand.control(
            *(dt, dynamics, q, v, attractor),
            moving=self._follower.moving,
            grip_force=self.tuning.grip_force,
        )

    def state(self) -> ArmState:
        """One reading, in B, not changed by later steps."""
        return self._hand.state(self._q, self._pose.position, self._pose.rotation)

    # -- the verbs

    def _go_to(self, args: tuple[float, ...]) -> Start:
        return self._reach((*args[:4], 0.0, args[4], math.nan))

    def _reach(self, args: tuple[float, ...]) -> Start:
        here = self._pose.position.tolist()
        x, y, z = (or_now(*each) for each in zip("xyz", args, here, strict=False))
        for name, value in (("twist", args[3]), ("tilt", args[4])):
            if math.isinf(value):
                raise BadArgument(name, value, "finite")
        goal = Goal(x, y, z, args[3], args[4])
        self._body.must_have_power()
        speed = self._speed(args[5])
        self._body.allow(self.side, np.array(goal.point), speed)
        return self._beginning(self._body.reach(self.side, goal, speed, HAND_ACCELERATION))

    def _posture(self, args: tuple[float, ...]) -> Start:
        self._body.must_have_power()
        led = self.led.tolist()
        end = np.array([or_now(f"j{i + 1}", args[i], led[i]) for i in range(ARM_JOINTS)])
        speed = self._speed(args[6])
        self._body.allow(self.side, None, speed)
        return self._beginning(self._body.posture(self.side, end, speed, HAND_ACCELERATION))

    def _speed(self, asked: float) -> float:
        tuning = self.tuning
        return speed_or(asked, tuning.speed, SLOWEST, tuning.top_speed)

    def _beginning(self, way: Way) -> Start:
        def begin() -> None:
            self._follower.follow(way)
            self._way, self._running = way, lambda: self._hand.travelling(self._follower)
            self._law.braking = 1.0

        return begin

    def _grip(self, args: tuple[float, ...]) -> Start:
        width = self._hand.width_asked(args)

        def begin() -> None:
            # The hand rests where it is led, not where the load has pulled it: it must not sink at each grip.
            self._follower.rest(self.led)
            self._way = None
            self._hand.gripper.move(width)
            self._running = self._hand.gripping

        return begin
