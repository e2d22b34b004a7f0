"""Keys, pages and bundles for the tests of this folder."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterable, Mapping
from hashlib import sha256
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from robotree.vr.base.permissions import Permissions
from robotree.vr.base.principal import Principal, this_process, user_name
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.build import SigningKey, file_of, signed
from robotree.vr.bundle.trust import Signer

PAGE = '''"""A page."""

from robotree.vr import Child, VirtualRobot, command


class Guide(VirtualRobot):
    arm = Child("Arm")

    @command
    def wave(self) -> float:
        """Wave."""
        self.arm.move(x=1.0)
        return self.arm.readings.z

    move = arm.exposed("move_to")
'''


def key_of(name: str) -> SigningKey:
    """Return the key of somebody: always the same one."""
    return SigningKey(Ed25519PrivateKey.from_private_bytes(sha256(name.encode()).digest()), name)


def signer(name: str, permissions: Permissions | None = None, **more: object) -> Signer:
    """Return the line of a file of trust that trusts somebody."""
    public = key_of(name).key.public_key().public_bytes_raw()
    given = {} if permissions is None else {"permissions": permissions}
    return Signer((name,), public, **given, **more)  # type: ignore[arg-type]


def trusting(folder: Path, *signers: Signer) -> Path:
    """Write a file of trust."""
    file = folder / "allowed_signers"
    file.write_text("".join(f"{one.line()}\n" for one in signers))
    file.chmod(0o600)
    return file


def page(files: Mapping[str, bytes] | None = None, source: str = PAGE) -> Bundle:
    """Return a page that nobody has signed."""
    return Bundle(source, "/home/anna/guide.py", "", dict(files or {}))


def of(name: str, permissions: Permissions | None = None, **more: object) -> Bundle:
    """Return a page that somebody has signed."""
    return signed(page(**more), key_of(name), permissions)  # type: ignore[arg-type]


def packed(bundle: Bundle) -> bytes:
    """Return the file of a bundle."""
    return file_of(bundle).pack()


def parts_of(data: bytes) -> list[tuple[zipfile.ZipInfo, bytes]]:
    """Return the parts of an archive."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return [(one, archive.read(one)) for one in archive.infolist()]


def archive_of(parts: Iterable[tuple[zipfile.ZipInfo | str, bytes]]) -> bytes:
    """Write an archive, as a forger would."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for info, content in parts:
            archive.writestr(info, content, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


ME = Principal(user_name(this_process().user), 1, "", "pts/1")
"""This user, on this machine."""
FROM_AFAR = Principal("anna", 1, "", "pts/1", "lab")
"""Somebody at another site."""
