"""Kinds of robots from files of other people."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.protocol.errors import UnknownMessage
from robotree.protocol.frame import encode
from robotree.protocol.messages import AnyMessage, Heartbeat, make
from robotree.protocol.parser import Parser
from robotree.protocol.testing import forgetting_messages
from robotree.proxy import kinds
from robotree.proxy.errors import NoKind, SeveralKinds, UnknownKind
from robotree.proxy.robot_proxy import RobotProxy
from robotree.proxy.session import ControllerSession
from robotree.vr.base.errors import BadName, BrokenSource, NoSuchFile, VrError

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
        assert (robot.name, robot.attributes) == ("door-1", {"controller": URL, "link": "open"})


def test_of_several_kinds_in_a_file_one_is_named(write: Path) -> None:
    (write / "doors.py").write_text(f'{DOOR}\n\nclass Gate(Door):\n    """A large door."""\n')
    assert kinds.make("doors.py:Gate", "gate", URL).kinds()[:2] == ("Gate", "Door")
    with pytest.raises(
        SeveralKinds, match=r"doors\.py defines several kinds of robots \(Door, Gate\); name one: doors\.py:"
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
            rf"'door' is no kind of robot; there is: {', '.join(kinds.KINDS)}, or a file .* as door\.py",
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


CRANE = '''"""A crane."""
from robotree.protocol.messages import Message, wire
from robotree.proxy import RobotProxy


@wire("CRANE_STATE", xml="crane.xml")
class CraneState(Message, frozen=True, gc=False):
    """How the crane is."""

    height: float
    magnet: int


class Crane(RobotProxy):
    """A crane."""

    readers = {CraneState: lambda told: {"height": told.height}}
    reading_units = {"height": "m"}
'''
CRANE_XML = """<mavlink><include>robotree.xml</include><messages>
    <message id="10000000" name="CRANE_STATE"><description>How it is.</description>
        <field type="float" name="height" units="m">Of the hook.</field>
        <field type="uint8_t" name="magnet">Whether it is on.</field></message>
</messages></mavlink>"""


def readings(robot: RobotProxy, message: AnyMessage) -> dict[str, float]:
    """What the kind of a robot reads in what a controller says."""
    session, parser = ControllerSession(readers=robot.readers), Parser()
    for each in (Heartbeat(0, 0, 0, 0, 4), message):
        for frame in parser.feed(encode(each, sequence=0, system=1, component=1)):
            session.receive(frame, 1.0)
    return session.twin.readings(1.0)


def test_a_kind_reads_messages_of_its_own_xml_which_lies_beside_its_file(write: Path) -> None:
    (write / "cranes").mkdir()
    (write / "cranes" / "crane.py").write_text(CRANE)
    (write / "cranes" / "crane.xml").write_text(CRANE_XML)
    robots = [kinds.make("cranes/crane.py", name, URL) for name in ("crane-1", "crane-2")]
    told = make("CRANE_STATE", height=1.5)
    assert [readings(robot, told) for robot in robots] == [{"height": 1.5, "age": 0.0}] * 2


@pytest.mark.parametrize(
    ("kind", "xml", "sentence"),
    [
        (
            CRANE.replace(', xml="crane.xml"', ""),
            CRANE_XML,
            "no message 'CRANE_STATE'; name the XML that has it: @wire\\(\"CRANE_STATE\", xml=",
        ),
        (CRANE, CRANE_XML.replace("CRANE_", "CROWN_"), "no message 'CRANE_STATE'; add it to crane.xml"),
        (CRANE, None, "crane.xml does not compile; correct the XML: there is no such file"),
        (CRANE, CRANE_XML.replace("float", "real"), "CRANE_STATE.height has the type 'real'"),
        (
            CRANE,
            CRANE_XML.replace("robotree.xml", "common.xml").replace("10000000", "57600"),
            "id 57600 is not the ROBOTREE_JOINTS .*; choose another name, and an id from 10000000 on",
        ),
        (
            CRANE.replace("magnet:", "magnetic:"),
            CRANE_XML,
            "CraneState is not as CRANE_STATE is; give it these fields, in this order: height, magnet",
        ),
    ],
)
def test_what_is_wrong_with_a_message_of_ones_own_is_one_sentence(
    write: Path, kind: str, xml: str | None, sentence: str
) -> None:
    (write / "crane.py").write_text(kind)
    if xml is not None:
        (write / "crane.xml").write_text(xml)
    with pytest.raises(BrokenSource, match=rf"crane\.py cannot be loaded: line 6: .*{sentence}"):
        kinds.make("crane.py", "crane-1", URL)


def test_messages_and_classes_that_a_test_adds_are_forgotten(write: Path) -> None:
    (write / "crane.py").write_text(CRANE)
    (write / "crane.xml").write_text(CRANE_XML)
    with forgetting_messages():
        kinds.make("crane.py", "crane-1", URL)
        said = encode(make("CRANE_STATE"), sequence=0, system=1, component=1)
        assert len(Parser().feed(said)) == 1
    assert Parser().feed(said) == []
    with pytest.raises(UnknownMessage):
        make("CRANE_STATE")


def test_a_kind_reads_messages_that_robotree_has_no_class_for(write: Path) -> None:
    early = encode(make("ALTITUDE"), sequence=0, system=1, component=1)
    assert [type(frame.message) for frame in Parser().feed(early)]  # heard before it has a class
    (write / "balloon.py").write_text(
        '''"""A balloon."""
from robotree.protocol.messages import Message, wire
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
    robots = [kinds.make("balloon.py", name, URL) for name in ("balloon-1", "balloon-2")]
    told = make("ALTITUDE", altitude_terrain=12.5)
    assert [readings(robot, told) for robot in robots] == [{"height": 12.5, "age": 0.0}] * 2
