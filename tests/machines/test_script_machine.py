"""Partners that come and go, acts that end in any order: what the rules know is always what is so."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from robotree.vr.author import context
from robotree.vr.base.address import Address
from robotree.vr.base.description import CommandSpec, RobotDescription
from robotree.vr.base.errors import CommandFailed, SlotEmpty, VrError
from robotree.vr.core.bonds import Bond, HeldLease
from robotree.vr.scripts.explain import parts
from robotree.vr.scripts.happening import Happening
from robotree.vr.scripts.run import ScriptRun
from robotree.vr.scripts.script import Script, script_class
from robotree.vr.scripts.when_then import read_yaml

SOURCE = """
script: pair
partners:
  left: {kind: Arm, needs: [wave]}
  right: {kind: Arm, optional: yes}
hears: {go: {who: text}}
rules:
  - rule: go-left
    when: [go: {who: left}, partner: {name: left, state: here}]
    then: [do: left.wave]
  - rule: go-right
    when: [go: {who: right}, partner: {name: right, state: here}]
    then: [do: right.wave]
  - rule: lost
    when: [lost: {partner: $p}]
    then: [log: $p]
  - rule: failed
    when: [failed: {partner: $p}]
    then: [log: $p]
""".replace("[go: {who: left}, partner:", "[{go: {who: left}}, {partner:").replace(
    "[go: {who: right}, partner:", "[{go: {who: right}}, {partner:"
).replace("state: here}]", "state: here}}]")  # fmt: skip


class Act:
    """An act that the test ends."""

    def __init__(self, slot: str) -> None:
        self.slot, self.error, self.cancelled = slot, None, False
        self.progress = math.nan
        self.done = False
        self._tell: Callable[[], None] = lambda: None

    def when_done(self, tell: Callable[[], None]) -> None:
        self._tell = tell

    def end(self, error: VrError | None = None) -> None:
        self.done, self.error = True, error
        self._tell()

    def get(self, _timeout: float) -> None:
        if self.error is not None:
            raise self.error

    def cancel(self) -> None:
        self.cancelled = True


class Activity:
    """The running command `start`."""

    cancelled = False

    simulated = True

    def __init__(self, robot: Script) -> None:
        self.robot, self.acts, self.said = robot, [], ""

    def in_this_thread(self) -> Activity:
        return self

    def check(self) -> None: ...

    def wake(self) -> None: ...

    def published(self, _slot: str) -> None:
        """Nothing yet."""

    def say(self, _level: str, text: str, **_options: object) -> None:
        self.said = text

    def now(self) -> float:
        return 0.0

    def receive(self, look: Callable[[], Any], _every: float) -> Any:
        return look()

    def progress(self, _fraction: float, text: str) -> None:
        self.said = text

    def start(self, slot: str, _command: str, _arguments: Mapping[str, Any], _limit: object = None) -> Act:
        assert self.robot.child_slots[slot].bond is not None, "an act of a partner that is not there"
        self.acts.append(act := Act(slot))
        return act


class PartnersThatComeAndGo(RuleBasedStateMachine):
    @initialize()
    def begin(self) -> None:
        self.robot = script_class(read_yaml(SOURCE, "pair.yaml"))("pair")
        self.activity = Activity(self.robot)
        context.enter(self.activity)
        self.run = ScriptRun(self.robot, self.robot.program, {}, self.activity)
        self.robot._run = self.run
        self.count = 0
        self.drain()

    def teardown(self) -> None:
        context._running.set(None)  # type: ignore[arg-type] # the thread is pytest's, and other tests follow

    def drain(self) -> None:
        """Let the thread of the script do all that there is to do."""
        while (happening := self.run.look()) is not None:
            self.run.take(happening)

    def bound(self, slot: str) -> bool:
        return self.robot.child_slots[slot].bond is not None

    slots = st.sampled_from(["left", "right"])

    @rule(slot=slots, able=st.booleans())
    def comes(self, slot: str, *, able: bool) -> None:
        if self.bound(slot):
            return
        self.count += 1
        child = Address("robot", f"arm-{self.count}", "1")
        commands = (CommandSpec(name="wave"),) if able else ()
        robot = RobotDescription(address=child, kinds=("Arm",), commands=commands)
        lease = HeldLease.begin(epoch=self.count, term=5.0, sent=0.0, now=0.0)
        self.robot.child_slots.begin(slot, child)
        self.robot.child_slots.bind(slot, Bond(child=child, lease=lease, description=robot))
        self.drain()

    @rule(slot=slots, politely=st.booleans())
    def goes(self, slot: str, *, politely: bool) -> None:
        if not self.bound(slot):
            return
        if politely:
            self.robot.child_slots.free(slot)
        else:
            bond = self.robot.child_slots.require(slot)
            self.robot.child_slots.lose(slot, bond.child, bond.lease.epoch, "its host has died")
        for act in self.activity.acts:  # as the agent does it
            if act.slot == slot and not act.done:
                act.end(SlotEmpty(robot="pair", slot=slot, reason="gone", kind="Arm"))
        self.drain()

    @rule(slot=slots)
    def asked(self, slot: str) -> None:
        if len([act for act in self.activity.acts if not act.done]) < 60:
            self.run.put(Happening(act="go", sender="op", arguments=(slot,)))
            before = len(self.activity.acts)
            self.run._orders = 0  # the flood is another test
            self.drain()
            assert len(self.activity.acts) == before + self.fit(slot)

    @precondition(lambda self: any(not act.done for act in self.activity.acts))
    @rule(data=st.data(), well=st.booleans())
    def ends(self, data: st.DataObject, *, well: bool) -> None:
        act = data.draw(st.sampled_from([act for act in self.activity.acts if not act.done]))
        act.end(None if well else CommandFailed(robot="arm", command="wave", detail="hot"))
        self.drain()

    def fit(self, slot: str) -> bool:
        bond = self.robot.child_slots[slot].bond
        return bond is not None and (slot == "right" or bool(bond.description.commands))

    @invariant()
    def the_rules_know_who_is_there(self) -> None:
        if not hasattr(self, "run"):
            return
        known = [parts(fact) for fact in self.run.engine.facts()]
        told = {slots["name"][0]: slots["state"][0] for kind, slots in known if kind == "partner"}
        assert told == {slot: "here" if self.fit(slot) else "missing" for slot in ("left", "right")}
        assert (self.robot.condition == "active") == self.fit("left")
        assert self.robot.condition.startswith("inactive: needs left (Arm)") != self.fit("left")

    @invariant()
    def no_act_is_forgotten(self) -> None:
        if hasattr(self, "run"):
            assert len(self.run._acts) == sum(not act.done for act in self.activity.acts)
            messages = [fact for fact in self.run.engine.facts() if fact.startswith("(msg")]
            assert not messages, "a message is gone when the rules have come to rest"


PartnersThatComeAndGo.TestCase.settings = settings(max_examples=25, stateful_step_count=20, deadline=None)
TestPartnersThatComeAndGo = PartnersThatComeAndGo.TestCase
