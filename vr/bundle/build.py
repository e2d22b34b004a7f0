"""Makes a bundle of a page, and signs it."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from msgspec.structs import replace

from robotree.files import read
from robotree.vr.base.errors import BadBundle, BrokenSource, NoSigningKey
from robotree.vr.base.permissions import ALL, Permissions, SignedManifest
from robotree.vr.bundle.bundle import Bundle, is_script
from robotree.vr.bundle.child_calls import needs
from robotree.vr.bundle.file import BundleFile
from robotree.vr.bundle.manifest import PANEL, PROGRAM, Manifest, expect_inside
from robotree.vr.bundle.requirements import declared
from robotree.vr.bundle.trust import NAMESPACE
from robotree.vr.sites.ssh import PrivateKey, private_key, public_text, signature_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from robotree.vr.sites.keys import RealmKeys

LARGEST_KEY = 1 << 14
"""[bytes] of a private key's file."""
SSH_KEY = "~/.ssh/id_ed25519"
"""The key that is used where a person names no other one, and is a member of no realm."""


class SigningKey(NamedTuple):
    """A key with which a person signs."""

    key: PrivateKey
    name: str
    """Where it is from, for people."""
    certificate: bytes = b""
    """From a realm's authority; empty: it is a key of its own."""

    @property
    def public(self) -> str:
        """The public half, as in allowed_signers."""
        return public_text(self.key.public_key().public_bytes_raw())


def realm_key(keys: RealmKeys) -> SigningKey:
    """Return the key with which this machine's person or site belongs to a realm."""
    own = keys.own
    return SigningKey(own.key, f"{keys.name}@{keys.realm}", own.certificate)


def ssh_key(path: str = SSH_KEY, password: Callable[[str], bytes] | None = None) -> SigningKey:
    """Return a key of OpenSSH.

    Args:
        path: of its file.
        password: asks for the password of a protected key; takes the path.

    Raises:
        NoSigningKey: it cannot be used; says why.
    """
    try:
        file = Path(path).expanduser()
        data = read(file, LARGEST_KEY)
    except (OSError, RuntimeError) as error:
        reason = f"{path}: {getattr(error, 'strerror', None) or error}; `ssh-keygen -t ed25519` makes one"
        raise NoSigningKey(reason=reason) from None
    try:
        try:
            return SigningKey(private_key(data), path)
        except ValueError as error:
            if password is None or "protected" not in str(error):
                raise
        return SigningKey(private_key(data, password(path)), path)
    except ValueError as error:
        raise NoSigningKey(reason=f"{path}: {error}") from None


def manifest_of(page: Bundle, signer: str, permissions: Permissions | None = None) -> Manifest:
    """Return the manifest of a page.

    Args:
        page: the page, with what belongs to it.
        signer: public key of who signs it.
        permissions: what it may do; None: what its head declares, else what its tree says that it needs.

    Raises:
        BrokenSource: it is no Python, or its head cannot be read.
        BadBundle: its name cannot be that of a bundle.
    """
    path = Path(page.path)
    script = is_script(page.path)
    head = declared("" if script else page.source, page.path)
    wants = permissions or head.permissions
    if wants is None:
        try:
            wants = ALL if script else needs(page.source, page.wanted)
        except (SyntaxError, ValueError) as error:
            raise BrokenSource(path=page.path, reason=str(error)) from None
    files = {path.name: page.source.encode(), **page.files}
    for file in files:
        expect_inside(file, page.path)
    panels = (f"{path.stem}{end}" for end in (PROGRAM, PANEL))
    return Manifest(
        name=path.stem,
        page=path.name,
        wanted=page.wanted,
        python=head.python,
        requires=head.requires,
        permissions=wants,
        panel=next((panel for panel in panels if panel in files), ""),
        files={file: hashlib.sha256(data).hexdigest() for file, data in sorted(files.items())},
        signer=signer,
    )


def sign(manifest: Manifest, key: SigningKey) -> SignedManifest:
    """Sign a manifest; its signer is the owner of the key then."""
    packed = replace(manifest, signer=key.public).packed()
    return SignedManifest(packed, signature_of(key.key, packed, NAMESPACE), key.certificate)


def signed(page: Bundle, key: SigningKey, permissions: Permissions | None = None) -> Bundle:
    """Return a page with a manifest that somebody has signed; see `manifest_of`."""
    return replace(page, signed=sign(manifest_of(page, key.public, permissions), key), sender="")


def file_of(page: Bundle) -> BundleFile:
    """Return the bundle of a signed page, for its file.

    Raises:
        BadBundle: nobody has signed it.
    """
    if page.signed is None:
        raise BadBundle(path=page.path, reason="nobody has signed it")
    return BundleFile(page.signed, {Path(page.path).name: page.source.encode(), **page.files})
