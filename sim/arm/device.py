"""The arm as one robot: ports below, verbs above, the control law between.

Each control period: read the joints and the wrist sensor, walk the attractor on its leash, compute the
torques.

The parameters can be tuned while it runs, within the limits it was measured with. Speeds and accelerations
count from the next movement or set-point on; the spring changes gradually (see `compliance`), so tuning a
pressing arm does not make it jump.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from robotree.protocol.messages import SetpointKind, Verb
from robotree.sim.arm.compliance import FORCE_LIMIT, TOOL_STIFFNESS, NaturalAdmittance, pointing_down
from robotree.sim.arm.hand import SPEED as GRIP_SPEED
from robotree.sim.arm.hand import ArmState, Hand
from robotree.sim.arm.kinematics import Kinematics, twist_of
from robotree.sim.arm.model import ArmPorts
from robotree.sim.arm.planner import TOOL_ACCELERATION, TOOL_SPEED, TWIST, Planner
from robotree.sim.firmware.device import (
    Device,
    Plan,
    Progress,
    Start,
    Tunable,
    WayAhead,
    ended,
    or_now,
    pursuing,
    require,
    speed_or,
    way_along,
)
from robotree.sim.motion.follower import Follower, Group, Pursuit
from robotree.sim.motion.path import Path
from robotree.sim.physics.vectors import Vector

TOP_SPEED: Final = 0.25
"""[m/s] that a goal may ask for: the reduced speed of ISO 10218-1 for people near an arm."""
SLOWEST: Final = 0.005
"""[m/s] that a goal may ask for."""
GRIP_FORCE: Final = 15.0
"""[N] of each finger; half of what the gripper's servo can pull."""


@dataclass(slots=True)
class ArmTuning:
    """The values of `PARAMETERS`, in their units."""

    speed: float = TOOL_SPEED
    top_speed: float = TOP_SPEED
    acceleration: float = TOOL_ACCELERATION
    stiffness: float = TOOL_STIFFNESS
    force_limit: float = FORCE_LIMIT
    grip_speed: float = GRIP_SPEED
    grip_force: float = GRIP_FORCE


PARAMETERS: Final = (
    Tunable("TOOL_SPEED", "speed", SLOWEST, TOP_SPEED, "m/s, of a goal that names no speed"),
    Tunable("TOOL_SPEED_MAX", "top_speed", SLOWEST, TOP_SPEED, "m/s, that a goal or set-point may ask for"),
    Tunable("TOOL_ACCEL", "acceleration", 0.1, TOOL_ACCELERATION, "m/s2, of the next movement"),
    Tunable("TOOL_STIFFNESS", "stiffness", 250.0, 1000.0, "N/m, of the spring on which the tool hangs"),
    Tunable("TOOL_FORCE_MAX", "force_limit", 10.0, FORCE_LIMIT, "N, that the spring pulls at most"),
    Tunable("GRIP_SPEED", "grip_speed", 0.01, GRIP_SPEED, "m/s, of the gap between the fingers"),
    Tunable("GRIP_FORCE", "grip_force", 2.0, GRIP_FORCE, "N, of each finger"),
)
"""The parameters that people can tune."""


REACHED: Final = 0.004
"""[m] between tool and goal that counts as reached; friction leaves 1 mm, 3 mm at worst."""
SETTLED: Final = 0.01
"""[rad/s] of the fastest joint that counts as standing."""
BRAKING: Final = 5.0
"""times the damping of the usual law while the tool is brought to a stand."""
BRAKED_WITHIN: Final = 0.3
"""[s] after which a tool that was told to hold and has not come to a stand keeps the place it was told at."""
WIDEST_BLEND: Final = 0.05
"""[m] from its end at which a move may count as reached in passing."""
TURNED: Final = 0.1
"""[rad] that the tool may lack of its twist then."""
AXES: Final = ("x", "y", "z", "twist")
"""Of a tool that points down."""


class Arm(Device):
    """The arm in its cell.

    Args:
        ports: of the arm in the cell; its joints stand where the arm is switched on.
    """

    setpoint_kinds = (SetpointKind.TOOL_POSE, SetpointKind.TOOL_VELOCITY)

    def __init__(self, ports: ArmPorts) -> None:
        self._ports = ports
        self.tuning = ArmTuning()
        """The values of `parameters`; they are read in every control period."""
        self._kinematics = Kinematics()
        self._planner = Planner(Kinematics())
        self._law = NaturalAdmittance()
        self._hand = Hand(ports.hand, self._law, reached=REACHED, settled=SETTLED)
        self._position, self._rotation = self._kinematics.pose(ports.q)
        self._follower = Follower(self._here())
        self._velocity: Vector = np.zeros(len(AXES))
        self._braking: Vector | None = None
        """The velocity at which it was told to hold, while it brakes."""
        self._brake_left = 0.0
        self._pursuit: Pursuit | None = None
        plans: Mapping[Verb, Plan] = {
            Verb.GO_TO: self._go_to,
            Verb.GRIP: self._grip,
            Verb.HOLD: lambda _: self.hold,
        }
        super().__init__(self.tuning, PARAMETERS, plans)

    def follow(self, kind: int, args: tuple[float, ...]) -> Start:
        """Check one set-point; nothing changes yet.

        Args:
            kind: TOOL_POSE or TOOL_VELOCITY.
            args: (7,) as in robotree.xml.

        Returns:
            What follows it, within the limits of speed and place.

        Raises:
            GoalRefused: no posture brings the tool there, or a number is infinite.
        """
        if kind == SetpointKind.TOOL_POSE:
            here = self._follower.reference.pose.tolist()
            target = np.array([or_now(*each) for each in zip(AXES, args, here, strict=False)])
            target[3] = here[3] + math.remainder(target[3] - here[3], math.tau)
            self._planner.check(target, np.array(self._ports.q))
            return lambda: self._pursue().toward(target)
        now = [0.0] * len(AXES) if self._pursuit is None else self._pursuit.rate.tolist()
        rate = np.array([or_now(*each) for each in zip(AXES, args, now, strict=False)])
        return lambda: self._pursue().along(rate)

    def hold(self) -> None:
        """Drop the movement, brake, and rest where the tool then stands; the fingers keep what they hold."""
        self._braking, self._brake_left = np.array(self._velocity), BRAKED_WITHIN
        self._law.braking = BRAKING
        self._follower.rest(self._here())
        self._hand.halt_fingers()
        self._running, self._pursuit = ended, None

    def control(self, dt: float) -> None:
        """One period [s] of the control law."""
        ports, tuning, hand = self._ports, self.tuning, self._hand
        self._law.tune(tuning.stiffness, tuning.force_limit, dt)
        hand.gripper.speed = tuning.grip_speed
        dynamics = self._kinematics.dynamics(ports.q, ports.v)
        twist = dynamics.jacobian @ ports.v
        self._velocity[:3], self._velocity[3] = twist[:3], twist[5]
        if self._braking is not None:
            self._brake(self._braking, dt)
        attractor = pointing_down(self._follower.advance(dt, hand.load))
        hand.control(
            *(dt, dynamics, ports.q, ports.v, attractor),
            moving=self._follower.moving,
            grip_force=tuning.grip_force,
        )
        self._position[:], self._rotation[:] = dynamics.position, dynamics.rotation

    def state(self) -> ArmState:
        """One reading, in W, not changed by later steps."""
        return self._hand.state(self._ports.q, self._position, self._rotation)

    def _brake(self, began: Vector, dt: float) -> None:
        """Once the tool has come to a stand, rest there: the spring, stretched by then, would pull it back.

        Args:
            began: (4,) velocity at which it was told to hold; cleared for the axes that stand.
            dt: control period [s].
        """
        self._brake_left -= dt
        rest, here = np.array(self._follower.reference.pose), self._here()
        for axes in (slice(0, 3), slice(3, 4)):
            if began[axes].any() and float(self._velocity[axes] @ began[axes]) <= 0.0:
                rest[axes], began[axes] = here[axes], 0.0
                self._follower.rest(rest)
                self._law.begin(self._ports.v)
        if self._brake_left <= 0.0 or not began.any():
            self._go_free()

    def _go_free(self) -> None:
        """Brake no more."""
        self._braking, self._law.braking = None, 1.0

    def _here(self) -> Vector:
        return np.array((*self._position, twist_of(self._rotation)))

    def way(self, verb: int, args: tuple[float, ...]) -> WayAhead:
        """The way of the tool to the end of a GO_TO; none for other verbs.

        Args:
            verb: as for `prepare`.
            args: as for `prepare`.

        Raises:
            GoalRefused: as `prepare`.
        """
        if verb != Verb.GO_TO:
            return WayAhead()
        _blend(args)
        return way_along(self._path_to(args), lambda pose: (pose[0], pose[1], pose[2]))

    def _path_to(self, args: tuple[float, ...]) -> Path:
        start = self._follower.reference
        goal = np.array([or_now(*each) for each in zip(AXES, args, start.pose.tolist(), strict=False)])
        tuning = self.tuning
        speed = speed_or(args[4], tuning.speed, SLOWEST, tuning.top_speed)
        return self._planner.plan(start, np.array(self._ports.q), goal, speed, tuning.acceleration)

    def _go_to(self, args: tuple[float, ...]) -> Start:
        path, blend = self._path_to(args), _blend(args)

        def begin() -> None:
            self._follower.follow(path)
            self._running, self._pursuit = lambda: self._going(path.goal, blend), None
            self._go_free()

        return begin

    def _going(self, goal: Vector, blend: float) -> Progress:
        """How far a move is, which may count as reached `blend` [m] from its goal (4,)."""
        progress, here = self._hand.travelling(self._follower), self._here()
        turned = abs(math.remainder(float(goal[3] - here[3]), math.tau)) <= TURNED
        near = blend > 0.0 and math.dist(goal[:3], here[:3]) <= blend
        return replace(progress, passed=near and turned)

    def _grip(self, args: tuple[float, ...]) -> Start:
        width = self._hand.width_asked(args)

        def begin() -> None:
            self.hold()
            self._hand.gripper.move(width)
            self._running = self._hand.gripping

        return begin

    def _pursue(self) -> Pursuit:
        """The pursuit that runs, else a new one from where the attractor is."""
        tuning = self.tuning
        groups = (
            Group(slice(0, 3), tuning.top_speed, tuning.acceleration),
            Group(slice(3, 4), TWIST[0], TWIST[1]),
        )
        if self._pursuit is None:
            self._pursuit = Pursuit(self._follower.reference, groups, self._stands)
            self._follower.chase(self._pursuit)
            self._go_free()
            self._running = pursuing
        self._pursuit.limit(groups)
        return self._pursuit

    def _stands(self, pose: Vector) -> bool:
        return self._planner.stands(pose, np.array(self._ports.q))


def _blend(args: tuple[float, ...]) -> float:
    """How near [m] to its end a GO_TO counts as reached; 0: when it stands there.

    Raises:
        BadArgument: out of range.
    """
    blend = or_now("blend", args[5], 0.0)
    require("blend", blend, 0.0, WIDEST_BLEND, "m")
    return blend
