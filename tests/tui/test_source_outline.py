"""What a source offers is seen without running it."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.screen.source_outline import outline, suggested_name
from robotree.vr.base.address import check_name

EXAMPLES = Path(__file__).parents[2] / "examples"
PAGES = sorted(path for path in EXAMPLES.glob("[a-z]*.py") if not path.name.endswith(".panel.py"))


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_every_example_offers_a_robot_with_commands_and_a_documentation(path: Path) -> None:
    (found,) = [one for one in outline(path.read_text()) if one.commands][-1:]
    assert found.doc
    assert found.slots


def test_slots_commands_and_heirs_are_found() -> None:
    source = """
import vr
boom = 1 / 0
class Base(vr.VirtualRobot):
    "A base."
    arm = vr.Child("Arm", "the arm")
    move = arm.exposed()
    @vr.command(effect="repeat")
    def close(self) -> None: ...
    def helper(self) -> None: ...
class Heir(Base): ...
class Other: ...
"""
    base, heir = outline(source)
    assert (base.name, base.doc) == ("Base", "A base.")
    assert base.slots == (("arm", "Arm"),)
    assert base.commands == ("move", "close")
    assert heir.name == "Heir"


def test_settings_are_read_without_running_the_source() -> None:
    source = """
from typing import Annotated, Literal
from robotree.vr import Range, Unit, VirtualRobot, state
Speed = Annotated[float, Unit("m/s"), Range(0.01, upper=0.3), "how quickly it goes"]
class Base(VirtualRobot):
    speed: Speed = 0.1
    hand: Literal["left", "right"] = "left"
    picked: int = state(0)
    _hidden: int = 1
    table: dict[str, int] = {}
    many: "int" = 3
    unknown: Somewhere = 4
    plain = 5
class Heir(Base):
    speed: Speed = 0.2
    label: str | None = None
"""
    base, heir = outline(source)
    assert [(setting.name, setting.type, setting.default) for setting in base.settings] == [
        ("speed", "float", 0.1),
        ("hand", "choice", "left"),
        ("many", "int", 3),
    ]
    speed = base.settings[0]
    assert (speed.unit, speed.lower, speed.upper, speed.doc) == ("m/s", 0.01, 0.3, "how quickly it goes")
    assert [(setting.name, setting.default) for setting in heir.settings] == [
        ("speed", 0.2),
        ("hand", "left"),
        ("many", 3),
        ("label", None),
    ]


def test_a_file_without_a_robot_offers_nothing_and_no_python_is_told() -> None:
    assert outline("x = 1") == []
    with pytest.raises(SyntaxError):
        outline("def")


@given(
    name=st.text("ABcdXyz_0", min_size=1, max_size=30).filter(
        lambda text: text.isidentifier() and text[0] != "_"
    ),
    taken=st.sets(st.sampled_from(["a", "x", "y", "z", "b", "a-2", "x-2"])),
)
def test_a_suggested_name_can_be_a_name_and_is_free(name: str, taken: set[str]) -> None:
    found = suggested_name(name, frozenset(taken))
    assert check_name(found) == found
    assert found not in taken


def test_a_suggested_name_reads_well() -> None:
    assert suggested_name("OpenCloseLever", frozenset()) == "open-close-lever"
    assert suggested_name("MoveTo", frozenset({"move-to"})) == "move-to-2"


def test_an_enum_a_tuple_and_a_constant_are_read_without_running_the_source() -> None:
    source = """
class Side(Enum):
    LEFT = "left"
    RIGHT = "right"
SLOW = 0.1
class Team(VirtualRobot):
    side: Side = Side.RIGHT
    home: Annotated[tuple[float, float], Unit("m")] = (0.3, 0.1)
    names: tuple[str, ...] = ()
    speed: float = SLOW
"""
    (team,) = outline(source)
    assert [(setting.name, setting.type, setting.default, setting.choices) for setting in team.settings] == [
        ("side", "choice", "right", ("left", "right")),
        ("home", "tuple", [0.3, 0.1], ()),
        ("names", "list", [], ()),
        ("speed", "float", 0.1, ()),
    ]
