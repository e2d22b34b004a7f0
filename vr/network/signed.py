"""Whether the authority of a realm has signed something: needed only where a realm has keys."""

from __future__ import annotations

from robotree.vr.base.policy import ABOUT


def is_signed(authority: bytes, signature: str, body: bytes) -> bool:
    """Whether a policy was signed; where `cryptography` is not installed nobody can tell, so it was not.

    Args:
        authority: public key, Ed25519, 32 bytes.
        signature: in hexadecimal.
        body: of the policy.
    """
    try:
        from cryptography.exceptions import InvalidSignature
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey
    except ImportError:
        return False
    try:
        Ed25519PublicKey.from_public_bytes(authority).verify(bytes.fromhex(signature), ABOUT + body)
    except (InvalidSignature, ValueError):
        return False
    return True
