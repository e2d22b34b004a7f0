"""When to send what was recorded. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.protocol.capture.captured import plausible_time

if TYPE_CHECKING:
    from collections.abc import Generator, Iterable

    from robotree.protocol.capture.captured import Captured


LONGEST_GAP = 60_000_000
"""[us] of silence that are replayed; a longer one is a pause of the recorder, or a damaged time."""


def schedule(records: Iterable[Captured], speed: float = 1.0) -> Generator[tuple[float, bytes]]:
    """Each record's moment; never earlier than the one before it, even if the recording's clock was set back.

    A time that nothing was captured at is damaged, and its record follows at once; no gap is longer than
    `LONGEST_GAP`.

    Args:
        records: with times; those without one follow at once.
        speed: how many seconds of the recording pass in one; infinity: as fast as it goes.

    Yields:
        [s] after the beginning, and what is to be sent then.
    """
    elapsed, latest = 0, None
    for record in records:
        if record.time is not None and plausible_time(record.time):
            elapsed += min(max(record.time - latest, 0), LONGEST_GAP) if latest is not None else 0
            latest = record.time
        yield elapsed / 1e6 / speed, record.data
