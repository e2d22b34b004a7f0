"""A machine that plays against groups: carts come, go and change, groups are made and ended, orders given.

Whoever is in a group when an order is given has it once, nobody else has it, and each member has one answer:
a member that refuses or is away keeps it from no other one.
"""

from __future__ import annotations

import asyncio
import tempfile
from collections.abc import Coroutine
from pathlib import Path
from typing import Any, TypeVar

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from robotree.tui.line.action import Where
from robotree.tui.line.carrying import Refusal, Silent, carry_out
from robotree.tui.line.surface import Surface
from robotree.vr import Robot, command
from robotree.vr.network.policy_file import PolicyFile
from robotree.vr.world.virtual_loop import VirtualLoop
from robotree.vr.world.virtual_runner import VirtualRunner
from tests.vr.orders.conftest import Stage

NAMES = ("c1", "c2", "c3", "c4")
PLACES = ("hall", "shed")
RULES = {
    "battery > 50": lambda cart: cart.battery > 50,
    "near hall": lambda cart: cart.place == "hall",
    "battery > 50 & near shed": lambda cart: cart.battery > 50 and cart.place == "shed",
    "not near shed": lambda cart: cart.place != "shed",
}
"""Rules, and who fulfils them."""
GROUPS = ("g1", "g2")

R = TypeVar("R")


class Cart(Robot):
    """A cart that refuses what is too heavy."""

    def __init__(self, name: str, battery: float, place: str) -> None:
        super().__init__(name, {"place": place})
        self.battery, self.place = battery, place
        self.loads: list[float] = []
        self.stops = 0

    def readings(self) -> dict[str, float]:
        return {"battery": self.battery}

    def safe_stop(self, reason: str) -> None:
        del reason
        self.stops += 1

    @command
    def load(self, kilos: float) -> None:
        """Take something on."""
        self.loads.append(kilos)
        if kilos > self.battery:
            raise ValueError("too heavy")


class GroupMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.loop = VirtualLoop(VirtualRunner())
        self.folder = tempfile.TemporaryDirectory()
        self.carts: dict[str, Cart] = {}
        self.agents: dict[str, Any] = {}
        self.groups: dict[str, tuple[tuple[str, ...], str]] = {}
        self.given = 0
        self.run(self._open())

    async def _open(self) -> None:
        self.stage = Stage(Path(self.folder.name))
        self.stage.network.gate = PolicyFile(Path(self.folder.name))
        await self.stage.directory("d1")
        self.person = await self.stage.person()

    def run(self, work: Coroutine[Any, Any, R]) -> R:
        asyncio.set_event_loop(self.loop)
        return self.loop.run_until_complete(work)

    def say(self, *words: str) -> Any:
        """Carry a line out; returns its plain data, or the refusal."""

        async def say() -> Any:
            found = await carry_out(self.person, Surface(Where.SCRIPT).parse(words), Silent())
            return found if isinstance(found, Refusal) else found.data

        return self.run(say())

    def members(self, group: str) -> set[str]:
        """Whom a group has now, those by name also while they are away."""
        names, rule_ = self.groups[group]
        return {*names} | {name for name, cart in self.carts.items() if rule_ and RULES[rule_](cart)}

    # -- what happens -----------------------------------------------------------------------------

    @rule(name=st.sampled_from(NAMES), battery=st.sampled_from([20.0, 80.0]), place=st.sampled_from(PLACES))
    def a_cart_comes_or_changes(self, name: str, battery: float, place: str) -> None:
        async def come() -> None:
            cart = Cart(name, battery, place)
            self.agents[name] = await self.stage.robot(cart, identity=f"{name}-for-life")
            self.carts[name] = cart
            await self.stage.until(lambda: bool(self.person.directory.present("robot", name)))

        if name in self.carts:
            self.carts[name].battery = battery
            self.run(asyncio.sleep(0.5))
        else:
            self.run(come())

    @precondition(lambda self: self.carts)
    @rule(name=st.sampled_from(NAMES))
    def a_cart_goes(self, name: str) -> None:
        async def go() -> None:
            await self.stage.switch_off(self.agents.pop(name))
            await self.stage.until(lambda: not self.person.directory.present("robot", name))

        if self.carts.pop(name, None) is not None:
            self.run(go())

    @rule(
        group=st.sampled_from(GROUPS),
        names=st.sets(st.sampled_from(NAMES), max_size=3),
        where=st.sampled_from(["", *RULES]),
    )
    def make_a_group(self, group: str, names: set[str], where: str) -> None:
        if not (names or where):
            return
        data = self.say("group", group, *sorted(names), *(["--where", where] if where else []))
        self.groups[group] = tuple(sorted(names)), where
        assert {one["name"] for one in data["members"]} == self.members(group)

    @precondition(lambda self: self.groups)
    @rule(group=st.sampled_from(GROUPS))
    def end_a_group(self, group: str) -> None:
        ended = self.say("group", group, "--delete")
        assert isinstance(ended, Refusal) == (group not in self.groups)
        self.groups.pop(group, None)

    @precondition(lambda self: self.groups)
    @rule(group=st.sampled_from(GROUPS), heavy=st.booleans())
    def have_all_carry(self, group: str, *, heavy: bool) -> None:
        if group not in self.groups:
            return
        self.given += 1
        kilos = 60.0 + self.given / 1000 if heavy else 10.0 + self.given / 1000
        members = self.members(group)
        data = self.say("call", f"{group}.load", f"kilos={kilos}")
        had = {name for name, cart in self.carts.items() for one in cart.loads if one == kilos}
        assert had == members & self.carts.keys(), "who is there and a member has it, and nobody else"
        assert all(cart.loads.count(kilos) <= 1 for cart in self.carts.values())
        if not members:
            assert isinstance(data, Refusal)
            return
        answers = {one["name"]: one["ok"] for one in data["members"]}
        able = {name for name, cart in self.carts.items() if cart.battery >= kilos}
        assert answers == {name: name in able for name in members}, "one answer of each"

    @precondition(lambda self: self.groups)
    @rule(group=st.sampled_from(GROUPS))
    def stop_and_resume(self, group: str) -> None:
        if group not in self.groups:
            return
        before = {name: cart.stops for name, cart in self.carts.items()}
        members = self.members(group)
        self.say("stop", group)
        stopped = {name for name, cart in self.carts.items() if cart.stops > before[name]}
        assert stopped == members & self.carts.keys()
        self.run(asyncio.sleep(1))
        self.say("resume", group)
        held = self.run(self.person.orders.board()).holds
        assert not [hold for hold in held if hold.robot in members], "what was held is free again"

    def teardown(self) -> None:
        self.run(self.stage.close())
        self.folder.cleanup()


TestGroups = GroupMachine.TestCase
TestGroups.settings = settings(max_examples=15, stateful_step_count=12, deadline=None)
