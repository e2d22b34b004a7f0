"""Pages of Python become robots: what is loaded, what is refused, and what is left behind."""

from __future__ import annotations

import ast
import gc
import linecache
import os
import sys
import threading
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_type_hints

import pytest

from robotree.vr.author.command import commands_of
from robotree.vr.base.errors import BadName, BrokenSource, BundleError, VrError
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.syntax import parse, parse_expression
from robotree.vr.running.page_trace import authors_file

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


def test_two_versions_live_side_by_side() -> None:
    first, second = bundle(SQUARE).load(), bundle(SQUARE + "\n# new").load()
    assert first is not second
    assert first.__module__ != second.__module__
    assert first.__module__ in sys.modules


def test_two_robots_of_one_page_share_nothing_that_they_keep_in_their_class() -> None:
    page = bundle(HEAD + "class V(VirtualRobot):\n    taught = []\n")
    one, other = page.create("one"), page.create("other")
    one.taught.append("a pose")  # type: ignore[attr-defined]
    assert other.taught == []  # type: ignore[attr-defined]
    assert type(one).kinds() == type(other).kinds()


FAILS = HEAD + "class V(VirtualRobot):\n    def fail(self):\n        1 / 0  # {}\n"


def test_a_traceback_shows_the_authors_own_file_and_the_version_that_runs() -> None:
    pages = [(FAILS.format("old"), "a.py"), (FAILS.format("new"), "a.py"), (FAILS.format("old"), "b.py")]
    robots = [bundle(source, path=path).create("v") for source, path in pages]
    told = []
    for robot in robots:
        with pytest.raises(ZeroDivisionError) as caught:
            robot.fail()  # type: ignore[attr-defined]
        told.append(traceback.extract_tb(caught.value.__traceback__)[-1])
    assert [frame.line for frame in told] == ["1 / 0  # old", "1 / 0  # new", "1 / 0  # old"]
    assert [authors_file(frame.filename) for frame in told] == ["a.py", "a.py", "b.py"]
    assert len({frame.filename for frame in told}) == 3
    assert authors_file("/home/a@b/c.py") == "/home/a@b/c.py"


def traces() -> set[str]:
    """Return what loaded sources leave in the process."""
    gc.collect()
    return {
        name for name in (*sys.modules, *linecache.cache) if "robotree_bundle" in name or "page.py@" in name
    }


def test_robots_that_come_and_go_leave_nothing_behind() -> None:
    before = traces()
    page = bundle(SQUARE, path="page.py")
    robots = [page.create(f"v{number}") for number in range(5)]
    assert len(traces() - before) == 6, "a module each, and one text"
    survivor = robots.pop()
    robots.clear()
    assert len(traces() - before) == 2
    assert get_type_hints(type(survivor).move_square), "which still works"  # type: ignore[attr-defined]
    del survivor
    for source in ("1 / 0", HEAD, HEAD + "class V(VirtualRobot):\n    def __init__(self, name): 1 / 0"):
        with pytest.raises(BundleError):
            bundle(source, path="page.py").create("v")
    assert traces() == before


def test_a_source_that_came_by_the_network_has_a_limit_too() -> None:
    for source in ("#" * 1_000_001, "ä" * 500_001):
        with pytest.raises(BrokenSource, match=r"robot\.py cannot be loaded: it is larger than 1000 kB"):
            bundle(source).load()


def test_a_source_that_heeds_no_interruption_is_told_of(caplog: pytest.LogCaptureFixture) -> None:
    release = threading.Event()
    threading.release_the_page = release  # type: ignore[attr-defined] # how a page gets at the test's event
    with pytest.raises(BrokenSource, match="ignores every interruption and still runs; restart the host"):
        bundle("import threading\nthreading.release_the_page.wait()", path="deaf.py").load(limit=0.05)
    assert "deaf.py is abandoned" in caplog.text
    release.set()
    del threading.release_the_page  # type: ignore[attr-defined]


def test_type_hints_and_dataclasses_of_a_bundle_work() -> None:
    source = (
        "from __future__ import annotations\nfrom dataclasses import dataclass\n"
        + HEAD
        + "@dataclass\nclass Pose:\n    x: float\n"
        "class V(VirtualRobot):\n    @command\n    def where(self) -> Pose: return Pose(1)\n"
    )
    spec = commands_of(bundle(source).load())["where"].spec
    assert [field.name for field in spec.result] == ["x"]


def test_a_file_of_another_kind_is_called_none_of_ours_not_python_with_a_mistake(tmp_path: Path) -> None:
    (tmp_path / "README.md").write_text("# Cell 007\n\nStart it with 007.\n")
    with pytest.raises(
        BrokenSource, match=r"README\.md cannot be loaded: it is no Python page, script or bundle"
    ):
        Bundle.read(tmp_path / "README.md")


@pytest.mark.parametrize(
    ("source", "wanted", "sentence"),
    [
        ("x = 1", "", "robot.py defines no virtual robot; it needs a class that derives from VirtualRobot"),
        (HEAD, "", "robot.py defines no virtual robot; it needs a class"),
        (SQUARE, "Lever", "robot.py defines no virtual robot named 'Lever'; it needs a class"),
        (
            HEAD + "class A(VirtualRobot): ...\nclass B(VirtualRobot): ...",
            "",
            "robot.py defines several virtual robots (A, B); name one: robot.py:CLASS",
        ),
        ("def f(:", "", "robot.py cannot be loaded: line 1: invalid syntax (this host runs Python 3."),
        ("x = 1\0", "", "robot.py cannot be loaded: source code string cannot contain null bytes"),
        ("\n1/0", "", "robot.py cannot be loaded: line 2: ZeroDivisionError: division by zero"),
        (
            "import no_such_module",
            "",
            "robot.py cannot be loaded: line 1: ModuleNotFoundError: No module named",
        ),
        ("raise SystemExit(3)", "", "robot.py cannot be loaded: line 1: SystemExit: 3"),
        (
            "from robotree.vr.base.errors import Busy\nraise Busy(robot='x', waiting=1, how='wait')",
            "",
            "robot.py cannot be loaded: line 2: Busy: x takes no more commands: 1 wait already",
        ),
        (
            HEAD + "class V(VirtualRobot):\n    @command\n    def go(self, x): ...",
            "",
            "robot.py cannot be loaded: line 4: V.go: parameter 'x' needs a type",
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


@pytest.mark.timeout(60)
def test_a_file_that_cannot_be_read_says_why_at_once(tmp_path: Path) -> None:
    """A FIFO and /dev/zero are refused at once, before anything is read from them."""
    os.mkfifo(tmp_path / "fifo.py")
    (tmp_path / "zero.py").symlink_to("/dev/zero")
    (tmp_path / "picture.py").write_bytes(b"\xff\xd8\xff")
    (tmp_path / "large.py").write_bytes(b"#" * 1_000_001)
    for name, reason in {
        "missing.py": "No such file or directory",
        "": "it is a folder, not a file",
        "fifo.py": "it is a FIFO, not a file",
        "zero.py": "it is a device, not a file",
        "picture.py": "it is not UTF-8 text",
        "large.py": "it is larger than 1000 kB",
        "nul\0.py": "its name contains a zero byte",
    }.items():
        with pytest.raises(VrError, match=f"cannot read .*{reason}"):
            Bundle.read(f"{tmp_path}/{name}")


def test_a_bad_name_is_the_callers_fault_not_the_sources() -> None:
    with pytest.raises(BadName):
        bundle(SQUARE).create("no/slash")


# -- a page is read into a tree whatever else its process does meanwhile ---------------------------


PAGE = "".join(f"def f{n}(a, b=({n}, [1, {{2: 3}}])):\n    return a.b[{n}](*a, **b)\n" for n in range(50))


@pytest.fixture
def collected() -> Iterator[list[ast.Module]]:
    """Collect garbage again and again, and make a tree each time, as a finalizer of another thread may do."""
    made: list[ast.Module] = []

    def meanwhile(phase: str, info: dict[str, Any]) -> None:
        del phase, info
        made.append(ast.parse("x = 1"))

    usual = gc.get_threshold()
    gc.callbacks.append(meanwhile)
    gc.set_threshold(5)
    yield made
    gc.set_threshold(*usual)
    gc.callbacks.remove(meanwhile)


def test_garbage_that_is_collected_meanwhile_breaks_no_page(collected: list[ast.Module]) -> None:
    """In CPython 3.11.7 `ast.parse` ends with a SystemError here."""
    assert len(parse(PAGE).body) == 50
    assert isinstance(parse_expression("a + 1"), ast.BinOp)
    gc.collect()
    assert collected, "garbage is collected again"


def test_garbage_is_collected_again_after_a_mistake() -> None:
    with pytest.raises(SyntaxError):
        parse("def")
    assert gc.isenabled()
    with pytest.raises(SyntaxError):
        parse_expression("1 +")
    assert gc.isenabled()
