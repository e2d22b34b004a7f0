"""What takes part in rehearsals of a crash: arms that count what they do, and a rover that forgets it."""

from __future__ import annotations

from robotree.sim.controller.fence_file import FenceFile
from robotree.sim.firmware import SILENCE
from robotree.sim.kinds import KINDS
from robotree.testing.parts import Part, Stage
from robotree.testing.simulated import Simulated
from robotree.vr import Robot, command


class Arm(Robot):
    """Counts what it does."""

    done = 0

    def readings(self) -> dict[str, float]:
        return {"done": float(self.done)}

    @command
    def act(self, n: int, seconds: float = 0.0) -> int:
        """Do one thing, which takes its time."""
        self.sleep(seconds or 0.02)
        self.done += 1
        return n * 2


class Arms(Part):
    """An arm in a process of its own."""

    def enter(self, team: Stage, path: str, name: str) -> None:
        team.start_robot(path, Arm(name))


class Rover(Simulated):
    """A rover whose controller has another life each time that it is started."""

    lives = 0

    def __init__(self) -> None:
        super().__init__("rover")

    def enter(self, team: Stage, path: str, name: str) -> None:
        super().enter(team, path, name)
        self.restart_controller()

    def restart_controller(self) -> None:
        """Have it stand at 0 and know nothing of before."""
        self.cut()
        self.world, self.lives = KINDS["rover"].world(), self.lives + 1
        memory = FenceFile(None)
        memory.life = self.lives
        self._controller = KINDS["rover"]._controller(self.world, 1, SILENCE, memory)
        self._began = self._team.now
        self.mend()

    @property
    def x(self) -> float:
        """Where it is [m]."""
        return float(self.world.rover.state().position[0])
