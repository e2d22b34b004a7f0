"""Why frames that arrive over a link are rejected, in the same words everywhere. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from robotree.protocol.signing import OLDEST_STREAM, UNITS

if TYPE_CHECKING:
    from robotree.protocol.signing import Verifier

ALLOWED_DELAY = OLDEST_STREAM / UNITS
"""[s] by which a clock may be behind ours."""
_STRANGE = "frames arrive but none is signed with our key"
_UNTIMELY = "frames arrive that are signed with our key but not new"
_WHAT = {
    "forged": _STRANGE,
    "unsigned": _STRANGE,
    "late": _UNTIMELY,
    "early": _UNTIMELY,
    "replayed": _UNTIMELY,
}
_ALLOWED = f"{ALLOWED_DELAY:.0f} s are allowed; set both clocks right"


class Rejection(NamedTuple):
    """The commonest reason for which frames were refused."""

    kind: str
    refused: int
    why: str
    """And what to do, as two clauses that either end can be told."""


def cause(verifier: Verifier) -> Rejection | None:
    """Return the most frequent cause of refusals; None: nothing was refused."""
    seen = verifier.statistics
    worst = max(
        Rejection(
            "forged",
            seen.forged,
            "they have the signature of another key; give both ends the same key, and the same name of the"
            " controller (its address, or ?controller=NAME)",
        ),
        Rejection("unsigned", seen.unsigned, "they have no signature; sign them with the key of this link"),
        Rejection("late", seen.late, _late(seen.behind)),
        Rejection("early", seen.early, f"their clock is {seen.ahead:.0f} s ahead, and {_ALLOWED}"),
        Rejection("replayed", seen.replayed, _replayed(seen.replayed, seen.repeated)),
        key=lambda each: each.refused,
    )
    return worst if worst.refused else None


def rejection(verifier: Verifier | None, *, keyless: int = 0) -> str:
    """One clause, or nothing.

    Args:
        verifier: has refused frames; None: the link has no key.
        keyless: frames that were signed while the link has no key: who signs obeys nobody without it.

    Returns:
        The clause: which it is, by how much, and what to do; empty: there is nothing to say.
    """
    if keyless:
        return f"its controller signs what it says and this link has no key ({keyless} refused)"
    worst = None if verifier is None else cause(verifier)
    return "" if worst is None else f"{_WHAT[worst.kind]} ({worst.refused} refused): {worst.why}"


def _late(behind: float) -> str:
    if behind > ALLOWED_DELAY:
        return f"their clock is {behind:.0f} s behind, and {_ALLOWED}, or give both ends a new key"
    return (
        f"their clock is {behind:.1f} s behind, so that they seem older than this program; "
        f"wait {behind:.0f} s, or set both clocks right, or give both ends a new key"
    )


def _replayed(replayed: int, repeated: int) -> str:
    if 2 * repeated > replayed:
        return "several have the same time; let it grow by 10 us with each frame"
    return "their time is not later than one that was heard; they are a recording, or came out of order"
