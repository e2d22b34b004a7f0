"""Protective stops of one robot, as a wanted state with generations.

Each stop that begins, ordered from outside or reported by the robot itself (a controller in a stop of its
own), is one more generation. A release names the generation that it ends and is refused when a later one has
begun (docs/decisions/0013). Whatever stands behind the robot and all its children confirm a generation, or
not; the robot stays stopped until a release of the newest generation is confirmed by all of them. Pure.
"""

from __future__ import annotations

import msgspec

MOST_ORDERS = 64
"""Orders of stops in force that are remembered; a copy of an older one counts as a new stop."""


class Stop(msgspec.Struct, kw_only=True):
    """Whether a robot is stopped, why, and how often it was."""

    reason: str = ""
    """Of the ordered stop that is in force; empty: none is."""
    halted: str = ""
    """Why the robot says itself that it is stopped; empty: it does not."""
    generation: int = 0
    """How many stops have begun."""
    confirmed: int = 0
    """The newest generation that everything below has confirmed."""
    latest: str = ""
    """Reason of the newest stop, also after its release."""
    orders: dict[str, int] = {}
    """Generation of each order that is in force."""

    @property
    def in_force(self) -> str:
        """Why nothing that moves may begin; empty: it may."""
        return self.reason or self.halted

    def known(self, order: str) -> int:
        """Return the generation of an order that is obeyed already; 0: it is new."""
        return self.orders.get(order, 0) if self.reason else 0

    def begin(self, reason: str, order: str) -> int:
        """Stop once more; returns the generation."""
        if not self.reason:
            self.orders.clear()  # those before the last release
        self.generation += 1
        self.reason = self.latest = reason
        if order:
            self.orders[order] = self.generation
            while len(self.orders) > MOST_ORDERS:
                del self.orders[next(iter(self.orders))]
        return self.generation

    def hear(self, halted: str) -> bool:
        """Take what the robot says of itself; returns whether that is the beginning of a stop."""
        begins = bool(halted) and not self.halted
        if begins:
            self.generation += 1
            self.latest = halted
        self.halted = halted
        return begins

    def confirm(self, generation: int) -> None:
        """Everything below has confirmed a generation."""
        self.confirmed = max(self.confirmed, generation)

    def release(self) -> None:
        """End the ordered stop."""
        self.reason = ""
        self.orders.clear()
