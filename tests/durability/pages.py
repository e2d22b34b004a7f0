"""Pages whose commands are interrupted: each says in its result what it believes to have done.

Those that drive a rover, which adds up, differ in what they do about a step of which nobody knows.
"""

from __future__ import annotations

import threading

from robotree.vr import Child, CommandInDoubt, StepInDoubt, VirtualRobot, command, state
from robotree.vr.base.errors import VrError


class Helper(VirtualRobot):
    """Lives beside the tourist, and has an arm of its own."""

    arm = Child("Robot")
    helped: int = state(0)

    @command
    def act(self, n: int, seconds: float = 0.0) -> int:
        """Do one thing."""
        result = int(self.arm.act(n=n, seconds=seconds) if seconds else self.arm.act(n=n))
        self.helped += 1
        return result


class Tourist(VirtualRobot):
    """Takes steps of all kinds."""

    arm = Child("Robot")
    helper = Child("Robot")
    pace: float = 0.0
    done: int = state(0)
    seen: list[int] = state([])
    won: list[int] = state([])
    chance: float = 0.0

    @command
    def tour(self, steps: int, pause: float = 0.0) -> list[float]:
        """Act in turns, by the arm and by the helper; note each in place."""
        began, dice = self.now(), [0.0]
        for n in range(steps):
            dice.append(self.random())
            (self.helper if n % 2 else self.arm).act(n=n)
            self.done += 1
            self.seen.append(n)
            self.sleep(pause)
            assert self.now() >= began
        assert len(set(dice)) == len(dice)
        return [float(self.done), float(len(self.seen))]

    @command
    def pairs(self, steps: int) -> list[int]:
        """Act by both at once."""
        results: list[int] = []
        for n in range(0, steps, 2):
            with self.together() as both:
                both.start(self.arm.act, n=n, seconds=0.02)
                both.start(self.helper.act, n=n + 1)
            results += [int(result) for result in both.results]
        return results

    @command
    def parts(self, steps: int) -> int:
        """Act by two functions of this page at once."""
        with self.together() as both:
            both.start(self._row, "arm", 0, steps)
            both.start(self._row, "helper", steps, 2 * steps)
        return sum(both.results)

    def _row(self, slot: str, first: int, end: int) -> int:
        child, total = getattr(self, slot), 0
        for n in range(first, end):
            total += child.act(n=n)
            self.sleep(0.001)
        return total

    @command
    def races(self, steps: int) -> list[int]:
        """Have both act, and take the first."""
        winners: list[int] = []
        for n in range(0, steps, 2):
            with self.first() as race:
                race.start(self.arm.act, n=n, seconds=0.03)
                race.start(self.helper.act, n=n + 1)
            winners.append(int(race.winner))
            self.won = [*self.won, int(race.winner)]
        return winners

    @command(effect="read")
    def winners(self) -> list[int]:
        """Return who had won, as it was kept at once."""
        return self.won

    @command
    def careful(self, steps: int) -> int:
        """Act, and act once more however it ends."""
        try:
            for n in range(steps):
                self.arm.act(n=n, seconds=0.05)
                self.sleep(0.01)
        finally:
            with self.cleanup(within=8.0):
                for n in range(100, 104):
                    self.arm.act(n=n, seconds=0.02)
        return steps

    @command
    def watch(self, steps: int) -> list[float]:
        """Act, and wait until the arm publishes it."""
        found: list[float] = []
        begun = self.arm.readings.done
        for n in range(steps):
            self.arm.act(n=n)
            self.wait_until(lambda n=n: self.arm.readings.done >= begun + n + 1, within=20.0)
            found.append(self.arm.readings.done - begun)
        return found

    @command
    def telling(self, steps: int) -> int:
        """Start what goes on by itself."""
        for n in range(steps):
            if n % 2:
                self.arm.act.tell(n=n)
            else:
                self.arm.act.start(n=n).detach()
            self.helper.act(n=100 + n)
        return steps

    @command
    def paced(self, steps: int) -> list[float]:
        """Note the setting before each act."""
        paces: list[float] = []
        for n in range(steps):
            paces.append(self.pace)
            self.arm.act(n=n, seconds=0.05)
        return paces

    @command
    def mending(self, steps: int) -> list[str]:
        """Catch what a child refuses, and go on."""
        words: list[str] = []
        for n in range(steps):
            try:
                self.arm.act(n="none")
            except VrError as error:
                words.append(type(error).__name__)
            self.helper.act(n=n)
        return words

    @command
    def threading(self, steps: int) -> int:
        """Act from a thread of the page's own."""
        import contextvars

        def act() -> None:
            for n in range(steps):
                self.arm.act(n=n, seconds=0.05)

        thread = threading.Thread(target=contextvars.copy_context().run, args=(act,))
        thread.start()
        thread.join()
        return steps

    @command
    def rounds(self, steps: int) -> int:
        """Need no step of the rounds before."""
        while self.done < steps:
            self.arm.act(n=self.done)
            self.helper.act(n=self.done + 100)
            self.done += 1
            self.checkpoint()
        return self.done


class Walker(VirtualRobot):
    """Drives to and fro; takes no step twice, whatever becomes of it."""

    rover = Child("Rover", returns=20.0)

    @command
    def walk(self, first: int, steps: int) -> list[tuple[int, str]]:
        """Take numbered steps of different lengths; return what became of each."""
        said: list[tuple[int, str]] = []
        for n in range(first, first + steps):
            way = (100 + n) * 1e-4 * (1 if n % 2 else -1)
            try:
                self.rover.move(x=way, y=0.0)
                said.append((n, "done"))
            except VrError as error:
                said.append((n, type(error).__name__))
                self.sleep(0.1)
        return said


class Patrol(VirtualRobot):
    """Goes on for ever, as far as it knows: its rounds are in its state."""

    arm = Child("Robot")
    done: int = state(0)
    seen: list[int] = state([])

    @command
    def rounds(self, steps: int) -> list[int]:
        """Act once, and then in rounds that begin with a checkpoint."""
        self.arm.act(n=1000)
        while True:
            self.checkpoint()
            if self.done == steps:
                return self.seen
            self.arm.act(n=2 * self.done)
            self.arm.act(n=2 * self.done + 1)
            self.seen.append(self.done)
            self.done += 1

    @command
    def nested(self, steps: int) -> int:
        """Act in rounds within rounds, with a checkpoint in each."""
        while self.done < 3 * steps:
            self.checkpoint()
            while True:
                self.checkpoint()
                self.arm.act(n=self.done)
                self.done += 1
                if self.done % 3 == 0:
                    break
            self.arm.act(n=1000 + self.done // 3 - 1)
        return self.done


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
