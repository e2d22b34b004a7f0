"""Why what arrives over a link is not believed, in the same words whoever asks. Pure."""

from __future__ import annotations


def disbelief(*, refused: int, keyless: int) -> str:
    """One clause, or nothing.

    Args:
        refused: frames that our key did not fit.
        keyless: frames that were signed while the link has no key: who signs obeys nobody without it.

    Returns:
        The clause; empty: there is nothing to say.
    """
    if keyless:
        return f"its controller signs what it says and this link has no key ({keyless} refused)"
    if refused:
        return f"frames arrive but none is signed with our key ({refused} refused)"
    return ""
