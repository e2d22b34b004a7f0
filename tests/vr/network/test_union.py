"""One list out of several services: what is remembered of those who withdrew."""

from __future__ import annotations

from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing
from robotree.vr.base.requests import Listed, Unlisted
from robotree.vr.lookup.union import MOST_ABSENT, Change, Union

QUICK, SLOW = "lookup/quick/1", "lookup/slow/1"


def agent(number: int) -> Address:
    return Address("robot", f"arm-{number}", "1")


def listed(address: Address, revision: int) -> Listed:
    return Listed(listing=Listing(address=address, kinds=("Arm", "Robot"), revision=revision))


class Seen(Union):
    """Knows who is alive from what it was shown."""

    def __init__(self) -> None:
        self.alive = set[Address]()
        super().__init__(self.alive.__contains__)

    def show(self, address: Address, *, alive: bool) -> list[Change]:
        (self.alive.add if alive else self.alive.discard)(address)
        return self.see(address)


def union() -> Seen:
    both = Seen()
    both.add_service(QUICK)
    both.add_service(SLOW)
    return both


def test_who_came_and_went_leaves_no_trace_for_ever() -> None:
    """Each withdrawal is heard when its agent has already gone."""
    both = union()
    for number in range(MOST_ABSENT + 50):
        both.show(agent(number), alive=True)
        both.take_news(SLOW, listed(agent(number), 1))
        both.show(agent(number), alive=False)
        both.take_news(SLOW, Unlisted(address=agent(number), revision=2))
    assert len(both._withdrawn) == len(both._absent) == MOST_ABSENT


def test_who_lives_is_not_forgotten_for_those_who_have_gone() -> None:
    both = union()
    living = agent(0)
    both.show(living, alive=True)
    both.take_news(QUICK, Unlisted(address=living, revision=2))
    for number in range(1, MOST_ABSENT + 50):
        both.take_news(QUICK, Unlisted(address=agent(number), revision=2))
    assert both.take_news(SLOW, listed(living, 1)) == [], "it has been withdrawn meanwhile"


def test_who_hung_for_a_while_is_not_listed_again_by_an_old_word() -> None:
    both = union()
    address = agent(0)
    both.show(address, alive=True)
    both.take_news(QUICK, Unlisted(address=address, revision=2))
    both.show(address, alive=False)
    both.show(address, alive=True)
    assert both.take_news(SLOW, listed(address, 1)) == []
    again = listed(address, 3)
    assert both.take_news(QUICK, again) == [Change("arrived", again.listing)]
