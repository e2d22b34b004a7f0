"""The rules of a script do the same each time, whatever happens in which order."""

from __future__ import annotations

import random

import pytest

from robotree.vr.scripts.engine import Engine
from robotree.vr.scripts.happening import Happening, ScriptOrder
from robotree.vr.scripts.program import Program
from robotree.vr.scripts.when_then import read_yaml

SCRIPT = """
script: shunter
partners:
  left: {kind: CartProxy, needs: [drive]}
  right: {kind: CartProxy, optional: yes}
facts:
  count: {asked: 0}
hears: {go: {ticket: number}}
start: {itself: yes}
begin with:
  - count: {asked: 0}
rules:
  - rule: go
    when:
      - go: {ticket: $t}
      - count: {asked: $n}
        as: c
    then:
      - update c: {asked: = $n + 1}
      - do: left.drive
        with: {ticket: = $t * 10, seconds: 0.4}
        as: $t
  - rule: then-right
    when:
      - done: {partner: left}
      - partner: {name: right, state: here}
      - count: {asked: $n}
    then:
      - do: right.drive
        with: {ticket: = $n + 1000, seconds: 0.4}
  - rule: driven
    when: [{done: {partner: $p}}]
    then: [log: "driven by $p"]
  - rule: failed
    when: [{failed: {partner: $p}}]
    then: [log: "failed $p"]
  - rule: lost
    when: [{lost: {partner: $p}}]
    then: [log: "lost $p"]
"""
HAPPENINGS = (
    Happening(act="start"),
    Happening(act="found", sender="left", partner="left", robot="cart-1", arguments=("cart-1",)),
    Happening(act="found", sender="right", partner="right", robot="cart-2", arguments=("cart-2",)),
    Happening(act="lost", sender="right", partner="right", arguments=("cart-2", "it has ended")),
    Happening(act="go", sender="operator", arguments=(1.0,)),
    Happening(act="go", sender="operator", arguments=(2.0,)),
    Happening(act="done", sender="left", arguments=("drive", 10.0), conversation="1"),
    Happening(performative="failure", act="drive", sender="left", arguments=("hot",), conversation="2"),
)


@pytest.mark.parametrize("orders", [50, pytest.param(1000, marks=pytest.mark.soak)])
def test_the_same_facts_in_the_same_order_give_the_same_commands(orders: int) -> None:
    """In random orders of what can happen; rules that are built anew give the same commands again."""
    program = read_yaml(SCRIPT, "shunter.yaml")
    chance = random.Random(7)
    given: set[str] = set()
    for _ in range(orders):
        order = chance.choices(HAPPENINGS, k=6)
        one, other = commands(program, order), commands(program, order)
        assert one == other, order
        given.add(repr(one))
    assert len(given) > 20, "the order matters"


def commands(program: Program, happenings: list[Happening]) -> list[ScriptOrder]:
    """Return what new rules want done, all in all."""
    engine = Engine(program)
    return [order for happening in happenings for order in engine.feed(happening)]
