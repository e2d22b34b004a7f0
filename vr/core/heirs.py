"""How a child knows the next process of a parent that moves.

Before it leaves, the parent makes a secret, which travels with it, and gives each child only the hash of a
proof that follows from the secret and from the child. The next process shows the proof. Pure.
"""

from __future__ import annotations

import hashlib


def proof_of(secret: str, child: str) -> str:
    """Return what the next process shows to a child; empty: there is no secret.

    Args:
        secret: of the move.
        child: key of the child: no child can use its proof at another one.
    """
    return hashlib.sha256(f"{secret}\n{child}".encode()).hexdigest() if secret else ""


def seal_of(proof: str) -> str:
    """Return what the child is given before, by which it knows the proof; empty: there is none."""
    return hashlib.sha256(proof.encode()).hexdigest() if proof else ""
