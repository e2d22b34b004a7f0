"""The evening's rules with a robot that fails, is stopped, lost and released: seeds decide when."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from robotree.vr.scripts.engine import Engine
from robotree.vr.scripts.explain import parts
from robotree.vr.scripts.happening import CancelAct, Do, Happening, ScriptOrder, Wait
from robotree.vr.scripts.program import Program
from robotree.vr.scripts.when_then import read_yaml

PAGE = Path(__file__).parents[3] / "examples" / "companion" / "evening.yaml"
CUPS = ("blue cup", "green cup", "red cup")
PEOPLE = ("anna", "bela", "cleo")
HANDS = ("left", "right")
FAULTS = 0.25
"""Share of the acts that fail."""
UNREST, REST = 120, 600
"""Steps with faults, and at most after them."""


@cache
def program() -> Program:
    return read_yaml(PAGE.read_text(), PAGE.name)


class Story:
    """A script, its robot, and where the cups really are.

    Args:
        seed: decides what happens when.
    """

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.engine = Engine(program())
        self.places: dict[str, str] = dict.fromkeys(CUPS, "table")
        self.people = set[str]()
        """Who is in the flat."""
        self.state, self.faults, self.now = "here", True, 0.0
        self.acts: list[Do] = []
        self.questions: list[Do] = []
        self.timers: list[tuple[float, Wait]] = []
        self.inbox = [Happening(act="start"), self.partner("found")]

    # -- what happens

    def unrest(self) -> None:
        """One thing happens."""
        happens = {
            self.tell: 8,
            self.end_of_an_act: 6,
            self.answer: 6,
            self.somebody_comes: 1,
            self.somebody_goes: 0.2,
            self.wait: 2,
            (self.interrupt if self.state == "here" else self.go_on): 1,
        }
        self.chance.choices([*happens], [*happens.values()])[0]()

    def rest(self) -> None:
        """Go on without faults until nothing is left to do."""
        self.faults = False
        if self.state != "here":
            self.go_on()
        for _ in range(REST):
            if self.inbox:
                self.tell()
            elif self.questions:
                self.answer()
            elif self.acts:
                self.end_of_an_act()
            elif self.timers:
                self.wait()
            else:
                return
        raise AssertionError("it does not come to rest")

    def somebody_comes(self) -> None:
        who = self.chance.choice(PEOPLE)
        self.people.add(who)
        self.inbox.append(Happening(act="person_seen", arguments=(who,), sender="operator"))

    def somebody_goes(self) -> None:
        for who in sorted(self.people)[:1]:
            self.people.discard(who)
            self.inbox.append(Happening(act="person_left", arguments=(who,), sender="operator"))

    def wait(self) -> None:
        """Let time pass until the next timer."""
        self.now = max(self.now, min((at for at, _ in self.timers), default=self.now))
        for at, timer in [one for one in self.timers if one[0] <= self.now]:
            self.timers.remove((at, timer))
            self.inbox.append(
                Happening(act="timer", arguments=(timer.name,), conversation=timer.conversation)
            )

    def interrupt(self) -> None:
        """The robot is stopped, or lost: what it does ends there, and so does what waits."""
        change = self.chance.choice(("stopped", "lost"))
        self.state = "stopped" if change == "stopped" else "missing"
        if self.acts and self.acts[0].act in {"take", "give", "put"}:
            self.carry_out(self.acts[0])
        ended, self.acts, self.questions = [*self.acts, *self.questions], [], []
        told = [self.failure(order, change) for order in ended]
        told.insert(self.chance.choice((0, len(told))), self.partner(change))
        self.inbox += told

    def go_on(self) -> None:
        self.inbox.append(self.partner("released" if self.state == "stopped" else "found"))
        self.state = "here"

    def partner(self, change: str) -> Happening:
        robot = "" if change == "lost" else "companion"
        return Happening(
            act=change, sender="robot", partner="robot", robot=robot, arguments=("companion", change)
        )

    # -- what the robot does

    def end_of_an_act(self) -> None:
        if self.acts:
            order = self.acts.pop(0)
            failure = self.carry_out(order)
            self.inbox.append(
                self.failure(order, failure)
                if failure
                else Happening(
                    act="done", sender="robot", arguments=(order.act,), conversation=order.conversation
                )
            )

    def answer(self) -> None:
        """Say where a cup really is."""
        if self.questions:
            order = self.questions.pop(0)
            place = self.places[str(order.named["what"])]
            self.inbox.append(
                Happening(
                    act="done", sender="robot", arguments=("where", place), conversation=order.conversation
                )
            )

    def carry_out(self, order: Do) -> str:
        """Move a cup; returns why the act fails nevertheless, empty: it does not."""
        fails = self.faults and self.chance.random() < FAULTS
        held = [cup for hand in HANDS for cup in CUPS if self.places[cup] == hand]
        match order.act:
            case "take":
                cup = str(order.named["what"])
                assert not held, "one cup at a time"
                if self.places[cup] != "table":
                    return "it is not there"
                self.places[cup] = self.chance.choice(("table", "floor", "left") if fails else HANDS)
            case "put" | "give" if not held:
                return "both hands are empty"
            case "put":
                self.places[held[0]] = self.chance.choice(("table", "floor", "left")) if fails else "table"
            case "give":
                who = str(order.named["who"])
                if who not in self.people:
                    return "nobody holds out a hand"
                self.places[held[0]] = self.chance.choice(("floor", "left", who)) if fails else who
            case _:
                pass
        return "it went wrong" if fails else ""

    def failure(self, order: Do, reason: str) -> Happening:
        return Happening(
            performative="failure",
            act=order.act,
            sender="robot",
            arguments=(reason,),
            conversation=order.conversation,
        )

    # -- what the rules do

    def tell(self) -> None:
        """Tell the rules the oldest that has happened, and carry out what they want."""
        if self.inbox:
            for order in self.engine.feed(self.inbox.pop(0)):
                self.obey(order)
            meant = Counter(cup["for"] for cup in self.facts("cup") if cup["for"] != "nobody")
            assert max(meant.values(), default=0) <= 1, f"two cups for one visitor: {self.facts('cup')}"

    def obey(self, order: ScriptOrder) -> None:
        match order:
            case Do() if self.state != "here":
                self.inbox.append(self.failure(order, self.state))
            case Do(act="where"):
                self.questions.append(order)
            case Do():
                self.acts.append(order)
            case Wait(seconds=seconds):
                self.timers.append((self.now + seconds, order))
            case CancelAct(what=who):
                if self.acts and self.acts[0].conversation == who:
                    self.carry_out(self.acts[0])
                self.acts = [act for act in self.acts if act.conversation != who]
                self.timers = [timer for timer in self.timers if timer[1].conversation != who]
            case _:
                pass

    def facts(self, kind: str) -> Sequence[dict[str, Any]]:
        read = (parts(fact) for fact in self.engine.facts())
        return [{name: values[0] for name, values in slots.items()} for of, slots in read if of == kind]


def evening(seed: int) -> None:
    """Play one, and see that it ends well."""
    story = Story(seed)
    for _ in range(UNREST):
        story.unrest()
    story.rest()
    visitors = {visitor["who"]: visitor["stage"] for visitor in story.facts("visitor")}
    assert set(visitors.values()) <= {"over"}, f"seed {seed}: {visitors}, {story.facts('cup')}"
    booked = {cup["what"]: cup["place"] for cup in story.facts("cup")}
    assert booked == story.places, f"seed {seed}"
    given = Counter(place for place in booked.values() if place in PEOPLE)
    assert max(given.values(), default=0) <= 1, f"seed {seed}: {booked}"
    assert not set(HANDS) & set(booked.values()), f"seed {seed}: {booked}"


def test_every_visitor_is_done_with_and_every_cup_is_where_it_is_booked() -> None:
    for seed in range(40):
        evening(seed)


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_every_visitor_is_done_with_on_two_thousand_evenings() -> None:
    for seed in range(2000):
        evening(seed)
