"""Realms of several machines, or of several users of one."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import PROCESS, Action, Where

shell = partial(Action, group=PROCESS, where=Where.SHELL)

VERBS = (
    shell(
        "hub --listen ADDRESS [--print-config]",
        "Run the router that the sites of a realm dial; it delivers, and can read nothing. It prints its"
        " address with the fingerprint of its certificate. ADDRESS: tls:HOST:PORT; tcp: only on loopback."
        " --print-config: print the configuration with which the official zenohd does the same.",
        start="agents:hub",
        needs=("machines",),
        examples=("hub --listen tls:0.0.0.0:7447",),
    ),
    shell(
        "gateway",
        "Link this machine to the other sites of the realm (--realm NAME), of which it must have a key.",
        start="agents:gateway",
        needs=("machines",),
        examples=("gateway --realm plant",),
    ),
    shell(
        "realm create NAME [--group GROUP] [--hub ADDRESS] [--site SITE]",
        "Make a realm of several machines, with this one as its first SITE, and its authority here."
        " ADDRESS: as `robotree hub` printed it; of several, with commas, the first that answers is used."
        " --group: share the realm with the users of a GROUP of this machine instead, by its policy.",
        start="sites.sharing:create",
        alters=True,
        examples=(
            "realm create plant --hub tls:hub.example:7447#FINGERPRINT --site lab",
            "realm create cell --group robots",
        ),
    ),
    shell(
        "realm invite NAME [--as KIND] [--may ROLES] [--days N]",
        "Print a token with which a machine joins the realm under a NAME, once, within an hour. KIND:"
        " site, or person. --days: for which its key will be good (90).",
        start="sites.realms:invite",
        alters=True,
        needs=("machines",),
        examples=("realm invite hall --realm plant", "realm invite anna --as person --realm plant"),
    ),
    shell(
        "realm join TOKEN",
        "Make a key on this machine, which never leaves it, and have it signed with a TOKEN."
        " TOKEN: from `realm invite`; NAME@USER for a realm that another user of this machine shares.",
        start="sites.sharing:join",
        alters=True,
        examples=("realm join TOKEN", "realm join cell@anna"),
    ),
    shell(
        "realm members",
        "List the members of the realm, and how long their keys are good.",
        start="sites.realms:members",
        needs=("machines",),
        examples=("realm members --realm plant",),
    ),
    shell(
        "realm revoke NAME",
        "End the key of a member now, where the realm was made.",
        start="sites.realms:revoke",
        alters=True,
        needs=("machines",),
        examples=("realm revoke anna --realm plant",),
    ),
    shell(
        "realm renew [--days N]",
        "Have the key of this machine signed again.",
        start="sites.realms:renew",
        alters=True,
        needs=("machines",),
        examples=("realm renew --realm plant",),
    ),
    shell(
        "realm export",
        "Print what everybody may know of the realm; no key is in it.",
        start="sites.realms:export",
        needs=("machines",),
        examples=("realm export --realm plant",),
    ),
)
