"""The manifest of a bundle: what its page is, what it needs, and what it may do. Pure.

It is JSON in one form only, so that the same manifest has the same bytes, and its hash is the bundle's:
keys in the order of `Manifest`, no spaces. Who reads one that was written otherwise refuses it.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from pathlib import PurePosixPath

import msgspec

from robotree.vr.base.errors import BadBundle
from robotree.vr.base.permissions import Permissions

FORMAT = 1
LARGEST = 256 * 1024
"""[bytes] of a manifest."""
LONGEST_PATH = 200
DEEPEST = 16
"""Folders in a path."""
PANEL = ".panel.yaml"
"""End of the name of a file with a panel."""
PROGRAM = ".panel.py"
"""The same of one that is a program."""

_HASH = re.compile(r"[0-9a-f]{64}")
_NAME = re.compile(r"[A-Za-z_][\w-]{0,63}")
_CLASS = re.compile(r"(?:[A-Za-z_]\w{0,99})?")
_PART = re.compile(r"[^\x00-\x1f\x7f/\\:*?\"<>|]{1,100}")


class Manifest(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """See the module."""

    format: int = FORMAT
    name: str
    """Of the bundle: the name of the page's file without its end."""
    page: str
    """Path of the page among the files."""
    wanted: str = ""
    """Name of the class; empty: the only one in the page."""
    python: str = ""
    """Versions of Python that it runs on, such as `>=3.11` (PEP 440); empty: any."""
    requires: tuple[str, ...] = ()
    """Packages that must be installed where it runs (PEP 508)."""
    permissions: Permissions = Permissions()
    panel: str = ""
    """Path of its panel among the files; empty: it brings none."""
    files: dict[str, str]
    """SHA-256 of each file by its path, in hexadecimal; sorted."""
    signer: str
    """Public key of who signs it, as in allowed_signers: nobody else's signature counts."""

    def packed(self) -> bytes:
        """Return the bytes that are signed."""
        return msgspec.json.encode(self)


_decode = msgspec.json.Decoder(Manifest).decode


def read_manifest(packed: bytes, path: str) -> Manifest:
    """Read a manifest.

    Args:
        packed: as it came.
        path: of the bundle, for messages.

    Raises:
        BadBundle: it is none, or a rule is broken; says which.
    """
    if len(packed) > LARGEST:
        raise BadBundle(path=path, reason=f"its manifest is larger than {LARGEST // 1024} kB")
    try:
        manifest = _decode(packed)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise BadBundle(path=path, reason=f"its manifest cannot be read: {error}") from None
    if manifest.format != FORMAT:
        known = f"this version of robotree reads format {FORMAT}"
        raise BadBundle(path=path, reason=f"its manifest has format {manifest.format}; {known}")
    if manifest.packed() != packed:
        raise BadBundle(path=path, reason="its manifest is not in the one form that is signed")
    _expect_rules(manifest, path)
    return manifest


def _expect_rules(manifest: Manifest, path: str) -> None:
    """Refuse a manifest that breaks a rule.

    Raises:
        BadBundle: says which.
    """
    for file, digest in manifest.files.items():
        expect_inside(file, path)
        if not _HASH.fullmatch(digest):
            raise BadBundle(path=path, reason=f"the hash of {file} is none")
    if [*manifest.files] != sorted(manifest.files):
        raise BadBundle(path=path, reason="the files of its manifest are not sorted")
    if len({file.casefold() for file in manifest.files}) < len(manifest.files):
        raise BadBundle(path=path, reason="two of its files differ only in capital letters")
    for needed in (manifest.page, *filter(None, (manifest.panel,))):
        if needed not in manifest.files:
            raise BadBundle(path=path, reason=f"its manifest names {needed!r}, which is not among its files")
    if not _NAME.fullmatch(manifest.name) or not _CLASS.fullmatch(manifest.wanted):
        raise BadBundle(path=path, reason="its name, or that of its class, cannot be one")
    try:
        manifest.permissions.expect_sane()
    except ValueError as error:
        raise BadBundle(path=path, reason=str(error)) from None


def expect_inside(file: str, path: str) -> None:
    """Refuse the path of a file that leads out of its bundle, or that no system could have.

    Args:
        file: the path, from the folder of the bundle.
        path: of the bundle, for messages.

    Raises:
        BadBundle: says what is wrong with it.
    """
    parts = file.split("/")
    if len(file) > LONGEST_PATH or len(parts) > DEEPEST:
        raise BadBundle(path=path, reason=f"the path {file[:60]!r}… is too long")
    if file.startswith(("/", "~")) or ".." in parts:
        raise BadBundle(path=path, reason=f"the path {file!r} leads out of it")
    if any(part in ("", ".") or not _PART.fullmatch(part) or part.endswith((" ", ".")) for part in parts):
        raise BadBundle(path=path, reason=f"the path {file!r} is not in its plain form")
    if str(PurePosixPath(file)) != file:
        raise BadBundle(path=path, reason=f"the path {file!r} is not in its plain form")


def expect_same(manifest: Manifest, files: Mapping[str, bytes], path: str) -> None:
    """Refuse files that are not those of the manifest.

    Args:
        manifest: that was signed.
        files: all of them, by path.
        path: of the bundle, for messages.

    Raises:
        BadBundle: one is missing, changed, or not named in it.
    """
    for file, digest in manifest.files.items():
        if file not in files:
            raise BadBundle(path=path, reason=f"{file} is missing")
        if hashlib.sha256(files[file]).hexdigest() != digest:
            raise BadBundle(path=path, reason=f"{file} was changed after it was signed")
    for file in files:
        if file not in manifest.files:
            raise BadBundle(path=path, reason=f"{file} was added after it was signed")
