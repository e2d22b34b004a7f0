# Narrow stub of ruckig 0.19: what robotree uses of it.
# ruff: noqa: A002  the library's own names

from enum import Enum

class Result(Enum):
    Working = ...
    Finished = ...

class ControlInterface(Enum):
    Position = ...
    Velocity = ...

class InputParameter:
    control_interface: ControlInterface
    current_position: list[float]
    current_velocity: list[float]
    target_position: list[float]
    max_velocity: list[float]
    max_acceleration: list[float]
    max_jerk: list[float]
    def __init__(self, degrees_of_freedom: int) -> None: ...

class Trajectory:
    duration: float
    def __init__(self, degrees_of_freedom: int) -> None: ...
    def at_time(self, time: float) -> tuple[list[float], list[float], list[float]]: ...

class Ruckig:
    def __init__(self, degrees_of_freedom: int) -> None: ...
    def calculate(self, input: InputParameter, trajectory: Trajectory) -> Result: ...
