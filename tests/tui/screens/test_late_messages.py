"""What a person typed or chose counts at once, however late the toolkit's messages about it are handled.

Between two lines without `await` no message is handled: that is the slowest machine there is.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import pytest
from textual.widgets import Button, Input, Label, OptionList

from robotree.tui.line.grammar import Line
from robotree.tui.screen.pages.enslave import EnslaveDialog, Opening
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.new import NewPage
from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.screen.source_outline import outline
from robotree.tui.screen.widgets.cameras import Cameras
from robotree.tui.screen.widgets.field_row import Choice, FieldRow
from robotree.tui.screen.widgets.prompt import Prompt
from robotree.tui.screen.widgets.views_pane import ViewsPane
from robotree.vr.base.address import Address
from robotree.vr.base.description import FieldSpec, Listing
from robotree.vr.base.requests import ViewDescribed

if TYPE_CHECKING:
    from screens.conftest import Operator
    from tui.conftest import Realm

SOURCE = '''
from robotree.vr import VirtualRobot, command

class {name}(VirtualRobot):
    """Does {name}."""

    @command
    def do(self) -> None:
        """Do it."""
'''


async def test_a_command_that_was_just_chosen_is_the_one_that_runs(realm: Realm, operator: Operator) -> None:
    page = await operator.panel()
    names = [command.name for command in page.robot.commands]
    page.query_one("#commands", OptionList).highlighted = names.index("hold")
    page.action_run()
    page.action_fill_in()
    page.action_copy()
    assert operator.app.store.entries[-1].text == "the form of hold is being made: press again"
    await operator.settled()
    assert realm.arm.calls == [], "go_to, which was chosen before, has not run"
    page.action_run()
    await operator.sees("arm-1: hold by ", "is done: ran")


async def test_a_choice_that_a_person_made_is_not_taken_back_by_the_robot(operator: Operator) -> None:
    spec = FieldSpec(
        name="mode", type="choice", choices=("slow", "fast", "off"), required=False, default="slow"
    )
    row = FieldRow(spec, {})
    assert row.text == "slow", "also before it is on the screen"
    await operator.app.main.mount(row)
    row.query_one(Choice).value = "fast"
    row.become(msgspec.structs.replace(spec, default="off"))
    assert (row.text, row.touched) == ("fast", True)
    await operator.settled()
    assert str(row.query_one(".field-name", Label).render()) == "mode *"
    row.follow()
    assert (row.text, row.touched) == ("off", False)
    await operator.settled()
    assert (row.text, row.touched) == ("off", False)
    row.become(spec)
    assert row.text == "slow", "what nobody touched follows"


async def test_the_prompt_acts_once_on_what_stands_in_it(realm: Realm, operator: Operator) -> None:
    main, prompt = operator.app.main, operator.app.main.query_one(Prompt)
    line = prompt.query_one(Input)
    prompt.open("verb")
    line.value = "re"
    prompt.action_complete(1)
    assert line.value == "reload"
    prompt.action_complete(1)
    assert line.value == "release"
    await operator.settled()
    prompt.action_complete(1)
    assert line.value == "resume", "the choices are those of what was typed"
    prompt.action_leave()
    prompt.open("verb")
    await operator.settled()
    assert line.has_focus, "it was opened again before the list could take the keys back"
    prompt.action_leave()
    await operator.settled()
    prompt.open("filter")
    line.value = "rov"
    prompt.action_leave()
    await operator.settled()
    assert main.filters.get("robots", "") == ""
    assert prompt.letters == ""
    prompt.open("verb")
    line.value = "call arm-1.go_to x=0.3 y=0 z=0.3 twist=0"
    line.post_message(Input.Submitted(line, line.value))
    line.post_message(Input.Submitted(line, line.value))
    await operator.sees("is done: ran")
    await operator.settled()
    assert realm.arm.calls == ["go_to"], "a line that is sent twice is carried out once"


async def test_a_cancel_ends_also_the_steps_still_to_be_sent(realm: Realm, operator: Operator) -> None:
    await operator.panel()
    operator.app.open_teleoperation(operator.app.store.descriptions["arm-1"])
    page = await operator.at(TeleopPage)
    page.action_jog("x", 1)
    page.action_cancel()
    await operator.settled()
    assert page.jog.target is None
    page.action_jog("x", 1)
    await operator.until(lambda: realm.arm.calls == ["go_to"], "the step after the cancel")


async def test_turning_twice_comes_to_the_camera_after_the_next_and_one_chosen_while_views_are_asked_stays(
    realm: Realm, operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    operator.app.main.show_pane("views")
    views = operator.app.main.query_one(ViewsPane)
    cameras = views.query_one(Cameras)
    await operator.until(lambda: bool(cameras.all), "cameras")
    cameras.all = [("cell", "a"), ("cell", "b"), ("cell", "c")]
    views.draw()
    await operator.settled()
    seen: list[int] = []
    choose = cameras.choose

    def note(at: int) -> None:
        seen.append(at)
        choose(at)

    monkeypatch.setattr(cameras, "choose", note)
    views.turn()
    views.turn()
    await operator.settled()
    assert seen == [1, 2]
    monkeypatch.setattr(cameras, "choose", choose)

    described = await realm.realm_client.describe_view("cell")
    asked, answered = asyncio.Event(), asyncio.Event()

    async def answer(_view: str) -> ViewDescribed:
        asked.set()
        await answered.wait()
        return msgspec.structs.replace(described, cameras=("a", "b", "c"))

    monkeypatch.setattr(operator.app.realm_client, "describe_view", answer)
    cameras._ask(("cell",))
    await asked.wait()
    cameras.all, cameras.at = [("cell", "a"), ("cell", "b")], 0  # after any earlier answer
    cameras.turn()
    answered.set()
    await operator.until(lambda: len(cameras.all) == 3, "the answer")
    assert cameras.at == 1


def listing(name: str) -> Listing:
    return Listing(
        address=Address("robot", name, "1"), kinds=("Arm", "Robot"), doc="An arm.", commands=("hold",)
    )


async def test_a_robot_is_enslaved_only_into_the_slot_for_which_it_was_shown(operator: Operator) -> None:
    store = operator.app.store
    answers: list[Line | None] = []
    places = [Opening("duo", "left", "Arm"), Opening("duo", "right", "Arm", "", ("fly",))]
    dialog = EnslaveDialog(store, places, "arm-1")
    operator.app.push_screen(dialog, answers.append)
    await operator.at(EnslaveDialog)
    children = dialog.query_one("#children", OptionList)
    dialog.query_one("#slots", OptionList).highlighted = 1
    dialog.query_one("#yes", Button).press()
    await operator.settled()
    assert operator.app.screen is dialog, "no robot of the other slot was taken"
    dialog.query_one("#slots", OptionList).highlighted = 0
    await operator.settled()
    store.robots["arm-2"] = listing("arm-2")
    dialog._offer()
    assert children.option_count == 2, "a robot that has just come is offered"
    children.highlighted = 1
    del store.robots["arm-2"]
    dialog._offer()
    assert children.highlighted is None, "Enter takes no other robot than the one that was seen"
    dialog.query_one("#yes", Button).press()
    await operator.sees("choose a robot")
    children.highlighted = 0
    dialog.query_one("#yes", Button).press()
    dialog.query_one("#yes", Button).press()
    await operator.at(MainPage)
    assert answers == [Line("enslave", {"PARENT.SLOT": "duo.left", "CHILD": ("arm-1",)})]


async def test_the_file_that_was_chosen_last_is_the_one_that_is_made(
    operator: Operator, tmp_path: Path
) -> None:
    first, second, broken = (tmp_path / f"{name}.py" for name in ("first", "second", "broken"))
    operator.app.push_screen(NewPage())
    page = await operator.at(NewPage)
    create, name = page.query_one("#create", Button), page.query_one("#name", Input)
    found = {path: outline(SOURCE.format(name=path.stem.title())) for path in (first, second)}

    first.write_text(SOURCE.format(name="First"))
    page.read(first)
    await operator.until(lambda: name.value == "first", "its name")
    page.path = second  # chosen, and not read yet
    page._offer(first, found[first], "")
    page._offer(second, found[second], "")
    page._offer(first, found[first], "")
    assert page._chosen is not None
    assert page._chosen.name == "Second"
    page.query_one("#host", Choice).focus()
    await operator.settled()
    assert page.query_one("#host", Choice).has_focus, "a late message does not take the cursor away"
    page.path = broken
    page._offer(broken, [], "It cannot be read: it is broken")
    await operator.settled()
    await operator.sees("it is broken")
    assert create.disabled
    page.carrying = "first is being made"
    page._offer(broken, found[first], "")
    name.value = "other"
    await operator.settled()
    assert create.disabled, "nothing is made while something is made"
