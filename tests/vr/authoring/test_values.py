"""What a thesis student hands over: numpy, lists of points, own choices, records in records, a picture."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum, StrEnum, auto
from pathlib import Path
from typing import Annotated, Any, NotRequired, TypedDict

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.tui.line.carrying import Silent
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import call
from robotree.tui.screen import entry
from robotree.tui.seen import wording
from robotree.tui.session.conditions import Scene, condition
from robotree.vr import BadArgument, Child, Range, Robot, Unit, VirtualRobot, command
from robotree.vr.author.command import commands_of
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.errors import CommandFailed
from robotree.vr.base.literal import read_list, read_record, write
from robotree.vr.base.plain import LARGEST_BYTES, to_plain
from tests.vr.core.conftest import Realm, refusal

Metres = Annotated[float, Unit("m"), Range(0, 0.8)]
JPEG = b"\xff\xd8\xff\xe0" + bytes(996)


@dataclass
class Point:
    x: Metres
    y: Metres = 0.0


class Hand(StrEnum):
    OPEN = auto()
    CLOSED = auto()


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


class Cup(TypedDict):
    at: Point
    colour: Colour
    label: NotRequired[str]


@dataclass
class Seen:
    cups: list[Cup]
    centre: tuple[Metres, Metres]
    nearest: Metres | None
    image: bytes = b""


class Painter(Robot):
    """Takes and gives every kind of value."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.took: Any = None
        self.gives: Any = None

    @command
    def follow(
        self, points: list[Point], speed: Annotated[float | None, Unit("m/s"), Range(0, 1)] = None
    ) -> int:
        self.took = (points, speed)
        return len(points)

    @command
    def stroke(
        self,
        heights: Annotated[list[float], Unit("m"), Range(0, 0.8)],
        start: tuple[Metres, Metres] = (0.0, 0.0),
        hand: Hand = Hand.OPEN,
    ) -> None:
        self.took = (heights, start, hand)

    @command
    def sort(self, cups: list[Cup], by: list[Colour]) -> None:
        self.took = (cups, by)

    @command(effect="read")
    def look(self) -> Seen:
        return self.gives  # type: ignore[no-any-return]

    @command(effect="read")
    def heights(self) -> list[float]:
        return self.gives  # type: ignore[no-any-return]

    @command
    def pose(
        self,
        joints: Annotated[dict[str, float], Unit("rad"), Range(-3, 3)],
        at: dict[str, Point] | None = None,
    ) -> Annotated[dict[str, float], Unit("rad")]:
        self.took = (joints, at)
        return joints

    @command(effect="read")
    def snap(self) -> bytes:
        return self.gives  # type: ignore[no-any-return]


class Student(VirtualRobot):
    """Has only numpy in mind."""

    painter = Child("Painter")
    said: Any = None

    @command
    def paint(self) -> list[float]:
        way = np.linspace(0.0, 0.5, 3)
        self.painter.stroke(heights=way, start=(np.float32(0.5), np.int64(0)), hand=Hand.CLOSED)
        turned = self.painter.pose(joints={"a": np.float64(0.5), "b-1": np.int8(1)})
        assert turned.a == turned["a"] == 0.5
        self.painter.follow([Point(float(x)) for x in way], speed=np.float64(0.25))
        seen = self.painter.look()
        self.said = (seen.cups[0].at.x, seen.centre, seen.nearest)
        return way * 2  # type: ignore[return-value]

    @command
    def clumsy(self) -> None:
        self.painter.follow(points=[object()])

    look = painter.exposed()


SPECS = {name: one.spec for name, one in commands_of(Painter).items()}


def read(name: str, **arguments: Any) -> dict[str, Any]:
    return check_arguments(SPECS[name], arguments)


async def test_numpy_goes_to_a_child_and_back(realm: Realm) -> None:
    painter, student = await realm.start(Painter("painter")), await realm.start(Student("student"))
    await realm.client(student).enslave("painter", painter.address)
    painter.robot.gives = Seen(  # type: ignore[attr-defined]
        cups=[{"at": Point(0.25), "colour": Colour.RED}], centre=(0.0, 0.5), nearest=None
    )
    assert await realm.client(student).call("paint", {}) == [0.0, 0.5, 1.0]
    assert student.robot.said == (0.25, [0.0, 0.5], None), "parts of parts are read by name"  # type: ignore[attr-defined]
    points, speed = painter.robot.took  # type: ignore[attr-defined]
    assert points == [Point(0.0), Point(0.25), Point(0.5)]
    assert (speed, type(speed)) == (0.25, float)
    error = await refusal(realm.client(student).call("clumsy", {}))
    assert "painter.follow: points: cannot travel: object is neither number" in str(error)


async def test_a_dictionary_is_an_argument_and_a_result(realm: Realm) -> None:
    painter = await realm.start(Painter("painter"))
    client = realm.client(painter)
    assert await client.call("pose", {"joints": "{left-1: 90 deg, right: 0.5}"}) == {
        "left-1": pytest.approx(math.pi / 2),
        "right": 0.5,
    }
    at = {"cup": {"x": "10 cm"}}
    await client.call("pose", {"joints": {"a": 1.0}, "at": to_plain(at)})
    assert painter.robot.took == ({"a": 1.0}, {"cup": Point(0.1)})  # type: ignore[attr-defined]


def test_a_dictionary_is_written_with_its_units_and_read_back() -> None:
    pose = SPECS["pose"]
    assert wording.signature(pose) == "pose(joints: {name: rad, …}, at: {name: {x: m, y: m}, …}? = -)"
    assert wording.result(pose.result, {"a": math.pi / 2, "b": 0.0}) == [("a", "90 °"), ("b", "0 °")]
    assert entry.read(pose, {"joints": "a: 90, b=1 rad"}).arguments == {
        "joints": {"a": pytest.approx(math.pi / 2), "b": pytest.approx(1.0)}
    }
    odd = {"": 1, "a b": 2, 'say "c"': 3, "back\\slash": 4}
    assert read_record(write(odd)) == {name: str(value) for name, value in odd.items()}


async def test_an_author_gets_the_classes_that_the_page_names(realm: Realm) -> None:
    painter = await realm.start(Painter("painter"))
    client = realm.client(painter)
    await client.call("stroke", {"heights": "10cm, 0.2", "start": "(5 cm, 0)", "hand": "closed"})
    assert painter.robot.took == ([0.1, 0.2], (0.05, 0.0), Hand.CLOSED)  # type: ignore[attr-defined]
    await client.call("sort", {"cups": "[{at: {x: 0.1}, colour: red}]", "by": "blue, red"})
    assert painter.robot.took == (  # type: ignore[attr-defined]
        [{"at": Point(0.1), "colour": Colour.RED}],
        [Colour.BLUE, Colour.RED],
    )


async def test_a_result_that_is_none_of_those_promised_is_refused_with_its_place(realm: Realm) -> None:
    painter = await realm.start(Painter("painter"))
    painter.robot.gives = [0.1, "far"]  # type: ignore[attr-defined]
    error = await refusal(realm.client(painter).call("heights", {}))
    assert isinstance(error, CommandFailed)
    assert (
        "it promises list[float] but returned [0.1, 'far']: Expected `float`, got `str` - at `$[1]` "
        "(test_values.py, line " in str(error)
    )


async def test_a_picture_is_saved_from_the_command_line(realm: Realm, tmp_path: Path) -> None:
    painter = await realm.start(Painter("painter"))
    painter.robot.gives = JPEG  # type: ignore[attr-defined]
    realm_client: Any = realm.client(painter)

    class One:
        """A realm client of one robot."""

        async def call(self, _name: str, command: str, given: Any, **_: Any) -> Any:
            return await realm_client.call(command, given)

    line = Line(
        "call", {"ROBOT.COMMAND": "painter.snap", "--within": "5s", "--save": str(tmp_path / "a.jpg")}
    )
    said = await call(One(), line, Silent())  # type: ignore[arg-type]
    assert (tmp_path / "a.jpg").read_bytes() == JPEG
    assert said.text.endswith("a.jpg  JPEG, 1.0 kB")
    painter.robot.gives = bytes(LARGEST_BYTES + 1)  # type: ignore[attr-defined]
    error = await refusal(realm.client(painter).call("snap", {}))
    assert "256001 bytes are more than 256000; make the picture smaller" in str(error)


@pytest.mark.parametrize(
    ("command_", "given_", "sentence"),
    [
        (
            "follow",
            {"points": [{"x": 0.1}, {"x": 0.1}, {"x": 0.1}, {"x": 12}]},
            "follow: points[3].x: 12 m is out of range; give a number in m from 0 to 0.8",
        ),
        ("follow", {"points": "[{x: 12 m}]"}, "follow: points[0].x: 12 m is out of range; give"),
        (
            "follow",
            {"points": "[{y: 0}]"},
            "follow: points[0].x: is missing; give a number in m from 0 to 0.8",
        ),
        ("follow", {"points": "[{x: 0, z: 1}]"}, "follow: points[0].z: there is no such part; it has x, y"),
        (
            "follow",
            {"points": "[{x: 3 kg}]"},
            "follow: points[0].x: kg cannot be turned into m; give it in m",
        ),
        (
            "follow",
            {"points": 3},
            "follow: points: 3 is not a list [value, value …], each value {x: a number",
        ),
        (
            "follow",
            {"points": "[{x: 1"},
            "follow: points: '[{x: 1' cannot be read: a comma or '}' is missing before its",
        ),
        (
            "follow",
            {"points": "[{x 1}]"},
            "follow: points: '[{x 1}]' cannot be read: `name: value` is missing before",
        ),
        ("follow", {"points": "[] x"}, "follow: points: '[] x' cannot be read from 'x' on"),
        ("follow", {"points": "[,]"}, "follow: points: '[,]' cannot be read: a value is missing before ',]'"),
        ("stroke", {"heights": [0.1, 0.9]}, "stroke: heights[1]: 0.9 m is out of range"),
        (
            "stroke",
            {"heights": [], "start": [1]},
            "stroke: start: [1] has 1 values; give 2 values: (a number in m",
        ),
        ("stroke", {"heights": [], "hand": "up"}, "stroke: hand: 'up' is not one of open, closed"),
        ("pose", {"joints": {"a": 1, "b": 4}}, "pose: joints.b: 4 rad is out of range; give a number in rad"),
        (
            "pose",
            {"joints": {1: 1}},
            "pose: joints: the key 1 is no text; give values by name {name: value, …}",
        ),
        (
            "pose",
            {"joints": [1]},
            "pose: joints: [1] is not values by name {name: value, …}, each value a number",
        ),
        ("sort", {"cups": [], "by": ["red", "green"]}, "sort: by[1]: 'green' is not one of red, blue"),
    ],
)
def test_an_error_names_the_element(command_: str, given_: dict[str, Any], sentence: str) -> None:
    with pytest.raises(BadArgument) as refused:
        read(command_, **given_)
    assert str(refused.value).startswith(sentence)


def test_one_grammar_reads_lists_and_records_on_every_surface() -> None:
    meant = {"points": [{"x": 0.1, "y": 0.05}, {"x": 0.2}]}
    for text in (
        "[{x: 10 cm, y: 5cm}, {x: 0.2}]",
        "{x: 0.1, y: 0.05}, {x: 0.2}",
        '[{"x": 0.1, "y": 0.05},{"x": 0.2}]',
    ):
        assert read("follow", points=text) == meant
        assert entry.read(SPECS["follow"], {"points": text}).arguments == meant
    assert read("follow", points="", speed="none") == {"points": [], "speed": None}
    assert entry.complaint(SPECS["follow"].parameters[0], "[{x: 2}]").startswith("[0].x: 2 is out of range")


def test_forms_and_help_show_how_a_value_is_written() -> None:
    assert wording.signature(SPECS["follow"]) == "follow(points: [{x: m, y: m}, …], speed: m/s? = -)"
    stroke = SPECS["stroke"]
    assert (
        wording.signature(stroke) == "stroke(heights: [m, …], start: (m, m) = 0, 0, hand: open|closed = open)"
    )
    assert [entry.first_text(parameter, {}) for parameter in stroke.parameters] == ["", "[0.0, 0.0]", "open"]
    assert entry.hints(stroke.parameters[1], {}) == ["(m, m)", "default 0, 0"]


def test_results_are_written_with_their_units() -> None:
    seen = Seen(cups=[{"at": Point(0.25), "colour": Colour.RED}], centre=(0.1, 0.2), nearest=None, image=JPEG)
    plain = to_plain(seen)
    assert wording.result(SPECS["look"].result, plain) == [
        ("cups[0]", "at x 0.25 m, y 0 m, colour red"),
        ("centre", "0.1 m, 0.2 m"),
        ("nearest", "-"),
        ("image", "JPEG, 1.0 kB"),
    ]
    assert wording.result(SPECS["heights"].result, [0.1, 0.2]) == [("", "0.1, 0.2")]
    assert condition("result.cups[0].at.x = 0.25").judge(Scene(result=plain)).holds
    assert not condition("result.cups[1].at.x = 0.25").judge(Scene(result=plain)).holds


def test_what_numpy_and_classes_hand_over_becomes_plain() -> None:
    @dataclass
    class Mine:
        grid: Any
        when: float = field(default=1.5)

    class Theirs(msgspec.Struct):
        n: Any

    grid = np.array([[1, 2], [3, 4]], dtype=np.int16)
    assert to_plain(Mine(grid)) == {"grid": [[1, 2], [3, 4]], "when": 1.5}
    assert to_plain(Theirs(np.bool_(True))) == {"n": True}  # a value
    assert to_plain((np.str_("a"), np.float32(0.5), np.array(3))) == ["a", 0.5, 3]
    assert math.isnan(to_plain(np.float64("nan")))
    for odd in (object(), {1: 2}, 2**70, lambda: 1, np.array([1j])):
        with pytest.raises(TypeError, match="cannot travel"):
            to_plain(odd)
    endless: list[Any] = []
    endless.append(endless)
    with pytest.raises(TypeError, match="more than 32 levels"):
        to_plain(endless)


PLAIN = st.recursive(
    st.one_of(st.integers(-(10**6), 10**6), st.floats(allow_nan=False, allow_infinity=False), st.text()),
    lambda inner: st.one_of(st.lists(inner), st.dictionaries(st.text(max_size=9), inner)),
    max_leaves=12,
)


def spelled(value: Any) -> Any:
    """Return what the reader gives for a value: its single values are texts."""
    if isinstance(value, dict):
        return {name: spelled(part) for name, part in value.items()}
    if isinstance(value, list):
        return [spelled(part) for part in value]
    return value if isinstance(value, str) else write(value)


@settings(max_examples=40)
@given(value=PLAIN)
def test_what_is_written_is_read_back(value: Any) -> None:
    assert read_list(write([value])) == [spelled(value)]
    assert read_record(write({"a": value})) == {"a": spelled(value)}


@given(text=st.text(alphabet="[](){},:='\" ax1\\", max_size=30))
def test_no_text_breaks_the_reader(text: str) -> None:
    for reader in (read_list, read_record):
        said = ""
        try:
            reader(text)
        except ValueError as error:
            said = str(error)
        assert not said or "cannot be read" in said or "twice" in said or "levels" in said


def test_an_unknown_unit_names_the_nearest() -> None:
    for wrong, near in (("metrs", "'m'"), ("Nm", "'N*m'"), ("degres", "'deg'"), ("secnds", "'s'")):
        with pytest.raises(ValueError, match=f"the unit '{wrong}' is not known; the nearest is ") as refused:
            Unit(wrong)
        assert str(refused.value).endswith(near)
    assert Unit("kg*m/s**2").symbol == "kg*m/s**2"
    with pytest.raises(ValueError, match="'heigth' is not known; write for example"):
        type("Odd", (VirtualRobot,), {"reading_units": {"height": "heigth"}})
