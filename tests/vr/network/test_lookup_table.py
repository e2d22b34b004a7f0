"""What a lookup service keeps, and one list out of several: laws with time as an argument."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing, Template
from robotree.vr.base.requests import Listed, Register, Unlisted
from robotree.vr.lookup.table import LONGEST_TERM, LOST, MOST_REMEMBERED, SHORTEST_TERM, LookupTable, Update
from robotree.vr.lookup.union import MOST_ABSENT, Change, Union

ARM = Address("robot", "arm", "1")


@pytest.fixture
def table() -> LookupTable:
    return LookupTable()


def listing(revision: int = 1, address: Address = ARM, **given: object) -> Listing:
    return Listing(**{"address": address, "kinds": ("Arm", "Robot"), "revision": revision, **given})  # type: ignore[arg-type]


def register(
    table: LookupTable, *listings: Listing, now: float, term: float = 5.0, holder: str = "process-1"
) -> tuple[tuple[str, ...], list[Update]]:
    """Register under one lease; returns the names of what is refused, and the news."""
    answer, news = table.register(Register(holder=holder, term=term, listings=listings), now)
    return tuple(address.name for address, _ in answer.outdated), news


def renew(table: LookupTable, now: float, holder: str = "process-1") -> int:
    """Renew a lease; returns how many listings depend on it."""
    answer, news = table.register(Register(holder=holder, term=5.0), now)
    assert all(isinstance(item, Unlisted) for item in news), "a renewal brings nothing in"
    return answer.count


def names(table: LookupTable, now: float, template: Template | None = None) -> list[str]:
    return [found.name for found, _ in table.find(template or Template(), now)]


def test_a_listing_lasts_as_long_as_its_lease(table: LookupTable) -> None:
    assert register(table, listing(), now=0.0) == ((), [Listed(listing=listing())])
    assert table.find(Template(), now=3.0) == ((listing(), 2.0),)
    assert table.expire(now=4.9) == []
    assert table.find(Template(), now=5.0) == (), "even before anybody looked at the clock"
    assert table.expire(now=5.0) == [Unlisted(address=ARM, revision=LOST)]


def test_a_larger_revision_replaces_a_smaller_one_and_never_the_other_way(table: LookupTable) -> None:
    register(table, listing(2, doc="new"), now=0.0)
    assert register(table, listing(1, doc="late"), now=0.1) == (("arm",), [])
    assert table.fill(listing(1), 5.0, now=0.1) == []
    assert table.find(Template(), now=0.1)[0][0].doc == "new"
    changed = listing(3, doc="newer")
    assert register(table, changed, now=0.2) == ((), [Listed(listing=changed)])


def test_withdrawals_are_remembered_in_a_bounded_number_the_latest_ones(table: LookupTable) -> None:
    """A host that creates and deletes robots all the time withdraws hundreds a second."""
    withdrawn = [Address("robot", f"r{number}", "1") for number in range(MOST_REMEMBERED + 100)]
    for address in withdrawn:
        register(table, listing(1, address), now=0.0)
        table.withdraw(address, 2, now=0.0)
        table.withdraw(withdrawn[0], 3, now=0.0)  # the first one is the latest again and again
    assert len(table._withdrawals) == MOST_REMEMBERED
    for address in (withdrawn[0], *withdrawn[-MOST_REMEMBERED + 1 :]):
        assert register(table, listing(1, address), now=0.0) == ((address.name,), [])


def test_a_late_withdrawal_does_not_take_out_what_returned(table: LookupTable) -> None:
    register(table, listing(3), now=0.0)
    assert table.withdraw(ARM, 2, now=0.1) == []
    assert names(table, 0.1) == ["arm"]


def test_a_withdrawal_of_the_unknown_is_remembered_and_told(table: LookupTable) -> None:
    """Another table may know it: a process that sees several must hear of it."""
    assert table.withdraw(ARM, 2, now=0.0) == [Unlisted(address=ARM, revision=2)]
    assert register(table, listing(1), now=0.1) == (("arm",), [])


ROVER = Address("robot", "rover", "1")


def test_what_was_withdrawn_is_not_filled_in_again_and_a_lost_lease_takes_all_with_it(
    table: LookupTable,
) -> None:
    register(table, listing(1), now=0.0)
    table.withdraw(ARM, 2, now=1.0)
    assert table.fill(listing(1), 5.0, now=1.1) == []
    assert names(table, 1.1) == []
    register(table, listing(3), listing(address=ROVER), now=2.0)
    assert table.expire(now=7.0) == [Unlisted(address=one, revision=LOST) for one in (ARM, ROVER)]


def test_a_renewal_holds_only_what_its_own_process_has_listed(table: LookupTable) -> None:
    register(table, listing(), now=0.0)
    register(table, listing(address=ROVER), now=0.0, holder="process-2")
    assert renew(table, now=4.0) == 1
    assert names(table, 6.0) == ["arm"]


def test_the_answer_to_a_late_renewal_shows_that_the_lease_was_lost(table: LookupTable) -> None:
    register(table, listing(), now=0.0)
    assert renew(table, now=5.0) == 0
    assert names(table, 5.0) == []
    register(table, listing(), now=5.1)
    assert (renew(table, now=5.2), names(table, 5.2)) == (1, ["arm"])


def test_a_listing_that_moves_to_another_lease_is_no_news(table: LookupTable) -> None:
    register(table, listing(), listing(address=ROVER), now=0.0)
    assert register(table, listing(), now=1.0, holder="anew") == ((), [])
    assert (renew(table, 4.0, "anew"), names(table, 6.0)) == (1, ["arm"]), "the other one ran out"


def test_a_table_filled_from_another_has_what_remained_of_the_lease(table: LookupTable) -> None:
    assert table.fill(listing(), 3.0, now=0.0) == [Listed(listing=listing())]
    assert table.find(Template(), now=1.0) == ((listing(), 2.0),)
    assert register(table, listing(), now=1.0) == ((), []), "then its process registers it here"
    assert renew(table, now=4.0) == 1


@given(term=st.floats())
def test_any_term_asked_for_is_granted_within_bounds(term: float) -> None:
    answer, _ = LookupTable().register(Register(holder="process-1", term=term, listings=(listing(),)), 0.0)
    granted = answer.term
    assert SHORTEST_TERM <= granted <= LONGEST_TERM
    if SHORTEST_TERM <= term <= LONGEST_TERM:
        assert granted == term


@given(remaining=st.one_of(st.just(math.nan), st.floats(max_value=0), st.floats(min_value=LONGEST_TERM + 1)))
def test_a_lease_that_no_service_grants_is_not_taken_over(remaining: float) -> None:
    table = LookupTable()
    assert table.fill(listing(), remaining, now=0.0) == []
    assert names(table, 0.0) == []


words = st.sampled_from(["a", "b", ""])


texts = st.dictionaries(words, words)
addresses = st.builds(Address, st.just("robot"), st.text("ab", min_size=1), st.just("1"))
pairs = st.tuples(words, words)
listings = st.builds(listing, st.just(1), addresses, kinds=pairs, commands=pairs, attributes=texts)
templates = st.builds(Template, name=words, kind=words, command=words, attributes=texts)


@given(listed=st.lists(listings), template=templates)
def test_find_returns_exactly_what_matches_by_name(listed: list[Listing], template: Template) -> None:
    table = LookupTable()
    for each in listed:
        register(table, each, now=0.0)
    last = {each.address: each for each in listed}
    expected = [
        each for each in sorted(last.values(), key=lambda each: each.address) if template.matches(each)
    ]
    assert [found for found, _ in table.find(template, now=0.0)] == expected


facts = st.lists(
    st.one_of(
        st.tuples(st.just("register"), st.integers(1, 6)), st.tuples(st.just("withdraw"), st.integers(1, 6))
    ),
    max_size=8,
)


@given(facts=facts, data=st.data())
def test_what_is_known_does_not_depend_on_the_order_in_which_it_was_learnt(
    facts: list[tuple[str, int]], data: st.DataObject
) -> None:
    """Listings have odd revisions and withdrawals even ones here, as an agent never uses one for both."""
    apart = [(what, revision * 2 + (what == "register")) for what, revision in facts]
    tables = [LookupTable(), LookupTable()]
    for table, order in zip(tables, (apart, data.draw(st.permutations(apart))), strict=True):
        for what, revision in order:
            if what == "register":
                register(table, listing(revision), now=0.0)
            else:
                table.withdraw(ARM, revision, now=0.0)
    assert tables[0].find(Template(), now=0.0) == tables[1].find(Template(), now=0.0)


# -- one list out of several services: what is remembered of those who withdrew --------------------

QUICK, SLOW = "lookup/quick/1", "lookup/slow/1"


def agent(number: int) -> Address:
    return Address("robot", f"arm-{number}", "1")


class Seen(Union):
    """Knows who is alive from what it was shown."""

    def __init__(self) -> None:
        self.alive = set[Address]()
        super().__init__(self.alive.__contains__)
        self.add_service(QUICK)
        self.add_service(SLOW)

    def show(self, address: Address, *, alive: bool) -> list[Change]:
        (self.alive.add if alive else self.alive.discard)(address)
        return self.see(address)


def test_who_came_and_went_leaves_no_trace_for_ever() -> None:
    """Each withdrawal is heard when its agent has already gone."""
    both = Seen()
    for number in range(MOST_ABSENT + 50):
        both.show(agent(number), alive=True)
        both.take_news(SLOW, Listed(listing=listing(1, agent(number))))
        both.show(agent(number), alive=False)
        both.take_news(SLOW, Unlisted(address=agent(number), revision=2))
    assert len(both._withdrawn) == len(both._absent) == MOST_ABSENT


def test_who_lives_is_not_forgotten_for_those_who_have_gone() -> None:
    both = Seen()
    living = agent(0)
    both.show(living, alive=True)
    both.take_news(QUICK, Unlisted(address=living, revision=2))
    for number in range(1, MOST_ABSENT + 50):
        both.take_news(QUICK, Unlisted(address=agent(number), revision=2))
    assert both.take_news(SLOW, Listed(listing=listing(1, living))) == [], "it has been withdrawn meanwhile"


def test_who_hung_for_a_while_is_not_listed_again_by_an_old_word() -> None:
    both = Seen()
    address = agent(0)
    both.show(address, alive=True)
    both.take_news(QUICK, Unlisted(address=address, revision=2))
    both.show(address, alive=False)
    both.show(address, alive=True)
    assert both.take_news(SLOW, Listed(listing=listing(1, address))) == []
    again = Listed(listing=listing(3, address))
    assert both.take_news(QUICK, again) == [Change("arrived", again.listing)]
