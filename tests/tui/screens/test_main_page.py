"""The main page: robots, tree, views and log of a realm, and what can be done from there."""

from __future__ import annotations

import asyncio
import os
from typing import TYPE_CHECKING

import pytest
from textual.containers import VerticalScroll
from textual.widgets import Button, DirectoryTree, Input

from robotree.tui.diagnosis.agents import permits
from robotree.tui.screen.app import words_of
from robotree.tui.screen.pages.dialogs import Confirm, Reading
from robotree.tui.screen.pages.enslave import EnslaveDialog
from robotree.tui.screen.pages.help import help_text
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.new import NewPage
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.widgets.log_pane import LogPane
from robotree.tui.screen.widgets.robot_table import RobotTable
from robotree.tui.seen.selection import Place
from robotree.vr import Robot
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import principal_of, this_process, user_name

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


ME = principal_of(this_process(), "", "pts/1").person
"""Who asks in these tests."""


async def test_a_robot_that_the_policy_denies_is_grey_and_says_why(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate, me = PolicyGate(), user_name(os.geteuid())
    head = f"realm: test\nversion: 1\npersons: {{'{me}': some}}\nroles:"
    gate.policy = read_policy(f"{head} {{some: {{see: '*', command: arm-1.grip}}}}")
    monkeypatch.setattr(realm.realm_client._transport, "gate", gate)
    with sitting_at("pts/3"):
        async with operate(realm.realm_client) as operator:
            await operator.sees("may not command arm-1.go_to: line 4 allows")
            await operator.sees("rover-1", "● free ✗")
            assert operator.text.count("● free ✗") == 1, "arm-1 has a command that is allowed"
            found = list(permits(realm.realm_client, operator.app.store.descriptions.values(), ""))
            assert [one.grade for one in found] == ["good", "doubt"]
            assert f"the policy denies {me} to command rover-1: line 4 allows" in found[1].result
            gate.policy = read_policy(f"{head} {{some: {{}}}}")
            (_, hidden) = permits(realm.realm_client, (), "rover-1")
            assert f"the policy denies {me} to see it: line 3 gives the role some" in hidden.result
            assert hidden.grade == "bad"


@pytest.mark.usefixtures("every_frame")
async def test_a_cursor_key_draws_two_lines_before_anything_else(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in range(9):
        await realm.robot(Robot(f"z{number}"))
    async with operate(realm.realm_client) as operator:
        table = await operator.select("z3")
        await operator.settled()
        drawn, draw = set[int](), table.render_line
        monkeypatch.setattr(table, "render_line", lambda y: (drawn.add(y), draw(y))[1])
        line = table.names.index("z3") + 1
        table.action_move(1)  # nothing else has a turn before the lines are drawn
        assert {line, line + 1} == drawn
        await operator.until(lambda: "z4" in str(operator.one(VerticalScroll, "#details-box").border_title))


async def test_enslaving_from_the_child_offers_the_slots_that_take_it_and_what_cannot_be_is_not_asked(
    realm: Realm, operator: Operator
) -> None:
    await realm.create("move_to.py", "mover")
    await operator.until(lambda: "mover" in operator.app.store.descriptions)
    await operator.sees("mover")
    assert operator.one(RobotTable).selected == "arm-1"
    await operator.press("e")
    await operator.at(EnslaveDialog)
    await operator.press("escape")
    await operator.at(MainPage)
    for key, refusal in (
        ("d", "arm-1 stands for a robot: end its proxy"),
        ("r", "arm-1 has no child"),
        ("R", "no robot is in protective stop"),
    ):
        await operator.press(key)
        await operator.sees(refusal)
    await operator.press("down", "down", "e")
    await operator.sees("rover-1 has no empty slot and none waits for it")


async def test_space_stops_everything_on_every_page_but_is_a_space_while_typing(
    realm: Realm, operator: Operator
) -> None:
    await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
    await operator.press("colon", "a", "space", "b")
    assert operator.one(Input, "#line").value == "a b"
    assert operator.app.store.stopped == ()
    await operator.press("ctrl+s")
    await operator.sees("PROTECTIVE STOP: arm-1, rover-1")
    await operator.press("escape", "R")
    await operator.at(Confirm)
    await operator.press("right", "enter")
    await operator.until(lambda: operator.app.store.stopped == (), "the stop is released")
    for keys in (["enter"], ["x"], ["escape", "escape", "v"], ["question_mark"]):
        await operator.press(*keys, "space")
        await operator.until(lambda: len(operator.app.store.stopped) == 2, f"stop after {keys}")
        await realm.realm_client.resume(None)
        await operator.until(lambda: operator.app.store.stopped == (), "released")


async def test_verbs_are_typed_at_the_prompt_as_on_the_command_line(realm: Realm, operator: Operator) -> None:
    await operator.obey("call arm-1.go_to x=0.5 y=0 z=0.3 twist=0")
    await operator.sees(f"✓ arm-1: go_to by {ME} is done: ran")
    assert realm.arm.pose["x"] == pytest.approx(0.5)
    await operator.obey("show arm-1")
    await operator.at(Reading)
    await operator.sees("kinds", "Arm < Robot", "get_info()")
    await operator.press("escape")
    await operator.obey("tree")
    await operator.press("escape")
    await operator.obey("enslav a.b c")
    await operator.sees("did you mean enslave")
    await operator.obey("call arm-1.stumble")
    await operator.sees("a stone [/x] lay there")
    await operator.obey("views")
    await operator.sees("cell / wrist")
    await operator.obey("delete rover-1")
    await operator.at(Confirm)


async def test_the_prompt_completes_remembers_and_tab_goes_through_what_a_word_may_become(
    operator: Operator,
) -> None:
    await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
    await operator.press("colon")
    await operator.type("call arm-1.sho")
    await operator.until(lambda: operator.one(Input, "#line")._suggestion != "", "a suggestion")
    await operator.press("tab")
    assert operator.one(Input, "#line").value == "call arm-1.shout"
    await operator.type(" text=hello")
    await operator.press("enter")
    await operator.sees("hello")
    await operator.press("colon", "up")
    assert operator.one(Input, "#line").value == "call arm-1.shout text=hello"
    await operator.press("escape", "colon")
    await operator.type("call arm-1.s")
    line = operator.one(Input, "#line")
    await operator.sees("arm-1.shout", "arm-1.stumble")
    seen: list[str] = []
    for _ in range(3):
        await operator.press("tab")
        seen.append(line.value)
    assert seen[0] == seen[2]
    assert set(seen) == {"call arm-1.shout", "call arm-1.stumble"}
    await operator.press("shift+tab")
    assert line.value == seen[1]
    await operator.type(" ")
    await operator.press("escape", "colon")
    assert line.value == ""


async def test_the_cursor_returns_to_the_robot_that_a_filter_hid(realm: Realm, operator: Operator) -> None:
    await operator.until(lambda: {"arm-1", "rover-1"} <= operator.app.store.descriptions.keys())
    table = operator.one(RobotTable)
    await operator.press("ctrl+end")
    assert table.selected == "rover-1"
    await operator.press("slash")
    await operator.type("stumble")
    await operator.until(lambda: table.selected == "arm-1", "the arm, by what its commands are called")
    assert table.row_count == 1
    await operator.press("escape")
    await operator.until(lambda: table.row_count == 2, "the filter has gone")
    assert table.selected == "rover-1"
    await realm.robot(Robot("aaa-1"))
    await operator.until(lambda: table.row_count == 3, "another robot")
    assert table.selected == "rover-1"


async def test_who_leaves_the_demo_is_told_that_it_ends(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client, farewell="The demo ends with this screen.") as operator:
        assert "Leave. The demo ends with this screen." in help_text(operator.app).plain
        await operator.press("q")
        await operator.at(Confirm)
        await operator.sees("The demo ends with this screen.")
        await operator.press("escape")
        await operator.at(MainPage)
        await operator.press("q", "right", "enter")
        await operator.until(lambda: operator.app.return_value == 0, "it has ended")


async def test_the_others_hear_which_part_is_in_front_and_pictures_are_live_only_while_they_are_looked_at(
    realm: Realm, operator: Operator
) -> None:
    told = [words_of(operator.app.screen)]
    for key in ("F", "g", "l", "v"):
        await operator.press(key)
        told.append(words_of(operator.app.screen))
    assert told == ["the list", "the plan", "the log", "the list", "the views"]
    await operator.sees("cell / cell", "cell / wrist", "lever", "peak_force 6.5 N", "▀▀▀▀")
    await operator.press("down")
    await operator.until(lambda: "wrist" in realm.cell.looks, "the other camera")
    await operator.press("l")
    await operator.until(lambda: isinstance(operator.app.focused, RobotTable))
    looks = len(realm.cell.looks)
    await operator.press("g")
    await asyncio.sleep(0.6)
    assert len(realm.cell.looks) <= looks + 1, "nobody looks, nobody draws"


async def test_an_empty_realm_says_how_to_fill_it(operate: Operate) -> None:
    from robotree.vr.supervision.realm_client import RealmClient
    from robotree.vr.world.network import MemoryNetwork

    realm_client = RealmClient(MemoryNetwork().join("operator"))
    await realm_client.start()
    async with operate(realm_client) as operator:
        await operator.sees("No robot is here yet.", "robotree demo")
        assert "STALE" not in operator.text
        for key in ("enter", "e", "r", "d", "c", "i", "t", "enter", "e", "r", "d", "v", "g", "R"):
            await operator.press(key)
    await realm_client.close()


async def test_wide_shows_more_columns_and_a_key_unfolds_the_joints(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client, size=(150, 44)) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions, "arm-1")
        operator.app.choose("arm-1")
        await operator.sees("joints  14.3 °", "ABOUT")
        await operator.press("J")
        await operator.sees("j1      14.3 °")
        assert "joints" not in operator.text
        await operator.press("J", "w")
        await operator.sees("EPOCH", "LEASE", "PROCESS", "ABOUT")
        await operator.until(lambda: "joints" not in operator.text, "the list has the whole page")
        await operator.press("w")
        await operator.sees("joints  14.3 °")
        await operator.until(lambda: "EPOCH" not in operator.text, "the narrow list")


async def test_a_long_list_is_drawn_to_its_end_and_follows_and_its_ends_come_in_sight(
    realm: Realm, operate: Operate
) -> None:
    for number in range(30):
        await realm.robot(Robot(f"r{number}"))
    async with operate(realm.realm_client, size=(80, 75)) as operator:
        await operator.until(lambda: len(operator.one(RobotTable).names) == 32, "all of them")
        await operator.until(lambda: operator.text.count("● free") >= 32, "all lines")
        await operator.press("space")
        await operator.until(lambda: operator.text.count("■ stopped") >= 32, "each line follows")
        await operator.resize(80, 24)
        table = operator.one(RobotTable)
        await operator.press("end")
        await operator.until(lambda: table.selected == "rover-1", "the last one")
        await operator.until(lambda: "rover-1" in operator.text, "it is in sight")
        await operator.press("home")
        await operator.until(lambda: table.selected == "arm-1", "the first one")
        await operator.until(lambda: "arm-1 " in operator.text, "it is in sight")


async def test_the_help_is_in_every_footer_and_opens_while_one_types(realm: Realm, operate: Operate) -> None:
    await realm.create("move_to.py", "mover")
    async with operate(realm.realm_client, size=(50, 15)) as operator:
        await operator.until(lambda: "mover" in operator.app.store.descriptions, "mover")
        await operator.sees("? Help")
        await operator.press("colon")
        await operator.sees("f1 Help", "esc Leave")
        await operator.press("f1")
        await operator.at(Reading)
        await operator.sees("Protective stop", "? Help")
        await operator.press("question_mark")
        await operator.at(MainPage)
        await operator.press("escape")
        operator.app.ask_for("delete", Place("mover"))
        await operator.at(Confirm)
        await operator.sees("? Help")
        await operator.press("question_mark")
        await operator.at(Reading)
        await operator.press("escape")
        await operator.at(Confirm)
        operator.app.screen.dismiss(None)
        await operator.at(MainPage)
        await operator.press("n")
        await operator.at(NewPage)
        await operator.sees("Help")


async def test_control_that_changes_hands_is_told_once_and_taken_after_a_plain_question(
    realm: Realm, operator: Operator
) -> None:
    app = operator.app
    app.store.me = ME  # as the realm in memory has it
    with sitting_at("pts/9"):
        ben = await realm.realm_client.control("arm-1", "get")
    await operator.until(lambda: app.store.by("arm-1") == ben, "somebody else has it")
    app.choose("arm-1")
    await operator.obey("say hello")
    await operator.press("4")
    await operator.sees("Take control of arm-1?", f"{ben} has control, and loses it", "Take control")
    app.screen.query_one("#yes", Button).focus()
    await operator.press("enter")
    await operator.sees("you have control of arm-1")
    await operator.press("6")
    await operator.at(Reading)  # a key that comes before that is meant for the page before
    await operator.sees("CONTROL", "ROBOT")
    await operator.press("escape")
    await operator.at(MainPage)
    await operator.obey("control leave arm-1")
    await operator.sees("nobody has control of arm-1")
    said = [entry.text for entry in app.store.entries]
    assert "" not in said
    about_me = [text for text in said if ME in text or "you have control" in text]
    assert about_me == [
        "you have control of arm-1",
        f"nobody has control of arm-1: {ME} gave it up, or is gone",
    ]


def log_lines(operator: Operator) -> str:
    """Return what the log shows, without the line that flashes below it."""
    log = operator.one(LogPane)
    return "\n".join(log.render_line(y).text for y in range(log.size.height))


@pytest.mark.usefixtures("every_frame")
async def test_the_log_opens_at_its_newest_line_unless_somebody_scrolled_up(operator: Operator) -> None:
    for number in range(80):
        operator.app.tell(f"event {number}")
    await operator.press("g")
    await operator.sees("event 79")
    await operator.press("l")
    await operator.resize(100, 20)
    for number in range(20):
        operator.app.tell(f"later {number}")
    operator.app.main.draw()
    await operator.press("g")
    await operator.until(lambda: "later 19" in log_lines(operator), "the end")
    await operator.press("home")
    await operator.until(lambda: "event 0" in log_lines(operator), "the beginning")
    operator.app.tell("another one")
    await operator.press("l")
    await operator.resize(100, 24)
    await operator.press("g")
    await operator.until(lambda: "event 3" in log_lines(operator), "what was read")
    await operator.press("end")
    await operator.until(lambda: "another one" in log_lines(operator), "the end")
    operator.app.tell("the last")
    await operator.until(lambda: "the last" in log_lines(operator), "what comes then")
    await operator.press("down")
    operator.app.tell("the next")
    operator.app.progress(0.5, "3 cm to go")  # of a typed command: the list shows it, not the log
    await operator.until(lambda: "the next" in log_lines(operator), "who is at the end follows on")
    assert operator.app.store.entries[-1].text == "the next"


async def test_who_goes_to_the_beginning_while_lines_come_stays_there(operator: Operator) -> None:
    for number in range(80):
        operator.app.tell(f"event {number}")
    await operator.press("g")
    await operator.sees("event 79")
    operator.app.tell("a line that is still to be scrolled to")
    operator.app.main.draw()
    operator.one(LogPane).action_scroll_home()  # in the same turn
    await operator.until(lambda: "event 0" in log_lines(operator), "the beginning")
    operator.app.tell("the next")
    operator.app.main.draw()
    await operator.settled()
    assert "event 0" in log_lines(operator)


async def test_the_log_is_there_in_a_small_terminal(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client, size=(50, 15)) as operator:
        for number in range(30):
            operator.app.tell(f"something happened, and it takes more than one line to say: {number}")
        await operator.press("g")
        await operator.sees("say: 29")
        await operator.resize(80, 24)
        await operator.sees("say: 29")
        await operator.resize(50, 15)
        await operator.sees("say: 29")


def at_a_file(tree: DirectoryTree) -> bool:
    node = tree.cursor_node
    return node is not None and node.data is not None and node.data.path.suffix == ".py"


class Counting:
    """Presses keys and counts them."""

    def __init__(self, operator: Operator) -> None:
        self.operator, self.keys = operator, 0

    async def press(self, *keys: str) -> None:
        self.keys += len(keys)
        await self.operator.press(*keys)

    async def make(self, file: str, name: str) -> None:
        """Make a robot of an example, with the name that is suggested."""
        operator = self.operator
        await self.press("n")
        page = await operator.at(NewPage)
        await operator.sees(file)
        tree = operator.one(DirectoryTree)
        await operator.until(lambda: tree.has_focus and at_a_file(tree), "the first file")
        for _ in range(9):
            node = tree.cursor_node
            if node and node.data and node.data.path.name == file:
                break
            await self.press("down")
        await self.press("enter")
        await operator.until(lambda: not page.query_one("#create", Button).disabled, "it can be made")
        await self.press("enter")
        await operator.at(MainPage)
        await operator.until(lambda: operator.app.selection.name == name, f"{name} is selected")
        await operator.until(lambda: name in operator.app.store.descriptions, f"{name} is described")
        app = operator.app
        await operator.until(lambda: not app.selection.refusal(app.now()), "a person has seen the selection")

    async def enslave(self, path: str, child: str) -> None:
        await self.press("e")
        await self.operator.at(EnslaveDialog)
        await self.operator.sees(path, child)
        await self.press("enter")
        await self.operator.sees(f"{path} commands {child}")


async def test_a_lever_closes_after_eighteen_keys_from_nothing(realm: Realm, operator: Operator) -> None:
    await operator.until(lambda: "arm-1" in operator.app.store.descriptions, "the arm")
    await operator.until(lambda: bool(operator.app.store.hosts), "a host")
    hand = Counting(operator)
    await hand.make("move_to.py", "move-to")
    await hand.enslave("move-to.arm", "arm-1")
    await hand.make("open_close_lever.py", "open-close-lever")
    await hand.enslave("open-close-lever.mover", "move-to")
    await hand.press("enter")
    page = await operator.at(PanelPage)
    await operator.until(lambda: bool(page.query("CommandForm")), "the form")
    assert page.robot.commands[0].name == "close"
    await hand.press("ctrl+r")
    await operator.sees("done in")
    assert realm.arm.lever > 0.75, "the lever is closed"
    assert hand.keys <= 18, f"{hand.keys} keys"
