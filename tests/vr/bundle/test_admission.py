"""Which pages a host runs: its user's own as ever, and those of trusted signers, within what they may."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from msgspec.structs import replace

from robotree.files import read
from robotree.vr.base.errors import (
    BadBundle,
    BadTrustFile,
    BundleError,
    ExcessPermission,
    MissingRequirement,
    NotSigned,
    OtherPython,
    RevokedSigner,
    UnknownSigner,
)
from robotree.vr.base.permissions import Permissions, SignedManifest
from robotree.vr.base.principal import ITSELF
from robotree.vr.bundle import Bundle
from robotree.vr.bundle.admission import OWN, Clearance, Gate
from robotree.vr.bundle.build import SigningKey, manifest_of, sign, signed
from robotree.vr.sites.certificates import Authority
from robotree.vr.sites.keys import create
from robotree.vr.sites.ssh import public_text
from tests.vr.bundle.signed import FROM_AFAR, ME, PAGE, key_of, of, page, signer, trusting

NEEDED = Permissions(("Arm.move", "Arm.move_to"), ("Arm.z",))
"""What the page of these tests needs."""


def admitted(gate: Gate, bundle: Bundle) -> Clearance:
    return gate.admit(bundle, FROM_AFAR, "host-1")


def refused(gate: Gate, bundle: Bundle, error: type[BundleError]) -> str:
    with pytest.raises(error) as found:
        admitted(gate, bundle)
    return str(found.value)


@pytest.mark.parametrize("asker", [ITSELF, ME])
def test_ones_own_page_runs_without_a_question(asker: object) -> None:
    assert Gate().admit(page(), asker, "host-1") == OWN  # type: ignore[arg-type]


def test_a_page_from_another_site_must_be_signed() -> None:
    said = refused(Gate(), page(), NotSigned)
    assert said.startswith(
        "/home/anna/guide.py comes from anna@lab and is not signed, so host-1 does not run"
    )


def test_an_unsigned_page_from_afar_is_not_ones_own_after_a_restart() -> None:
    kept = replace(page(), sender="anna@lab")
    with pytest.raises(NotSigned):
        Gate().admit(kept, ITSELF, "host-1")


def test_a_foreign_signers_page_does_not_run_and_the_sentence_says_what_to_type() -> None:
    anna = key_of("anna").public
    for asker in (FROM_AFAR, ME, ITSELF):
        with pytest.raises(UnknownSigner) as error:
            Gate().admit(of("anna"), asker, "host-1")
        said = str(error.value)
        assert f"is signed by {anna}, whom host-1 does not trust" in said
        assert f"`robotree bundle trust {anna} --name WHO`" in said


def test_a_trusted_signers_page_runs_within_its_manifest_and_apart(tmp_path: Path) -> None:
    gate = Gate(trusting(tmp_path, signer("anna")))
    assert admitted(gate, of("anna")) == Clearance("anna", NEEDED, "process")
    nearer = Gate(trusting(tmp_path, signer("anna", isolation="sandbox")))
    assert admitted(nearer, of("anna")).isolation == "sandbox"


def test_a_page_that_is_signed_with_ones_own_key_needs_no_trust() -> None:
    public = key_of("anna").key.public_key().public_bytes_raw()
    gate = Gate(own_keys=lambda: {public})
    assert admitted(gate, of("anna")) == Clearance("", NEEDED)


def test_a_page_that_wants_more_than_its_signer_may_grant_does_not_run(tmp_path: Path) -> None:
    gate = Gate(trusting(tmp_path, signer("anna", Permissions(("Arm.move",), ("*.*",), ("*.*",)))))
    said = refused(gate, of("anna"), ExcessPermission)
    assert "wants commands Arm.move_to, which its signer anna may not grant here" in said
    assert admitted(gate, of("anna", Permissions(("Arm.move",)))).signer == "anna"
    assert "commands Arm.*" in refused(gate, of("anna", Permissions(("Arm.*",))), ExcessPermission)
    assert "commands *.move" in refused(gate, of("anna", Permissions(("*.move",))), ExcessPermission)


def test_a_revoked_signers_page_does_not_run_and_that_counts_at_once(tmp_path: Path) -> None:
    trust = trusting(tmp_path, signer("anna"))
    gate = Gate(trust)
    admitted(gate, of("anna"))
    revoked = tmp_path / "revoked_signers"
    revoked.write_text(f"# gone\n{key_of('anna').public}\n")
    revoked.chmod(0o600)
    assert "the key is on the list of revoked ones" in refused(gate, of("anna"), RevokedSigner)


def test_trust_has_a_beginning_and_an_end(tmp_path: Path) -> None:
    line = signer("anna").line()
    file = tmp_path / "allowed_signers"
    now = 1_780_000_000.0
    for option, reason in (
        ('valid-before="20260101Z"', "has ended"),
        ('valid-after="20990101Z"', "not begun"),
    ):
        file.write_text(line.replace("namespaces", f"{option},namespaces"))
        file.chmod(0o600)
        assert reason in refused(Gate(file, unix=lambda: now), of("anna"), RevokedSigner)


def test_a_line_for_other_purposes_trusts_nobody_here(tmp_path: Path) -> None:
    file = tmp_path / "allowed_signers"
    file.write_text(signer("anna").line().replace("robotree-bundle", "git"))
    file.chmod(0o600)
    refused(Gate(file), of("anna"), UnknownSigner)


def test_a_key_swap_is_refused(tmp_path: Path) -> None:
    """Bob signs a manifest that names Anna as its signer."""
    gate = Gate(trusting(tmp_path, signer("anna"), signer("bob")))
    manifest = manifest_of(page(), key_of("anna").public)
    packed = manifest.packed()
    bob = key_of("bob")
    by_bob = sign(manifest, bob)
    as_anna = SignedManifest(packed, by_bob.signature)
    assert "another text" in refused(gate, replace(page(), signed=as_anna), BadBundle)
    from robotree.vr.bundle.trust import NAMESPACE
    from robotree.vr.sites.ssh import signature_of

    names_anna = SignedManifest(packed, signature_of(bob.key, packed, NAMESPACE))
    assert "signed with another key than its manifest names" in refused(
        gate, replace(page(), signed=names_anna), BadBundle
    )


@pytest.mark.parametrize("what", ["source", "files", "class"])
def test_a_page_that_was_changed_on_its_way_is_refused(tmp_path: Path, what: str) -> None:
    gate = Gate(trusting(tmp_path, signer("anna")))
    good = of("anna", files={"map.json": b"{}"})
    bad = {
        "source": replace(good, source=PAGE.replace("1.0", "9.0")),
        "files": replace(good, files={"map.json": b"[]"}),
        "class": replace(good, wanted="Other"),
    }[what]
    refused(gate, bad, BadBundle)
    admitted(gate, good)


def test_a_signature_for_another_purpose_does_not_count(tmp_path: Path) -> None:
    from robotree.vr.sites.ssh import signature_of

    gate = Gate(trusting(tmp_path, signer("anna")))
    good, key = of("anna"), key_of("anna").key
    assert good.signed is not None
    other = replace(good.signed, signature=signature_of(key, good.signed.manifest, "git"))
    assert "not for robotree-bundle" in refused(gate, replace(good, signed=other), BadBundle)


def test_any_signer_must_be_asked_for_and_is_told() -> None:
    gate = Gate(any_signer=True)
    assert admitted(gate, page()).unchecked
    assert admitted(gate, of("anna")) == Clearance(key_of("anna").public, NEEDED, "process", unchecked=True)
    assert gate.admit(page(), ME, "host-1") == OWN
    tampered = replace(of("anna"), source="")
    refused(gate, tampered, BadBundle)


def test_a_page_for_another_python_is_refused_by_name(tmp_path: Path) -> None:
    head = '# /// script\n# requires-python = ">=4"\n# ///\n'
    gate = Gate(trusting(tmp_path, signer("anna")))
    assert "needs Python >=4, and this host has 3." in refused(
        gate, of("anna", source=head + PAGE), OtherPython
    )


HEAD = '# /// script\n# dependencies = ["{}"]\n# ///\n'


@pytest.mark.parametrize(
    ("policy", "allowed", "needed", "reason"),
    [
        ("refuse", (), "msgspec", "this host takes no page of others that needs packages"),
        ("allowlist", (), "msgspec", "`--allow-packages msgspec` puts it there"),
        ("allowlist", ("msgspec",), "msgspec>=99", "is installed here, and nothing is ever installed"),
        ("allowlist", ("no-such-thing",), "no-such-thing", "it is not installed here, and nothing is ever"),
        ("allowlist", ("a",), "a @ https://example.org/a.whl", "an address is never followed"),
        ("locked", (), "msgspec>=0.1", "this host takes exact versions alone"),
        ("locked", (), "msgspec==0.*", "this host takes exact versions alone"),
        ("locked", (), "msgspec==0.0.1", "is installed here, and nothing is ever installed"),
    ],
)
def test_a_requirement_that_is_not_met_is_refused_and_never_installed(
    tmp_path: Path, policy: str, allowed: tuple[str, ...], needed: str, reason: str
) -> None:
    gate = Gate(trusting(tmp_path, signer("anna")), requirements=policy, allowed=allowed)  # type: ignore[arg-type]
    assert reason in refused(gate, of("anna", source=HEAD.format(needed) + PAGE), MissingRequirement)


def test_requirements_that_are_met_are_no_hindrance(tmp_path: Path) -> None:
    import msgspec

    trust = trusting(tmp_path, signer("anna"))
    plain, exact = ("msgspec>=0.1", f"msgspec=={msgspec.__version__}")
    elsewhere = "no-such-thing; sys_platform == 'nowhere'"
    for policy, needed in (("allowlist", plain), ("locked", exact), ("refuse", elsewhere)):
        gate = Gate(trust, requirements=policy, allowed=["Msgspec"])  # type: ignore[arg-type]
        assert admitted(gate, of("anna", source=HEAD.format(needed) + PAGE)).signer == "anna"


# -- the file of trust -----------------------------------------------------------------------------


def test_a_file_of_trust_that_others_can_write_trusts_nobody(tmp_path: Path) -> None:
    trust = trusting(tmp_path, signer("anna"))
    trust.chmod(0o666)
    assert "others can write it" in refused(Gate(trust), of("anna"), BadTrustFile)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("anna", "write: NAME ssh-ed25519 KEY"),
        ("anna ssh-ed25519 AAAA", "it is cut off"),
        ("anna ssh-ed25519 !", "it is no base64"),
        (f"anna namespace=x {key_of('anna').public}", "'namespace=x' is not known"),
        (f"anna {key_of('anna').public} may=Arm", "'Arm' is no permission"),
        (f"anna {key_of('anna').public} isolation=much", "there is no isolation 'much'"),
        (f'anna valid-before="soon" {key_of("anna").public}', "'soon' is no moment"),
    ],
)
def test_a_file_of_trust_with_a_mistake_trusts_nobody_and_names_the_line(
    tmp_path: Path, line: str, reason: str
) -> None:
    file = tmp_path / "allowed_signers"
    file.write_text(f"# whom we trust\n{line}\n{signer('anna').line()}\n")
    file.chmod(0o600)
    said = refused(Gate(file), of("anna"), BadTrustFile)
    assert f"{file}:2 cannot be used" in said
    assert reason in said


# -- members of a realm ----------------------------------------------------------------------------


def test_a_member_of_a_trusted_realm_signs_until_the_authority_revokes_it(tmp_path: Path) -> None:
    now = time.time()
    keys = create(tmp_path / "a" / "keys", "plant", "lab", (), now=now)
    anna = key_of("anna").key
    authority = Authority(
        "plant", Ed25519PrivateKey.from_private_bytes(read(keys.folder / "authority.key", 32))
    )
    public = anna.public_key().public_bytes_raw()
    certificate = authority.admit("anna", "person", public, serial=7, now=now, days=1.0)
    page_of_anna = signed(page(), SigningKey(anna, "anna@plant", certificate))
    line = signer("anna")._replace(names=("*@plant",), key=authority.public, authority=True)
    gate = Gate(trusting(tmp_path, line), realm=lambda: keys)
    assert admitted(gate, page_of_anna) == Clearance("anna@plant", NEEDED, "process")

    other = Authority("plant", key_of("forger").key)
    forged = other.admit("anna", "person", public, serial=7, now=now, days=1.0)
    refused(gate, signed(page(), SigningKey(anna, "anna@plant", forged)), UnknownSigner)
    stolen = signed(page(), SigningKey(key_of("bob").key, "anna@plant", certificate))
    refused(gate, stolen, UnknownSigner)

    elsewhere = Gate(trusting(tmp_path, line._replace(names=("*@mill",))))
    refused(elsewhere, page_of_anna, UnknownSigner)

    keys.take_revocations(authority.revoke(keys.trust.revocations, (7,)))
    gate = Gate(trusting(tmp_path, line), realm=lambda: keys)
    assert "revoked" in refused(gate, page_of_anna, RevokedSigner)
    assert public_text(public) in refused(gate, page_of_anna, RevokedSigner)
