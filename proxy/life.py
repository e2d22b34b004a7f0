"""Whether two words of a controller are of one life, and in which order they were said: by its clock. Pure.

A controller that tells a number of its life tells both by that and its clock. A number may come again, after
65 535 starts or because a controller without memory draws it: then its clock, which has fallen, tells the
restart. One wrong word must not make the right ones after it be taken for old ones, so only what is a little
older is. The rest of this page is about controllers that tell no number. The clock begins anew when the
controller restarts.

A new life is younger than the time that has passed since the old one was heard. So a controller whose clock
shows more than that is the old one, however slowly that clock goes: a simulation on a loaded machine may lose
half of each second. One that shows less, and has fallen behind our clock, counts as new, though it may be a
slow one that was not heard for long. Of the two mistakes it is the safe one: who takes the old for a new one
stops what somebody has released, who takes a new one for the old forgets a stop.
"""

from __future__ import annotations

from typing import NamedTuple

from robotree.protocol.services.heartbeat import SILENCE

_TURN = 1 << 32
"""[ms] After so long the wire's clock begins anew."""
LATE = 1.0
"""[s] by which one word may have been longer on its way than another."""
LONGEST_WAY = SILENCE
"""[s] The same where a number of the life is told. Over a stream nothing is overtaken; behind a router that
repeats words, this is long, and as long as one wrong word can keep the right ones out."""


class Word(NamedTuple):
    """When something was said."""

    boot_ms: int
    """[ms] since the controller began to live."""
    heard_at: float
    """[s] on our clock."""
    life: int = 0
    """Names the controller's life; 0: it is not told."""


def restarted(before: Word, after: Word) -> bool:
    """Whether the controller began a new life between two words.

    The wire's clock begins anew after 49.7 days; where no life is told, that passes for a new one, too.
    """
    if before.life and after.life:
        return before.life != after.life or _behind(before, after) > LONGEST_WAY
    advanced = (after.boot_ms - before.boot_ms) / 1000
    passed = after.heard_at - before.heard_at
    younger = after.boot_ms / 1000 < passed + LATE
    return advanced < (passed - LATE if younger else -LATE)


def overtaken(before: Word, after: Word) -> bool:
    """Whether the second word was said before the first, in the same life, and was longer on its way.

    A word of a new life passes for it where the old one was not older than the new one by more than LATE.
    That is over within LATE.
    """
    if before.life and after.life:
        return before.life == after.life and 0 < _behind(before, after) <= LONGEST_WAY
    return after.boot_ms < before.boot_ms and not restarted(before, after)


def _behind(before: Word, after: Word) -> float:
    """By how much the second word's clock is behind the first one's [s]; negative: it is ahead."""
    return ((before.boot_ms - after.boot_ms + _TURN // 2) % _TURN - _TURN // 2) / 1000
