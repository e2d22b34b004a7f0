"""`robotree bundle …`: pages that can be trusted, as files.

robotree bundle build team.py
robotree bundle verify team.bundle
robotree bundle trust team.bundle --name anna --may Arm.*
"""

from __future__ import annotations

import getpass
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line import sources
from robotree.tui.line.grammar import Line
from robotree.tui.processes.trust import gate_for, realm_keys, trust_file
from robotree.tui.terminal import answer

if TYPE_CHECKING:
    from robotree.vr.base.permissions import Permissions, SignedManifest
    from robotree.vr.bundle import Bundle
    from robotree.vr.bundle.admission import Gate
    from robotree.vr.bundle.build import SigningKey
    from robotree.vr.bundle.requirements import RequirementPolicy
    from robotree.vr.bundle.trust import Signer


def gate_of(line: Line, realm: str) -> Gate:
    """Return what decides which pages a host runs, as its line says."""
    policies: dict[str, RequirementPolicy] = {one: one for one in ("refuse", "allowlist", "locked")}
    policy = line.text("--requirements", "refuse")
    if policy not in policies:
        raise ValueRefused("--requirements", f"it is one of {', '.join(policies)}")
    return gate_for(
        realm,
        Path(line.text("--trust")).expanduser() if line.text("--trust") else None,
        any_signer=line.flag("--insecure-any-signer"),
        requirements=policies[policy],
        allowed=tuple(one for one in line.text("--allow-packages").split(",") if one),
    )


def signing_key(realm: str, path: str = "") -> SigningKey:
    """Return the key with which this person signs: a file, the realm's, or that of OpenSSH.

    Raises:
        NoSigningKey: there is none that can be used.
    """
    from robotree.vr.bundle.build import SSH_KEY, realm_key, ssh_key

    if not path and (keys := realm_keys(realm)) is not None:
        return realm_key(keys)
    return ssh_key(path or SSH_KEY, _password if sys.stdin.isatty() else None)


def _password(path: str) -> bytes:
    return getpass.getpass(f"Password of {path}: ").encode()


# -- the verbs -------------------------------------------------------------------------------------


def build(line: Line, realm: str) -> int:
    """Make a bundle of a page."""
    from robotree.vr.bundle import Bundle
    from robotree.vr.bundle.build import signed

    path, wanted = sources.found(line.text("FILE"))
    page = Bundle.read(path, wanted)
    if page.signed is not None:
        raise ValueRefused("FILE", f"{path} is a bundle; `robotree bundle sign {path}` signs it anew")
    page.examine()
    key = signing_key(realm, line.text("--key"))
    made = signed(page, key, _permissions(line))
    return _written(made, line.text("--out") or f"{Path(path).stem}.bundle", key)


def sign_anew(line: Line, realm: str) -> int:
    """Sign a bundle anew."""
    from robotree.vr.bundle import Bundle
    from robotree.vr.bundle.build import sign
    from robotree.vr.bundle.file import BundleFile

    path = line.text("FILE")
    found, key = BundleFile.read(Path(path).expanduser()), signing_key(realm, line.text("--key"))
    made = BundleFile(sign(found.manifest(path), key), found.files)
    return _written(Bundle.of_file(made, path), line.text("--out") or path, key)


def _written(page: Bundle, out: str, key: SigningKey) -> int:
    from robotree.vr.bundle.build import file_of

    packed = file_of(page)
    packed.write(Path(out).expanduser())
    size = len(packed.pack())
    text = f"{out}: {size} bytes, signed with the key of {key.name}\n  sha256:{page.hash}"
    answer(text, lambda: {"file": out, "bytes": size, "hash": page.hash, "signer": key.public})
    return exit_codes.DONE


def _bundle(line: Line) -> tuple[Bundle, SignedManifest]:
    """Read the bundle of a line."""
    from robotree.vr.bundle import Bundle

    path = line.text("FILE")
    page = Bundle.read(path)
    if page.signed is None:
        raise ValueRefused(
            "FILE", f"{path} is a page, not a bundle; `robotree bundle build {path}` makes one"
        )
    return page, page.signed


def verify(line: Line, realm: str) -> int:
    """Say whether a host of this user would run a bundle."""
    from robotree.vr.base.principal import ITSELF

    page, _ = _bundle(line)
    admission = gate_of(line, realm).admit(page, ITSELF, "this machine")
    who = f"is signed by {admission.signer}" if admission.signer else "is signed with a key of yours"
    level = f"; it runs with isolation {admission.isolation}" if admission.isolation != "none" else ""
    answer(
        f"{line.text('FILE')} is as it was signed, and {who}{level}", lambda: _seen(page, admission.signer)
    )
    return exit_codes.DONE


def show(line: Line, _realm: str) -> int:
    """Print what a bundle says of itself."""
    from robotree.vr.bundle.manifest import read_manifest

    page, signed = _bundle(line)
    manifest = read_manifest(signed.manifest, line.text("FILE"))
    rows = [f"{manifest.name}  {manifest.page}{f':{manifest.wanted}' if manifest.wanted else ''}"]
    rows.append(f"  sha256:{page.hash}")
    rows.append(f"  signer    {manifest.signer}")
    rows.append(f"  Python    {manifest.python or 'any'}")
    rows += _listed("needs", manifest.requires)
    rows += _listed("calls", manifest.permissions.commands)
    rows += _listed("reads", manifest.permissions.readings)
    rows += _listed("sees", manifest.permissions.streams)
    files = {manifest.page: page.source.encode(), **page.files}
    rows += _listed("files", (f"{name} ({len(files.get(name, b''))} bytes)" for name in manifest.files))
    answer("\n".join(rows), lambda: _seen(page, ""))
    return exit_codes.DONE


def _listed(title: str, words: Iterable[str]) -> list[str]:
    found = [*words]
    return [f"  {title:<9} {', '.join(found)}"] if found else []


def _seen(page: Bundle, signer: str) -> Mapping[str, Any]:
    import json

    assert page.signed is not None  # noqa: S101 # see the callers
    return {"hash": page.hash, "trusted_as": signer, **json.loads(page.signed.manifest)}


def trust(line: Line, _realm: str) -> int:
    """Trust a key, end that, or list whom hosts of this user trust."""
    file, words = trust_file() if not line.text("--trust") else Path(line.text("--trust")), line.many("KEY")
    if line.flag("--revoke"):
        return _revoke(file, words)
    if not words:
        return _list(file)
    from robotree.vr.bundle.admission import REVOKED_FILE
    from robotree.vr.bundle.trust import Signer, granted, read_revoked, read_signers

    if not line.text("--name"):
        raise ValueRefused("--name", "say whose key it is: --name anna")
    given = [f"may={line.text('--may')}"] if line.text("--may") else []
    if level := line.text("--isolation"):
        given.append(f"isolation={level}")
    try:
        permissions, isolation = granted(given)
    except ValueError as error:
        raise ValueRefused("--may" if "permission" in str(error) else "--isolation", str(error)) from None
    key = _key(words)
    signer = Signer((line.text("--name"),), key, permissions, isolation, line.flag("--authority"))
    revoked = file.with_name(REVOKED_FILE)
    if key in read_revoked(_content(revoked), str(revoked)):
        raise ValueRefused(
            "KEY", f"that key was revoked; if that was a mistake, take its line out of {revoked}"
        )
    before = _content(file)
    others = [one for one in before.splitlines() if not _is_of(one, key, str(file))]
    lines = [one for one in before.splitlines() if one not in others]
    replaced = [one for one in lines if one != signer.line()]
    if replaced and not line.flag("--replace"):
        reason = (
            f"that key has a line already, {'; '.join(replaced)}; --replace puts the new one in its place"
        )
        raise ValueRefused("KEY", reason)
    text = "".join(f"{one}\n" for one in (*others, signer.line()))
    read_signers(text, str(file))
    _write(file, text)
    instead = "".join(f"\n  instead of: {one}" for one in replaced)
    text = f"{signer.name} is trusted: {signer.line()}{instead}"
    answer(text, lambda: {**_trusted(signer), "replaced": replaced})
    return exit_codes.DONE


def _revoke(file: Path, words: Sequence[str]) -> int:
    from robotree.vr.bundle.admission import REVOKED_FILE
    from robotree.vr.bundle.trust import read_revoked
    from robotree.vr.sites.ssh import public_text

    key = _key(words)
    revoked = file.with_name(REVOKED_FILE)
    before = _content(revoked)
    if key not in read_revoked(before, str(revoked)):
        _write(revoked, f"{before}{public_text(key)}\n")
    text = (
        f"{public_text(key)} is revoked: no host of yours runs what it has signed, from its next start on too"
    )
    answer(text, lambda: {"revoked": public_text(key)})
    return exit_codes.DONE


def _list(file: Path) -> int:
    from robotree.vr.bundle.admission import Gate

    found = Gate(file).signers()
    rows = [one.line() + ("  REVOKED" if one.key in found.revoked else "") for one in found.known]
    data = [{**_trusted(one), "revoked": one.key in found.revoked} for one in found.known]
    answer("\n".join(rows) or f"nobody is trusted yet ({file})", lambda: data)
    return exit_codes.DONE


def _trusted(signer: Signer) -> Mapping[str, Any]:
    from msgspec import to_builtins

    from robotree.vr.sites.ssh import public_text

    return {
        "name": signer.name,
        "key": public_text(signer.key),
        "permissions": to_builtins(signer.permissions),
        "isolation": signer.isolation,
        "authority": signer.authority,
    }


def _key(words: Sequence[str]) -> bytes:
    """Read a key from the line: `ssh-ed25519 AAAA…`, the file of a public key, or a bundle."""
    from robotree.vr.bundle.file import BundleFile
    from robotree.vr.sites.ssh import read_public

    try:
        if len(words) == 1:
            file = Path(words[0]).expanduser()
            if file.suffix == ".bundle":
                words = BundleFile.read(file).manifest(words[0]).signer.split()
            else:
                words = file.read_text().split()
        return read_public(*words[:2])
    except (OSError, ValueError, TypeError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ValueRefused("KEY", f"write `ssh-ed25519 AAAA…`, its file, or a bundle: {reason}") from None


def _is_of(line: str, key: bytes, path: str) -> bool:
    """Whether a line of the file of trust is of a key; one that cannot be read is refused."""
    from robotree.vr.bundle.trust import read_signers

    return any(one.key == key for one in read_signers(line, path))


def _content(file: Path) -> str:
    try:
        return file.read_text()
    except FileNotFoundError:
        return ""


def _write(file: Path, text: str) -> None:
    from robotree.files import private_folder, replace

    private_folder(file.parent)
    replace(file, text.encode())
    file.chmod(0o600)


def _permissions(line: Line) -> Permissions | None:
    """Return what `--may` says; None: nothing."""
    from robotree.vr.base.permissions import Permissions

    if not line.text("--may"):
        return None
    given = Permissions(tuple(one for one in line.text("--may").split(",") if one))
    try:
        given.expect_sane()
    except ValueError as error:
        raise ValueRefused("--may", str(error)) from None
    return given
