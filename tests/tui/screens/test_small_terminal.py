"""A small terminal keeps what an operator needs: how to stop, what is asked, where one types."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from textual.containers import Vertical
from textual.widgets import Button, Input

from robotree.tui.screen.pages import page
from robotree.tui.screen.pages.enslave import EnslaveDialog
from robotree.tui.screen.pages.main import EMPTY
from robotree.tui.screen.pages.new import NewPage
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.screen.widgets.cameras import PictureView
from robotree.tui.screen.widgets.key_line import fitting
from robotree.tui.screen.widgets.log_pane import FlashLine
from robotree.tui.screen.widgets.readings import Readings
from robotree.tui.screen.widgets.robot_table import RobotTable
from robotree.tui.seen.selection import Place
from robotree.tui.seen.watched import Alarm

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm

SMALL = (40, 12)


def test_what_has_no_room_in_the_line_of_keys_is_left_out_whole_but_for_help() -> None:
    assert fitting([5, 5, 5, 5], 20, 3) == [0, 1, 2, 3]
    assert fitting([5, 5, 5, 5], 19, 3) == [0, 1, 3]
    assert fitting([5, 9, 2, 5], 13, 3) == [0, 3], "nothing is taken before what matters more"
    assert fitting([5, 5], 4, 1) == [1]
    assert fitting([5, 5], 9, None) == [0]


async def test_another_size_is_drawn_at_once_and_ctrl_c_says_what_leaves(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    await operator.until(lambda: "x" in operator.app.store.readings("arm-1"), "its readings")
    await operator.until(lambda: "arm-1" in operator.app.store.descriptions, "its description")
    await operator.press("ctrl+c")
    await operator.sees("ctrl+q leaves; ctrl+s stops every robot")
    assert "Do you want to quit" not in operator.text
    monkeypatch.setattr(page, "TICK", 1e6)
    operator.app.ask_for("panel", Place("arm-1"))
    await operator.at(PanelPage)
    for width, counts in ((120, True), (80, False), (120, True)):
        await operator.resize(width, 24)

        def fits(width: int = width, counts: bool = counts) -> bool:  # noqa: FBT001 # of this turn
            top, who, *_ = operator.text.splitlines()
            cut = who.rstrip().endswith("…")
            return (
                len(top) == width
                and ("1 view" in top, "2 free" in top, cut) == (counts, True, not counts)
                and "STOP" in top
            )

        await operator.until(fits, f"{width} columns")


async def test_a_panel_has_its_form_below_the_commands_in_a_small_terminal(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client, size=SMALL) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions, "its description")
        alarm = Alarm(robot="arm-1", reading="shoulder", sign=">", limit=10.0, unit="N", raised=1.0)
        operator.app.store.take_alarms([alarm], operator.app.now(), "")
        await operator.sees("● free ▲ ")  # an alarm leaves the word for how the robot is
        page = await operator.panel()
        operator.app.open_teleoperation(operator.app.store.descriptions["arm-1"])
        teleop = await operator.at(TeleopPage)
        await operator.sees("space STOP", "↑ +x", "⇟ -z", "step 10 mm", "● at rest")
        assert teleop.query_one(PictureView).size.width == 0, "its keys have the terminal to themselves"
        await operator.press("escape")
        await operator.at(PanelPage)
        await operator.press("enter")
        await operator.until(lambda: isinstance(operator.app.focused, Input), "the cursor")
        await operator.sees("arm-1", "space STOP", "x           0.35", "-0.8 …")
        assert not page.query_one(Readings).display
        await operator.resize(80, 24)
        await operator.sees("space STOP", "-0.8 … 0.8 m", "readings")


def test_the_first_words_of_an_empty_realm_fit_into_a_narrow_terminal() -> None:
    assert max(map(len, EMPTY.splitlines())) <= 50 - 2 * 2


async def test_tele_operation_tells_what_it_does_however_many_readings_there_are(
    realm: Realm, operate: Operate
) -> None:
    more = {**realm.arm.readings(), **{f"joint-{number}": 0.5 for number in range(20)}}
    realm.arm.readings = lambda: more  # type: ignore[method-assign]
    async with operate(realm.realm_client, size=(80, 24)) as operator:
        store = operator.app.store
        await operator.until(lambda: "arm-1" in store.descriptions, "its description")
        await operator.until(lambda: "joint-19" in store.readings("arm-1"), "its readings")
        operator.app.open_teleoperation(store.descriptions["arm-1"])
        await operator.at(TeleopPage)
        await operator.sees("joint-1 ", "● at rest; press a key to move")


async def test_another_page_shows_what_happened_last_and_how_much_more(
    realm: Realm, operate: Operate
) -> None:
    long = f"the stop is confirmed by {', '.join(['arm-1'] * 12)} but NOT by rover-1"
    async with operate(realm.realm_client, size=(80, 24)) as operator:
        operator.app.tell(long, "error")  # one line is too short: it is told to its end
        await operator.sees("the stop is confirmed by", "NOT by rover-1", "? Help")
        operator.app.tell("calm again", "good")
        await operator.sees("✓ calm again", "✗ the stop is")
        await operator.until(lambda: "NOT by" not in operator.text, "one line is enough for what is older")
        await operator.press("n")
        await operator.at(NewPage)
        for number in range(4):
            operator.app.tell(f"event {number} {'very long ' * number * 5}")
        await operator.sees("· event 3", "…  +5 · g", "? Help")
        operator.app.tell(long, "error")
        await operator.sees("NOT by rover-1")
        operator.app.tell("calm again", "good")
        await operator.until(lambda: operator.one(FlashLine).size.height == 1, "one line is enough again")


async def test_how_to_resume_and_which_page_is_in_front_are_read_in_40_columns(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client, size=(40, 20)) as operator:
        await operator.sees("realm test  robots", "arm-1")
        for name in ("mover", "mover-2", "mover-3"):  # the list has room for four robots
            await realm.create("move_to.py", name)
        table = operator.one(RobotTable)
        await operator.until(lambda: "mover" in table.names and table.show_vertical_scrollbar, "a scrollbar")
        await operator.until(lambda: table.room == table.scrollable_content_region.width, "its columns")
        await operator.press("space")
        await operator.sees("PROTECTIVE STOP", "R resumes")
        operator.app.ask_for("panel", Place("arm-1"))
        await operator.sees("arm-1 / panel")


async def test_a_question_about_a_slot_has_slots_robots_and_answers_in_sight(
    realm: Realm, operate: Operate
) -> None:
    await realm.create("move_to.py", "mover")
    async with operate(realm.realm_client, size=(80, 24)) as operator:
        await operator.until(lambda: "mover" in operator.app.store.descriptions)
        operator.app.ask_for("enslave", Place("mover"))
        await operator.at(EnslaveDialog)
        for size, read in (((80, 24), ""), ((40, 20), "mover.arm  takes Arm"), ((40, 12), "")):
            await operator.resize(*size)
            await operator.sees("arm-1  Arm", "Cancel", "Enslave", read)

            def inside() -> bool:
                answers = operator.one(Button, "#yes").region
                return operator.one(Vertical, ".dialog").content_region.contains_region(answers)

            await operator.until(inside, f"the answers in {size}")
