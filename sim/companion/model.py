"""The companion's ports in the compiled flat: views into the live `MjData`.

Reading is measuring, writing is commanding.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotree.sim.arm.model import HandPorts, bind_hand
from robotree.sim.companion.figure import JOINT_NAMES, SIDES
from robotree.sim.companion.flat import PREFIX
from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Vector


@dataclass(frozen=True, slots=True)
class BodyPorts:
    """Of the whole body.

    Attributes:
        qpos: of the flat; `at` (15,) are the places of the figure's joints in it.
        qvel: likewise, `rate_at` (15,).
        root: (7,) position [m] and quaternion w, x, y, z of the base in W.
        root_rate: (6,) its linear velocity in W [m/s], angular in B [rad/s].
        drive: (3,) force along x, y of B [N] and torque about z [N m] asked for.
        waist: (1,) torque asked for [N m].
        neck: (2,) torques asked for [N m].
        hands: left and right.
    """

    qpos: Vector
    at: NDArray[np.intp]
    qvel: Vector
    rate_at: NDArray[np.intp]
    root: Vector
    root_rate: Vector
    drive: Vector
    waist: Vector
    neck: Vector
    hands: tuple[HandPorts, HandPorts]


def bind(model: mujoco.MjModel, data: mujoco.MjData, prefix: str = PREFIX) -> BodyPorts:
    """Find the ports; `data` must be forwarded once, with the fingers centred."""

    def control(name: str, count: int) -> Vector:
        first = int(model.actuator_ctrladr[model.actuator(prefix + name).id])
        return data.ctrl[first : first + count]

    joints = [model.joint(prefix + name) for name in JOINT_NAMES]
    root = model.joint(prefix + "root")
    place, rate = int(root.qposadr[0]), int(root.dofadr[0])
    left, right = (bind_hand(model, data, f"{prefix}{side}_") for side in SIDES)
    return BodyPorts(
        qpos=data.qpos,
        at=np.array([int(joint.qposadr[0]) for joint in joints]),
        qvel=data.qvel,
        rate_at=np.array([int(joint.dofadr[0]) for joint in joints]),
        root=data.qpos[place : place + 7],
        root_rate=data.qvel[rate : rate + 6],
        drive=control("drive_x", 3),
        waist=control("lean", 1),
        neck=control("pan", 2),
        hands=(left, right),
    )
