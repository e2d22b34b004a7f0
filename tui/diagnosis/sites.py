"""Checks of a realm of several machines: why a site, or a robot there, is not seen or cannot be commanded.

Between machines nobody says no: a hub that is away, a key that has ended and a gateway that was never started
look alike from here. The gateway of this machine knows which it is; each answer that did not come has a
reason.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from robotree.tui.diagnosis.finding import Finding, Grade
from robotree.tui.processes.state_files import KEYS, state_home
from robotree.vr.base.errors import Hanging, NoKeys, NotAMember, VrError
from robotree.vr.base.extras import lacks
from robotree.vr.core.bonds import DEFAULT_TERM
from robotree.vr.sites.known import names_of_sites

if TYPE_CHECKING:
    from robotree.vr.base.requests import GatewayDescribed, SiteSeen
    from robotree.vr.supervision.realm_client import RealmClient

DAY = 86_400.0
SOON = 14 * DAY
"""[s] before the end of a certificate from which on it is named."""
CLOCK_OFF, CLOCK_WRONG = 5.0, 300.0
"""[s] by which two clocks differ so that people are misled, and so that certificates are refused."""
BEARS = DEFAULT_TERM * 2 / 3
"""[s] of the way there and back that a lease bears: it is renewed after a third of its term, and counts from
when that was asked for (`HeldLease`)."""
AGAIN = "robotree --realm {realm} gateway"


async def sites(realm_client: RealmClient, realm: str, name: str) -> list[Finding]:
    """Check the gateway, the hub and the other sites; nothing where this machine has no keys of the realm.

    Args:
        realm_client: which has looked around.
        realm: its name.
        name: of a robot that is missed; empty: none.
    """
    folder = state_home() / realm / KEYS
    if not folder.is_dir() and not realm_client.places.own:
        return []
    found = list(own_certificate(realm))
    try:
        described = await realm_client.gateway()
    except Hanging as error:
        return [*found, Finding("gateway", "bad", str(error), "until it goes on, no other site is seen")]
    except VrError as error:
        return [
            *found,
            Finding("gateway", "bad", f"the gateway does not answer: {error}", AGAIN.format(realm=realm)),
        ]
    if described is None:
        known = ", ".join(names_of_sites(folder)) or "others"
        result = f"no gateway runs on this machine: nothing is seen of the sites of realm {realm} ({known})"
        return [*found, Finding("gateway", "bad", result, AGAIN.format(realm=realm))]
    found += judged(described, time.time())
    if name:
        found += await robot(realm_client, name, described)
    return found


def own_certificate(realm: str) -> Iterator[Finding]:
    """See that this machine's key of the realm is good, also where its gateway cannot start without it."""
    if next(lacks("machines"), None) is not None:
        return
    from robotree.vr.sites.keys import RealmKeys

    try:
        ends = RealmKeys(state_home() / realm / KEYS).certificate(time.time()).ends
    except NoKeys:
        return
    except NotAMember as error:
        yield Finding(
            "certificate", "bad", str(error), "robotree realm renew, or ask the authority for a new token"
        )
        return
    except OSError as error:
        yield Finding("certificate", "bad", f"the keys of realm {realm} cannot be read: {error}")
        return
    left = ends - time.time()
    if left < SOON:
        yield Finding(
            "certificate", "doubt", f"the certificate of this machine ends in {left / DAY:.0f} days",
            "robotree realm renew",
        )  # fmt: skip
    else:
        yield Finding(
            "certificate", "good", f"the certificate of this machine is good for {left / DAY:.0f} days"
        )


def judged(described: GatewayDescribed, now: float) -> Iterator[Finding]:
    """Say what the gateway of this machine knows.

    Args:
        described: its answer.
        now: [s since 1970]
    """
    if described.out:
        yield Finding(
            "gateway", "bad", described.out, "robotree realm renew, or ask the authority for a new token"
        )
    elif described.trouble:
        remedy = f"look at the hub and at the way to {described.hub}; it is dialed for ever"
        yield Finding("hub", "bad", described.trouble, remedy)
    else:
        yield Finding("hub", "good", f"site {described.site} reaches the hub {described.hub}")
    for site in described.sites:
        yield from of_site(site, described, now)
    for reason, count in described.refused.items():
        times = "once" if count == 1 else f"{count} times"
        yield Finding("refused", "doubt", f"{times}: {reason}", "nothing of it was done; see who that is")
    if not described.sites:
        remedy = "robotree realm invite NAME, where the realm was made"
        yield Finding("sites", "doubt", "no other site has joined", remedy)


def of_site(site: SiteSeen, described: GatewayDescribed, now: float) -> Iterator[Finding]:
    """Say how one site is."""
    who = f"{site.kind} {site.name}"
    if site.state == "linked":
        way = f"{site.way * 1000:.0f} ms there and back, of which a bond bears {BEARS * 1000:.0f}"
        yield Finding("sites", "good", f"{who} is linked: {site.agents} agents, {way}")
    else:
        since = "has not been heard since this gateway began"
        heard = since if site.heard < 0 else f"was heard {site.heard:.1f} s ago"
        remedy = "" if site.reason in {described.out, described.trouble} else site.remedy
        yield Finding("sites", "bad", f"{who} is {site.state}, it {heard}: {site.reason}", remedy)
    if site.way > 0.75 * BEARS:
        yield Finding(
            "sites", "doubt", f"the way to {who} and back takes {site.way:.1f} s: bonds across it end",
            "command robots there from a robot that lives there",
        )  # fmt: skip
    if site.version and described.version and site.version != described.version:
        result = f"{who} runs robotree {site.version}, and here runs {described.version}"
        yield Finding(
            "version", "doubt", result, "use one version; what the older one does not know it ignores"
        )
    if site.state == "linked" and abs(site.clock) > CLOCK_OFF + site.round_trip:
        ahead = f"{abs(site.clock):.0f} s {'ahead of' if site.clock > 0 else 'behind'} the one here"
        grade: Grade = "bad" if abs(site.clock) > CLOCK_WRONG else "doubt"
        yield Finding(
            "clock", grade, f"the clock of {who} is {ahead}: certificates are judged by it",
            "set both by NTP; commands and leases do not depend on it",
        )  # fmt: skip
    renew = f"at {site.name}: robotree realm renew"
    if 0 < site.ends - now < SOON:
        result = f"the certificate of {who} ends in {(site.ends - now) / DAY:.0f} days"
        yield Finding("certificate", "doubt", result, renew)
    elif 0 < site.ends <= now:
        yield Finding("certificate", "bad", f"the certificate of {who} has ended", renew)
    for name, process, remedy in site.hung:
        yield Finding(
            "robots", "bad", f"{site.name}:{name} hangs there, in {process}", f"at {site.name}: {remedy}"
        )


async def robot(realm_client: RealmClient, name: str, described: GatewayDescribed) -> Sequence[Finding]:
    """Say whether a robot of another site answers; nothing of one of this machine."""
    try:
        address = await realm_client.directory.resolve(name)
        site = realm_client.places.site_of(address.key)
        if not site:
            return []
        begin = time.monotonic()
        await realm_client.describe(name)
    except VrError as error:
        site = name.partition(":")[0] if ":" in name else ""
        remedy = next((link.remedy for link in described.sites if link.name == site), "")
        return [Finding("robot", "bad", f"{name} cannot be asked: {error}", remedy)] if site else []
    seconds = time.monotonic() - begin
    return [Finding("robot", "good", f"{name} is at site {site} and answers in {seconds:.2f} s")]
