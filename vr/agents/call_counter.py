"""How often each command of a robot was called, over all incarnations of its name."""

from __future__ import annotations

from robotree.vr.space.contract import Space


class CallCounter:
    """Counts in memory, and in a space so that the counts survive."""

    def __init__(self, space: Space | None, robot: str) -> None:
        """Begin; `recall` brings the earlier counts.

        Args:
            space: where they survive; None: nowhere.
            robot: its name.
        """
        self._space, self._prefix = space, f"calls/{robot}/"
        self._counts: dict[str, int] = {}

    @property
    def counts(self) -> dict[str, int]:
        """Calls by command."""
        return dict(self._counts)

    async def recall(self) -> None:
        """Read what earlier incarnations have counted."""
        if self._space is not None:
            found = await self._space.read(self._prefix)
            self._counts = {name.removeprefix(self._prefix): count for name, count in found.items()}

    def count(self, command: str) -> None:
        """Count one more call."""
        self._counts[command] = self._counts.get(command, 0) + 1
        if self._space is not None:
            self._space.add(self._prefix + command)
