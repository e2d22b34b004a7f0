"""The worlds that can be simulated: scenery compiled, devices bound and put in their first place."""

from dataclasses import dataclass

from robotree.sim.arm import Arm
from robotree.sim.cell import Cell
from robotree.sim.engine import mujoco
from robotree.sim.kinematics import HOME
from robotree.sim.models import arm as arm_model
from robotree.sim.models import lever as lever_model
from robotree.sim.models import rover as rover_model
from robotree.sim.models import scenery
from robotree.sim.rover import Rover

FINGERS_AT_FIRST = 0.03
"""[m] slide of each finger: the gripper is three quarters open."""


@dataclass(frozen=True, slots=True)
class ArmWorld:
    """The arm at its table, with the lever open."""

    cell: Cell
    arm: Arm
    lever: lever_model.LeverPorts

    @property
    def lever_angle(self) -> float:
        """[rad] below 0: open, towards the arm; above 0: closed."""
        return float(self.lever.angle[0])


@dataclass(frozen=True, slots=True)
class RoverWorld:
    """The rover on its floor."""

    cell: Cell
    rover: Rover


def arm_world() -> ArmWorld:
    """Build the arm's cell: arm at home, fingers open, lever open."""
    model = scenery.arm_cell().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    ports = arm_model.bind(model, data)
    lever = lever_model.bind(model, data)
    ports.q[:] = HOME
    for finger in ("finger_l", "finger_r"):
        data.qpos[model.joint(arm_model.PREFIX + finger).qposadr[0]] = FINGERS_AT_FIRST
    ports.finger_target[:] = FINGERS_AT_FIRST
    lever.angle[:] = lever_model.OPEN
    mujoco.mj_forward(model, data)
    arm = Arm(ports)
    return ArmWorld(Cell(model, data, arm), arm, lever)


def rover_world() -> RoverWorld:
    """Build the rover's cell: the rover in the middle of the floor."""
    model = scenery.rover_cell().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rover = Rover(rover_model.bind(model, data))
    return RoverWorld(Cell(model, data, rover), rover)
