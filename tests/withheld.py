"""How long threads were ready to run and had no processor: what a busy machine is forgiven, nobody else."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path


class Withheld:
    """Counts from its making on. What a thread has waited that ends meanwhile is not counted.

    Args:
        pids: of the processes whose threads are looked at.
    """

    def __init__(self, *pids: int) -> None:
        self._pids = pids
        self._before = dict(self._waited())

    @property
    def seconds(self) -> float:
        """The sum over all threads [s]."""
        return sum(waited - self._before.get(task, 0) for task, waited in self._waited()) / 1e9

    def _waited(self) -> Iterator[tuple[Path, int]]:
        """Each thread, and how long it has waited in its life [ns]; see the kernel's sched-stats.rst."""
        for pid in self._pids:
            for task in Path(f"/proc/{pid}/task").glob("*"):
                with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # it has just ended
                    yield task, int((task / "schedstat").read_text().split()[1])
