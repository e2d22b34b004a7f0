"""Editors and type checkers know the commands of children: right and wrong pages under pyright and mypy."""

from __future__ import annotations

import contextlib
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from robotree.tui.cli import main
from tests.vr.authoring.test_values import Painter

ROOT = Path(__file__).parents[3]
TOOLS = Path(sys.executable).parent

RIGHT = '''
from robotree.kinds import Arm, Rover
from robotree.vr import Child, Children, VirtualRobot, command


class Right(VirtualRobot):
    """Uses its children as they are."""

    arm = Child(Arm)
    rovers = Children(Rover, least=1, most=4)
    other = Child("Conveyor", optional=True)

    @command
    def go(self, x: float) -> float:
        """Go there."""
        here = self.arm.get_info()
        self.arm.go_to(x=x, y=here.y, z=here.z + 0.1, twist=0)
        self.arm.go_to(x, 0.0, 0.3, 0.0, speed=0.1)
        self.arm.go_to(x=x, y=0, z=0.3, twist=0, within="5 s")
        self.arm.go_to(x, 0, 0.3, 0, within=5)
        self.arm.grip.start(action="open", within="500 ms").result()
        soon: float = self.arm.get_info(within=0.5).z
        moving = self.arm.get_info.start()
        self.arm.grip.tell(action="open")
        height: float = moving.result().z
        for index, rover in self.rovers.items():
            rover.move(x=index * 0.1, y=0)
        first: float = self.rovers[0].get_info().vx
        if self.other:
            self.other.run(speed=1)
        with self.together() as both:
            low: float = both.start(self.arm.get_info).result().z
            both.start(self.arm.go_to, x=0.1, y=0, z=low, twist=0)
            both.start(self.arm.go_to, 0.1, 0, 0.1, 0, speed=0.1)
            both.start(self.fetch, "cup", count=2).result().upper()
            both.start(self.other.run, speed=1)
            for rover in self.rovers:
                both.start(rover.move, x=0.1, y=0).detach()
        with self.first() as race:
            race.start(self.arm.get_info)
            race.start(self.arm.get_info, within="1 s")
        return height + first + soon

    def fetch(self, what: str, count: int = 1) -> str:
        """Fetch something."""
        return what * count

    get_info = arm.exposed()
'''
WRONG = '''
from robotree.kinds import Arm, Rover
from robotree.vr import Child, Children, VirtualRobot, command


class Wrong(VirtualRobot):
    """Makes one mistake in each marked line."""

    arm = Child(Arm)
    rovers = Children(Rover)

    @command
    def go(self) -> None:
        """Go there."""
        self.arm.go_to(x="far", y=0, z=0, twist=0)  # wrong
        self.arm.go_to(x=0.1, y=0, z=0)  # wrong
        self.arm.no_such()  # wrong
        self.arm.get_info().height  # wrong
        self.arm.grip(action="ajar")  # wrong
        self.arm.go_to.start(x=0.1, y=0, z="up", twist=0)  # wrong
        self.arm.go_to.tell(a=1)  # wrong
        self.arm.go_to(x=0.1, y=0, z=0.1, twist=0, within=[5])  # wrong
        self.arm.go_to(x="far", y=0, z=0.1, twist=0, within="5 s")  # wrong
        self.arm.go_to(x=0.1, y=0, within="5 s")  # wrong
        self.arm.go_to(x=0.1, y=0, z=0.1, twist=0, whithin="5 s")  # wrong
        self.arm.go_to(0.1, 0, 0.1, 0, 0.1, "5 s")  # wrong
        number: str = self.arm.get_info(within="5 s").z  # wrong
        self.arm.get_info.start(within=None, without=2)  # wrong
        word: str = self.arm.get_info.start().result().z  # wrong
        for rover in self.rovers:
            rover.fly()  # wrong
        self.rovers[0].move(x=None, y=0)  # wrong
        with self.together() as both:
            both.start(self.arm.go_to, x="far", y=0, z=0, twist=0)  # wrong
            both.start(self.arm.go_to, x=0.1)  # wrong
            both.start(self.arm.get_info, within=b"5 s")  # wrong
            both.start(self.arm.no_such)  # wrong
            both.start(self.fetch, 3)  # wrong
            word = both.start(self.arm.get_info).result().z  # wrong
            both.start(self.arm.go_to(x=0.1, y=0, z=0.1, twist=0))  # wrong
        with self.first() as race:
            race.start(self.rovers[0].move, x=None, y=0)  # wrong
        print(word, number)

    def fetch(self, what: str) -> str:
        """Fetch something."""
        return what


class NoKind(VirtualRobot):
    """Gives a class that is no interface."""

    arm = Child(int)  # wrong
'''
OWN = '''
from painter_kind import Painter
from robotree.vr import Child, VirtualRobot, command


class Studio(VirtualRobot):
    """Uses the interface that was written from a living robot."""

    painter = Child(Painter)

    @command
    def paint(self) -> int:
        """Paint."""
        self.painter.stroke(heights=[0.1], hand="up")  # wrong
        seen = self.painter.look(within="1 s")
        self.painter.look(within=None, where=1)  # wrong
        nearest: float = seen.nearest  # wrong
        print(nearest, seen.cups[0].at.x + 1)
        return self.painter.follow(points=[])
'''


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of an author's own, with pages."""
    from robotree.vr.author.command import commands_of
    from robotree.vr.author.stubs import interface
    from robotree.vr.base.address import Address
    from robotree.vr.base.description import RobotDescription

    made = tmp_path_factory.mktemp("pages")
    specs = tuple(one.spec for one in commands_of(Painter).values())
    painter = RobotDescription(address=Address("robot", "p", "1"), kinds=Painter.kinds(), commands=specs)
    (made / "painter_kind.py").write_text(interface(painter, origin="Written by a test."))
    with contextlib.chdir(made):
        assert main(["new", "mine", "--over", "arm"]) == 0
    for name, text in (("right", RIGHT), ("wrong", WRONG), ("own", OWN)):
        (made / f"{name}.py").write_text(text)
    return made


def marked(folder: Path) -> set[tuple[str, int]]:
    return {
        (path.name, number)
        for path in folder.glob("*.py")
        for number, line in enumerate(path.read_text().splitlines(), 1)
        if line.endswith("# wrong")
    }


@pytest.fixture(scope="module", autouse=True)
def checkers(folder: Path) -> Iterator[dict[str, subprocess.Popen[str]]]:
    """Both at work, beside each other."""
    venv = {"venvPath": str(TOOLS.parents[1]), "venv": TOOLS.parent.name}
    settings = {"extraPaths": [str(ROOT / "typings")], "typeCheckingMode": "standard", **venv}
    (folder / "pyrightconfig.json").write_text(json.dumps(settings | {"reportUnusedExpression": False}))
    options = ["--strict", "--follow-imports=silent", f"--cache-dir={ROOT / '.mypy_cache'}"]
    commands = {
        "pyright": ["--outputjson"],
        "mypy": [*options, "--no-error-summary", "--no-color-output", "."],
    }
    pipe = subprocess.PIPE
    started = {
        name: subprocess.Popen([str(TOOLS / name), *more], cwd=folder, stdout=pipe, stderr=pipe, text=True)
        for name, more in commands.items()
    }
    yield started
    for one in started.values():
        one.kill()
        one.communicate()


def test_pyright_flags_the_wrong_lines_and_no_others(
    folder: Path, checkers: dict[str, subprocess.Popen[str]]
) -> None:
    found = json.loads(checkers["pyright"].communicate()[0])["generalDiagnostics"]
    places = {(Path(one["file"]).name, one["range"]["start"]["line"] + 1) for one in found}
    assert places == marked(folder), found


def test_mypy_flags_the_wrong_lines_and_no_others(
    folder: Path, checkers: dict[str, subprocess.Popen[str]]
) -> None:
    said = checkers["mypy"].communicate()
    found = re.finditer(r"^(\w+\.py):(\d+): error", said[0], re.MULTILINE)
    assert {(one[1], int(one[2])) for one in found} == marked(folder), said
