"""One act that a script has given to a partner that is a group: an answer from each, and one end. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

from robotree.vr.base.written import Scalar
from robotree.vr.scripts.happening import Do, Happening

ANSWER = "answer"
"""What happens when one member has ended its part."""


@dataclass(slots=True)
class GroupAct:
    """The answers of the members, as they come."""

    order: Do
    """As the rules gave it: to the group."""
    number: int
    """Among the acts of the script."""
    open: set[str]
    """Slots of members that have not answered."""
    results: dict[str, tuple[Scalar, ...]] = field(default_factory=dict[str, tuple[Scalar, ...]])
    """Of those that have done it, by slot."""
    reasons: dict[str, str] = field(default_factory=dict[str, str])
    """Of those that have not, by slot."""

    def answer(self, slot: str, robot: str, ended: Happening) -> Happening:
        """Take how a member's part has ended; return what the rules are told of it.

        Args:
            slot: of the member.
            robot: the one that was in it when the act began.
            ended: `done` or a failure, as the end of any act.
        """
        self.open.discard(slot)
        well = ended.performative != "failure"
        values = ended.arguments[1:] if well else ended.arguments
        if well:
            self.results[slot] = values
        else:
            self.reasons[slot] = f"{robot or slot}: {values[0] if values else 'no reason given'}"
        return Happening(
            act=ANSWER,
            sender=self.order.partner,
            arguments=(self.order.act, robot or slot, well, *(values or ("none",))),
            conversation=self.order.conversation,
        )

    def end(self) -> Happening:
        """Return how the whole act has ended: done if all have done it; the results in the order of slots."""
        if not self.reasons:
            results = (value for slot in sorted(self.results, key=_place) for value in self.results[slot])
            return Happening(
                act="done",
                sender=self.order.partner,
                arguments=(self.order.act, *results),
                conversation=self.order.conversation,
                number=self.number,
            )
        count = len(self.reasons) + len(self.results)
        first = self.reasons[min(self.reasons, key=_place)]
        return Happening(
            performative="failure",
            act=self.order.act,
            sender=self.order.partner,
            arguments=(f"{len(self.reasons)} of {count} did not do it: {first}",),
            conversation=self.order.conversation,
            number=self.number,
        )


def _place(slot: str) -> int:
    return int(slot.rpartition("_")[2])
