"""The verbs about the keys of a realm: `robotree realm create`, `invite`, `join` and their kin."""

from __future__ import annotations

import socket
import time
from typing import Any

from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.processes.state_files import KEYS, needed_file
from robotree.tui.sites.policies import expect_to_administrate
from robotree.tui.terminal import answer
from robotree.vr.network.realms import state_home
from robotree.vr.sites.certificates import DAY, Certificate, MemberKind, fingerprint
from robotree.vr.sites.hub import hub_of
from robotree.vr.sites.invitations import Hub, read_token, token_of
from robotree.vr.sites.joining import ask_authority
from robotree.vr.sites.keys import DAYS, Member, RealmKeys, create
from robotree.vr.sites.known import KnownSite


def keys_of(realm: str) -> RealmKeys:
    """Return the keys of a realm; looking makes nothing.

    Raises:
        NoKeys: this machine has none.
    """
    return RealmKeys(state_home() / realm / KEYS)


def create_keys(line: Line, _realm: str) -> int:
    """Make a realm of several machines."""
    realm, hubs = line.text("NAME"), _hubs(line.text("--hub"))
    name = line.text("--site") or socket.gethostname().partition(".")[0]
    made = create(needed_file(realm, KEYS), realm, name, hubs, now=time.time())
    text = (
        f"realm {realm} is made, with this machine as site {name}; its authority, "
        f"{fingerprint(made.trust.authority)}, is in {made.folder}: keep a copy of it in a safe place"
    )
    if not hubs:
        text += "\nit has no hub yet, so nobody can join: `robotree hub --listen tls:HOST:PORT` makes one"
    answer(text, lambda: {"realm": realm, "site": name, "folder": str(made.folder)})
    return exit_codes.DONE


def invite(line: Line, realm: str) -> int:
    """Print a token with which a machine joins."""
    expect_to_administrate(realm)
    name, days = line.text("NAME"), _days(line)
    may = tuple(role for role in line.text("--may").split(",") if role)
    invitation = keys_of(realm).invite(
        name, _kind(line.text("--as", "site")), now=time.time(), days=days, may=may
    )
    token = token_of(invitation)
    until = time.strftime("%H:%M", time.localtime(invitation.ends))
    text = f"{token}\n\nuntil {until}, once, there: `robotree realm join TOKEN`; a gateway must run here then"
    answer(text, lambda: {"token": token, "name": name, "ends": invitation.ends})
    return exit_codes.DONE


def join_by_token(line: Line, _realm: str) -> int:
    """Join a realm by a token."""
    now = time.time()
    invitation = read_token(line.text("TOKEN"), now)
    keys = ask_authority(needed_file(invitation.realm, KEYS), invitation, now=now)
    answer(
        f"this machine is {keys.kind} {keys.name} of realm {keys.realm} now; "
        f"`robotree --realm {keys.realm} gateway` links it to the other sites",
        lambda: {"realm": keys.realm, "name": keys.name, "kind": keys.kind, "folder": str(keys.folder)},
    )
    return exit_codes.DONE


def members(_line: Line, realm: str) -> int:
    """List the members of a realm."""
    keys, now = keys_of(realm), time.time()

    def about(one: Member | Certificate | KnownSite, *, revoked: bool = False) -> dict[str, Any]:
        lasting = {"name": one.name, "kind": one.kind, "serial": one.serial, "ends": one.ends}
        return {**lasting, "revoked": revoked}

    if keys.is_authority:
        rows = [about(member, revoked=member.revoked) for member in keys.members()]
    else:
        rows = [about(keys.certificate(now)), *map(about, keys.sites())]

    def text(row: dict[str, Any]) -> str:
        left = (row["ends"] - now) / DAY
        state = "revoked" if row["revoked"] else f"{left:.0f} days left" if left > 0 else "ended"
        return f"{row['name']:24} {row['kind']:7} {state}"

    answer("\n".join(map(text, rows)), lambda: rows)
    return exit_codes.DONE


def revoke(line: Line, realm: str) -> int:
    """End the key of a member."""
    expect_to_administrate(realm)
    name = line.text("NAME")
    ended = keys_of(realm).revoke(name)
    answer(
        f"{name} is revoked; each site that is linked refuses it within 10 s, any other one when it is "
        "linked again, or when the certificate ends",
        lambda: {"name": name, "serials": [one.serial for one in ended]},
    )
    return exit_codes.DONE


def renew(line: Line, realm: str) -> int:
    """Have the key of this machine signed again."""
    keys, now = keys_of(realm), time.time()
    if keys.is_authority:
        packed = keys.renew(keys.own.certificate, now, _days(line))
        found = keys.replace_certificate(packed, now)
    else:
        from robotree.vr.sites.joining import ask_to_renew

        found = ask_to_renew(keys, now=now)
    left = (found.ends - now) / DAY
    answer(f"the certificate of {found.name} is good for {left:.0f} days now", lambda: {"ends": found.ends})
    return exit_codes.DONE


def export(_line: Line, realm: str) -> int:
    """Print what everybody may know of a realm; no key is in it."""
    keys = keys_of(realm)
    about: dict[str, Any] = {
        "realm": keys.realm,
        "authority": keys.trust.authority.hex(),
        "hubs": [{"address": hub.address, "fingerprint": hub.fingerprint} for hub in keys.hubs],
        "revocations": keys.trust.packed.hex(),
        "sites": sorted({keys.name, *(site.name for site in keys.sites())}),
    }
    import json

    answer(json.dumps(about, indent=2), lambda: about)
    return exit_codes.DONE


def _hubs(text: str) -> tuple[Hub, ...]:
    try:
        return tuple(hub_of(each.strip()) for each in text.split(",") if each.strip())
    except ValueError as error:
        raise ValueRefused("ADDRESS", str(error)) from None


def _kind(text: str) -> MemberKind:
    if text == "person":
        return "person"
    if text == "site":
        return "site"
    raise ValueRefused("KIND", f"{text!r} is none; write person or site")


def _days(line: Line) -> float:
    text = line.text("--days", f"{DAYS:g}")
    return values.ranged("N", text, 1e-6, 3650, "is no number of days from 1 to 3650")
