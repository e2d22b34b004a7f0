"""Whether a controller restarted between two of its reports, and which report is the older one. Pure.

Every report carries the controller's clock, which begins at 0 when the controller starts. Most controllers
also send a number of their life, another one after each start. A number may come again, after 65 535 starts
or drawn at random: then the clock, which has fallen, shows the restart. A report counts as old only if it is
older by no more than LONGEST_DELAY: one with a wrong clock must not make all right ones after it old.

Without the number only the clock decides. A new life is shorter than the time since the old one was heard, so
a controller whose clock shows more has not restarted, however slow its clock is (a simulation on a loaded
machine may lose half of each second). One whose clock shows less, and has fallen behind ours, counts as
restarted. That is the safe mistake: it stops a robot again that was released; the other one forgets a stop.
"""

from __future__ import annotations

from typing import NamedTuple

from robotree.protocol.services.heartbeat import SILENCE

_CLOCK_WRAP = 1 << 32
"""[ms] after which the clock on the wire wraps to 0."""
MAX_JITTER = 1.0
"""[s] by which the delays of two reports may differ."""
LONGEST_DELAY = SILENCE
"""[s] The same where the number of the life is sent. A stream keeps the order of its reports; a router may
repeat one later. This is also how long one report with a wrong clock can suppress the right ones."""


class Report(NamedTuple):
    """When a report was made, and when it arrived."""

    boot_ms: int
    """[ms] since the controller started."""
    heard_at: float
    """[s] on our clock."""
    life: int = 0
    """Number of the controller's life; 0: not sent."""


def has_restarted(before: Report, after: Report) -> bool:
    """Whether the controller restarted between two reports.

    The clock on the wire wraps after 49.7 days; without the number of a life that also counts as a restart.
    """
    if before.life and after.life:
        return before.life != after.life or _clock_lag(before, after) > LONGEST_DELAY
    advanced = (after.boot_ms - before.boot_ms) / 1000
    passed = after.heard_at - before.heard_at
    younger = after.boot_ms / 1000 < passed + MAX_JITTER
    return advanced < (passed - MAX_JITTER if younger else -MAX_JITTER)


def is_older(before: Report, after: Report) -> bool:
    """Whether the second report was made before the first, in the same life, and arrived late.

    A report of a new life is taken for one if the old life was not longer than the new one by more than
    MAX_JITTER. That lasts for MAX_JITTER at most, longer if the old report was delayed longer than the new.
    """
    if before.life and after.life:
        return before.life == after.life and 0 < _clock_lag(before, after) <= LONGEST_DELAY
    return after.boot_ms < before.boot_ms and not has_restarted(before, after)


def _clock_lag(before: Report, after: Report) -> float:
    """By how much the second report's clock is behind the first one's [s]; negative: it is ahead."""
    return ((before.boot_ms - after.boot_ms + _CLOCK_WRAP // 2) % _CLOCK_WRAP - _CLOCK_WRAP // 2) / 1000
