"""What a person is asked, by a key, an assistant or a script: answered on each screen, closed when over."""

from __future__ import annotations

import asyncio
import io
import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from msgspec.structs import replace
from PIL import Image
from textual.containers import VerticalScroll
from textual.widgets import Button, Input, OptionList

from robotree.tui.line.action import Where
from robotree.tui.line.carrying import Refusal, Silent, carry_out
from robotree.tui.line.surface import Surface
from robotree.tui.line.verbs import Outcome
from robotree.tui.screen.pages.dialogs import Confirm
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.permits import PermitDialog, PermitsPage, QuestionDialog
from robotree.tui.screen.pages.user import UserPage
from robotree.tui.screen.user_app import UserApp
from robotree.tui.screen.widgets.cameras import PictureView
from robotree.tui.screen.widgets.row_list import RowList
from robotree.tui.seen.asked import DOUBT, AskedQuestion
from robotree.tui.seen.selection import Place
from robotree.vr.base.permit import Permit
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import user_name
from robotree.vr.bundle import Bundle
from robotree.vr.network.permit_file import PermitFiles

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


async def test_the_question_to_resume_closes_when_somebody_else_has_resumed_those_that_it_is_about(
    realm: Realm, operator: Operator
) -> None:
    await realm.realm_client.stop(None)
    await operator.sees("PROTECTIVE STOP: arm-1, rover-1 — R resumes")
    await operator.press("R")
    await operator.at(Confirm)
    await operator.sees("resume?", "arm-1, rover-1 may move again")
    await realm.realm_client.resume("rover-1")
    await operator.until(lambda: operator.app.store.stopped == ("arm-1",), "one is released")
    await operator.at(Confirm)
    await realm.realm_client.resume("arm-1")
    await operator.at(MainPage)
    await operator.sees("no need to resume: the stop of arm-1, rover-1 has ended meanwhile")
    await operator.obey("resume")
    await operator.at(Confirm)
    await operator.sees("All robots may move again")
    await operator.press("escape")
    await operator.at(MainPage)
    await realm.realm_client.stop(None)
    await operator.sees("PROTECTIVE STOP: arm-1, rover-1")
    await operator.obey("resume rover-1")
    await operator.at(Confirm)
    await realm.realm_client.resume("rover-1")
    await operator.at(MainPage)
    await operator.sees(
        "no need to resume: the stop of rover-1 has ended meanwhile", "PROTECTIVE STOP: arm-1"
    )


async def test_the_question_to_delete_closes_when_another_robot_has_taken_the_name(
    realm: Realm, operator: Operator
) -> None:
    await realm.create("move_to.py", "mover")
    await operator.until(lambda: "mover" in operator.app.store.descriptions, "its description")
    operator.app.ask_for("delete", Place("mover"))
    await operator.at(Confirm)
    await operator.sees("delete mover?", "mover ends for good")
    await realm.realm_client.delete("mover")
    await realm.create("two_arms.py", "mover")
    await operator.at(MainPage)
    await operator.until(
        lambda: any("mover " in entry.text for entry in operator.app.store.entries), "it is told"
    )
    assert "mover" in {robot.name for robot in await realm.realm_client.tree()}, "the new one lives"


async def test_the_question_to_release_names_the_child_and_closes_when_the_slot_has_another_one(
    realm: Realm, operator: Operator
) -> None:
    await realm.create("move_to.py", "mover")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    store = operator.app.store
    await operator.until(
        lambda: "mover" in store.descriptions and bool(store.descriptions["mover"].slots[0].child), "bond"
    )
    operator.app.ask_for("release", Place("mover"))
    await operator.at(Confirm)
    await operator.sees("release mover.arm?", "arm-1 stops what it does for mover")
    await realm.realm_client.release("mover", "arm")
    await operator.at(MainPage)
    await operator.sees("mover.arm is empty now, not arm-1")


class Gate(PolicyGate):
    """The gate of a realm that keeps permits."""

    def __init__(self, folder: Path) -> None:
        self.permits = PermitFiles(folder)


@pytest.fixture
def permits(realm: Realm, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> PermitFiles:
    gate = Gate(tmp_path)
    monkeypatch.setattr(realm.realm_client._transport, "gate", gate)
    return gate.permits


def asked(id_: str, x: float = 0.5) -> Permit:
    return Permit(
        id=id_, assistant="claude", robot="arm-1", life="", stops=0, command="go_to",
        arguments={"x": x}, units={"x": "m"}, why="the lever [/x] is open", asked=time.time(),
        preview=("it would go 0.21 m",),
    )  # fmt: skip


async def test_a_person_sees_that_an_assistant_asks_and_answers_in_a_dialog(
    operator: Operator, permits: PermitFiles
) -> None:
    jpeg = io.BytesIO()
    Image.new("RGB", (64, 36), (200, 30, 30)).save(jpeg, "JPEG")
    permits.ask(asked("aaaaaaaa"), jpeg.getvalue())
    await operator.sees("1 permit waits: P", "claude asks for arm-1.go_to(x=0.5 m)")
    permits.ask(asked("bbbbbbbb", 0.7))
    await operator.sees("2 permits wait: P")
    await operator.press("P")
    await operator.at(PermitsPage)
    await operator.sees("aaaaaaaa", "bbbbbbbb")
    await operator.press("enter")
    page = await operator.at(PermitDialog)
    await operator.sees("May claude do this, once?", "x=0.5 m", "the lever [/x] is open", "0.21 m")
    assert page.query_one(".dialog").outer_size.width == 96
    assert page.query_one(VerticalScroll).max_scroll_y == 0, "all of it is in sight"
    await operator.until(lambda: page.query_one(PictureView).frames > 0, "the picture")
    await operator.sees("\u2580")
    await operator.press("enter")  # the harmless answer has the focus
    await operator.at(PermitsPage)
    assert {one.id for one in permits.waiting()} == {"aaaaaaaa", "bbbbbbbb"}
    await operator.press("enter")
    await operator.at(PermitDialog)
    await operator.press("tab", "enter")
    await operator.until(lambda: permits.find("aaaaaaaa").state == "allowed", "it is allowed")
    await operator.at(PermitsPage)
    await operator.until(lambda: "aaaaaaaa" not in operator.text, "it is off the list")
    await operator.press("enter")
    await operator.at(PermitDialog)
    permits.answer("bbbbbbbb", yes=False, by="bert@pts/9")
    await operator.at(PermitsPage)
    await operator.sees("no permit waits for an answer", "waits for no answer any more")
    await operator.press("escape")
    await operator.at(MainPage)
    await operator.until(lambda: "permit waits" not in operator.text, "none waits")


async def test_a_choice_whose_permit_has_gone_asks_about_no_other_one(
    operator: Operator, permits: PermitFiles
) -> None:
    permits.ask(asked("aaaaaaaa"))
    permits.ask(asked("bbbbbbbb", 0.7))
    await operator.sees("2 permits wait: P")
    await operator.press("P")
    page = await operator.at(PermitsPage)
    permits.answer("aaaaaaaa", yes=False, by="bert@pts/9")
    page.query_one(RowList).action_select()
    operator.app.store.take_permits(permits.waiting(), operator.app.now(), "")
    page._look()
    await operator.settled()
    await operator.at(PermitsPage)


async def test_who_may_not_command_the_robot_cannot_say_yes(
    realm: Realm, operate: Operate, permits: PermitFiles
) -> None:
    realm.realm_client.gate.policy = read_policy(
        f"realm: test\nversion: 1\npersons: {{'{user_name(os.geteuid())}': looker}}\n"
        "roles: {looker: {see: '*'}}\n"
    )
    permits.ask(asked("aaaaaaaa"))
    async with operate(realm.realm_client) as operator:
        await operator.sees("1 permit waits")
        await operator.press("P", "enter")
        page = await operator.at(PermitDialog)
        await operator.sees("may not command")
        assert not page.query("#allow")
        await operator.press("tab", "enter")
        await operator.until(lambda: permits.find("aaaaaaaa").state == "denied", "anybody may say no")


async def test_it_is_a_question_in_the_list_for_users(
    realm: Realm, operate: Operate, permits: PermitFiles
) -> None:
    permits.ask(replace(asked("aaaaaaaa"), why="it is late"))
    async with operate(realm.realm_client, size=(60, 30), kind=UserApp) as operator:
        await operator.sees("Questions", "May claude do this?", "it is late")
        operator.one(OptionList, "#can").highlighted = 1
        await operator.press("enter")
        await operator.at(PermitDialog)
        await operator.press("tab", "enter")
        await operator.until(lambda: permits.find("aaaaaaaa").state == "allowed", "it is allowed")
        await operator.at(UserPage)
        await operator.until(lambda: "May claude" not in operator.text, "the question is answered")


async def test_a_yes_that_a_stop_has_made_useless_is_not_given(realm: Realm, permits: PermitFiles) -> None:
    client = realm.realm_client
    robot = await client.describe("arm-1")
    life = {"life": robot.address.key, "stops": robot.stops}
    permits.ask(replace(asked("aaaaaaaa"), **life))
    permits.ask(replace(asked("bbbbbbbb", 0.6), **life))
    permits.ask(replace(asked("cccccccc", 0.7), life="robot/arm-1/another", stops=robot.stops))

    async def answered(permit: str) -> str:
        outcome = await carry_out(client, Surface(Where.SCRIPT).parse(["permit", "allow", permit]), Silent())
        return str(outcome) if isinstance(outcome, Refusal) else outcome.text

    assert "may begin, once" in await answered("aaaaaaaa")
    await client.stop("arm-1")
    await client.resume("arm-1")
    assert "arm-1 was stopped since it was asked for; the assistant has to ask again" in await answered(
        "bbbbbbbb"
    )
    assert permits.find("bbbbbbbb").state == "waits"
    assert "arm-1 was started anew since it was asked for" in await answered("cccccccc")


ASKS = """
script: asker
doc: Asks who may come in.
hears:
  ring: {who: text}
rules:
  - rule: ask
    when: [ring: {who: $w}]
    then:
      - ask: {question: "May $w come in?", answers: [yes, later]}
        as: $w
  - rule: free
    when: [ring: {who: nobody}]
    then: [ask: What shall I say?]
  - rule: hear
    when: [answered: {answer: $a, by: $by, conversation: $w}]
    then: [log: "$by says $a"]
"""


async def test_a_question_of_a_script_is_asked_and_answered(realm: Realm, operate: Operate) -> None:
    agent = await realm.robot(Bundle(ASKS, "asker.yaml").create("asker"))
    client, said = realm.realm_client, agent.runtime.log.since
    running = asyncio.ensure_future(client.call("asker", "start", {}, deadline=600.0))
    async with operate(client, kind=UserApp, size=(40, 20)) as operator:
        await operator.until(lambda: agent.description().attributes.get("condition") == "active", "it runs")
        await client.call("asker", "ring", {"who": "Anna"}, deadline=60.0)
        await operator.sees("Questions", "May Anna come in?", "asker asks")
        await operator.press("home", "enter")
        await operator.sees("Later", "yes", "later")
        await operator.press("tab", "enter")
        await operator.until(lambda: any(line.text.endswith(" says yes") for line in said(0)), "the answer")
        await operator.until(lambda: "May Anna" not in operator.text, "it is asked no more")
        await client.call("asker", "ring", {"who": "nobody"}, deadline=60.0)
        await operator.sees("May nobody come in?")
        outcome = await carry_out(client, Surface(Where.SCRIPT).parse(["questions"]), Silent())
        assert isinstance(outcome, Outcome)
        assert outcome.data[0]["answers"] == ["yes", "later"]
        assert "decide asker yes|later" in outcome.text
        done = await carry_out(client, Surface(Where.SCRIPT).parse(["decide", "asker", "later"]), Silent())
        assert isinstance(done, Outcome), done
        await operator.sees("? What shall I say?")  # its row, not the line that tells of it
        await operator.press("home", "enter")
        await operator.until(lambda: isinstance(operator.app.focused, Input), "the field")
        await operator.type("good day")
        await operator.press("enter")
        await operator.until(lambda: any("says good day" in line.text for line in said(0)), "the free answer")
    await client.call("asker", "finish", {}, deadline=60.0)
    await running


async def test_an_operator_is_told_of_a_question_and_how_it_is_answered(
    realm: Realm, operate: Operate
) -> None:
    agent = await realm.robot(Bundle(ASKS, "asker.yaml").create("asker"))
    client, said = realm.realm_client, agent.runtime.log.since
    running = asyncio.ensure_future(client.call("asker", "start", {}, deadline=600.0))
    async with operate(client) as operator:
        await operator.until(lambda: agent.description().attributes.get("condition") == "active", "it runs")
        await client.call("asker", "ring", {"who": "Anna"}, deadline=60.0)
        await operator.sees("asker asks: May Anna come in? `decide asker yes|later` answers")
        await operator.obey("decide asker later")
        await operator.until(lambda: any(line.text.endswith(" says later") for line in said(0)), "the answer")
    await client.call("asker", "finish", {}, deadline=60.0)
    await running


async def test_of_the_answers_to_a_doubt_the_dangerous_one_is_red(
    operator: Operator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(QuestionDialog, "_answered", lambda _: "")
    operator.app.push_screen(QuestionDialog(operator.app, AskedQuestion("arm-1", "Was it done?", DOUBT)))
    page = await operator.at(QuestionDialog)
    await operator.sees("I do not know", "It is done", "Again", "End it")
    assert [each.name for each in page.query(Button) if each.variant == "error"] == ["abort"]
