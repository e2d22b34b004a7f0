"""How the other sites are, in words: for `robotree doctor`, lists and screens. Pure.

Zenoh denies silently, and a router that drops says nothing: what was not answered must become a reason here.
"""

from __future__ import annotations

from typing import NamedTuple

from robotree.vr.base.address import Address
from robotree.vr.base.requests import SiteSeen
from robotree.vr.sites.certificates import MemberKind
from robotree.vr.sites.site import Site


class RememberedSite(NamedTuple):
    """What this machine remembers of a site."""

    name: str
    kind: MemberKind = "site"
    ends: float = 0.0


def seen(known: RememberedSite, site: Site | None, now: float, trouble: tuple[str, str]) -> SiteSeen:
    """Return how a site is.

    Args:
        known: what is remembered of it.
        site: what is seen of it since this gateway began; None: nothing.
        now: [s]
        trouble: why no site can be reached, as a clause, and the remedy; empty: the hub answers.
    """
    stream = None if site is None else site.stream
    if site is None or stream is None:
        reason, remedy = trouble
        if site is not None and site.refused and not reason:
            reason, remedy = site.refused, f"what it says helps, at site {known.name} or here"
        return SiteSeen(
            name=known.name,
            kind=known.kind,
            ends=known.ends,
            heard=-1.0 if site is None or not site.was_heard else now - site.was_heard,
            reason=reason or "the hub is reached, and nothing comes from there",
            remedy=remedy
            or f"see that `robotree gateway` runs at site {known.name} and reaches the same hub",
        )
    linked = site.linked(now)
    reason, remedy = ("", "") if linked else trouble
    if not linked and not reason:
        reason = "its gateway, or its line to the hub, has fallen silent"
        remedy = f"wait: it is dialed for ever; or look at the gateway of site {known.name}"
    hung = ((address, where, cure) for key, where, cure in site.hung if (address := Address.parse(key)))
    return SiteSeen(
        name=known.name,
        kind=known.kind,
        state="linked" if linked else "silent",
        heard=stream.silence(now),
        way=stream.way,
        round_trip=stream.round_trip,
        rate=stream.rate,
        agents=sum(Address.parse(key) is not None for key in site.keys),
        reason=reason,
        remedy=remedy,
        version=site.version,
        clock=site.clock,
        ends=known.ends if site.member is None else site.member.ends,
        hung=tuple((address.name, where, cure) for address, where, cure in hung),
    )
