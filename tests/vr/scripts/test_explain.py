"""What is told about a rule that fired, and about one that does not fire, uses the words of its script."""

from __future__ import annotations

import pytest

from robotree.vr.scripts import explain
from robotree.vr.scripts.clp import read_clp
from robotree.vr.scripts.engine import Engine
from robotree.vr.scripts.explain import in_words
from robotree.vr.scripts.trial import Rehearsal
from robotree.vr.scripts.when_then import read_yaml
from tests.vr.scripts.stage import EXAMPLES

HEAD = """
script: small
partners: {robot: Companion}
parameters: {most: 2}
hears: {bell: {who: text, times: number}}
facts: {count: {guests: 0}, cup: {id: none, stage: full}}
begin with: [{count: {guests: 1}}, {cup: {id: a}}, {cup: {id: b, stage: empty}}]
rules:
- rule: r
  then: [log: x]
  when:
  - """


@pytest.mark.parametrize(
    ("when", "told"),
    [
        ("count: {guests: {above: 3}}", "no fact fits; the nearest is count: {guests: 1}"),
        ("count: {guests: {above: $most}}", "no fact fits; the nearest is count: {guests: 1}"),
        ("cup: {id: a, stage: empty}", "no fact fits; the nearest is cup: {id: b, stage: empty}"),
        ("no cup: {id: a}", "there is such a fact, and there must be none"),
        ("no cup: {id: $any}", "there is such a fact, and there must be none"),
        ("if: $most > 3", "this is not true"),
        ("bell: {who: $who}", "this has not just happened"),
        ("role: {name: child}", "there is no fact role"),
    ],
)
def test_a_rule_that_does_not_fire_names_its_condition_and_what_it_lacks(when: str, told: str) -> None:
    engine = Rehearsal(read_yaml(HEAD + when, "s.yaml")).engine
    assert explain.why(engine, "r").splitlines() == [
        "r does not fire now:",
        f"  line 12: {when}",
        f"    {told}",
    ]


@pytest.mark.parametrize(
    ("second", "told"),
    [
        ("cup: {id: a, stage: $s}", "no fact fits this together with the conditions above it"),
        ("no cup: {stage: $s}", "there is such a fact, and there must be none"),
    ],
)
def test_conditions_that_only_fail_together_name_the_first_that_does_not_fit(second: str, told: str) -> None:
    source = f"{HEAD}cup: {{id: b, stage: $s}}\n  - {second}"
    engine = Rehearsal(read_yaml(source, "s.yaml")).engine
    assert explain.why(engine, "r").splitlines()[1:] == [f"  line 13: {second}", f"    {told}"]


def test_a_rule_that_fired_names_what_made_it_fire() -> None:
    rehearsal = Rehearsal(read_yaml((EXAMPLES / "guide.yaml").read_text(), "guide.yaml"))
    rehearsal.play('person_seen "Mister Li" hall')
    told = explain.why(rehearsal.engine, "note-a-visitor").splitlines()
    assert told[:3] == [
        "note-a-visitor fired last at happening 3 of 3, because of",
        '  person_seen: {who: "Mister Li", place: hall, from: operator}',
        "  no visitor: {id: $who}",
    ]
    shown = explain.state(rehearsal.engine)
    assert 'visitor: {id: "Mister Li", place: hall, stage: greeted}' in shown
    assert "parameters: {welcome: Welcome}" in shown, "as the head of the script writes it"


@pytest.mark.parametrize(
    ("line", "shown"),
    [
        ("start", "start"),
        ("bell Anna 3", "bell: {who: Anna, times: 3, from: operator}"),
        ("done robot say hi as Anna", "done: {partner: robot, act: say, result: hi, conversation: Anna}"),
        ('failed robot say "too hot"', 'failed: {partner: robot, act: say, reason: "too hot"}'),
        ("progress robot go_to 0.5", "progress: {partner: robot, act: go_to, fraction: 0.5}"),
        ("lost robot", 'lost: {partner: robot, robot: robot, reason: "it was lost"}'),
        ("timer bored as Anna", "timer: {name: bored, conversation: Anna}"),
    ],
)
def test_what_happened_is_shown_as_a_condition_would_name_it(line: str, shown: str) -> None:
    source = HEAD.replace("  - ", "  - message: {act: $act}")
    rehearsal = Rehearsal(read_yaml(source, "s.yaml"))
    assert not rehearsal.play(line).fault
    assert explain.why(rehearsal.engine, "r").splitlines()[1] == f"  {shown}"


def test_the_rules_that_fire_next_are_named() -> None:
    engine = Engine(
        read_yaml(
            f"{HEAD}no role: {{name: child}}".replace("- rule: r", "- rule: r\n  priority: 5"), "s.yaml"
        )
    )
    assert "\nnext (1):\n  r\n" in explain.state(engine)


def test_an_expert_reads_clips() -> None:
    source = "(deftemplate cup (slot id)) (defrule r (msg (act start)) (not (cup (id a))) => (log x))"
    engine = Engine(read_clp(source, "s.clp", "s"))
    assert explain.why(engine, "r").splitlines()[1:] == [
        "  line 1: (msg (act start))",
        "    this has not just happened",
    ]
    assert in_words("(cup (id a))", engine.program) == "(cup (id a))"
