"""The pytest plug-in, in a run of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

TESTS = """
from robotree.proxy.arm import Arm
from robotree.testing import Fake, rehearse, rehearse_seeds
from robotree.vr import Child, VirtualRobot, command

class Nod(VirtualRobot):
    arm = Child("Arm")

    @command
    def nod(self) -> None:
        self.arm.grip(action="open")
        self.arm.go_to(x=0.3, y=0.0, z=0.2, twist=0.0)

def test_that_passes() -> None:
    team = rehearse(Nod, arm=Fake(Arm))
    team.call("nod")
    assert team.commanded.names == ["arm.grip", "arm.go_to"]

def test_that_fails() -> None:
    team = rehearse(Nod, arm=Fake(Arm))
    team.call("nod")
    assert team.commanded == [
        ("arm", "grip", {"action": "open"}),
        ("arm", "go_to", {"x": 0.3, "y": 0, "z": 0.25, "twist": 0}),
    ]

def test_that_nothing_is_left_open() -> None:
    from robotree.testing.team import unended
    assert unended() == []

def test_under_seeds() -> None:
    rehearse_seeds(Nod, "nod", arm=Fake(Arm), seeds=5, check=lambda team: print("seed", team.world.seed))
"""


def run(folder: Path, *options: str) -> str:
    (folder / "test_nod.py").write_text(TESTS)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *options, str(folder)],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
    )
    return done.stdout + done.stderr


def test_a_failing_test_shows_the_difference_and_the_story(tmp_path: Path) -> None:
    output = run(tmp_path)
    assert "3 passed" in output
    assert "1 failed" in output
    assert "= arm.grip(action='open')" in output
    assert "- arm.go_to(x=0.3, y=0, z=0.25, twist=0)" in output
    assert "+ arm.go_to(x=0.3, y=0, z=0.2, twist=0)" in output
    assert "rehearsal 1: what was commanded" in output
    assert "1.124 s  arm.go_to(x=0.3, y=0, z=0.2, twist=0)" in output


def test_the_command_line_chooses_the_seed(tmp_path: Path) -> None:
    output = run(tmp_path, "-s", "-k", "seeds", "--robotree-seed", "4321")
    assert "seed 4321" in output
    assert "seed 1\n" not in output


def test_a_type_checker_reads_the_kit() -> None:
    import robotree.testing

    assert Path(robotree.testing.__file__).with_name("py.typed").exists()
