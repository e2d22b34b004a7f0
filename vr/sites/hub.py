"""A hub: the router that sites dial, over TLS. It delivers, and can neither read nor forge anything.

It is the Zenoh router of the wheel; the official `zenohd` does as well with the configuration of `settings`.
Its certificate is its own: who dials it knows the fingerprint, which comes with the address or a token.
"""

from __future__ import annotations

import datetime as dt
import hashlib
import json
import ssl
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import zenoh
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import NameOID

from robotree.files.opening import alone
from robotree.files.private import private_folder
from robotree.vr.base.errors import NetworkUnusable
from robotree.vr.sites.invitations import Hub
from robotree.vr.sites.keys import write

LEASE = 2.0
"""[s] of silence after which a link counts as lost. With 1 s a busy machine was enough to lose one."""

YEARS = 10
"""For which the certificate of a hub is good."""

NAME = "robotree-hub"
"""In each hub's certificate; nobody checks it, for the certificate itself is known."""

LOOPBACK = frozenset({"127.0.0.1", "localhost", "[::1]"})


class HubAddress(NamedTuple):
    """Where a hub listens, or is dialed."""

    scheme: str
    host: str
    """With brackets, if it is an address of IPv6."""
    port: int

    @property
    def endpoint(self) -> str:
        """As Zenoh writes it."""
        return f"{self.scheme}/{self.host}:{self.port}"

    @property
    def text(self) -> str:
        """As people write it."""
        return f"{self.scheme}:{self.host}:{self.port}"


def address_of(text: str) -> HubAddress:
    """Read an address.

    Args:
        text: `tls:HOST:PORT`, or `tcp:HOST:PORT` on loopback.

    Raises:
        ValueError: it is none; says why.
    """
    scheme, _, rest = text.partition(":")
    host, _, port = rest.rpartition(":")
    if scheme not in {"tls", "tcp"} or not host or not port.isdecimal() or not 0 < int(port) < 1 << 16:
        raise ValueError(f"{text!r} is no address of a hub; write tls:HOST:PORT")
    if scheme == "tcp" and host not in LOOPBACK:
        raise ValueError(f"{text!r} is not on loopback; there only tls:HOST:PORT is allowed")
    return HubAddress(scheme, host, int(port))


def hub_of(text: str) -> Hub:
    """Read the address of a hub with its fingerprint: `tls:HOST:PORT#FINGERPRINT`.

    Raises:
        ValueError: it is none; says why.
    """
    address, _, fingerprint = text.partition("#")
    found = address_of(address)
    if found.scheme == "tls" and (len(fingerprint) != 64 or not set(fingerprint) <= set("0123456789abcdef")):
        raise ValueError(f"{text!r} has no fingerprint; copy the whole line that `robotree hub` prints")
    return Hub(found.text, fingerprint)


class HubCertificate(NamedTuple):
    """Where the certificate of a hub and its key lie."""

    certificate: Path
    key: Path

    @property
    def fingerprint(self) -> str:
        """SHA-256 of the certificate, in hexadecimal."""
        return fingerprint_of(self.certificate.read_text(encoding="ascii"))


def fingerprint_of(pem: str) -> str:
    """Return the SHA-256 of a certificate, in hexadecimal."""
    return hashlib.sha256(ssl.PEM_cert_to_DER_cert(pem)).hexdigest()


def certificate_in(folder: Path, now: dt.datetime) -> HubCertificate:
    """Return the certificate of this machine's hubs; make it if there is none.

    Args:
        folder: of it; only this user can enter it then.
        now: the date.

    Raises:
        OSError: it cannot be made.
    """
    private_folder(folder)
    found = HubCertificate(folder / "hub.pem", folder / "hub.key")
    with alone(folder / ".lock"):  # of two hubs that start at once, one makes it
        if not (found.certificate.exists() and found.key.exists()):
            _make_certificate(found, now)
    return found


def _make_certificate(place: HubCertificate, now: dt.datetime) -> None:
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, NAME)])
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - dt.timedelta(days=1))
        .not_valid_after(now + dt.timedelta(days=365 * YEARS))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName(NAME)]), critical=False)
        .sign(key, SHA256())
    )
    write(place.key, key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))
    write(place.certificate, certificate.public_bytes(Encoding.PEM))


def settings(address: HubAddress, certificate: HubCertificate | None) -> dict[str, object]:
    """Return the configuration of a hub, by paths as Zenoh has them.

    Args:
        address: where it listens.
        certificate: for TLS.
    """
    found: dict[str, object] = {
        "mode": "router",
        "listen/endpoints": [address.endpoint],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,  # links that gossip finds are not made anew when they break
        "transport/link/tx/lease": int(LEASE * 1000),
        "transport/shared_memory/enabled": False,
    }
    if certificate is not None:
        found["transport/link/tls/listen_certificate"] = str(certificate.certificate)
        found["transport/link/tls/listen_private_key"] = str(certificate.key)
    return found


def as_file(found: Mapping[str, object]) -> str:
    """Return a configuration as the file that `zenohd --config` takes."""
    tree: dict[str, Any] = {}
    for path, setting in found.items():
        *folders, last = path.split("/")
        place = tree
        for folder in folders:
            place = place.setdefault(folder, {})
        place[last] = setting
    return json.dumps(tree, indent=2)


def configured(found: Mapping[str, object]) -> zenoh.Config:
    """Return a configuration as Zenoh's wheel takes it."""
    config = zenoh.Config()
    for path, setting in found.items():
        config.insert_json5(path, json.dumps(setting))
    return config


def open_hub(address: HubAddress, certificate: HubCertificate | None) -> zenoh.Session:
    """Open a hub. It waits: call it in a thread.

    Raises:
        NetworkUnusable: it cannot listen there.
    """
    try:
        return zenoh.open(configured(settings(address, certificate)))
    except zenoh.ZError as error:
        reason = str(error).partition(" at /")[0]
        raise NetworkUnusable(where=address.text, reason=reason) from None
