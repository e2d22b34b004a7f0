"""Processes that are agents, realms written into a file, and realms of several machines or users."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import ANYWHERE, PROCESS, About, Action, Where

shell = partial(Action, group=PROCESS, where=Where.SHELL)

VERBS = (
    Action(
        "restart NAME",
        "Start a proxy, a host or another agent again whose process has gone: by systemd where it is a"
        " service of yours, else as `apply` started it.",
        group=PROCESS,
        where=ANYWHERE,
        about=About.ROBOT,
        run="line.restarting:restart",
        key="X",
        alters=True,
        examples=("restart arm-1", "restart host-1"),
    ),
    shell(
        "sim KIND --listen URL [--key FILE | --open] [--state FILE] [--reset-epoch] [--speedup FACTOR]"
        " [--log FILE]",
        "Simulate a robot's controller; every program can command it unless it has a key"
        " (`realm`: the realm's). --reset-epoch: forget the leases that it has accepted."
        " --log: write each goal that it begins and ends into a file, with its key."
        " --speedup: simulated seconds in a second, up to 10.",
        start="agents:sim",
        needs=("sim",),
        examples=("sim arm --listen tcp:127.0.0.1:5760",),
    ),
    shell(
        "proxy KIND NAME --connect URL [--component N] [--key FILE | --open] [--take-over]",
        "Connect a robot's controller to the realm; KIND: arm, rover, limb, head, base, or"
        " FILE.py with yours. --component: which MAVLink component of the controller it is (1)."
        " --take-over: also if another proxy holds it.",
        start="agents:proxy",
        examples=("proxy arm arm-1 --connect tcp:127.0.0.1:5760",),
    ),
    shell(
        "view NAME --connect URL [--cameras LIST] [--key FILE | --open]",
        "Offer pictures of the workspace of a robot's controller."
        " --cameras: other cameras than cell=100,wrist=101.",
        start="agents:view",
        examples=("view cell --connect tcp:127.0.0.1:5760",),
    ),
    shell(
        "host NAME [--only ROBOT | --forget | --standby-for HOST] [--after TIME] [--journal URL]"
        " [--trust FILE] [--requirements POLICY] [--allow-packages LIST] [--insecure-any-signer]"
        " [--isolate LEVEL] [--most N]",
        "Run virtual robots that are created, and keep them; --only: this one alone, until it ends."
        " --forget: begin without those that were kept, and keep none."
        " --standby-for: wait, and have the robots of HOST when it is away for TIME (3s). --journal: keep"
        " them in a PostgreSQL database that several machines can reach, instead of a folder of this one."
        " --trust: whose pages it runs beside your own (`help bundle trust`). --requirements: what it does"
        " with pages of others that need packages: refuse (as it does by itself), allowlist, locked;"
        " --allow-packages: names, for the allowlist. --insecure-any-signer: run what anybody has signed, or"
        " nobody; for a trial alone, and red on the screen. --isolate process: each robot in a process of"
        " its own. --most: run N robots at most.",
        start="agents:host",
        examples=("host host-1", "host host-2 --standby-for host-1 --after 5s"),
    ),
    shell(
        "lookup NAME",
        "Run a lookup service; any number of them serve together.",
        start="agents:lookup",
        examples=("lookup lookup-1",),
    ),
    shell(
        "directory NAME [--store URL]",
        "Run a lookup service with a durable memory: it remembers robots that are away, and keeps orders"
        " for them and their results. Several share what they have. URL: of a database (postgresql://…) that"
        " has the memory instead of a folder of this machine.",
        start="agents:directory",
        examples=("directory directory-1",),
        guide=("robotree.vr.orders.service",),
    ),
    shell(
        "save FILE [--force]",
        "Write the realm into a FILE that people can read and edit: its processes, robots, pages,"
        " settings, roles and bonds. --force: replace a FILE that is there.",
        start="realm_file.verbs:save",
        examples=("save cell.yaml", "save cell.yaml --force"),
    ),
    shell(
        "apply FILE [--dry-run] [--prune] [--yes]",
        "Start and bind what is in a FILE and not in the realm, and print each step. What the file does"
        " not name stays; --prune ends it, after a question (--yes: without one). --dry-run: only print.",
        start="agents:apply",
        alters=True,
        examples=("apply cell.yaml --dry-run", "apply cell.yaml", "apply cell.yaml --prune --yes --json"),
        guide=("robotree.tui.realm_file.reading",),
    ),
    shell(
        "space serve NAME [--store STORE] [--durability CLASS]",
        "Run the space in which robots write, read and take entries. STORE: a SQLite file (without it:"
        " one in the folder of the realm's state), the URL of a PostgreSQL database, or `memory`. CLASS, what"
        " an answered request survives: `process`, any kill, or `power`, loss of power.",
        start="agents:space",
        examples=(
            "space serve jobs",
            "space serve jobs --durability power",
            "space serve jobs --store postgresql://db.local/robots",
        ),
    ),
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
