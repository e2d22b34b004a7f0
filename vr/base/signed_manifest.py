"""The manifest of a bundle with its signature, as it travels with a page in requests and in the journal."""

from __future__ import annotations

import msgspec


class SignedManifest(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a signer says of a page. Nothing of it is believed before `bundle.admission` has looked at it."""

    manifest: bytes
    """JSON, exactly as it was signed: see `bundle.manifest`."""
    signature: str
    """Of the manifest, in the armoured form of OpenSSH (PROTOCOL.sshsig)."""
    certificate: bytes = b""
    """Of the signer's key, from the authority of a realm; empty: it is a key of its own."""
