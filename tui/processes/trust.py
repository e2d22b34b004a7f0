"""Whom this user trusts: the file of trust, and what decides by it for hosts and for the screen."""

from __future__ import annotations

import os
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from robotree.tui.processes.state_files import KEYS
from robotree.vr.network.realms import state_home

if TYPE_CHECKING:
    from robotree.vr.bundle.admission import Gate
    from robotree.vr.bundle.requirements import RequirementPolicy
    from robotree.vr.sites.keys import RealmKeys


def gate_for(
    realm: str,
    trust: Path | None = None,
    *,
    any_signer: bool = False,
    requirements: RequirementPolicy = "refuse",
    allowed: Collection[str] = (),
) -> Gate:
    """Return what decides which pages run, or are shown, for this user.

    Args:
        realm: whose keys count.
        trust: file of trust; None: this user's.
        any_signer: see `Gate`. So are the rest.
        requirements: what is done with pages of others that need packages.
        allowed: names of packages.
    """
    from robotree.vr.bundle.admission import Gate

    return Gate(
        trust or trust_file(),
        any_signer=any_signer,
        requirements=requirements,
        allowed=allowed,
        own_keys=lambda: own_keys(realm),
        realm=lambda: realm_keys(realm),
    )


def trust_file() -> Path:
    """Return the file that says whom hosts of this user trust."""
    from robotree.vr.bundle.admission import TRUST_FILE

    home = os.environ.get("XDG_CONFIG_HOME") or "~/.config"
    return Path(home).expanduser() / "robotree" / TRUST_FILE


def realm_keys(realm: str) -> RealmKeys | None:
    """Return the keys of a realm; None: this machine has none."""
    from robotree.vr.base.errors import RealmError
    from robotree.vr.sites.keys import RealmKeys

    try:
        return RealmKeys(state_home() / realm / KEYS)
    except (RealmError, OSError):
        return None


def own_keys(realm: str) -> frozenset[bytes]:
    """Return the public keys of this user: of the realm, and of OpenSSH."""
    from robotree.vr.bundle.build import SSH_KEY
    from robotree.vr.sites.ssh import read_public

    found: set[bytes] = set()
    if (keys := realm_keys(realm)) is not None:
        found.add(keys.own.key.public_key().public_bytes_raw())
    try:
        kind, key, *_ = Path(f"{SSH_KEY}.pub").expanduser().read_text().split()
        found.add(read_public(kind, key))
    except (OSError, ValueError, RuntimeError):
        pass
    return frozenset(found)
