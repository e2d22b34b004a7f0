"""The arm as a device: its MuJoCo description and its ports in a compiled cell."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Vector

XML: Final = Path(__file__).with_name("arm.xml")
JOINTS: Final = 6
PREFIX: Final = "arm/"


def spec() -> mujoco.MjSpec:
    """Read the arm's description."""
    return mujoco.MjSpec.from_file(str(XML))


@dataclass(frozen=True, slots=True)
class ArmPorts:
    """Views into the live `MjData` of a cell: reading is measuring, writing is commanding.

    Attributes:
        q: (6,) joint angles [rad].
        v: (6,) joint velocities [rad/s].
        torque: (6,) joint torques asked for [N m].
        finger: (1,) slide of one finger [m]; the gap is twice that.
        finger_speed: (1,) [m/s].
        finger_target: (1,) slide asked for [m].
        finger_force: (1,) force of the gripper's servo on its tendon [N]; half of it reaches each finger.
        finger_limit: (2,) smallest and largest force of that servo [N].
        wrist_force: (3,) what link6 exerts on the hand, in the sensor's frame [N].
        wrist_torque: (3,) the same, torque [N m].
        contact: (n, 3) force of contacts (and applied pushes) on each of the n bodies of the hand, axes of W
            [N]; the physics computes it for the wrist sensor.
        hand_bodies: ids of those bodies.
        hand_mass: mass beyond the wrist sensor [kg].
        hand_centre: (3,) its centre of mass in the sensor's frame [m].
    """

    q: Vector
    v: Vector
    torque: Vector
    finger: Vector
    finger_speed: Vector
    finger_target: Vector
    finger_force: Vector
    finger_limit: Vector
    wrist_force: Vector
    wrist_torque: Vector
    contact: Vector
    hand_bodies: slice
    hand_mass: float
    hand_centre: Vector


def bind(model: mujoco.MjModel, data: mujoco.MjData, prefix: str = PREFIX) -> ArmPorts:
    """Find the arm's ports; `data` must be forwarded once, with the fingers centred."""
    joints = [model.joint(f"{prefix}j{i}") for i in range(1, JOINTS + 1)]
    q0, v0 = int(joints[0].qposadr[0]), int(joints[0].dofadr[0])
    motor, grip = model.actuator(prefix + "m1").id, model.actuator(prefix + "grip").id
    u0, ug = int(model.actuator_ctrladr[motor]), int(model.actuator_ctrladr[grip])
    finger = model.joint(prefix + "finger_l")
    fq, fv = int(finger.qposadr[0]), int(finger.dofadr[0])
    force, torque = (int(model.sensor(prefix + name).adr[0]) for name in ("wrist_force", "wrist_torque"))
    hand, last = model.body(prefix + "hand").id, model.body(prefix + "finger_r").id
    sensor = model.site(prefix + "wrist_sensor").id
    rotation = data.site_xmat[sensor].reshape(3, 3)
    bodies = slice(hand, last + 1)
    return ArmPorts(
        q=data.qpos[q0 : q0 + JOINTS],
        v=data.qvel[v0 : v0 + JOINTS],
        torque=data.ctrl[u0 : u0 + JOINTS],
        finger=data.qpos[fq : fq + 1],
        finger_speed=data.qvel[fv : fv + 1],
        finger_target=data.ctrl[ug : ug + 1],
        finger_force=data.actuator_force[grip : grip + 1],
        finger_limit=model.actuator_forcerange[grip],
        wrist_force=data.sensordata[force : force + 3],
        wrist_torque=data.sensordata[torque : torque + 3],
        contact=data.cfrc_ext[bodies, 3:],
        hand_bodies=bodies,
        hand_mass=float(model.body_subtreemass[hand]),
        hand_centre=np.asarray(rotation.T @ (data.subtree_com[hand] - data.site_xpos[sensor])),
    )
