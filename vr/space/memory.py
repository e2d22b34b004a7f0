"""A space that lasts as long as its process: for tests, and for whoever wants no file."""

from __future__ import annotations


class MemorySpace:
    """See `Space`."""

    def __init__(self) -> None:
        """Begin empty."""
        self._variables: dict[str, int] = {}

    def add(self, name: str, amount: int = 1) -> None:
        """See `Space.add`."""
        self._variables[name] = self._variables.get(name, 0) + amount

    async def read(self, prefix: str) -> dict[str, int]:
        """See `Space.read`."""
        return {name: value for name, value in self._variables.items() if name.startswith(prefix)}

    async def close(self) -> None:
        """See `Space.close`; the variables stay."""
