"""Which robot is chosen, and why this one: candidates by what is listed, an order of their bids. Pure.

A robot is *free* when nobody commands it, nothing runs or waits there, and it is not stopped or paused.
Whom a lookup service lists nobody commands. The rest only the robot itself knows, so a few are asked, in
any order: `ASKED` at first, and twice as many each time that nobody of them fits. A *bid* is what a robot
says of itself now. It states its cost and its time as readings, `bid_cost` (in any unit that all bidders of
a kind share) and `bid_time` [s]; a robot that states none asks for nothing. The cheapest is chosen, the
quickest of those, and chance decides between equals, so that many who choose at once do not all want the
same one. The robot's own lease has the last word.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing, RobotDescription
from robotree.vr.scripts.requirement import KnownRobot, Requirement

ASKED = 3
"""Robots that are asked for a bid at first."""
COST, TIME = "bid_cost", "bid_time"
"""Readings by which a robot bids."""
NAMED = 4
"""Robots that did not fit, of which the reason is told."""

TieBreak = Callable[[], float]
"""Returns a random number from 0 to 1."""


class Bid(msgspec.Struct, frozen=True, kw_only=True):
    """What one robot says when it is asked."""

    address: Address
    cost: float = 0.0
    time: float = 0.0
    """[s]"""
    reason: str = ""
    """Why it cannot be chosen, as a clause; empty: it can."""
    seen: str = ""
    """What it says of what was asked for."""

    @property
    def offer(self) -> str:
        """Cost and time in words; empty: it asks for nothing."""
        parts = [f"cost {self.cost:.6g}"] if self.cost else []
        return ", ".join([*parts, *([f"time {self.time:.3g} s"] if self.time else [])])


def candidates(
    listings: Iterable[Listing],
    kind: str,
    wanted: Requirement,
    chance: TieBreak,
) -> Iterator[Listing]:
    """Return in random order those who may fit, as far as their listings say.

    Args:
        listings: of robots that nobody commands.
        kind: that they must have.
        wanted: what they must be.
        chance: decides their order.
    """
    found = [one for one in listings if kind in one.kinds]
    while found:
        place = min(int(chance() * len(found)), len(found) - 1)
        found[place], found[-1] = found[-1], found[place]
        one = found.pop()
        if wanted.holds(KnownRobot.listed(one)) is not False:
            yield one


def bid_of(robot: RobotDescription, wanted: Requirement) -> Bid:
    """Return the bid of a robot that describes itself so."""
    known = KnownRobot.described(robot)
    reason = occupation(robot)
    if not reason and not wanted.holds(known):
        reason = f"does not fit ({wanted.seen(known) or wanted.text})"
    return Bid(
        address=robot.address,
        cost=robot.readings.get(COST, 0.0),
        time=robot.readings.get(TIME, 0.0),
        reason=reason,
        seen=wanted.seen(known),
    )


def occupation(robot: RobotDescription) -> str:
    """Return why a robot is not free, as a clause; empty: it is."""
    if robot.bond is not None:
        return f"is commanded by {robot.bond.parent.name}"
    if robot.stopped:
        return "is stopped"
    if not robot.online:
        return "has lost its controller"
    if robot.busy or robot.waiting:
        return f"carries out {robot.busy}" if robot.busy else "has commands waiting"
    if robot.asks:
        return "waits for an answer of a person"
    return "is paused" if robot.paused else ""


def in_order(bids: Iterable[Bid], chance: TieBreak) -> list[Bid]:
    """Return those who can be chosen, the best first."""
    able = [(bid.cost, bid.time, chance(), number, bid) for number, bid in enumerate(bids) if not bid.reason]
    return [one[-1] for one in sorted(able, key=lambda one: one[:4])]


def sentence(chosen: Bid, bids: Sequence[Bid], wanted: Requirement, count: int) -> str:
    """Return why a robot was chosen.

    Args:
        chosen: its bid.
        bids: all that were asked.
        wanted: what they must be.
        count: how many of the kind were listed.
    """
    about = ", ".join(filter(None, (chosen.seen, chosen.offer)))
    others = [bid for bid in bids if bid.address != chosen.address]
    able = [bid for bid in others if not bid.reason]
    words = f"{chosen.address.name} is free" + (f" and has {about}" if about else "")
    if able:
        dearer = all((bid.cost, bid.time) > (chosen.cost, chosen.time) for bid in able)
        names = ", ".join(
            f"{bid.address.name} ({bid.offer})" if bid.offer else bid.address.name for bid in able
        )
        words += f"; it bids less than {names}" if dearer else f"; chance chose it before {names}"
    else:
        words += "; it was the only one"
    if unfit := [bid for bid in others if bid.reason]:
        words += f"; {_reasons(unfit)}"
    asked = f"; {len(bids)} of {count} were asked" if count > len(bids) else ""
    return f"{words}{asked}" + (f" (where {wanted.text})" if wanted.text else "")


def vain(bids: Sequence[Bid], kind: str, wanted: Requirement, count: int, *, stale: bool) -> str:
    """Return why nobody was chosen, as a clause."""
    if not count:
        return f"no {kind} is {'known: no lookup service is running' if stale else 'listed as free'}"
    fits = f" fits where {wanted.text}" if wanted.text else " is free"
    return f"none of {count} {kind}{fits}" + (f": {_reasons(bids)}" if bids else "")


def _reasons(bids: Sequence[Bid]) -> str:
    named = [f"{bid.address.name} {bid.reason}" for bid in bids[:NAMED]]
    left = Counter(bid.reason.partition(" (")[0] for bid in bids[NAMED:])
    return ", ".join([*named, *(f"{count} more {reason}" for reason, count in left.most_common(3))])
