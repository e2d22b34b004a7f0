"""Processes that are agents, and realms that are written into a file."""

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
)
