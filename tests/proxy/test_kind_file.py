"""Kinds of robots from files of other people."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.protocol.frame import encode
from robotree.protocol.messages import Heartbeat, make
from robotree.protocol.parser import Parser
from robotree.proxy import kinds
from robotree.proxy.errors import NoKind, SeveralKinds, UnknownKind
from robotree.proxy.session import Session
from robotree.vr.errors import BadName, BrokenSource, NoSuchFile, VrError

URL = "tcp:127.0.0.1:1"
DOOR = '''"""A door."""
from robotree.proxy import Motion, Request, RobotProxy, Span
from robotree.vr import command

class Swing(Motion):
    """Swing it."""

    def request(self) -> Request:
        """A verb of its own."""
        return Request(40000, ())

class Door(RobotProxy):
    """A door."""

    @command
    def swing(self) -> None:
        """Swing it."""
        self.carry_out(Swing())
'''


@pytest.fixture
def write(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_file_with_one_class_is_a_kind(write: Path) -> None:
    (write / "door.py").write_text(DOOR)
    for kind in ("door.py", "./door.py", "door.py:Door", str(write / "door.py")):
        robot = kinds.make(kind, "door-1", URL)
        assert robot.kinds() == ("Door", "RobotProxy", "Robot")
        assert (robot.name, robot.attributes) == ("door-1", {"controller": URL})


def test_of_several_kinds_in_a_file_one_is_named(write: Path) -> None:
    (write / "doors.py").write_text(f'{DOOR}\n\nclass Gate(Door):\n    """A large door."""\n')
    assert kinds.make("doors.py:Gate", "gate", URL).kinds()[:2] == ("Gate", "Door")
    with pytest.raises(
        SeveralKinds, match=r"doors\.py defines several kinds of robots \(Door, Gate\); say which: doors\.py:"
    ):
        kinds.make("doors.py", "gate", URL)


@pytest.mark.parametrize(
    ("kind", "text", "error", "sentence"),
    [
        ("none.py", None, NoSuchFile, "cannot read none.py: No such file or directory"),
        ("x.py", "1 +", BrokenSource, r"x\.py cannot be loaded: line 1: "),
        ("x.py", "\n1 / 0", BrokenSource, r"x\.py cannot be loaded: line 2: ZeroDivisionError"),
        ("x.py", "import nothing_of_this_name", BrokenSource, "line 1: ModuleNotFoundError"),
        (
            "x.py",
            "from robotree.proxy import RobotProxy",
            NoKind,
            r"x\.py defines no kind of robot; it needs",
        ),
        ("x.py:Wall", DOOR, NoKind, r"x\.py defines no kind of robot named 'Wall'; it needs a class that"),
        ("x.py", DOOR.replace("self)", "self, how)"), BrokenSource, "parameter 'how'"),
        (
            "x.py",
            f"{DOOR}\n    def __init__(self, name, url):\n        self.name = ''\n",
            BrokenSource,
            r"Door\.__init__ must call super\(\)\.__init__\(name, url, \*\*options\)",
        ),
        (
            "x.py",
            f"{DOOR}\n    def __init__(self, name, url):\n        super().__init__(name)\n",
            BrokenSource,
            "TypeError: .*missing 1 required positional argument: 'url'",
        ),
        (
            "door",
            DOOR,
            UnknownKind,
            r"'door' is no kind of robot; there is: arm, rover, or a file .* as door\.py",
        ),
    ],
)
def test_what_is_wrong_with_a_file_is_one_sentence(
    write: Path, kind: str, text: str | None, error: type[VrError], sentence: str
) -> None:
    if text is not None:
        (write / "x.py").write_text(text)
    with pytest.raises(error, match=sentence):
        kinds.make(kind, "door-1", URL)


def test_a_name_that_cannot_be_one_is_the_callers_mistake_and_not_the_files(write: Path) -> None:
    (write / "door.py").write_text(DOOR)
    with pytest.raises(BadName):
        kinds.make("door.py", "a/b", URL)


def test_a_kind_reads_messages_that_robotree_has_no_class_for(write: Path) -> None:
    early = encode(make("ALTITUDE"), sequence=0, system=1, component=1)
    assert [type(frame.message) for frame in Parser().feed(early)]  # heard before it has a class
    (write / "balloon.py").write_text(
        '''"""A balloon."""
from robotree.protocol.messages.base import Message, wire
from robotree.proxy import RobotProxy


@wire("ALTITUDE")
class Altitude(Message, frozen=True, gc=False):
    """Heights above several things."""

    time_usec: int
    altitude_monotonic: float
    altitude_amsl: float
    altitude_local: float
    altitude_relative: float
    altitude_terrain: float
    bottom_clearance: float


class Balloon(RobotProxy):
    """A balloon."""

    readers = {Altitude: lambda told: {"height": told.altitude_terrain}}
'''
    )
    kind = type(kinds.make("balloon.py", "balloon-1", URL))
    session, parser = Session(readers=kind.readers), Parser()
    for message in (Heartbeat(0, 0, 0, 0, 4), make("ALTITUDE", altitude_terrain=12.5)):
        for frame in parser.feed(encode(message, sequence=0, system=1, component=1)):
            session.hear(frame, 1.0)
    assert session.twin.readings(1.0) == {"height": 12.5, "age": 0.0}
