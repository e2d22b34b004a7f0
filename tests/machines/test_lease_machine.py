"""Leases against a network that delays, loses, doubles and reorders, and parents that die at any moment."""

from __future__ import annotations

from typing import Literal

import hypothesis.strategies as st
import msgspec
from hypothesis import settings
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, initialize, invariant, multiple, rule

from robotree.vr.base.address import Address
from robotree.vr.base.errors import LeaseDenied, Retracted, StaleEpoch
from robotree.vr.core.bonds import GrantedLease, HeldLease
from tests.machines.checkpoint import decoded

NAMES = ("a", "b")


class Message(msgspec.Struct, frozen=True):
    """A request on its way to the child, or the answer to one on its way back."""

    what: Literal["petition", "retract", "renew", "release", "granted", "refused"]
    parent: str
    sent: float
    """When the request left, on the parent's clock."""
    epoch: int = 0
    term: float = 0.0
    life: int = 0
    """Which incarnation of the parent speaks, or is spoken to."""
    key: str = ""
    """Of the petition."""


class Parent:
    """What one parent believes. Its clock is not the child's."""

    def __init__(self, name: str, offset: float) -> None:
        self.name, self.offset = name, offset
        self.life = 0
        self.given_back = 0
        """Epoch that it has let go: a grant of it that comes late counts no more."""
        self.lease: HeldLease | None = None
        self.petitions = 0
        self.given_up: set[str] = set()

    @property
    def address(self) -> Address:
        return Address("robot", self.name, str(self.life))

    def message(self, what: Literal["petition", "renew", "release"], now: float, epoch: int = 0) -> Message:
        self.petitions += what == "petition"
        return Message(what, self.name, now + self.offset, epoch, life=self.life, key=self.key)

    @property
    def key(self) -> str:
        """Of its latest petition."""
        return f"{self.address}-{self.petitions}"

    def awaits(self, key: str) -> bool:
        """Whether the answer to a petition still counts."""
        return key == self.key and key not in self.given_up

    def believes(self, now: float) -> bool:
        return self.lease is not None and now + self.offset < self.lease.expires


class LeaseMachine(RuleBasedStateMachine):
    on_the_way = Bundle("on_the_way")

    @initialize(
        term=st.sampled_from([1.0, 4.0]),
        offsets=st.tuples(*[st.integers(-1000, 1000)] * 2),
        unix=st.integers(0, 2**31),
    )
    def begin(self, term: float, offsets: tuple[int, ...], unix: int) -> None:
        self.now, self.unix = 0.0, unix
        self.child = GrantedLease.free("child", term=term, unix=unix)
        self.parents = {name: Parent(name, offset) for name, offset in zip(NAMES, offsets, strict=True)}
        self.epochs = [self.child.epoch]
        self.retracted: set[str] = set()

    @rule()
    def go_on_from_the_encoded_states(self) -> None:
        self.child = decoded(self.child)
        for parent in self.parents.values():
            parent.lease = parent.lease and decoded(parent.lease)

    @rule(target=on_the_way, name=st.sampled_from(NAMES))
    def ask(self, name: str) -> Message:
        return self.parents[name].message("petition", self.now)

    @rule(target=on_the_way, name=st.sampled_from(NAMES))
    def renew(self, name: str) -> Message:
        parent = self.parents[name]
        if parent.lease is None:
            return multiple()  # type: ignore[return-value] # hypothesis' way to add nothing
        parent.lease.asked(self.now + parent.offset)
        return parent.message("renew", self.now, parent.lease.epoch)

    @rule(target=on_the_way, name=st.sampled_from(NAMES))
    def let_go(self, name: str) -> Message:
        parent = self.parents[name]
        lease, parent.lease = parent.lease, None
        if lease is None:
            return multiple()  # type: ignore[return-value] # as above
        parent.given_back = lease.epoch
        return parent.message("release", self.now, lease.epoch)

    @rule(target=on_the_way, name=st.sampled_from(NAMES))
    def give_up_asking(self, name: str) -> Message:
        """No answer has come; one that comes later counts no more."""
        parent = self.parents[name]
        if parent.lease is not None or not parent.petitions:
            return multiple()  # type: ignore[return-value] # as above
        parent.given_up.add(parent.key)
        return Message("retract", name, self.now + parent.offset, life=parent.life, key=parent.key)

    @rule(target=on_the_way, message=consumes(on_the_way))
    def arrive(self, message: Message) -> Message:
        answer = self.deliver(message)
        return multiple() if answer is None else answer  # type: ignore[return-value] # as above

    @rule(target=on_the_way, message=on_the_way)
    def arrive_and_come_again(self, message: Message) -> Message:
        answer = self.deliver(message)
        return multiple() if answer is None else answer  # type: ignore[return-value] # as above

    @rule(more=st.sampled_from([-1, 0, 1, 1000]))
    def the_controller_tells_what_it_obeys(self, more: int) -> None:
        self.child.note_obeyed(self.child.epoch + more)

    @rule(message=consumes(on_the_way))
    def get_lost(self, message: Message) -> None:
        del message

    @rule(
        name=st.sampled_from(NAMES), there=st.sampled_from([0.0, 1.0]), back=st.sampled_from([0.0, 1.0, 3.0])
    )
    def ask_or_renew_and_wait_for_the_answer(self, name: str, there: float, back: float) -> None:
        parent = self.parents[name]
        epoch = 0 if parent.lease is None else parent.lease.epoch
        request = parent.message("renew" if epoch else "petition", self.now, epoch)
        self.wait(there)
        answer = self.deliver(request)
        self.wait(back)
        if answer is not None:
            self.deliver(answer)

    @rule(seconds=st.sampled_from([0.5, 2.0]))
    def wait(self, seconds: float) -> None:
        self.now += seconds

    @rule()
    def notice(self) -> None:
        """The child's timer rings, sooner or later."""
        self.child.tick(self.now, self.unix + self.now)

    @rule(name=st.sampled_from(NAMES))
    def die(self, name: str) -> None:
        """A parent ends, the child sees its presence go, and it begins anew."""
        parent = self.parents[name]
        if self.child.current is not None and self.child.current.parent == parent.address:
            self.child.end(self.unix + self.now)
        parent.lease = None
        parent.life, parent.petitions = parent.life + 1, 0

    def deliver(self, message: Message) -> Message | None:
        parent = self.parents[message.parent]
        if message.what == "granted":
            if message.life == parent.life and message.epoch > parent.given_back:
                self.take_grant(parent, message)
        elif message.what == "refused":
            if parent.lease is not None and (parent.life, parent.lease.epoch) == (
                message.life,
                message.epoch,
            ):
                parent.lease = None
        else:
            return self.ask_child(Address("robot", message.parent, str(message.life)), message)
        return None

    def take_grant(self, parent: Parent, message: Message) -> None:
        """A parent waits for the answer to its latest petition only; a renewal is of the lease it holds."""
        here = self.now + parent.offset
        if parent.lease is not None and message.epoch == parent.lease.epoch:
            parent.lease.granted(sent=message.sent, now=here, term=message.term)
        elif parent.awaits(message.key) and (parent.lease is None or message.epoch > parent.lease.epoch):
            parent.lease = HeldLease.begin(
                epoch=message.epoch, term=message.term, sent=message.sent, now=here
            )

    def ask_child(self, who: Address, message: Message) -> Message | None:
        now, unix = self.now, self.unix + self.now
        try:
            match message.what:
                case "petition":
                    epoch = self.child.petition(
                        who, "slot", (who.name,), 10.0, now=now, unix=unix, key=message.key
                    ).epoch
                    self.epochs.append(epoch)
                case "retract":
                    self.child.retract(who, message.key, unix=unix)
                    self.retracted.add(message.key)
                    return None
                case "renew":
                    epoch = self.child.renew(who, message.epoch, (who.name,), now=now).epoch
                case _:
                    self.child.release(who, message.epoch, unix=unix)
                    return None
        except (LeaseDenied, Retracted, StaleEpoch):
            return Message("refused", message.parent, message.sent, message.epoch, life=message.life)
        term = self.child.term_granted
        key = message.key if message.what == "petition" else ""
        return Message("granted", message.parent, message.sent, epoch, term, message.life, key)

    @invariant()
    def whoever_believes_to_command_does(self) -> None:
        for parent in self.parents.values():
            if parent.believes(self.now):
                assert self.child.current is not None
                assert self.child.current.parent == parent.address

    @invariant()
    def what_was_taken_back_is_granted_never_again(self) -> None:
        lease = self.child.current
        assert lease is None or lease.petition not in self.retracted

    @invariant()
    def never_do_two_parents_command(self) -> None:
        commanding = 0
        for parent in self.parents.values():
            if parent.believes(self.now) and parent.lease is not None:
                try:
                    self.child.check(parent.lease.epoch, self.now)
                except StaleEpoch:
                    continue
                commanding += 1
        assert commanding <= 1

    @invariant()
    def epochs_only_grow(self) -> None:
        assert self.epochs == sorted(set(self.epochs))
        assert self.child.epoch >= self.epochs[-1]
        lease = self.child.current
        if lease is not None:
            assert lease.epoch == self.child.epoch == self.epochs[-1]

    @invariant()
    def a_free_child_obeys_no_epoch_and_a_bound_one_nobody_without(self) -> None:
        if self.child.current is None:
            self.child.check(None, self.now)
            for epoch in self.epochs:
                try:
                    self.child.check(epoch, self.now)
                except StaleEpoch:
                    continue
                raise AssertionError(f"a free robot obeyed epoch {epoch}")


TestLeaseMachine = LeaseMachine.TestCase
TestLeaseMachine.settings = settings(max_examples=100, stateful_step_count=50, deadline=None)
