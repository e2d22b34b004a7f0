"""The composer: steps are chosen by keys, changed, nested, given parameters, and made a page of one's own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import pytest
from textual.widgets import Button, Input, OptionList

from robotree.tui.screen.app import Composer
from robotree.tui.screen.pages.compose import Choosing, ComposePage
from robotree.tui.screen.pages.dialogs import Confirm
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.seen.store import Store
from robotree.vr import command
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec
from robotree.vr.network.realms import state_home
from tests.tui.conftest import Arm
from tests.tui.screens.test_teleop_page import moved

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


async def composer(operator: Operator) -> ComposePage:
    """Open the composer when both robots are known."""
    await operator.until(lambda: len(operator.app.store.descriptions) == 2, "both are described")
    await operator.until(lambda: "x" in operator.app.store.readings("arm-1"), "the arm is read")
    await operator.press("C")
    return await operator.at(ComposePage)


async def add(operator: Operator, word: str, line: str = "") -> None:
    """Add a step by keys: choose it, and write another line over the one that is offered."""
    await operator.press("a")
    choosing = await operator.at(Choosing)
    words = [choice for choice, _ in choosing._choices]
    operator.one(OptionList).highlighted = words.index(word)
    await operator.press("enter")
    await operator.at(ComposePage)
    if line:
        operator.one(Input, "#step-line").value = line
    await operator.press("enter")


def lines(page: ComposePage) -> list[str]:
    return [f"{'  ' * row.depth}{row.text}" for row in page.rows]


async def test_robotree_compose_begins_in_the_composer_over_one_main_page(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client, kind=Composer) as operator:
        await operator.at(ComposePage)
        assert [type(page) for page in operator.app.screen_stack[1:]] == [MainPage, ComposePage]


async def test_steps_are_chosen_nested_given_parameters_and_made(operator: Operator, here: Path) -> None:
    page = await composer(operator)
    await operator.sees("no step yet")
    await add(operator, "arm-1.go_to")
    await add(operator, "repeat", "repeat 3")
    await add(operator, "arm-1.grip")
    await operator.until(lambda: len(page.rows) == 3, "three steps")
    assert lines(page) == [
        "arm.go_to x=0.35 y=0.0 z=0.4 twist=0deg", "repeat 3", "  arm.grip action=open",
    ]  # fmt: skip
    await operator.sees("✓ 3 steps, which can be tried and made", "arm: Arm (arm-1)")
    await operator.press("home", "dollar_sign")
    await operator.at(Choosing)
    await operator.press("down", "enter")
    await operator.at(ComposePage)
    assert lines(page)[0] == "arm.go_to x=0.35 y=$y z=0.4 twist=0deg"
    assert page.parameters == {"y": "0.0"}
    await operator.press("ctrl+r")
    await operator.sees("✓ made mine.py")
    text = (here / "mine.py").read_text()
    assert "def carry_out(self, y: Metres = 0.0) -> None:" in text
    assert "for _ in range(3):" in text
    await operator.press("escape")
    await operator.at(MainPage)


async def test_steps_move_with_what_is_in_them_and_can_be_taken_out(operator: Operator) -> None:
    page = await composer(operator)
    await add(operator, "wait", "wait 1")
    await add(operator, "repeat")
    await add(operator, "arm-1.hold")
    assert lines(page) == ["wait 1", "repeat 2", "  arm.hold"]
    await operator.press("up", "ctrl+up")
    assert lines(page) == ["repeat 2", "  arm.hold", "wait 1"]
    await operator.press("ctrl+down")
    assert lines(page) == ["wait 1", "repeat 2", "  arm.hold"]
    await operator.press("down", "left")
    assert lines(page) == ["wait 1", "repeat 2", "arm.hold"]
    await operator.sees("there is no step in `repeat`")
    await operator.press("right")
    assert lines(page) == ["wait 1", "repeat 2", "  arm.hold"]
    await operator.press("up", "delete")
    assert lines(page) == ["wait 1"]


async def test_leaving_a_new_line_drops_it_and_leaving_the_page_asks_about_its_steps(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client, size=(80, 24)) as operator:
        page = await composer(operator)
        await add(operator, "arm-1.hold", "import os")
        await operator.sees("`import os` is no step")
        await operator.press("escape")
        assert page.rows == []
        await add(operator, "arm-1.hold")
        await operator.sees("✓ 1 step, which can be tried")
        await operator.press("delete")
        await operator.sees("no step yet")
        await add(operator, "arm-1.hold")
        await operator.press("escape")
        await operator.at(Confirm)
        operator.one(Button, "#yes").press()
        await operator.at(MainPage)


async def test_the_line_that_is_edited_is_made_too_and_one_that_is_no_step_is_refused(
    operator: Operator, here: Path
) -> None:
    page = await composer(operator)
    await add(operator, "arm-1.hold")
    await add(operator, "wait", "wait 1")
    await operator.press("enter")
    line = operator.one(Input, "#step-line")
    for key in ("f5", "ctrl+r"):
        line.value = "import os"
        await operator.press(key)
        await operator.sees("`import os` is no step")
        assert line.has_focus
        assert lines(page) == ["arm.hold", "wait 1"]
        assert not (here / "mine.py").exists()
    line.value = "wait 3"
    await operator.press("ctrl+r")
    await operator.sees("✓ made mine.py")
    assert lines(page) == ["arm.hold", "wait 3"]
    assert "self.sleep(3" in (here / "mine.py").read_text()


async def test_nothing_of_a_person_is_overwritten_without_a_question(operator: Operator, here: Path) -> None:
    (here / "mine.py").write_text("mine")
    await composer(operator)
    await add(operator, "arm-1.hold")
    await operator.press("ctrl+r")
    await operator.at(Confirm)
    await operator.press("enter")  # the harmless answer has the focus
    await operator.at(ComposePage)
    assert (here / "mine.py").read_text() == "mine"
    await operator.press("ctrl+r")
    await operator.at(Confirm)
    operator.one(Button, "#yes").press()
    await operator.sees("✓ made mine.py")
    assert "self.arm.hold()" in (here / "mine.py").read_text()


async def test_a_robot_is_led_by_hand_but_not_one_that_another_one_commands(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    await composer(operator)
    await operator.press("T")
    await operator.at(TeleopPage)
    await operator.press("escape")
    await operator.at(ComposePage)
    await operator.sees("nothing was shown")
    arm = operator.app.store.descriptions["arm-1"]
    bond = BondSpec(parent=Address("robot", "greeter", "9"), slot="arm", epoch=1, remaining=1.0)
    held = msgspec.structs.replace(arm, bond=bond)
    monkeypatch.setattr(Store, "described", lambda _self, _name: held)
    await operator.press("T")
    await operator.sees("arm-1 is commanded by greeter")
    assert isinstance(operator.app.screen, ComposePage)


SHOWN = """\
part take
  arm.go_to x=$from_x-0.05 y=$from_y z=$from_z+0.05 twist=30deg
  arm.go_to x=$from_x y=$from_y z=$from_z+0.05 twist=30deg
  arm.go_to x=$from_x y=$from_y z=$from_z twist=30deg
  arm.grip action=close
  arm.go_to x=$from_x y=$from_y z=$from_z+0.05 twist=30deg
part put
  arm.go_to x=$to_x y=$to_y z=$to_z+0.05 twist=30deg
  arm.go_to x=$to_x y=$to_y z=$to_z twist=30deg
  arm.grip action=open
  arm.go_to x=$to_x y=$to_y z=$to_z+0.05 twist=30deg
"""


async def test_a_robot_that_is_led_by_keys_once_becomes_named_steps_and_a_page(
    realm: Realm, operate: Operate, here: Path
) -> None:
    arm, realm.realm_client.realm = Arm("arm-2"), "hall"  # whose robots keep what they did
    await realm.robot(arm, state_home() / "hall" / "robots" / arm.name)
    async with operate(realm.realm_client) as operator:
        await operator.until(lambda: "x" in operator.app.store.readings("arm-2"), "the arm is read")
        await operator.press("C")
        page = await operator.at(ComposePage)
        await operator.press("T")
        await operator.at(Choosing)
        await operator.press("down", "enter")
        led = await operator.at(TeleopPage)
        await operator.press("plus", "plus")  # steps of 50 mm and 30 degrees
        for key in ("comma", "up", "pagedown", "O", "pageup", "left", "pagedown", "o", "pageup"):
            told: Sequence[Any] = led.felt if key in "oO" else arm.calls  # a grip is over when it was felt
            before = len(told)
            await operator.press(key)
            await operator.until(lambda told=told, before=before: len(told) > before, key)
            await moved(operator, led)
        await operator.press("escape")
        await operator.at(ComposePage)
        await operator.until(lambda: len(page.rows) > 0, "steps")
        assert "\n".join(lines(page)) + "\n" == SHOWN
        assert list(page.parameters.values()) == [0.4, 0.0, 0.35, 0.4, 0.05, 0.35]
        await operator.press("ctrl+r")
        await operator.sees("✓ made mine.py")
        assert "def carry_out(" in (here / "mine.py").read_text()


class Felt(msgspec.Struct, frozen=True):
    x: float
    y: float
    z: float
    twist: float
    width: float
    holding: bool


class Feeling(Arm):
    """An arm of paper that tells whether it holds something."""

    cup = False

    @command(effect="read")
    def get_info(self) -> Felt:  # type: ignore[override]
        """Tell where it is, and what it holds."""
        return Felt(**self.pose, width=self.width, holding=self.cup and self.width < 0.08)


async def test_after_each_grip_that_is_shown_the_robot_is_asked_what_it_holds(
    realm: Realm, operator: Operator
) -> None:
    arm = Feeling("arm-2")
    await realm.robot(arm)
    await operator.until(lambda: len(operator.app.store.descriptions) == 3, "all are described")
    await operator.until(lambda: "x" in operator.app.store.readings("arm-2"), "the arm is read")
    await operator.press("C")
    await operator.at(ComposePage)
    await operator.press("T")
    await operator.at(Choosing)
    await operator.press("down", "enter")
    led = await operator.at(TeleopPage)
    for number, arm.cup in enumerate((False, True)):
        await operator.press("O")
        await operator.until(lambda count=number + 1: len(led.felt) == count, "it was asked")
        assert led.felt[number].readings["holding"] is arm.cup
