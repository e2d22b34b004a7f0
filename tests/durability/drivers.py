"""Pages that drive a rover, which adds up: what they do about a step of which nobody knows."""

from __future__ import annotations

from robotree.vr import Child, CommandInDoubt, StepInDoubt, VirtualRobot, command, state


class Driver(VirtualRobot):
    """Leaves it to a person."""

    rover = Child("Rover")
    legs: int = state(0)

    @command
    def drive(self, legs: int) -> int:
        """Drive ahead, leg after leg."""
        for _ in range(legs):
            self.rover.move(x=0.1, y=0.0)
            self.legs += 1
        return self.legs

    @command
    def both(self) -> int:
        """Drive as one of two parts."""
        with self.together() as parts:
            parts.start(self.rover.move, x=0.1, y=0.0)
            parts.start(self._rest)
        return 2

    def _rest(self) -> None:
        self.sleep(0.01)


class Verifier(Driver):
    """Looks itself."""

    verdict: str = "done"
    asked: list[str] = state([])

    def verify(self, step: StepInDoubt) -> bool | None:
        where = self.rover.get_info().x
        self.asked = [*self.asked, f"{step.name} x={step.arguments['x']} at {where:.1f}"]
        if self.verdict == "fails":
            raise RuntimeError("no camera")
        return {"done": True, "not done": False}.get(self.verdict)


class Catcher(Driver):
    """Catches it."""

    caught: str = state("")

    @command
    def drive(self, legs: int) -> int:
        for _ in range(legs):
            try:
                self.rover.move(x=0.1, y=0.0)
            except CommandInDoubt as doubt:
                self.caught = str(doubt)
            self.legs += 1
        return self.legs
