"""The arm as a device: its MuJoCo description and its ports in a compiled cell."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Matrix, Vector

XML: Final = Path(__file__).with_name("arm.xml")
JOINTS: Final = 6
PREFIX: Final = "arm/"


def spec() -> mujoco.MjSpec:
    """Read the arm's description."""
    return mujoco.MjSpec.from_file(str(XML))


@dataclass(frozen=True, slots=True)
class HandPorts:
    """Views into the live `MjData` of a cell: reading is measuring, writing is commanding.

    Attributes:
        torque: (6,) of the arm's joints asked for [N m].
        finger: (1,) slide of one finger [m]; the gap is twice that.
        finger_speed: (1,) [m/s].
        finger_target: (1,) slide asked for [m].
        finger_force: (1,) of the gripper's servo on its tendon [N]; half of it reaches each finger.
        finger_limit: (2,) smallest and largest force of that servo [N].
        wrist_force: (3,) of the arm on the hand, in the sensor's frame [N].
        wrist_torque: (3,) the same, torque [N m].
        contact: (n, 3) force of contacts (and applied pushes) on each of the n bodies of the hand, axes of W
            [N]; the physics computes it for the wrist sensor.
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

    @property
    def width(self) -> float:
        """Between the fingers [m]."""
        return 2.0 * float(self.finger[0])


def bind_hand(model: mujoco.MjModel, data: mujoco.MjData, prefix: str) -> HandPorts:
    """Find the ports of a hand; `data` must be forwarded once, with the fingers centred.

    Args:
        model: of the cell.
        data: of the cell, living.
        prefix: of the names of all parts of this arm.
    """
    motor, grip = (int(model.actuator_ctrladr[model.actuator(prefix + name).id]) for name in ("m1", "grip"))
    servo = model.actuator(prefix + "grip").id
    finger = model.joint(prefix + "slide_l")
    slide, speed = int(finger.qposadr[0]), int(finger.dofadr[0])
    force, torque = (int(model.sensor(prefix + name).adr[0]) for name in ("wrist_force", "wrist_torque"))
    hand, last = model.body(prefix + "hand").id, model.body(prefix + "finger_r").id
    sensor = model.site(prefix + "wrist_sensor").id
    rotation = data.site_xmat[sensor].reshape(3, 3)
    return HandPorts(
        torque=data.ctrl[motor : motor + JOINTS],
        finger=data.qpos[slide : slide + 1],
        finger_speed=data.qvel[speed : speed + 1],
        finger_target=data.ctrl[grip : grip + 1],
        finger_force=data.actuator_force[servo : servo + 1],
        finger_limit=model.actuator_forcerange[servo],
        wrist_force=data.sensordata[force : force + 3],
        wrist_torque=data.sensordata[torque : torque + 3],
        contact=data.cfrc_ext[hand : last + 1, 3:],
        mass=float(model.body_subtreemass[hand]),
        centre=np.asarray(rotation.T @ (data.subtree_com[hand] - data.site_xpos[sensor])),
    )


@dataclass(frozen=True, slots=True)
class ArmPorts:
    """Views into the live `MjData` of a cell: reading is measuring, writing is commanding.

    Attributes:
        q: (6,) joint angles [rad].
        v: (6,) joint velocities [rad/s].
        hand: of the arm's motors and of what hangs on them.
    """

    q: Vector
    v: Vector
    hand: HandPorts


def bind(model: mujoco.MjModel, data: mujoco.MjData, prefix: str = PREFIX) -> ArmPorts:
    """Find the arm's ports; `data` must be forwarded once, with the fingers centred."""
    joints = [model.joint(f"{prefix}j{i}") for i in range(1, JOINTS + 1)]
    q0, v0 = int(joints[0].qposadr[0]), int(joints[0].dofadr[0])
    return ArmPorts(
        q=data.qpos[q0 : q0 + JOINTS], v=data.qvel[v0 : v0 + JOINTS], hand=bind_hand(model, data, prefix)
    )
