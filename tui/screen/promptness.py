"""How the interpreter runs while a screen answers keys: threads take turns often, collections are short.

Textual writes to the terminal in a thread of its own. Where two threads want to run, CPython changes between
them every 5 ms, so that the event loop may wait that long for the writer. With 1,000 robots, shorter turns
took the 95th percentile from a key to its first byte from 12.7 to 6.9 ms (docs/performance.md). A full
garbage collection looks at every object of the program, most of which are modules that never go: 25 to 43 ms.
"""

from __future__ import annotations

import asyncio
import gc
import sys
from collections.abc import Generator
from contextlib import contextmanager

TURN = 0.0005
"""[s] after which a thread gives way to another that wants to run."""

SETTLED = 3.0
"""[s] after which what a screen needs has been imported and made."""


def _settle() -> None:
    """Keep what is there now out of every later garbage collection."""
    gc.collect()
    gc.freeze()


@contextmanager
def prompt_answers() -> Generator[None]:
    """Run the interpreter so that the event loop of this thread answers quickly; as it was, afterwards."""
    before = sys.getswitchinterval()
    settling = asyncio.get_running_loop().call_later(SETTLED, _settle)
    sys.setswitchinterval(TURN)
    try:
        yield
    finally:
        settling.cancel()
        gc.unfreeze()
        sys.setswitchinterval(before)
