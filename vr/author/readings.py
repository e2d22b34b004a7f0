"""The readings of a child, for a page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from robotree.vr.author.context import running


class Record(dict[str, Any]):
    """A result of several parts: by item, as the mapping that it is, or by attribute."""

    __slots__ = ()

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"the result has no {name!r}; it has: {', '.join(self)}") from None


class Readings:
    """The readings of the child in a slot, as the child publishes them: nobody asks for them.

        for reading in self.arm.readings(hz=5): …  each new reading, five in a second at most
        self.arm.readings.z                        the latest value

    A child publishes ten times a second while one of its commands runs, else at each change of its state (ten
    times a second at most) and once a second. So the first reading can take a second. A reading is a step.
    """

    __slots__ = ("_slot",)

    def __init__(self, slot: str) -> None:
        """Made by access to the child's attribute."""
        self._slot = slot

    def __call__(self, *, hz: float = 10.0) -> Iterator[Record]:
        """Yield each new reading; if several came since the last one, the latest. Ends only by an error.

        Args:
            hz: [1/s] how many are yielded at most.

        Raises:
            SlotEmpty: the child was lost.
            ValueError: `hz` is not above 0.
        """
        if not hz > 0.0:
            raise ValueError(f"readings(hz={hz!r}): give a rate above 0, such as 5")
        return self._each(1.0 / hz)

    def _each(self, period: float) -> Iterator[Record]:
        number, at = 0, 0.0
        while True:
            number, reading = running().next_reading(self._slot, number, at)
            at = running().now() + period
            yield reading

    def __getattr__(self, name: str) -> float:
        if name.startswith("_"):
            raise AttributeError(name)
        value: float = getattr(running().reading(self._slot), name)
        return value

    def __getitem__(self, name: str) -> float:
        value: float = running().reading(self._slot)[name]
        return value
