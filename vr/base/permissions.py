"""What a page may do beyond itself: commands that it may call, readings and streams that it may see. Pure.

A permission is `KIND.NAME`: the kind of the robot that is asked and the name of its command or reading. Each
of the two may be `*`. A robot has several kinds, and one of them is enough. A stream is `VIEW.CAMERA`.

The manifest of a bundle says what its page needs, and the file of trust what its signer may grant. A page
without a manifest is its user's own, and is not limited: it has no `Permissions`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Literal, get_args

import msgspec

Isolation = Literal["none", "process", "sandbox"]
"""How the code of a page is kept from harming others, from least to most."""
LEVELS: tuple[Isolation, ...] = get_args(Isolation)

ANY = "*"
EVERYTHING = f"{ANY}.{ANY}"
MOST = 256
"""Permissions of one sort."""

_PERMISSION = re.compile(r"(?:[A-Za-z_][\w-]{0,63}|\*)\.(?:[A-Za-z_][\w-]{0,63}|\*)")


class Permissions(msgspec.Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """A set of permissions; empty: for nothing."""

    commands: tuple[str, ...] = ()
    """`KIND.COMMAND`"""
    readings: tuple[str, ...] = ()
    """`KIND.READING`"""
    streams: tuple[str, ...] = ()
    """`VIEW.CAMERA`"""

    def may_call(self, kinds: Iterable[str], command: str) -> bool:
        """Whether a command of a robot of these kinds may be called."""
        return _allows(self.commands, kinds, command)

    def may_read(self, kinds: Iterable[str], reading: str) -> bool:
        """Whether a reading of a robot of these kinds may be seen."""
        return _allows(self.readings, kinds, reading)

    def may_read_any(self, kinds: Iterable[str]) -> bool:
        """Whether some reading of a robot of these kinds may be seen."""
        asked = {ANY, *kinds}
        return any(one.partition(".")[0] in asked for one in self.readings)

    def may_see(self, view: str, camera: str) -> bool:
        """Whether the pictures of a camera may be seen."""
        return _allows(self.streams, (view,), camera)

    def beyond(self, other: Permissions) -> Iterator[str]:
        """Yield what these permissions have and the other ones have not, in words."""
        for sort in self.__struct_fields__:
            granted = getattr(other, sort)
            for one in getattr(self, sort):
                if not any(_covers(permission, one) for permission in granted):
                    yield f"{sort} {one}"

    def expect_sane(self) -> None:
        """Refuse what is no permission.

        Raises:
            ValueError: one cannot be read, or there are too many.
        """
        for sort in self.__struct_fields__:
            found = getattr(self, sort)
            if len(found) > MOST:
                raise ValueError(f"{len(found)} {sort} are more than {MOST}")
            for one in found:
                if not _PERMISSION.fullmatch(one):
                    raise ValueError(f"{one!r} is no permission; write KIND.NAME, such as Arm.move or Arm.*")


ALL = Permissions((EVERYTHING,), (EVERYTHING,), (EVERYTHING,))
"""What a signer may grant who is not limited."""


def _allows(permissions: Iterable[str], kinds: Iterable[str], name: str) -> bool:
    asked = (ANY, *kinds)
    for permission in permissions:
        kind, _, what = permission.partition(".")
        if what in (ANY, name) and kind in asked:
            return True
    return False


def _covers(wide: str, narrow: str) -> bool:
    """Whether whatever one permission allows, another one allows too."""
    pairs = zip(wide.split("."), narrow.split("."), strict=True)
    return all(left in (ANY, right) for left, right in pairs)


class SignedManifest(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a signer says of a page. Nothing of it is believed before `bundle.admission` has looked at it."""

    manifest: bytes
    """JSON, exactly as it was signed: see `bundle.manifest`."""
    signature: str
    """Of the manifest, in the armoured form of OpenSSH (PROTOCOL.sshsig)."""
    certificate: bytes = b""
    """Of the signer's key, from the authority of a realm; empty: it is a key of its own."""
