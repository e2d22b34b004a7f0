"""The one place where a host decides whether it runs a page, what that may do, and how it is kept apart.

A page that nobody has signed and that this user asks for on this machine is its own: it runs as ever, and
nothing of this is loaded or read. All others must be signed by somebody whom the file of trust names, or with
a key of this user.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from robotree.files import text
from robotree.vr.base.errors import (
    BadBundle,
    BadTrustFile,
    ExcessPermission,
    NotAMember,
    NotSigned,
    RevokedSigner,
    UnknownSigner,
)
from robotree.vr.base.extras import lack_of
from robotree.vr.base.permissions import Isolation, Permissions
from robotree.vr.base.principal import ITSELF, Principal, user_name
from robotree.vr.bundle.bundle import Bundle
from robotree.vr.bundle.manifest import Manifest, expect_same, read_manifest

if TYPE_CHECKING:
    from robotree.vr.bundle.requirements import RequirementPolicy
    from robotree.vr.bundle.trust import Signer, Signers
    from robotree.vr.sites.keys import RealmKeys

TRUST_FILE, REVOKED_FILE = "allowed_signers", "revoked_signers"
"""Names of the two files, which lie in one folder."""


class Clearance(NamedTuple):
    """How a host runs a page."""

    signer: str = ""
    """Name of who has signed it; empty: nobody had to."""
    permissions: Permissions | None = None
    """What it may do; None: it is not limited."""
    isolation: Isolation = "none"
    """How its code is kept apart, at least."""
    unchecked: bool = False
    """Whether it runs only because of `--insecure-any-signer`."""


OWN = Clearance()
"""A page of this user, asked for on this machine."""


class Gate:
    """Decides for one host. May be used in any thread."""

    level: Isolation = "none"
    """How all robots of this process are kept apart."""

    def __init__(
        self,
        trust: Path | None = None,
        *,
        any_signer: bool = False,
        requirements: RequirementPolicy = "refuse",
        allowed: Collection[str] = (),
        own_keys: Callable[[], Collection[bytes]] = frozenset,
        realm: Callable[[], RealmKeys | None] = lambda: None,
        unix: Callable[[], float] = time.time,
    ) -> None:
        """Prepare.

        Args:
            trust: file of trust; the list of revoked keys lies beside it. None: nobody is trusted.
            any_signer: run what nobody trusted has signed, too; never meant for more than a trial.
            requirements: what is done with pages of others that need packages.
            allowed: names of packages, for the allowlist.
            own_keys: public keys of this user.
            realm: keys of the realm, whose list of revoked members counts.
            unix: [s since 1970].
        """
        self.any_signer = any_signer
        self._trust, self._allowed = trust, allowed
        self._requirements: RequirementPolicy = requirements
        self._own_keys, self._realm, self._unix = own_keys, realm, unix
        self._read: tuple[object, Signers] | None = None

    def admit(self, bundle: Bundle, asker: Principal, host: str) -> Clearance:
        """Decide on a page.

        Args:
            bundle: the page, as it came.
            asker: who wants it to run.
            host: name of the host, for messages.

        Raises:
            NotSigned: it comes from elsewhere, and nobody has signed it.
            UnknownSigner: nobody whom this host trusts has signed it.
            RevokedSigner: its signer was trusted once.
            ExcessPermission: it wants more than its signer may grant.
            BadBundle: its manifest or its signature cannot be used, or it is not as it was signed.
            BadTrustFile: the file of trust cannot be used.
            OtherPython: it does not run on this Python.
            MissingRequirement: it needs a package that is not here, or not allowed.
        """
        if bundle.signed is None:
            if is_own(asker) and not bundle.sender:
                return OWN
            if self.any_signer:
                return Clearance("nobody", None, "process", unchecked=True)
            sender = bundle.sender or asker.person or asker.agent or "another machine"
            raise NotSigned(path=bundle.path, sender=sender, host=host)
        from robotree.vr.bundle.requirements import expect_installed, expect_python

        manifest = read_manifest(bundle.signed.manifest, bundle.path)
        expect_python(manifest.python, bundle.path)
        try:
            clearance = self._clearance(bundle, manifest, host)
        except ImportError as error:
            if lack := lack_of(error):
                reason = f"its signature cannot be checked: on this host {lack}"
                raise BadBundle(path=bundle.path, reason=reason) from None
            raise
        own = not clearance.signer
        expect_installed(manifest.requires, bundle.path, None if own else self._requirements, self._allowed)
        return clearance

    def _clearance(self, bundle: Bundle, manifest: Manifest, host: str) -> Clearance:
        from robotree.vr.bundle.trust import NAMESPACE
        from robotree.vr.sites.ssh import public_text, signer_of

        path, signed = bundle.path, bundle.signed
        assert signed is not None  # noqa: S101 # see `admit`
        try:
            key = signer_of(signed.signature, signed.manifest, NAMESPACE)
        except ValueError as error:
            raise BadBundle(path=path, reason=str(error)) from None
        if public_text(key) != manifest.signer:
            reason = "it is signed with another key than its manifest names"
            raise BadBundle(path=path, reason=reason)
        expect_same(manifest, {manifest.page: bundle.source.encode(), **bundle.files}, path)
        if manifest.wanted != bundle.wanted:
            raise BadBundle(
                path=path, reason=f"its manifest is for the class {manifest.wanted or 'it has'!r}"
            )
        if key in self._own_keys():
            return Clearance("", manifest.permissions)
        try:
            signer, name = self._trusted(key, signed.certificate, path, host)
        except (UnknownSigner, RevokedSigner):
            if self.any_signer:
                return Clearance(manifest.signer, manifest.permissions, "process", unchecked=True)
            raise
        if beyond := ", ".join(manifest.permissions.beyond(signer.permissions)):
            again = signer.words(Permissions((*signer.permissions.commands, *manifest.permissions.commands)))
            raise ExcessPermission(path=path, permissions=beyond, signer=name, again=again)
        return Clearance(name, manifest.permissions, signer.isolation)

    def _trusted(self, key: bytes, certificate: bytes, path: str, host: str) -> tuple[Signer, str]:
        """Return the line that trusts a key, and the name of its owner.

        Raises:
            UnknownSigner: there is none.
            RevokedSigner: there was one.
        """
        from robotree.vr.sites.ssh import public_text

        signers, now, text = self.signers(), self._unix(), public_text(key)
        if key in signers.revoked:
            raise RevokedSigner(path=path, signer=text, reason="the key is on the list of revoked ones")
        signer, name, reason = signers.find(key), "", ""
        if signer is not None:
            name = signer.name
        elif certificate:
            signer, name = self._member(signers, key, certificate, path)
        if signer is None:
            raise UnknownSigner(path=path, signer=text, host=host)
        if now >= signer.ends:
            reason = f"the trust in {name} has ended; `robotree bundle trust` prolongs it"
        elif now < signer.begins:
            reason = f"the trust in {name} has not begun yet"
        if reason:
            raise RevokedSigner(path=path, signer=text, reason=reason)
        return signer, name

    def _member(
        self, signers: Signers, key: bytes, certificate: bytes, path: str
    ) -> tuple[Signer | None, str]:
        """Return the line that trusts the authority of a realm to which a key belongs, and its owner's name.

        Raises:
            RevokedSigner: the authority has ended that.
        """
        from robotree.vr.sites.certificates import Trust, claimed
        from robotree.vr.sites.ssh import public_text

        said = claimed(certificate)
        if said is None or said.key != key:
            return None, ""
        name, keys = f"{said.name}@{said.realm}", self._realm()
        for signer in signers.known:
            if not signer.authority or not signer.fits(name):
                continue
            trust = Trust(said.realm, signer.key)
            if keys is not None and (keys.realm, keys.trust.authority) == (said.realm, signer.key):
                keys.take_revocations()
                trust = keys.trust
            try:
                trust.certificate(certificate, self._unix())
            except NotAMember as error:
                if signer.key == trust.authority and "signed" in str(error):
                    continue
                raise RevokedSigner(path=path, signer=public_text(key), reason=str(error)) from None
            return signer, name
        return None, ""

    def signers(self) -> Signers:
        """Return whom this host trusts; the files are read again when they have changed.

        Raises:
            BadTrustFile: one cannot be used.
        """
        from robotree.vr.bundle.trust import LARGEST, Signers, read_revoked, read_signers

        if self._trust is None:
            return Signers()
        files = (self._trust, self._trust.with_name(REVOKED_FILE))
        look = tuple(map(_look, files))
        if self._read is None or self._read[0] != look:
            texts = [
                "" if seen is None else _text(file, LARGEST) for file, seen in zip(files, look, strict=True)
            ]
            known, revoked = read_signers(texts[0], str(files[0])), read_revoked(texts[1], str(files[1]))
            self._read = look, Signers(known, revoked)
        return self._read[1]


def is_own(asker: Principal) -> bool:
    """Whether somebody is this user, on this machine, and not limited."""
    if asker == ITSELF:
        return True
    return not asker.site and asker.user == user_name(os.geteuid())


def _look(file: Path) -> tuple[int, int, int] | None:
    """Return how a file looks; None: it is not there.

    Raises:
        BadTrustFile: somebody else may write it.
    """
    try:
        seen = file.stat()
    except FileNotFoundError:
        return None
    except OSError as error:
        raise BadTrustFile(path=str(file), line="", reason=error.strerror or str(error)) from None
    if seen.st_uid not in {os.geteuid(), 0} or seen.st_mode & 0o022:
        reason = "others can write it; `chmod go-w` and own it"
        raise BadTrustFile(path=str(file), line="", reason=reason)
    return seen.st_mtime_ns, seen.st_ino, seen.st_size


def _text(file: Path, most: int) -> str:
    try:
        return text(file, most)
    except OSError as error:
        raise BadTrustFile(path=str(file), line="", reason=error.strerror or str(error)) from None
