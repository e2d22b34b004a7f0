"""When to send what was recorded. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable

    from robotree.protocol.capture.captured import Captured


def schedule(records: Iterable[Captured], speed: float = 1.0) -> Generator[tuple[float, bytes]]:
    """Each record's moment; never earlier than the one before it, even if the recording's clock was set back.

    Args:
        records: with times; those without one follow at once.
        speed: how many seconds of the recording pass in one; infinity: as fast as it goes.

    Yields:
        [s] after the beginning, and what is to be sent then.
    """
    elapsed, latest = 0, None
    for record in records:
        if record.time is not None:
            elapsed += max(record.time - latest, 0) if latest is not None else 0
            latest = record.time
        yield elapsed / 1e6 / speed, record.data
