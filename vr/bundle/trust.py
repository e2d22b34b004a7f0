"""The signers whom a host trusts: a file in the form of OpenSSH's allowed_signers, with permissions. Pure.

    anna@lab namespaces="robotree-bundle" ssh-ed25519 AAAA… may=Arm.*,Rover.move isolation=process
    *@plant cert-authority ssh-ed25519 AAAA…

`ssh-keygen -Y verify -f allowed_signers` reads the same file (ssh-keygen(1), ALLOWED SIGNERS): for OpenSSH,
what stands behind a key is a comment. There robotree looks for

    may=KIND.COMMAND,…      commands that pages of this signer may call
    readings=KIND.READING,… readings that they may see
    streams=VIEW.CAMERA,…   cameras that they may see
    isolation=LEVEL         how they run at least: none, process or sandbox

A sort that is not named is not limited. `cert-authority` with the key of a realm's authority trusts
the realm's members whose names, `anna@plant`, fit. The list of revoked keys has one public key in a line, as
`ssh-keygen -Y verify -r` reads it.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from typing import NamedTuple

from robotree.vr.base.errors import BadTrustFile
from robotree.vr.base.permissions import ALL, LEVELS, Isolation, Permissions
from robotree.vr.sites.certificates import PublicKey
from robotree.vr.sites.ssh import KIND, public_text, read_public

NAMESPACE = "robotree-bundle"
"""Signatures of bundles are made for this purpose, and count for no other one."""
LARGEST = 1 << 20
"""[bytes] of a file of trust."""

_WORD = re.compile(r'(?:"[^"]*"|[^\s"])+')
_OPTION = re.compile(r'([a-z-]+)(?:="([^"]*)")?(?:,|$)')
_MOMENT = re.compile(r"(\d{8})(\d{4})?(\d{2})?(Z?)")
_SORTS = {"may": "commands", "readings": "readings", "streams": "streams"}


class Signer(NamedTuple):
    """One line of the file."""

    names: tuple[str, ...]
    """Patterns of names."""
    key: PublicKey
    permissions: Permissions = ALL
    """What pages of this signer may do at most."""
    isolation: Isolation = "process"
    """How they run at least."""
    authority: bool = False
    """The key is that of a realm's authority, and its members are meant."""
    begins: float = 0.0
    ends: float = float("inf")
    """[s since 1970] in between it counts."""

    @property
    def name(self) -> str:
        """The first name, for people."""
        return self.names[0]

    def fits(self, name: str) -> bool:
        """Whether somebody of this name is meant: a pattern with `!` excludes."""
        excluded = any(fnmatchcase(name, one[1:]) for one in self.names if one.startswith("!"))
        return not excluded and any(fnmatchcase(name, one) for one in self.names)

    def words(self, permissions: Permissions) -> str:
        """Return what is typed behind `robotree bundle trust` for other permissions of this signer."""
        may = ",".join(dict.fromkeys(permissions.commands))
        authority = ["--authority"] * self.authority
        name = shlex.quote(",".join(self.names))
        words = [public_text(self.key), "--name", name, *authority, "--may", shlex.quote(may)]
        return " ".join([*words, "--isolation", self.isolation, "--replace"])

    def line(self) -> str:
        """Return the line of the file that says this; without limits of time."""
        words = [",".join(self.names), f'namespaces="{NAMESPACE}"']
        if self.authority:
            words[1] = f"cert-authority,{words[1]}"
        words.append(public_text(self.key))
        for word, sort in _SORTS.items():
            if (granted := getattr(self.permissions, sort)) != getattr(ALL, sort):
                words.append(f"{word}={','.join(granted)}")
        return " ".join([*words, f"isolation={self.isolation}"])


class Signers(NamedTuple):
    """Whom a host trusts."""

    known: tuple[Signer, ...] = ()
    revoked: frozenset[PublicKey] = frozenset()

    def find(self, key: PublicKey) -> Signer | None:
        """Return the line of a key; None: there is none."""
        return next((one for one in self.known if one.key == key and not one.authority), None)


def read_signers(text: str, path: str) -> tuple[Signer, ...]:
    """Read a file of trust.

    Args:
        text: of the file.
        path: of the file, for messages.

    Raises:
        BadTrustFile: a line cannot be read; no line of the file counts then.
    """
    found: list[Signer] = []
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() and not line.lstrip().startswith("#"):
            try:
                signer = _read_line(line)
            except ValueError as error:
                raise BadTrustFile(path=path, line=f":{number}", reason=str(error)) from None
            if signer is not None:
                found.append(signer)
    return tuple(found)


def read_revoked(text: str, path: str) -> frozenset[PublicKey]:
    """Read a list of revoked keys.

    Args:
        text: of the file.
        path: of the file, for messages.

    Raises:
        BadTrustFile: a line cannot be read.
    """
    found: set[PublicKey] = set()
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        if words and not words[0].startswith("#"):
            try:
                kind, key = words[:2]
                found.add(read_public(kind, key))
            except ValueError as error:
                raise BadTrustFile(path=path, line=f":{number}", reason=str(error)) from None
    return frozenset(found)


def granted(words: Iterable[str]) -> tuple[Permissions, Isolation]:
    """Read `may=…`, `readings=…`, `streams=…` and `isolation=…`; other words are a comment.

    Raises:
        ValueError: one cannot be read.
    """
    sorts = {sort: getattr(ALL, sort) for sort in _SORTS.values()}
    isolation: Isolation = "process"
    for word in words:
        name, equals, value = word.partition("=")
        if equals and name in _SORTS:
            sorts[_SORTS[name]] = tuple(one for one in value.split(",") if one)
        elif equals and name == "isolation":
            if value not in LEVELS:
                raise ValueError(f"there is no isolation {value!r}; there are: {', '.join(LEVELS)}")
            isolation = LEVELS[LEVELS.index(value)]
    permissions = Permissions(**sorts)
    permissions.expect_sane()
    return permissions, isolation


def _read_line(line: str) -> Signer | None:
    """Read one line; None: it is for other purposes.

    Raises:
        ValueError: it cannot be read.
    """
    words = _WORD.findall(line)
    at = next((index for index, word in enumerate(words) if word.startswith(("ssh-", "ecdsa-", "sk-"))), 0)
    if at not in {1, 2} or len(words) < at + 2:
        raise ValueError(f"write: NAME {KIND} KEY")
    names = tuple(one for one in words[0].strip('"').split(",") if one)
    options = _options(words[1]) if at == 2 else {}
    spaces = options.get("namespaces")
    if not names or (
        spaces is not None and not any(fnmatchcase(NAMESPACE, one) for one in spaces.split(","))
    ):
        return None
    if words[at] != KIND:
        return None  # of a kind that signs nothing here
    permissions, isolation = granted(words[at + 2 :])
    return Signer(
        names,
        read_public(words[at], words[at + 1]),
        permissions,
        isolation,
        "cert-authority" in options,
        _moment(options.get("valid-after", ""), 0.0),
        _moment(options.get("valid-before", ""), float("inf")),
    )


def _options(word: str) -> dict[str, str]:
    found: dict[str, str] = {}
    while word:
        option = _OPTION.match(word)
        if option is None or option[1] not in {"cert-authority", "namespaces", "valid-after", "valid-before"}:
            raise ValueError(f"the option {word!r} is not known")
        found[option[1]], word = option[2] or "", word[option.end() :]
    return found


def _moment(text: str, otherwise: float) -> float:
    """Read a moment as OpenSSH writes it, YYYYMMDD[HHMM[SS]][Z]; returns [s since 1970]."""
    if not text:
        return otherwise
    found = _MOMENT.fullmatch(text)
    if found is None:
        raise ValueError(f"{text!r} is no moment; write YYYYMMDD or YYYYMMDDHHMMZ")
    day, time, seconds, utc = found.groups()
    moment = datetime.strptime(f"{day}{time or '0000'}{seconds or '00'}", "%Y%m%d%H%M%S")  # noqa: DTZ007 # below
    return (moment.replace(tzinfo=UTC) if utc else moment.astimezone()).timestamp()
