"""The mailbox and the table of calls against models that are plain lists."""

from __future__ import annotations

import hypothesis.strategies as st
import pytest
from hypothesis import settings
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from robotree.vr.calls import CallTable
from robotree.vr.errors import Busy, CommandCancelled, KeyReused
from robotree.vr.mailbox import MOST_READERS, Mailbox

LIMIT = 3
keys = st.sampled_from("abcdefgh")
contents = st.tuples(st.sampled_from(["move", "stop"]), st.just({}))


class MailboxMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.box = Mailbox("arm-1", limit=LIMIT)
        self.queue: list[str] = []
        """The one that runs, then those that wait."""
        self.readers: set[str] = set()
        self.served: list[str] = []
        self.numbers = iter(range(10**9))

    @rule()
    def a_command_comes(self) -> None:
        key = str(next(self.numbers))
        if len(self.queue) > LIMIT:
            with pytest.raises(Busy):
                self.box.offer(key, reads=False)
            return
        assert self.box.offer(key, reads=False) == (not self.queue)
        self.queue.append(key)

    @rule()
    def a_reader_comes(self) -> None:
        key = str(next(self.numbers))
        if len(self.readers) == MOST_READERS:
            with pytest.raises(Busy):
                self.box.offer(key, reads=True)
            return
        assert self.box.offer(key, reads=True)
        self.readers.add(key)

    @precondition(lambda self: self.queue)
    @rule(data=st.data())
    def one_leaves(self, data: st.DataObject) -> None:
        key = data.draw(st.sampled_from(self.queue))
        first = key == self.queue[0]
        self.queue.remove(key)
        following = self.queue[0] if first and self.queue else ""
        assert self.box.leave(key) == following

    @precondition(lambda self: self.readers)
    @rule(data=st.data())
    def a_reader_leaves(self, data: st.DataObject) -> None:
        key = data.draw(st.sampled_from(sorted(self.readers)))
        self.readers.remove(key)
        assert self.box.leave(key) == ""

    @rule()
    def somebody_unknown_leaves(self) -> None:
        assert self.box.leave("nobody") == ""

    @invariant()
    def one_runs_and_the_others_wait_in_order(self) -> None:
        assert [self.box.running, *self.box.waiting] == (self.queue or [""])
        assert self.box.readers == self.readers


class CallMachine(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.table: CallTable[object] = CallTable("arm-1", limit=LIMIT)
        self.known: dict[str, tuple[tuple[str, dict[str, object]], object]] = {}
        self.ended: list[str] = []
        self.buried: list[str] = []

    @rule(key=keys, content=contents)
    def call(self, key: str, content: tuple[str, dict[str, object]]) -> None:
        if key in self.buried:
            with pytest.raises(CommandCancelled):
                self.table.find(key, content)
        elif key not in self.known:
            assert self.table.find(key, content) is None
            self.known[key] = (content, job := object())
            self.table.enter(key, content, job)
        elif self.known[key][0] == content:
            assert self.table.find(key, content) is self.known[key][1]
        else:
            with pytest.raises(KeyReused):
                self.table.find(key, content)

    @rule(key=keys)
    def end(self, key: str) -> None:
        self.table.end(key)
        if key in self.known and key not in self.ended:
            self.ended.append(key)
            while len(self.ended) > LIMIT:
                del self.known[self.ended.pop(0)]

    @rule(key=keys)
    def cancel(self, key: str) -> None:
        self.table.bury(key, "it was not wanted any more")
        if key not in self.known and key not in self.buried:
            self.buried.append(key)
            del self.buried[:-LIMIT]

    @invariant()
    def it_stays_small(self) -> None:
        assert len(self.table) == len(self.known)


TestMailboxMachine = MailboxMachine.TestCase
TestCallMachine = CallMachine.TestCase
TestMailboxMachine.settings = TestCallMachine.settings = settings(
    max_examples=100, stateful_step_count=40, deadline=None
)
