"""The promises of a store of a space, as checks: the same for memory, SQLite and PostgreSQL."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

from robotree.vr.base.entry import Entry
from robotree.vr.base.errors import FenceLost, KeyTaken, NoSuchEntry, TransactionOver
from robotree.vr.base.requests import FOR_EVER
from robotree.vr.space.store import SpaceStore
from robotree.vr.world.promises import promise

_R = TypeVar("_R")


class TimedStore(Protocol):
    """A store whose clock stands still until it is told to go on."""

    store: SpaceStore

    def pass_time(self, seconds: float) -> None:
        """Let the clock of the store go on [s]."""
        ...


OpenStore = Callable[[], TimedStore]
"""Opens a new, empty store; who has called for it closes it."""


def job(number: int, *kinds: str, **fields: Any) -> Entry:
    """Return an entry of the kinds `Job`, or of more special ones."""
    return Entry((*kinds, "Job"), {"number": number, **fields})


def write(timed: TimedStore, entry: Entry, *, term: float = FOR_EVER, key: str = "", within: str = "") -> int:
    """Write one entry; returns its number."""
    with timed.store.together():
        return timed.store.write(entry, term, key, within)[0]


def find(
    timed: TimedStore,
    kind: str = "Job",
    *,
    take: bool = False,
    most: int = 1,
    within: str = "",
    **fields: Any,
) -> list[int]:
    """Read or take entries; returns the fields `number`."""
    with timed.store.together():
        rows = timed.store.find(kind, fields, within, take=take, most=most)
    return [row.entry.fields["number"] for row in rows]


def do(timed: TimedStore, action: Callable[..., _R], *values: Any) -> _R:
    """Do one thing that is kept when it is done."""
    with timed.store.together():
        return action(*values)


def refused(error: type[Exception], timed: TimedStore, action: Callable[..., object], *values: Any) -> bool:
    """Whether a store refuses something."""
    try:
        do(timed, action, *values)
    except error:
        return True
    return False


# -- entries ---------------------------------------------------------------------------------------


def entries_are_found_in_the_order_of_writing(timed: TimedStore) -> None:
    """The oldest first; a read leaves them, a take does not."""
    for number in (3, 1, 2):
        write(timed, job(number))
    promise(find(timed) == [3] == find(timed), "a read gives the oldest entry, and leaves it")
    promise(find(timed, take=True) == [3] and find(timed, take=True) == [1], "takes follow the order")
    promise(find(timed, take=True, most=9) == [2], "several are taken at once, as many as there are")
    promise(find(timed, take=True) == [], "what was taken is gone")


def an_entry_matches_by_its_classes_and_equal_fields(timed: TimedStore) -> None:
    """A template of a base class finds entries of its subclasses; a field that is None may be any."""
    write(timed, job(1, "Delivery", place="hall", weight=2))
    write(timed, job(2, place="hall", done=True, route=["a", {"b": 1.0}], note="x" * 1000))
    promise(find(timed, "Delivery", most=9) == [1], "a subclass is found by its own name")
    promise(find(timed, "Job", most=9) == [1, 2], "and by that of its base")
    promise(find(timed, "", most=9) == [1, 2], "no kind: any")
    promise(find(timed, "Task", most=9) == [], "another class is not found")
    promise(find(timed, place="hall", weight=2.0) == [1], "numbers are equal by value")
    promise(find(timed, weight=True) == [] == find(timed, done=1), "a truth value is no number")
    promise(find(timed, weight="2") == [], "a text is no number")
    promise(find(timed, route=["a", {"b": 1}]) == [2], "lists and records are compared whole")
    promise(find(timed, route=["a"]) == [], "a part of a list is not equal to it")
    promise(find(timed, note="x" * 1000) == [2] and find(timed, note="x" * 999) == [], "so are long texts")
    promise(find(timed, weight=None, place="hall", most=9) == [1, 2], "None is any value")
    promise(find(timed, size=1) == [], "a field that is not there is not equal to anything")


def a_lease_ends_an_entry(timed: TimedStore) -> None:
    """It is renewed or cancelled by its number, and never found when its lease has ended."""
    first, second = write(timed, job(1), term=10.0), write(timed, job(2), term=10.0)
    timed.pass_time(6.0)
    promise(do(timed, timed.store.renew, first, 10.0) == 10.0, "a renewal counts from now on")
    timed.pass_time(6.0)
    promise(find(timed, most=9) == [1], "what was not renewed has ended")
    promise(refused(NoSuchEntry, timed, timed.store.renew, second, 10.0), "and cannot be renewed")
    do(timed, timed.store.renew, first, 0.0)
    promise(find(timed) == [], "a lease of 0 s ends it at once")
    promise(refused(NoSuchEntry, timed, timed.store.renew, first, 10.0), "a cancelled entry is gone")
    promise(write(timed, job(3)) > second, "no number is used twice")


def a_key_is_unique(timed: TimedStore) -> None:
    """Until its entry is taken, cancelled, or has ended."""
    write(timed, job(1), key="k", term=10.0)
    promise(_key_is_taken(timed, "k"), "a second entry with the key is refused")
    timed.pass_time(11.0)
    write(timed, job(3), key="k")
    promise(find(timed, take=True, most=9) == [3], "the key of an entry that has ended is free")
    write(timed, job(4), key="k")
    promise(find(timed, most=9) == [4], "so is that of one that was taken")


def _key_is_taken(timed: TimedStore, key: str, within: str = "") -> bool:
    return refused(KeyTaken, timed, timed.store.write, job(0), FOR_EVER, key, within)


def what_was_given_back_is_first_again(timed: TimedStore) -> None:
    """With its place, its key and its lease."""
    write(timed, job(1), key="k", term=10.0)
    write(timed, job(2))
    with timed.store.together():
        rows = timed.store.find("Job", {}, "", take=True, most=1)
    do(timed, timed.store.put_back, rows)
    promise(find(timed, most=9) == [1, 2], "it is where it was")
    promise(_key_is_taken(timed, "k"), "its key is taken")
    timed.pass_time(11.0)
    promise(find(timed, most=9) == [2], "its lease goes on")


# -- transactions ----------------------------------------------------------------------------------


def a_transaction_is_seen_by_nobody_before_it_commits(timed: TimedStore) -> None:
    """What it writes only it sees, what it takes nobody sees."""
    write(timed, job(1))
    within = do(timed, timed.store.open, 60.0)
    promise(find(timed, take=True, within=within) == [1], "it takes what is there")
    write(timed, job(2), within=within)
    promise(find(timed, most=9) == [] == find(timed, take=True), "others see nothing of both")
    promise(find(timed, most=9, within=within) == [2], "it sees what it wrote, not what it took")
    do(timed, timed.store.commit, within)
    promise(find(timed, most=9) == [2], "after the commit all see it")
    promise(refused(TransactionOver, timed, timed.store.commit, within), "it commits once")
    promise(refused(TransactionOver, timed, timed.store.write, job(3), 9.0, "", within), "and is over then")


def a_transaction_that_is_taken_back_has_done_nothing(timed: TimedStore) -> None:
    """Taken entries are back in their place, written ones are gone, keys are as before."""
    write(timed, job(1), key="k")
    write(timed, job(2))
    within = do(timed, timed.store.open, 60.0)
    find(timed, take=True, within=within)
    write(timed, job(3), key="k", within=within)
    write(timed, job(4), key="n", within=within)
    promise(_key_is_taken(timed, "k") and _key_is_taken(timed, "n"), "both keys are taken meanwhile")
    do(timed, timed.store.roll_back, within)
    promise(find(timed, most=9) == [1, 2], "all is as before")
    promise(_key_is_taken(timed, "k") and not _key_is_taken(timed, "n"), "keys, too")
    do(timed, timed.store.roll_back, within)
    promise(refused(TransactionOver, timed, timed.store.commit, within), "it cannot be committed then")


def a_transaction_ends_with_its_lease(timed: TimedStore) -> None:
    """A taker that has died keeps nothing."""
    write(timed, job(1))
    within = do(timed, timed.store.open, 10.0)
    find(timed, take=True, within=within)
    write(timed, job(2), within=within)
    timed.pass_time(9.0)
    promise(find(timed) == [], "it holds until its time is over")
    timed.pass_time(2.0)
    do(timed, timed.store.expire)
    promise(find(timed, most=9) == [1], "then the entry is back, and what it wrote is gone")
    promise(refused(TransactionOver, timed, timed.store.commit, within), "it cannot be committed any more")


def an_entry_can_be_exchanged_under_its_key(timed: TimedStore) -> None:
    """Take and write again in one transaction: the usual way to change an entry."""
    write(timed, job(1), key="k")
    within = do(timed, timed.store.open, 60.0)
    find(timed, take=True, within=within)
    write(timed, job(2), key="k", within=within)
    promise(find(timed, take=True, within=within) == [2], "it can be taken again in it")
    promise(_key_is_taken(timed, "k"), "the key stays that of the entry that was taken first")
    write(timed, job(3), key="k", within=within)
    do(timed, timed.store.commit, within)
    promise(find(timed, most=9) == [3] and _key_is_taken(timed, "k"), "the new entry has the key")


def a_key_goes_back_to_the_entry_that_was_taken(timed: TimedStore) -> None:
    """When what its taker wrote instead has ended, or was cancelled."""
    write(timed, job(1), key="k")
    within = do(timed, timed.store.open, 60.0)
    find(timed, take=True, within=within)
    write(timed, job(2), key="k", term=5.0, within=within)
    timed.pass_time(6.0)
    do(timed, timed.store.expire)
    promise(_key_is_taken(timed, "k"), "it has ended; the taken entry may come back, with its key")
    do(timed, timed.store.renew, write(timed, job(3), key="k", within=within), 0.0)
    promise(_key_is_taken(timed, "k"), "it was cancelled, and the same is so")
    do(timed, timed.store.roll_back, within)
    promise(find(timed, most=9) == [1] and _key_is_taken(timed, "k"), "it is back, with its key")


def what_a_transaction_has_read_stays(timed: TimedStore) -> None:
    """Others read it, too, and nobody takes it before the transaction ends."""
    write(timed, job(1))
    one, other = do(timed, timed.store.open, 60.0), do(timed, timed.store.open, 60.0)
    promise(find(timed, within=one) == [1] == find(timed, within=other), "both read it")
    promise(find(timed) == [1], "others read it, too")
    promise(find(timed, take=True) == [] == find(timed, take=True, within=one), "nobody takes it")
    do(timed, timed.store.roll_back, other)
    promise(find(timed, take=True) == [], "one still reads it")
    promise(find(timed, take=True, within=one) == [1], "it takes it itself")
    do(timed, timed.store.roll_back, one)
    promise(find(timed, take=True) == [1], "after the last one it is free")


# -- fences ----------------------------------------------------------------------------------------


def one_at_a_time_holds_a_fence(timed: TimedStore) -> None:
    """Under an epoch that grows for ever."""
    store = timed.store
    first = do(timed, store.acquire, "door", "anna", 10.0)
    promise(first.granted and first.left == 10.0, "who comes first holds it")
    second = do(timed, store.acquire, "door", "bob", 10.0)
    promise(not second.granted and second.holder == "anna", "the second one learns who does")
    promise(do(timed, store.acquire, "gate", "bob", 10.0).granted, "another name is another fence")
    timed.pass_time(9.0)
    promise(do(timed, store.renew_fence, "door", first.epoch, 10.0).left == 10.0, "it can be renewed")
    timed.pass_time(11.0)
    third = do(timed, store.acquire, "door", "bob", 10.0)
    promise(third.granted and third.epoch > first.epoch, "after its time the next one has a higher epoch")
    promise(refused(FenceLost, timed, store.renew_fence, "door", first.epoch, 10.0), "the old one is over")
    do(timed, store.renew_fence, "door", third.epoch, 0.0)
    promise(refused(FenceLost, timed, store.renew_fence, "door", third.epoch, 10.0), "let go is let go")
    fourth = do(timed, store.acquire, "door", "anna", 10.0)
    promise(fourth.granted and fourth.epoch > third.epoch, "and free for the next one")


def people_can_look_into_it(timed: TimedStore) -> None:
    """What is there, whose lease it has, and who holds what."""
    write(timed, job(1, "Delivery"), key="k", term=10.0)
    write(timed, job(2))
    within = do(timed, timed.store.open, 60.0)
    find(timed, "Delivery", take=True, within=within)
    write(timed, job(3), within=within)
    fence = do(timed, timed.store.acquire, "door", "anna", 10.0)
    contents = do(timed, timed.store.contents, "", 9)
    promise(contents.counts == {"Delivery": 1, "Job": 1} and contents.transactions == 1, "it counts by kind")
    promise([entry.entry.fields["number"] for entry in contents.entries] == [1, 2], "it lists the entries")
    promise([entry.held for entry in contents.entries] == [True, False], "and which are held")
    promise([entry.key for entry in contents.entries] == ["k", ""], "and their keys")
    promise(contents.fences[0].epoch == fence.epoch and contents.fences[0].holder == "anna", "and the fences")
    listed = do(timed, timed.store.contents, "Delivery", 9).entries
    promise([one.entry.kind for one in listed] == ["Delivery"], "of one kind, if that is asked for")


SPACE_CHECKS: tuple[Callable[[TimedStore], None], ...] = (
    entries_are_found_in_the_order_of_writing,
    an_entry_matches_by_its_classes_and_equal_fields,
    a_lease_ends_an_entry,
    a_key_is_unique,
    what_was_given_back_is_first_again,
    a_transaction_is_seen_by_nobody_before_it_commits,
    a_transaction_that_is_taken_back_has_done_nothing,
    a_transaction_ends_with_its_lease,
    an_entry_can_be_exchanged_under_its_key,
    a_key_goes_back_to_the_entry_that_was_taken,
    what_a_transaction_has_read_stays,
    one_at_a_time_holds_a_fence,
    people_can_look_into_it,
)
"""All promises, each for a store of its own."""


def check_space(open_store: OpenStore) -> None:
    """Examine a store by all checks.

    Raises:
        AssertionError: it breaks a promise.
    """
    for check in SPACE_CHECKS:
        timed = open_store()
        try:
            check(timed)
        finally:
            timed.store.close()
