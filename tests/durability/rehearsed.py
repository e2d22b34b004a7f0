"""Arms for rehearsals of a crash: they count what they do."""

from __future__ import annotations

from robotree.testing.parts import Part, Stage
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
