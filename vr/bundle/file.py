"""A bundle as one plain file, which can be mailed: a ZIP archive with rules of its own.

    manifest.json     exactly as it was signed
    manifest.json.sig the signature, which `ssh-keygen -Y verify -n robotree-bundle` can check
    certificate       of the signer's key, if a realm's authority has given one
    files/…           the page and what belongs to it

Any tool can look into one. Ours reads none that could harm who reads it: nothing is ever unpacked to a disk,
and a bundle is refused, with the reason, if a path leads out of it, a name stands twice, it has a link, a
folder or an encrypted part, something lies before, between or behind its parts, a part is larger than it
says, or it is larger than a page may be.
"""

from __future__ import annotations

import io
import stat
import struct
import zipfile
import zlib
from pathlib import Path
from typing import Self

import msgspec

from robotree.files import read, replace
from robotree.vr.base.errors import BadBundle, NoSuchFile
from robotree.vr.base.permissions import SignedManifest
from robotree.vr.bundle.beside import LARGEST as LARGEST_BESIDE
from robotree.vr.bundle.beside import MOST
from robotree.vr.bundle.manifest import LARGEST as LARGEST_MANIFEST
from robotree.vr.bundle.manifest import Manifest, expect_inside, expect_same, read_manifest

LARGEST_PAGE = 1_000_000
"""[bytes] of the page."""
LARGEST = LARGEST_BESIDE + LARGEST_PAGE + LARGEST_MANIFEST + (1 << 16)
"""[bytes] of a bundle, packed or not."""

_MANIFEST, _SIGNATURE, _CERTIFICATE, _FILES = "manifest.json", "manifest.json.sig", "certificate", "files/"
_LIMITS = {_MANIFEST: LARGEST_MANIFEST, _SIGNATURE: 4096, _CERTIFICATE: 2048}
_WRITTEN_AT = (1980, 1, 1, 0, 0, 0)
"""The earliest date of a ZIP: the same bundle has the same bytes, whenever it was written."""
_PLAIN_FILE = (stat.S_IFREG | 0o644) << 16
_LOCAL_HEADER = 30
_END = struct.Struct("<4s4H2IH")


class BundleFile(msgspec.Struct, frozen=True):
    """The content of a bundle. What it says of itself is not checked here: see `admission`."""

    signed: SignedManifest
    files: dict[str, bytes]

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a bundle from a file.

        Raises:
            NoSuchFile: it cannot be read, or is no ordinary file.
            BadBundle: a rule is broken; says which.
        """
        try:
            data = read(path, LARGEST)
        except OSError as error:
            raise NoSuchFile(path=str(path), reason=error.strerror or str(error)) from None
        return cls.unpack(data, str(path))

    @classmethod
    def unpack(cls, data: bytes, path: str) -> Self:
        """Read a bundle.

        Args:
            data: of the file.
            path: of the file, for messages.

        Raises:
            BadBundle: a rule is broken; says which.
        """
        parts = _parts(data, path)
        for needed in (_MANIFEST, _SIGNATURE):
            if needed not in parts:
                raise BadBundle(path=path, reason=f"it has no {needed}")
        manifest, certificate = parts.pop(_MANIFEST), parts.pop(_CERTIFICATE, b"")
        try:
            signature = parts.pop(_SIGNATURE).decode("ascii")
        except UnicodeDecodeError:
            raise BadBundle(path=path, reason="its signature cannot be read") from None
        files = {name.removeprefix(_FILES): content for name, content in parts.items()}
        found = cls(SignedManifest(manifest, signature, certificate), files)
        expect_same(found.manifest(path), files, path)
        return found

    def manifest(self, path: str) -> Manifest:
        """Return the manifest.

        Raises:
            BadBundle: it cannot be used.
        """
        return read_manifest(self.signed.manifest, path)

    def pack(self) -> bytes:
        """Return the file: the same bytes for the same content."""
        parts = {_MANIFEST: self.signed.manifest, _SIGNATURE: self.signed.signature.encode()}
        if self.signed.certificate:
            parts[_CERTIFICATE] = self.signed.certificate
        parts |= {f"{_FILES}{name}": content for name, content in sorted(self.files.items())}
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, content in parts.items():
                info = zipfile.ZipInfo(name, _WRITTEN_AT)
                info.external_attr, info.create_system = _PLAIN_FILE, 3
                archive.writestr(info, content, zipfile.ZIP_DEFLATED)
        return stream.getvalue()

    def write(self, path: Path) -> None:
        """Write the file.

        Raises:
            NoSuchFile: it cannot be written.
        """
        try:
            replace(path, self.pack())
        except OSError as error:
            raise NoSuchFile(path=str(path), reason=error.strerror or str(error)) from None


def _parts(data: bytes, path: str) -> dict[str, bytes]:
    """Return the parts of an archive by name.

    Raises:
        BadBundle: it is none, or a rule is broken.
    """
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
        infos = archive.infolist()
    except (zipfile.BadZipFile, ValueError, OSError, UnicodeDecodeError, NotImplementedError):
        raise BadBundle(path=path, reason="it is no bundle") from None
    _expect_plain(archive, infos, data, path)
    return {info.filename: _content(archive, info, path) for info in infos}


def _expect_plain(archive: zipfile.ZipFile, infos: list[zipfile.ZipInfo], data: bytes, path: str) -> None:
    """Refuse an archive that could harm who reads it, from its list of parts alone.

    Raises:
        BadBundle: says which rule is broken.
    """
    reason = ""
    if len(infos) > MOST + len(_LIMITS) + 1:
        reason = f"it has {len(infos)} parts, and {MOST} files are allowed"
    elif len({info.filename for info in infos}) < len(infos):
        reason = "a name stands twice in it"
    elif sum(info.file_size for info in infos) > LARGEST:
        reason = f"it is larger than {LARGEST // 1_000_000} MB when it is unpacked"
    elif archive.comment or any(info.comment for info in infos) or _gaps(infos, data, archive):
        reason = "something is hidden before, between or behind its parts"
    if reason:
        raise BadBundle(path=path, reason=reason)
    for info in infos:
        _expect_plain_part(info, path)


def _expect_plain_part(info: zipfile.ZipInfo, path: str) -> None:
    kind = stat.S_IFMT(info.external_attr >> 16)
    name, reason = info.filename, ""
    if info.orig_filename != name:
        reason = f"the path {name!r} is not in its plain form"
    elif stat.S_ISLNK(kind):
        reason = f"{name} is a link"
    elif info.is_dir() or kind not in (0, stat.S_IFREG):
        reason = f"{name} is no plain file"
    elif info.flag_bits & 0x1:
        reason = f"{name} is encrypted"
    elif info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        reason = f"{name} is packed in a way that is not taken"
    elif name not in _LIMITS and not name.startswith(_FILES):
        reason = f"{name!r} belongs to no bundle"
    elif info.file_size > _LIMITS.get(name, LARGEST_BESIDE):
        reason = f"{name} is larger than {_LIMITS.get(name, LARGEST_BESIDE)} bytes"
    if reason:
        raise BadBundle(path=path, reason=reason)
    if name not in _LIMITS:
        expect_inside(name.removeprefix(_FILES), path)


def _gaps(infos: list[zipfile.ZipInfo], data: bytes, archive: zipfile.ZipFile) -> bool:
    """Whether something lies before, between or behind the parts: others could see another archive."""
    at = 0
    for info in sorted(infos, key=lambda one: one.header_offset):
        if info.header_offset != at or info.flag_bits & 0x8 or len(data) < at + _LOCAL_HEADER:
            return True
        name, extra = (int.from_bytes(data[at + offset : at + offset + 2], "little") for offset in (26, 28))
        if extra or data[at + _LOCAL_HEADER : at + _LOCAL_HEADER + name] != info.filename.encode():
            return True
        at += _LOCAL_HEADER + name + info.compress_size
    return at != archive.start_dir or not _ends_plainly(data, at)


def _ends_plainly(data: bytes, at: int) -> bool:
    """Whether the list of parts begins at a place, and nothing but its plain end follows (APPNOTE 4.3.16)."""
    end = data[-_END.size :]
    if len(end) < _END.size:
        return False
    sign, _, _, _, _, size, offset, comment = _END.unpack(end)
    return sign == b"PK\x05\x06" and not comment and offset == at and at + size + _END.size == len(data)


def _content(archive: zipfile.ZipFile, info: zipfile.ZipInfo, path: str) -> bytes:
    """Return what is in a part, which may be no larger than it says.

    Raises:
        BadBundle: it is, or is damaged.
    """
    try:
        with archive.open(info) as part:
            content = part.read(info.file_size + 1)
            more = part.read(1)
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, OSError, NotImplementedError, RuntimeError):
        raise BadBundle(path=path, reason=f"{info.filename} is damaged") from None
    if len(content) != info.file_size or more:
        raise BadBundle(path=path, reason=f"{info.filename} has another size than it says")
    return content
