"""A script asks a person: at the page for users, on the command line and on the screen of operators."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

import pytest
from textual.widgets import Button, Input

from robotree.tui.line.action import Where
from robotree.tui.line.carrying import Silent, carry_out
from robotree.tui.line.surface import Surface
from robotree.tui.line.verbs import Outcome
from robotree.tui.screen.pages.permits import QuestionDialog
from robotree.tui.screen.user_app import UserApp
from robotree.tui.seen.asked import DOUBT, AskedQuestion
from robotree.vr.bundle import Bundle

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


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
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(QuestionDialog, "_answered", lambda _: "")
    async with operate(realm.realm_client) as operator:
        operator.app.push_screen(QuestionDialog(operator.app, AskedQuestion("arm-1", "Was it done?", DOUBT)))
        page = await operator.at(QuestionDialog)
        await operator.sees("I do not know", "It is done", "Again", "End it")
        assert [each.name for each in page.query(Button) if each.variant == "error"] == ["abort"]
