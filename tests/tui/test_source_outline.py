"""What a source offers is seen without running it."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.screen.source_outline import outline, suggested_name
from robotree.vr.address import check_name

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("[a-z]*.py")), ids=lambda path: path.name)
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
