"""What opens a screen: the full one, that for users, in a browser, and the demos."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import PROCESS, Action, Where

shell = partial(Action, group=PROCESS, where=Where.SHELL)

VERBS = (
    shell(
        "demo [STORY] [--crash] [--headless] [--pictures FOLDER] [--can] [--classic] [--speedup FACTOR]"
        " [--delay MS] [--key FILE | --open]",
        "A whole cell: simulated robots, proxies, lookups, a host, the full screen; --can: over CAN FD."
        " STORY: companion, a flat with visitors instead of the cell; sites, a lever that is closed from"
        " another site, --delay milliseconds away (150), while the hub between them is killed; travel, the"
        " same by robots near the operator, near the arm, moved in between, and left to themselves; away, a"
        " rover that is switched off and takes its orders when it is back; mcp, an assistant that closes the"
        " lever when you say yes; compose, a cup is carried once by hand, and again by the page made of that."
        " --crash: close the lever, kill the host of its robots meanwhile, and see them go on."
        " Its links are signed with the realm's own key, with --open they are not. --speedup: as for sim.",
        start="demos:demo",
        needs=("sim",),
        examples=(
            "demo --can",
            "demo --crash",
            "demo companion --headless",
            "demo sites --headless --delay 150",
            "demo travel --headless --delay 150",
            "demo away --headless",
            "demo mcp --headless",
            "demo compose --headless",
            "demo --headless --can --classic",
        ),
    ),
    shell(
        "supervise",
        "The full screen over the robots of this realm.",
        start="supervising:supervise",
        needs=("tui",),
    ),
    shell(
        "user",
        "The page for people who do not operate robots: what robots can do, in plain words; begin it,"
        " watch it, order it for later, answer questions, take results, choose a role, write a script."
        " 40 by 20 characters are enough; without a network it shows what was taken along.",
        start="supervising:supervise",
        needs=("tui",),
        examples=("user",),
    ),
    shell(
        "web [--listen ADDRESS] [--cert FILE] [--origin ORIGIN] [--tabs N]",
        "Serve the full screen to browsers at a port of this machine (7334), and print the addresses:"
        " one to command, one to watch. Each tab has its own screen; what that has begun ends when the"
        " tab closes."
        " ADDRESS: another port, or HOST:PORT, which needs --cert, a certificate with its key. ORIGIN: of a"
        " proxy in front of it, such as https://robots.example. --tabs: as many at most (8).",
        start="web.serving:web",
        needs=("tui", "web"),
        examples=("web", "web --listen 8080 --readonly"),
        guide=("robotree.tui.web.door",),
    ),
)
