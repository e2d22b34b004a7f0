"""The companion's ports in the compiled flat: views into the live `MjData`.

Reading is measuring, writing is commanding.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from robotree.sim.companion.figure import JOINT_NAMES, SIDES
from robotree.sim.companion.flat import PREFIX
from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Matrix, Vector


@dataclass(frozen=True, slots=True)
class HandPorts:
    """Of one hand.

    Attributes:
        torque: (6,) of the arm's joints asked for [N m].
        finger: (1,) slide of one finger [m]; the gap is twice that.
        finger_speed: (1,) [m/s].
        finger_target: (1,) slide asked for [m].
        finger_force: (1,) of the gripper's servo on its tendon [N]; half of it reaches each finger.
        finger_limit: (2,) smallest and largest force of that servo [N].
        wrist_force: (3,) of the arm on the hand, in the sensor's frame [N].
        wrist_torque: (3,) the same, torque [N m].
        contact: (n, 3) force of contacts on the bodies of the hand, axes of W [N].
        mass: beyond the wrist sensor [kg].
        centre: (3,) its centre of mass in the sensor's frame [m].
    """

    torque: Vector
    finger: Vector
    finger_speed: Vector
    finger_target: Vector
    finger_force: Vector
    finger_limit: Vector
    wrist_force: Vector
    wrist_torque: Vector
    contact: Matrix
    mass: float
    centre: Vector


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
    left, right = (_hand(model, data, prefix + side, control(f"{side}_m1", 6)) for side in SIDES)
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


def _hand(model: mujoco.MjModel, data: mujoco.MjData, side: str, torque: Vector) -> HandPorts:
    grip = model.actuator(f"{side}_grip").id
    ctrl = int(model.actuator_ctrladr[grip])
    finger = model.joint(f"{side}_slide_l")
    fq, fv = int(finger.qposadr[0]), int(finger.dofadr[0])
    force, turn = (int(model.sensor(f"{side}_{name}").adr[0]) for name in ("force", "torque"))
    hand, last = model.body(f"{side}_hand").id, model.body(f"{side}_finger_r").id
    sensor = model.site(f"{side}_wrist_sensor").id
    rotation = data.site_xmat[sensor].reshape(3, 3)
    return HandPorts(
        torque=torque,
        finger=data.qpos[fq : fq + 1],
        finger_speed=data.qvel[fv : fv + 1],
        finger_target=data.ctrl[ctrl : ctrl + 1],
        finger_force=data.actuator_force[grip : grip + 1],
        finger_limit=model.actuator_forcerange[grip],
        wrist_force=data.sensordata[force : force + 3],
        wrist_torque=data.sensordata[turn : turn + 3],
        contact=data.cfrc_ext[hand : last + 1, 3:],
        mass=float(model.body_subtreemass[hand]),
        centre=np.asarray(rotation.T @ (data.subtree_com[hand] - data.site_xpos[sensor])),
    )
