from __future__ import annotations

import sys
import threading
from pathlib import Path

import pytest

from robotree.vr.bundle import Bundle
from robotree.vr.command import commands_of
from robotree.vr.errors import BadName, BundleError, VrError

SQUARE = '''
"""Move in a square."""
from typing import Annotated
from robotree.vr import Child, Unit, VirtualRobot, command

Inches = Annotated[float, Unit("in")]

class MoveSquare(VirtualRobot):
    """A rover that can also drive in squares."""

    rover = Child("Rover")

    @command
    def move_square(self, length: Inches) -> None:
        """Drive one square."""
        for x, y in ((length, 0), (0, length), (-length, 0), (0, -length)):
            self.rover.move(x=x, y=y)

    move = rover.exposed("move")
'''
HEAD = "from robotree.vr import VirtualRobot, command\n"


def bundle(source: str, wanted: str = "", path: str = "robot.py") -> Bundle:
    return Bundle(source, path, wanted)


def test_a_page_of_python_becomes_a_robot(tmp_path: Path) -> None:
    file = tmp_path / "move_square.py"
    file.write_text(SQUARE)
    robot = Bundle.read(file).create("square-1")
    assert robot.name == "square-1"
    assert type(robot).kinds() == ("MoveSquare", "VirtualRobot", "Robot")
    assert list(commands_of(type(robot))) == ["move_square"]
    assert not robot.rover  # type: ignore[attr-defined]


def test_one_version_is_loaded_once_and_two_live_side_by_side() -> None:
    first, again, second = bundle(SQUARE).load(), bundle(SQUARE).load(), bundle(SQUARE + "\n# new").load()
    assert first is again
    assert first is not second
    assert first.__module__ != second.__module__
    assert first.__module__ in sys.modules


def test_type_hints_and_dataclasses_of_a_bundle_work() -> None:
    source = (
        "from __future__ import annotations\nfrom dataclasses import dataclass\n"
        + HEAD
        + "@dataclass\nclass Pose:\n    x: float\n"
        "class V(VirtualRobot):\n    @command\n    def where(self) -> Pose: return Pose(1)\n"
    )
    spec = commands_of(bundle(source).load())["where"].spec
    assert [field.name for field in spec.result] == ["x"]


@pytest.mark.parametrize(
    ("source", "wanted", "sentence"),
    [
        ("x = 1", "", "robot.py defines no virtual robot; it needs a class that derives from VirtualRobot"),
        (HEAD, "", "robot.py defines no virtual robot; it needs a class"),
        (SQUARE, "Lever", "robot.py defines no virtual robot named 'Lever'; it needs a class"),
        (
            HEAD + "class A(VirtualRobot): ...\nclass B(VirtualRobot): ...",
            "",
            "robot.py defines several virtual robots (A, B); say which: robot.py:CLASS",
        ),
        ("def f(:", "", "robot.py cannot be loaded: line 1: invalid syntax"),
        ("x = 1\0", "", "robot.py cannot be loaded: source code string cannot contain null bytes"),
        ("\n1/0", "", "robot.py cannot be loaded: line 2: ZeroDivisionError: division by zero"),
        (
            "import no_such_module",
            "",
            "robot.py cannot be loaded: line 1: ModuleNotFoundError: No module named",
        ),
        ("raise SystemExit(3)", "", "robot.py cannot be loaded: line 1: SystemExit: 3"),
        (
            "from robotree.vr.errors import Busy\nraise Busy(robot='x', waiting=1)",
            "",
            "robot.py cannot be loaded: line 2: Busy: x already has 1 commands waiting",
        ),
        (
            HEAD + "class V(VirtualRobot):\n    @command\n    def go(self, x): ...",
            "",
            "robot.py cannot be loaded: V.go: parameter 'x' needs a type",
        ),
        (
            HEAD + "class V(VirtualRobot):\n    def __init__(self, name):\n        self.x = 1 / 0",
            "",
            "robot.py cannot be loaded: line 4: ZeroDivisionError: division by zero",
        ),
        (
            HEAD + "class V(VirtualRobot):\n    def __init__(self, name): ...",
            "",
            "robot.py cannot be loaded: V.__init__ must call super().__init__(name)",
        ),
    ],
)
def test_a_source_that_cannot_be_used_is_refused_in_one_sentence(
    source: str, wanted: str, sentence: str
) -> None:
    before = set(sys.modules)
    with pytest.raises(BundleError) as refused:
        bundle(source, wanted).create("v")
    assert str(refused.value).startswith(sentence)
    if "cannot be loaded: line" in sentence and "class" not in source:  # what did not run leaves no trace
        assert not any("robotree_bundle" in name for name in set(sys.modules) - before)


def test_one_of_several_can_be_named() -> None:
    source = HEAD + "class A(VirtualRobot): ...\nclass B(A): ..."
    assert bundle(source, "A").load().kinds()[0] == "A"
    assert bundle(source, "B").load().kinds() == ("B", "A", "VirtualRobot", "Robot")


@pytest.mark.parametrize("place", ["", "class V(VirtualRobot):\n  def __init__(self, name):\n"])
def test_a_source_that_does_not_end_is_interrupted(place: str) -> None:
    source = HEAD + place + "   while True: pass" if place else HEAD + "\nwhile True: pass"
    with pytest.raises(BundleError, match=r"line \d: it did not end within 0.1 s"):
        bundle(source).create("v", limit=0.1)
    assert "load robot.py" not in {thread.name for thread in threading.enumerate()}


def test_a_file_that_cannot_be_read_says_why(tmp_path: Path) -> None:
    (tmp_path / "picture.py").write_bytes(b"\xff\xd8\xff")
    (tmp_path / "large.py").write_bytes(b"#" * 1_000_001)
    for name, reason in {
        "missing.py": "No such file or directory",
        "": "Is a directory",
        "picture.py": "it is not UTF-8 text",
        "large.py": "it is larger than 1000 kB",
        "nul\0.py": "embedded null byte",
    }.items():
        with pytest.raises(VrError, match=f"cannot read .*{reason}"):
            Bundle.read(f"{tmp_path}/{name}")


def test_a_bad_name_is_the_callers_fault_not_the_sources() -> None:
    with pytest.raises(BadName):
        bundle(SQUARE).create("no/slash")
