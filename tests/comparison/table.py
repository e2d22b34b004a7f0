"""Plays pick-and-place here and with two peers, and prints the table of docs/comparison.md.

    make comparison            the tests, after building .venv-comparison
    python -m tests.comparison.table        the table

The peers run in `.venv-comparison` against `arm.py`, a program of its own; robotree's page runs in a
rehearsal against the simulated arm with its own firmware. What is told of each is what the arm has done.
"""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.comparison.counting import code_lines

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
PYTHON = ROOT / ".venv-comparison" / "bin" / "python"
PAGE = ROOT / "examples" / "pick_and_place.py"
PEERS = ("py_trees", "bluesky")
SCENES = ("success", "cancel", "kill", "lost")
MOTION = 1.0
"""[s] that a goal of `arm.py` takes."""
NEVER = 1000.0
LIFTING = 3
"""Goals that are over when the accident comes: it is lifting what it has gripped."""


@dataclass
class Outcome:
    """What one peer did in one scene."""

    said: str
    """The last line of the program, or the error."""
    goals: list[tuple[float, str, Any]]
    """What the arm has logged: when, what, and the goal."""
    accident: float = 0.0
    """When it came."""

    @property
    def went_on(self) -> float:
        """[s] for which the goal under way went on after the accident; NaN: it was none."""
        ends = [at for at, what, goal in self.goals if at > self.accident and what != "begins"]
        return ends[0] - self.accident if ends else float("nan")

    @property
    def let_go(self) -> bool:
        """Whether the gripper was opened after the accident."""
        return any(
            at > self.accident and what == "reached" and goal.get("grip") == "open"
            for at, what, goal in self.goals
        )


def page_of(path: Path) -> str:
    """Return the part of a program that is its page: what its author writes, with what it imports."""
    source = path.read_text()
    if "# -- page" not in source:
        return source
    imports = [line for line in source.partition("# -- page")[0].splitlines() if "import" in line]
    page = source.partition("# -- page\n")[2].partition("# -- end of the page")[0]
    return "\n".join(imports) + "\n" + page


@contextmanager
def arm(folder: Path) -> Iterator[tuple[subprocess.Popen[str], int, Path]]:
    """Run the arm; yields its process, its port and its log."""
    log = folder / "log"
    log.touch()
    words = [sys.executable, str(HERE / "arm.py"), str(log)]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield process, int(process.stdout.readline()), log
        finally:
            process.kill()


def read(log: Path) -> list[tuple[float, str, Any]]:
    """Return what the arm has logged."""
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    return [(line["at"], line["what"], line["goal"]) for line in lines]


def lifting(log: Path) -> bool:
    """Whether it is lifting what it has gripped."""
    goals = read(log)
    reached = sum(what == "reached" for _, what, _ in goals)
    return reached == LIFTING and goals[-1][1] == "begins"


def play(peer: str, scene: str) -> Outcome:
    """Play one scene with one peer."""
    with tempfile.TemporaryDirectory(prefix="rt-") as place, arm(Path(place)) as (process, port, log):
        words = [str(PYTHON), str(HERE / f"with_{peer}.py"), str(port)]
        with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as program:
            accident = NEVER + time.time()
            if scene != "success":
                _wait(lambda: lifting(log))
                time.sleep(0.3)
                accident = time.time()
                match scene:
                    case "kill":
                        program.kill()
                    case "lost":
                        process.kill()
                    case _:
                        program.send_signal(signal.SIGUSR1)
            said = (program.communicate(timeout=30)[0].splitlines() or [""])[-1]
            time.sleep(1.2)
        return Outcome(said if scene != "kill" else "killed", read(log), accident)


def _wait(happened: Any) -> None:
    end = time.monotonic() + 30
    while not happened():
        if time.monotonic() > end:
            raise TimeoutError("the program does not begin")
        time.sleep(0.02)


def play_here(scene: str) -> Outcome:
    """Play one scene with robotree: the page in a rehearsal, the simulated arm below it."""
    from robotree.testing import cell, rehearse
    from robotree.vr import VrError

    if scene == "success":
        return _succeed_here()
    with rehearse(PAGE, arm=cell("arm")) as team:
        world = team["arm"].world
        going = team.start("pick_and_place", x=0.3, y=-0.2, to_x=0.3, to_y=-0.3)
        team.wait_until(lambda: team.commanded.names[2:4] == ["arm.grip", "arm.go_to"], within=30)
        team.wait(0.3)
        accident = team.now
        match scene:
            case "cancel":
                team.cancel(after=0.0)
            case "kill":
                team.lose("", after=0.0)
            case _:
                team.lose("arm", after=0.0)
        stood = _until_it_stands(team, world)
        with suppress(TimeoutError):
            team.wait_until(lambda: going.done, within=15)
        try:
            said = str(going.result()) if going.done else "killed"
        except VrError as error:
            said = f"{type(error).__name__}: {error}"
        team.wait(1.0)
        goals: list[tuple[float, str, Any]] = [(stood, "ended early", {})]
        goals += [
            (step.ended, "reached", step.arguments | {"grip": step.arguments.get("action")})
            for step in team.steps
            if step.robot and not step.error
        ]
        return Outcome(said, goals, accident)


def _succeed_here() -> Outcome:
    """Play the page where something is to be gripped; the simulated table is empty there."""
    from robotree.kinds import Arm
    from robotree.testing import Fake, rehearse

    with rehearse(PAGE, arm=Fake(Arm, get_info={"holding": True})) as team:
        team.call("pick_and_place", x=0.3, y=0.0, to_x=0.3, to_y=0.2)
        return Outcome("success", [(step.ended, "reached", {}) for step in team.steps], NEVER)


def _until_it_stands(team: Any, world: Any) -> float:
    """Return when the tool came to a stand."""
    place = world.arm.state().position
    while True:
        team.wait(0.02)
        now = world.arm.state().position
        if max(abs(now - place)) < 1e-4:
            return float(team.now)
        place = now


def _time(outcome: Outcome) -> str:
    """Return how long the motion went on; the arm that was lost cannot say it."""
    return "-" if math.isnan(outcome.went_on) else f"{1000 * outcome.went_on:.0f} ms"


def lines_row() -> str:
    """Return the first row of the table."""
    paths = (PAGE, *(HERE / f"with_{peer}.py" for peer in PEERS))
    return "| lines of code | " + " | ".join(str(code_lines(page_of(path))) for path in paths) + " |"


def table() -> str:
    """Play everything; return the table as Markdown."""
    names = ("robotree", *PEERS)
    outcomes = {
        (name, scene): play_here(scene) if name == "robotree" else play(name, scene)
        for name in names
        for scene in SCENES
    }
    rows = [["", *names], ["---"] * (len(names) + 1)]
    for scene in SCENES[1:]:
        of = [outcomes[name, scene] for name in names]
        rows.append([f"{scene}: the motion goes on for", *map(_time, of)])
        rows.append([f"{scene}: the gripper lets go", *("yes" if each.let_go else "no" for each in of)])
        rows.append([f"{scene}: what is said", *(f"`{each.said[:90]}`" for each in of)])
    lines = ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([*lines[:2], lines_row(), *lines[2:]])


if __name__ == "__main__":
    sys.stdout.write(table() + "\n")
