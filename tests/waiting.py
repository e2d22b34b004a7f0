"""How tests wait: for a condition, with a limit that no machine needs, however busy it is.

`until` is for coroutines, in real and in virtual time; `wait_until` is for threads and processes.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from robotree.vr.world.promises import IN_REAL_TIME, patience, until

__all__ = ["PATIENCE", "patience", "until", "wait_until"]

PATIENCE = IN_REAL_TIME
"""[s] A busy machine may take that long for one step."""


def wait_until(condition: Callable[[], object], sentence: str = "it comes about") -> None:
    """Wait in a thread until something is so that no event reports.

    Args:
        condition: what to wait for.
        sentence: says it.

    Raises:
        AssertionError: it did not come about within `PATIENCE`.
    """
    latest = time.monotonic() + PATIENCE
    while not (holds := condition()) and time.monotonic() < latest:
        time.sleep(0.005)
    assert holds, f"in vain: {sentence}"
