"""Keys and signatures in the forms of OpenSSH: people sign with the key that they have. Pure.

A signature has the form of PROTOCOL.sshsig (openssh/openssh-portable), so that `ssh-keygen -Y verify` can
check it without robotree, and `ssh-keygen -Y sign` can make it. Only Ed25519 (RFC 8032; the text form of its
keys is RFC 8709) is taken. What comes from elsewhere never raises anything but `ValueError`.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import re
import struct

from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey
from cryptography.hazmat.primitives.serialization import load_ssh_private_key

from robotree.vr.sites.certificates import KEY_SIZE, PublicKey

PrivateKey = Ed25519PrivateKey
KIND = "ssh-ed25519"
"""The one kind of key that is taken."""

_MAGIC, _VERSION = b"SSHSIG", 1
_HASHES = {"sha512": hashlib.sha512, "sha256": hashlib.sha256}
_BEGIN, _END = "-----BEGIN SSH SIGNATURE-----", "-----END SSH SIGNATURE-----"
_LONGEST = 4096
"""Characters of an armoured signature."""
_LINE = 70
_LENGTH = struct.Struct(">I")
_BASE64 = re.compile(r"[A-Za-z0-9+/]+={0,2}")


def private_key(data: bytes, password: bytes | None = None) -> Ed25519PrivateKey:
    """Read a private key as `ssh-keygen -t ed25519` writes it.

    Raises:
        ValueError: it is none of Ed25519, or it needs a password that was not given.
    """
    try:
        key = load_ssh_private_key(data, password)
    except TypeError:
        raise ValueError("it is protected by a password") from None
    except (ValueError, UnsupportedAlgorithm):
        raise ValueError("it is no private key of OpenSSH, or its password is another one") from None
    if not isinstance(key, Ed25519PrivateKey):
        raise ValueError("it is no Ed25519 key; `ssh-keygen -t ed25519` makes one")  # noqa: TRY004 # of data
    return key


def public_text(key: PublicKey) -> str:
    """Return a public key as it stands in authorized_keys and allowed_signers, without a comment."""
    return f"{KIND} {base64.b64encode(_blob(key)).decode()}"


def read_public(kind: str, text: str) -> PublicKey:
    """Read a public key from its two words.

    Raises:
        ValueError: it is none of Ed25519.
    """
    if kind != KIND:
        raise ValueError(f"a key of kind {kind[:40]!r} is not taken, only {KIND}")
    return _key_of(_decoded(text))


def signature_of(key: Ed25519PrivateKey, text: bytes, namespace: str) -> str:
    """Return the armoured signature of a text."""
    public = key.public_key().public_bytes_raw()
    hashed = hashlib.sha512(text).digest()
    made = key.sign(_to_sign(namespace, "sha512", hashed))
    inner = _string(KIND.encode()) + _string(made)
    head = _MAGIC + _LENGTH.pack(_VERSION) + _string(_blob(public)) + _string(namespace.encode())
    body = base64.b64encode(head + _string(b"") + _string(b"sha512") + _string(inner)).decode()
    lines = [body[at : at + _LINE] for at in range(0, len(body), _LINE)]
    return "\n".join((_BEGIN, *lines, _END, ""))


def signer_of(armoured: str, text: bytes, namespace: str) -> PublicKey:
    """Return the key that has signed a text.

    Raises:
        ValueError: the signature cannot be read, is for another purpose, or of another text.
    """
    lines = [line.strip() for line in armoured[: _LONGEST + 1].strip().splitlines()]
    if len(armoured) > _LONGEST or len(lines) < 3 or (lines[0], lines[-1]) != (_BEGIN, _END):
        raise ValueError("its signature has not the form of OpenSSH")
    data = _decoded("".join(lines[1:-1]))
    if not data.startswith(_MAGIC):
        raise ValueError("its signature has not the form of OpenSSH")
    version, data = _LENGTH.unpack(data[6:10].rjust(4, b"\0"))[0], data[10:]
    if version != _VERSION:
        raise ValueError(f"its signature has version {version}, and {_VERSION} is known")
    parts: list[bytes] = []
    for _ in range(5):
        part, data = _taken(data)
        parts.append(part)
    blob, used_for, _, hash_name, inner = parts
    if data or used_for != namespace.encode():
        raise ValueError(f"its signature is for {used_for[:40]!r}, not for {namespace}")
    kind, rest = _taken(inner)
    signature, rest = _taken(rest)
    hashing = _HASHES.get(hash_name.decode("ascii", "replace"))
    if rest or kind != KIND.encode() or hashing is None:
        raise ValueError("its signature is of a kind that is not taken")
    key, signed = _key_of(blob), _to_sign(namespace, hash_name.decode(), hashing(text).digest())
    try:
        Ed25519PublicKey.from_public_bytes(key).verify(signature, signed)
    except (InvalidSignature, ValueError):
        raise ValueError("its signature is of another text") from None
    return key


def _to_sign(namespace: str, hash_name: str, digest: bytes) -> bytes:
    parts = (namespace.encode(), b"", hash_name.encode(), digest)
    return _MAGIC + b"".join(map(_string, parts))


def _string(data: bytes) -> bytes:
    """Return a string as SSH writes it (RFC 4251, section 5)."""
    return _LENGTH.pack(len(data)) + data


def _taken(data: bytes) -> tuple[bytes, bytes]:
    """Take one string off; returns it and the rest.

    Raises:
        ValueError: it is cut off.
    """
    if len(data) < _LENGTH.size:
        raise ValueError("it is cut off")
    end = _LENGTH.size + _LENGTH.unpack_from(data)[0]
    if end > len(data):
        raise ValueError("it is cut off")
    return data[_LENGTH.size : end], data[end:]


def _blob(key: PublicKey) -> bytes:
    return _string(KIND.encode()) + _string(key)


def _key_of(blob: bytes) -> PublicKey:
    kind, rest = _taken(blob)
    key, rest = _taken(rest)
    if rest or kind != KIND.encode() or len(key) != KEY_SIZE:
        raise ValueError(f"the key is none of {KIND}")
    return key


def _decoded(text: str) -> bytes:
    if not _BASE64.fullmatch(text):
        raise ValueError("it is no base64")
    try:
        return base64.b64decode(text, validate=True)
    except binascii.Error:
        raise ValueError("it is no base64") from None
