"""One world and its step: MuJoCo moves it, the device's control law runs before every step.

A cell knows no clock and no thread. The caller of `advance` decides how fast its time passes: tests call it
as fast as they can, `realtime.RealTime` keeps pace with the wall clock. Only one thread may touch a cell; the
others read the state that it publishes after every batch.
"""

from typing import Final, Protocol

import numpy as np

from robotree.sim.physics.engine import mujoco
from robotree.sim.physics.vectors import Vector

BATCH: Final = 5
"""Steps between two looks at the wire: 5 steps of 1 ms cost the least processor time at the same jitter."""
STATE: Final = mujoco.mjtState.mjSTATE_INTEGRATION
"""Everything that the next step depends on."""


class Controlled(Protocol):
    """An actor of a cell before each of its steps."""

    def control(self, dt: float) -> None:
        """One step of the control law [s], before the world moves on."""
        ...


class Cell:
    """One MuJoCo world with one robot in it.

    Args:
        model: the compiled world.
        data: its state, forwarded once.
        device: what acts in it before each step, bound to `data`.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, device: Controlled) -> None:
        self.model, self.data, self.device = model, data, device
        self._steps = 0
        self._step = float(model.opt.timestep)
        self._size = mujoco.mj_stateSize(model, STATE)
        self.published = self.snapshot()
        """(n,) the state after the last batch; replaced whole, never changed, so any thread may read it."""

    @property
    def time_ms(self) -> int:
        """Time of this world since it began [ms]."""
        return round(1e3 * self._step * self._steps)

    def snapshot(self) -> Vector:
        """(n,) a copy of the whole state of the physics."""
        state: Vector = np.empty(self._size)
        mujoco.mj_getState(self.model, self.data, state, STATE)
        return state

    def advance(self, steps: int = BATCH) -> None:
        """Control and move the world for `steps` of its time steps, then publish."""
        model, data, control, dt = self.model, self.data, self.device.control, self._step
        for _ in range(steps):
            control(dt)
            mujoco.mj_step(model, data)
        self._steps += steps
        self.published = self.snapshot()
