"""What agents need of a shared, durable store. `testing.py` examines any implementation (`check_space`)."""

from __future__ import annotations

from typing import Protocol


class Space(Protocol):
    """Shared variables: whole numbers by name, which several agents may add to at the same time."""

    def add(self, name: str, amount: int = 1) -> None:
        """Add to a variable, which begins at 0. Never blocks; durable a moment later."""
        ...

    async def read(self, prefix: str) -> dict[str, int]:
        """Return the variables whose names begin so, with all that was added here before."""
        ...

    async def close(self) -> None:
        """Write what is not written yet, and let go. Twice is once."""
        ...
