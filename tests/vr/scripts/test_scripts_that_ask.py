"""A script asks people, and what they answer reaches its rules: once, and also after a crash."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from robotree.vr.base.errors import BrokenScript, CommandFailed
from robotree.vr.scripts.trial import Rehearsal
from robotree.vr.scripts.when_then import read_yaml
from tests.vr.scripts.stage import Stage

ASKS = """
script: asker
hears:
  ring: {who: text}
facts:
  let: {who: none, in: none, by: none}
rules:
  - rule: ask
    when: [ring: {who: $w}]
    then:
      - ask: {question: "May $w come in?", answers: [yes, later]}
        as: $w
  - rule: hear
    when: [answered: {answer: $a, by: $by, conversation: $w}]
    then: [remember: {let: {who: $w, in: $a, by: $by}}]
"""


async def asked(stage: Stage, *names: str) -> tuple[Any, asyncio.Task[Any]]:
    script = await stage.script(ASKS, "asker")
    running = stage.begin("asker")
    await stage.until(lambda: script._run is not None and script._run.engine.happened)
    for name in names:
        await stage.call("asker", "ring", who=name)
    await stage.until(lambda: not names or "question" in script.attributes)
    return script, running


async def test_a_question_is_shown_and_its_answer_reaches_the_rules(stage: Stage) -> None:
    script, running = await asked(stage, "Anna")
    shown = stage.agents["asker"].description().attributes
    assert (shown["question"], shown["answers"]) == ("May Anna come in?", "yes | later")
    with pytest.raises(CommandFailed, match="'perhaps' is no answer to that; there are: yes, later"):
        await stage.call("asker", "answer", answer="perhaps")
    await stage.call("asker", "answer", answer="later", question="Anna")
    await stage.until(lambda: "question" not in script.attributes)
    assert "let: {who: Anna, in: later, by: operator}" in await stage.call("asker", "facts")
    with pytest.raises(CommandFailed, match="that question waits for no answer any more"):
        await stage.call("asker", "answer", answer="yes", question="Anna")
    with pytest.raises(CommandFailed, match="it asks nothing"):
        await stage.call("asker", "answer", answer="yes")
    await stage.call("asker", "finish")
    await running


async def test_several_questions_wait_in_their_order_and_each_has_one_answer(stage: Stage) -> None:
    script, running = await asked(stage, "Anna", "Bela")
    await stage.until(lambda: script.attributes.get("asked") == "and 1 more")
    ends = await asyncio.gather(
        *(stage.call("asker", "answer", answer="yes", question="Anna") for _ in range(4)),
        return_exceptions=True,
    )
    assert sum(end is None for end in ends) == 1, ends
    assert (await stage.call("asker", "facts")).count("let: {who: Anna") == 1
    await stage.until(lambda: script.attributes.get("question") == "May Bela come in?")
    await stage.call("asker", "finish")
    await running
    assert "question" not in script.attributes, "a script that has ended asks nothing"


def test_a_table_of_tests_knows_questions_and_answers() -> None:
    played = Rehearsal(read_yaml(ASKS, "asker.yaml"))
    assert played.play("ring Anna").orders == ('ask "May Anna come in?" yes later',)
    assert played.play("answered yes as Anna").fault == ""
    assert "(let (who Anna) (in yes) (by operator))" in " ".join(played.engine.facts())


NUMBERS = """
script: foreman
hears:
  order: {number: number}
facts:
  open: {number: 0}
rules:
  - rule: ask
    when: [order: {number: $n}]
    then:
      - remember: {open: {number: $n}}
      - ask: "Shall order $n begin?"
        as: $n
      - wait: {name: silence, for: 1 min, conversation: $n}
  - rule: hear
    when: [answered: {answer: $a, conversation: $n}, open: {number: $n}]
    then: [log: "order $n: $a"]
  - rule: give-up
    when: [timer: {name: silence, conversation: $n}, open: {number: $n}]
    then: [cancel: $n, log: "nobody answers of order $n"]
"""


@pytest.mark.parametrize("number", ["7", "2.5"])
def test_what_is_asked_under_a_number_is_heard_under_that_number(number: str) -> None:
    """A conversation is a text on its way, and a number again for the rules."""
    played = Rehearsal(read_yaml(NUMBERS, "foreman.yaml"))
    assert played.play(f"order {number}").fault == ""
    assert played.play(f"answered yes from Anna as {number}").fired == ("hear",)
    assert played.play(f"timer silence as {number}").fired == ("give-up",)


@pytest.mark.parametrize(
    ("action", "reason"),
    [
        ("ask: {answers: [a]}", "the question"),
        ("ask: {question: x, answer: [a]}", "ask has no 'answer'"),
        ("ask: x\n        with: {a: b}", "only `do` has `with`"),
    ],
)
def test_a_question_that_cannot_be_asked_is_refused(action: str, reason: str) -> None:
    source = f"script: s\nrules:\n  - rule: r\n    when: [start]\n    then:\n      - {action}\n"
    with pytest.raises(BrokenScript, match=reason):
        read_yaml(source, "s.yaml")
