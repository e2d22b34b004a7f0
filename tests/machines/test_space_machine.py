"""A machine that plays against a space: what each store answers is what a plain list would answer.

Whatever robots write, read, take, commit, take back and acquire, however time passes, and however often the
process that owns the file is started anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    rule,
    run_state_machine_as_test,
)

from robotree.vr.base.entry import Entry
from robotree.vr.base.errors import FenceLost, KeyTaken, NoSuchEntry, TransactionOver, VrError
from robotree.vr.base.requests import FOR_EVER
from robotree.vr.space.postgres import PostgresStore
from robotree.vr.space.sqlite import SqliteStore
from robotree.vr.space.table import Row
from tests.vr.space import stores
from tests.vr.space.postgres import Server, server

KINDS = ("Job", "Job", "Delivery")
KEYS = ("", "k")
PLACES = (None, None, "hall", "door")
WHICH = st.sampled_from([0, 1, 1, 1, 2, -1])
"""Transactions: none, the older one that is open, the younger one, one that is over."""
NAMES = st.sampled_from(["door", "gate"])
MOST_OPEN = 2
"""Transactions at a time."""
TERMS = (FOR_EVER, 5.0, 20.0)


@dataclass
class Kept:
    """One entry, as the plain list has it."""

    id: int
    kinds: tuple[str, ...]
    fields: dict[str, Any]
    key: str
    expires: float
    written_by: str
    taken_by: str = ""
    readers: set[str] = field(default_factory=set)


class Model:
    """What a space is: a list."""

    def __init__(self) -> None:
        self.now = 1000.0
        self.entries: list[Kept] = []
        self.open: dict[str, float] = {}
        self.fences: dict[str, tuple[int, float]] = {}

    def check(self, transaction: str) -> None:
        if transaction and transaction not in self.open:
            raise TransactionOver(space="", reason="")

    def matching(self, kind: str, place: str | None, transaction: str, *, take: bool) -> list[Kept]:
        return [
            one
            for one in sorted(self.entries, key=lambda one: one.id)
            if kind in one.kinds
            and (place is None or one.fields["place"] == place)
            and not one.taken_by
            and one.written_by in {"", transaction}
            and one.expires > self.now
            and (not take or one.readers <= {transaction})
        ]

    def find(self, kind: str, place: str | None, transaction: str, *, take: bool, most: int) -> list[Kept]:
        self.check(transaction)
        found = self.matching(kind, place, transaction, take=take)[:most]
        for one in found:
            if take and (not transaction or one.written_by):
                self.entries.remove(one)
            elif take:
                one.taken_by, one.readers = transaction, set()
            elif transaction and not one.written_by:
                one.readers.add(transaction)
        return found

    def has_key(self, key: str, transaction: str) -> bool:
        return any(
            entry.key == key and (entry.taken_by or entry.expires > self.now)
            for entry in self.entries
            if not (transaction and entry.taken_by == transaction)
        )

    def end(self, transaction: str, *, commit: bool) -> None:
        if self.open.pop(transaction, None) is None:
            return
        doomed = "taken_by" if commit else "written_by"
        self.entries = [entry for entry in self.entries if getattr(entry, doomed) != transaction]
        for entry in self.entries:
            entry.readers.discard(transaction)
            entry.written_by = "" if entry.written_by == transaction else entry.written_by
            entry.taken_by = "" if entry.taken_by == transaction else entry.taken_by

    def sweep(self) -> None:
        for transaction in [name for name, end in self.open.items() if end <= self.now]:
            self.end(transaction, commit=False)
        self.entries = [entry for entry in self.entries if entry.expires > self.now or entry.taken_by]


def act(name: str, /, **values: st.SearchStrategy[Any]) -> st.SearchStrategy[tuple[str, dict[str, Any]]]:
    """Draw one act: a method of the machine, and its arguments."""
    return st.tuples(st.just(name), st.fixed_dictionaries(values))


WRITE = act(
    "write",
    kinds=st.sampled_from([("Job",), ("Delivery", "Job")]),
    place=st.sampled_from(PLACES[2:]),
    key=st.sampled_from(KEYS),
    term=st.sampled_from(TERMS),
    which=WHICH,
)
FIND = act(
    "find",
    kind=st.sampled_from(KINDS),
    place=st.sampled_from(PLACES),
    take=st.booleans(),
    most=st.sampled_from([1, 2]),
    which=WHICH,
)
ACTS = st.one_of(
    *[WRITE] * 3,
    *[FIND] * 4,
    act("give_back"),
    act("renew", back=st.integers(0, 3), term=st.sampled_from([0.0, 5.0])),
    *[act("begin", term=st.sampled_from([10.0, 30.0]))] * 2,
    act("end", which=WHICH, commit=st.booleans()),
    act("acquire", name=NAMES, term=st.sampled_from([5.0, 20.0])),
    act("renew_fence", name=NAMES, late=st.booleans(), term=st.sampled_from([0.0, 5.0])),
    act("pass_time", seconds=st.sampled_from([1.0, 6.0, 15.0])),
    act("start_anew"),
)


class SpaceMachine(RuleBasedStateMachine):
    """Its one rule does many acts: with a rule for each, most games are too short to meet anything."""

    def __init__(self, timed: stores.Timed, reopen: Callable[[stores.Timed], bool] | None = None) -> None:
        super().__init__()
        self.timed, self.reopen = timed, reopen
        self.model = Model()
        self.number, self.found = 0, 0
        self.given: list[tuple[Kept, Row]] = []
        self.ended = ""
        """A transaction that is over."""
        self.last_id = 0

    def chosen(self, which: int) -> str:
        """Return no transaction (0), one that is open, or one that is over (-1)."""
        if which < 0:
            return self.ended
        return [*self.model.open, "", "", ""][which - 1] if which else ""

    def teardown(self) -> None:
        self.timed.store.close()

    def both(self, ours: Callable[[], Any], theirs: Callable[[], Any]) -> tuple[Any, Any]:
        """Do the same with the list and with the store; both refuse it, or none."""
        try:
            expected, refusal = ours(), None
        except VrError as error:
            expected, refusal = None, type(error)
        try:
            with self.timed.store.together():
                got = theirs()
        except VrError as error:
            if type(error) is not refusal:
                raise
            return None, None
        assert refusal is None, f"the store did what had to be refused: {refusal}"
        return expected, got

    @rule(acts=st.lists(ACTS, min_size=30, max_size=60))
    def play(self, acts: list[tuple[str, dict[str, Any]]]) -> None:
        for name, values in acts:
            getattr(self, name)(**values)
            self.all_see_the_same()

    def write(self, kinds: tuple[str, ...], place: str, key: str, term: float, which: int) -> None:
        transaction = self.chosen(which)
        self.number += 1
        fields = {"number": self.number, "place": place}

        def expect() -> None:
            self.model.check(transaction)
            if key and self.model.has_key(key, transaction):
                raise KeyTaken(space="", key=key)
            if key:  # what has ended is out of the way
                self.model.entries = [
                    entry
                    for entry in self.model.entries
                    if entry.key != key or entry.taken_by or entry.expires > self.model.now
                ]

        def store() -> int:
            return self.timed.store.write(Entry(kinds, fields), term, key, transaction)[0]

        _, id_ = self.both(expect, store)
        if id_ is None:
            return
        assert id_ > self.last_id, "numbers grow"
        self.last_id = id_
        self.model.entries.append(Kept(id_, kinds, fields, key, self.model.now + term, transaction))

    def find(self, kind: str, place: str | None, take: bool, most: int, which: int) -> None:  # noqa: FBT001
        transaction = self.chosen(which)
        template = {"place": place}
        expected, rows = self.both(
            lambda: self.model.find(kind, place, transaction, take=take, most=most),
            lambda: self.timed.store.find(kind, template, transaction, take=take, most=most),
        )
        if rows is None:
            return
        assert [row.entry.fields for row in rows] == [one.fields for one in expected]
        assert [row.id for row in rows] == [one.id for one in expected]
        self.found += len(rows)
        if take and not transaction:
            self.given += zip(expected, rows, strict=True)

    def give_back(self) -> None:
        if not self.given:
            return
        kept, row = self.given.pop()
        with self.timed.store.together():
            self.timed.store.put_back([row])
        self.model.sweep()
        if kept.expires > self.model.now:
            kept.key = "" if any(entry.key == kept.key for entry in self.model.entries) else kept.key
            self.model.entries.append(kept)

    def renew(self, back: int, term: float) -> None:
        id_ = self.last_id - back

        def expect() -> None:
            found = [
                entry
                for entry in self.model.entries
                if entry.id == id_ and not entry.taken_by and entry.expires > self.model.now
            ]
            if not found:
                raise NoSuchEntry(space="", id=id_)
            found[0].expires = self.model.now + term
            if not term:
                self.model.entries.remove(found[0])

        self.both(expect, lambda: self.timed.store.renew(id_, term))

    def begin(self, term: float) -> None:
        if len(self.model.open) == MOST_OPEN:
            return
        with self.timed.store.together():
            transaction = self.timed.store.open(term)
        self.model.open[transaction] = self.model.now + term

    def end(self, which: int, commit: bool) -> None:  # noqa: FBT001
        transaction = self.chosen(which)
        if not transaction:
            return

        def expect() -> None:
            if commit:
                self.model.check(transaction)
            self.model.end(transaction, commit=commit)

        store = self.timed.store
        self.both(expect, lambda: (store.commit if commit else store.roll_back)(transaction))
        self.ended = transaction

    def acquire(self, name: str, term: float) -> None:
        epoch, end = self.model.fences.get(name, (0, 0.0))
        with self.timed.store.together():
            fence = self.timed.store.acquire(name, "anna", term)
        assert fence.granted == (end <= self.model.now)
        if fence.granted:
            assert fence.epoch > epoch, "an epoch comes once"
            self.model.fences[name] = fence.epoch, self.model.now + term
        else:
            assert fence.epoch == epoch

    def renew_fence(self, name: str, late: bool, term: float) -> None:  # noqa: FBT001
        epoch, end = self.model.fences.get(name, (0, 0.0))

        def expect() -> None:
            if late or end <= self.model.now:
                raise FenceLost(name=name, epoch=epoch, current=epoch)
            self.model.fences[name] = epoch, self.model.now + term

        self.both(expect, lambda: self.timed.store.renew_fence(name, epoch - late, term))

    def pass_time(self, seconds: float) -> None:
        self.timed.pass_time(seconds)
        self.model.now += seconds
        with self.timed.store.together():
            self.timed.store.expire()
        self.model.sweep()

    def start_anew(self) -> None:
        """The process that served it was killed; another one serves it."""
        if self.reopen is not None and not self.reopen(self.timed):  # what was not committed is gone
            for transaction in list(self.model.open):
                self.model.end(transaction, commit=False)

    def all_see_the_same(self) -> None:
        with self.timed.store.together():
            seen = self.timed.store.find("Job", {}, "", take=False, most=100)
        assert [row.id for row in seen] == [
            one.id for one in self.model.matching("Job", None, "", take=False)
        ]


def play(start: Callable[[], SpaceMachine], examples: int) -> int:
    """Play many games; returns how many entries were found in them."""
    found: list[int] = []

    class Counted(SpaceMachine):
        def teardown(self) -> None:
            found.append(self.found)
            super().teardown()

    def begin() -> SpaceMachine:
        machine = start()
        return Counted(machine.timed, machine.reopen)

    run_state_machine_as_test(
        begin, settings=settings(max_examples=examples, stateful_step_count=2, deadline=None)
    )
    return sum(found)


def test_a_space_in_memory_is_a_list() -> None:
    assert play(lambda: SpaceMachine(stores.memory()), 60) > 60


def test_a_space_in_a_file_is_a_list_that_survives_its_process(tmp_path: Path) -> None:
    paths: Iterator[Path] = (tmp_path / f"{number}.db" for number in range(10**6))

    def start() -> SpaceMachine:
        path = next(paths)

        def reopen(timed: stores.Timed) -> bool:
            timed.store.close()
            timed.store = SqliteStore("jobs", path, timed.now, timed.unix)
            return False

        return SpaceMachine(stores.sqlite(path), reopen)

    assert play(start, 20) > 20


@pytest.fixture(scope="module")
def database() -> Iterator[Server]:
    with server("fsync=off", "full_page_writes=off", "autovacuum=off") as running:
        yield running


def test_a_space_in_postgresql_is_a_list_that_survives_its_processes(database: Server) -> None:
    def reopen(timed: stores.Timed) -> bool:
        old = timed.store
        assert isinstance(old, PostgresStore)
        timed.store = PostgresStore("jobs", old._url, listens=False)
        timed.pass_time(0.0)
        old.close()
        return True

    assert play(lambda: SpaceMachine(stores.postgres(database), reopen), 8) > 8
