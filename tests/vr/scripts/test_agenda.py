"""Which rule fires next: priority, then the order of the script, then the age of the facts."""

from __future__ import annotations

import pytest

from robotree.vr.scripts.engine import Engine
from robotree.vr.scripts.happening import Happening, order_line
from robotree.vr.scripts.when_then import read_yaml

HEAD = (
    "script: order\nfacts: {cup: {id: none, state: table}, guest: {who: none}}\n"
    "hears: {go: {}, come: {who: text}}\n"
    "begin with:\n  - cup: {id: a}\n  - cup: {id: b}\n  - cup: {id: c}\nrules:\n"
)


def logged(rules: str, *happenings: Happening) -> list[str]:
    engine = Engine(read_yaml(HEAD + rules, "order.yaml"))
    orders = [order for happening in happenings for order in engine.feed(happening)]
    return [order_line(order).removeprefix("log ") for order in orders]


def rule(name: str, *conditions: str, then: str = "log: $id", priority: int = 0) -> str:
    whens = "".join(f"      - {condition}\n" for condition in conditions)
    return f"  - rule: {name}\n    priority: {priority}\n    when:\n{whens}    then:\n      - {then}\n"


CUP = "cup: {id: $id}"


@pytest.mark.parametrize("conditions", [("go", CUP), (CUP, "go")], ids=["happening first", "happening last"])
def test_the_oldest_fact_is_first_wherever_its_condition_stands(conditions: tuple[str, str]) -> None:
    assert logged(rule("all", *conditions), Happening(act="go")) == ["a", "b", "c"]


def test_of_two_rules_the_higher_one_in_the_script_is_first_and_a_priority_goes_before() -> None:
    rules = (
        rule("one", "go", CUP, then='log: "1 $id"')
        + rule("two", "go", CUP, then='log: "2 $id"')
        + rule("urgent", "go", then="log: urgent", priority=3)
        + rule("last", "go", then="log: last", priority=-3)
    )
    wanted = ["urgent", '"1 a"', '"1 b"', '"1 c"', '"2 a"', '"2 b"', '"2 c"', "last"]
    assert logged(rules, Happening(act="go")) == wanted


def test_a_fact_that_was_changed_keeps_its_age() -> None:
    change = "  - rule: change\n    when:\n      - come\n      - cup: {id: a}\n        as: c\n"
    rules = change + "    then: [update c: {state: used}]\n" + rule("all", "go", CUP)
    assert logged(rules, Happening(act="come", arguments=("x",)), Happening(act="go")) == ["a", "b", "c"]


def test_what_a_rule_causes_waits_until_those_before_it_have_fired_unless_it_is_more_urgent() -> None:
    guest = "remember: {guest: {who: $id}}"
    rules = rule("all", "go", CUP, then=guest) + rule("seen", "guest: {who: $id}")
    assert logged(rules, Happening(act="go")) == ["a", "b", "c"]
    both = rule("all", "go", CUP, then="log: $id\n      - " + guest)
    urgent = both + rule("seen", "guest: {who: $id}", then='log: "seen $id"', priority=1)
    assert logged(urgent, Happening(act="go")) == ["a", '"seen a"', "b", '"seen b"', "c", '"seen c"']
