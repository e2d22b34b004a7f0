"""What crosses the wire between a proxy and its controller; no agents are needed."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import WIRE, Action, Where

shell = partial(Action, group=WIRE, where=Where.SHELL)

VERBS = (
    shell(
        "wire decode FILE [--as FORMAT] [--xml DIALECT]",
        "Print the MAVLink frames in a recording, a candump log or raw bytes (- for standard input).",
        start="wire.record:decode",
        examples=("wire decode flight.tlog", "wire decode - --json"),
    ),
    shell(
        "wire record --connect URL FILE [--for TIME] [--key FILE] [--xml DIALECT]",
        "Record the frames of a link in a FILE.tlog, or FILE.mcap for Foxglove.",
        start="wire.record:record",
        examples=(
            "wire record --connect tcp:127.0.0.1:5760 arm.tlog --for 10s",
            "wire record --connect tcp:127.0.0.1:5771 crane.mcap --xml crane.xml",
        ),
    ),
    shell(
        "wire replay FILE --connect URL | --listen URL [--speed SPEED] [--commands] [--key FILE]",
        "Send a recording again at its own speed, SPEED times as fast, or as fast as possible (max);"
        " with --connect frames that command are left out unless --commands is given.",
        start="wire.replay:replay",
        examples=(
            "wire replay arm.tlog --listen tcp:127.0.0.1:5770",
            "wire replay arm.tlog --connect tcp:5780",
        ),
        alters=True,
    ),
    shell(
        "wire monitor --connect URL [URL …] [--for TIME] [--every TIME] [--key FILE] [--xml DIALECT]",
        "Watch links: rate, age and last value of each message; loss, delay and bytes per second.",
        start="wire.monitor:monitor",
        examples=("wire monitor --connect tcp:127.0.0.1:5760",),
    ),
    shell(
        "wire ping --connect URL [--count COUNT] [--every TIME] [--for TIME] [--by SERVICE] [--key FILE]",
        "Measure how long a frame takes there and back, by PING (or by timesync).",
        start="wire.ping:ping",
        examples=("wire ping --connect tcp:127.0.0.1:5760 --count 100 --every 10ms",),
    ),
    shell(
        "wire conform --connect URL [RULE …] [--kind KIND] [--component N] [--key FILE]",
        "Try whether a controller keeps the rules of docs/bring-your-own-robot.md; its robot moves."
        " KIND: arm, rover, base, limb or head; without it, what the telemetry shows. RULE: only these.",
        start="wire.conform:conform",
        examples=(
            "wire conform --connect tcp:127.0.0.1:5761",
            "wire conform --connect tcp:127.0.0.1:5761 key-repeat silence --json",
        ),
        alters=True,
    ),
    shell(
        "wire dissector [FILE] [--port PORT] [--xml DIALECT]",
        "Write a Lua file with which Wireshark and tshark decode the frames.",
        start="wire.dialect:dissector",
        needs=("wire",),
        examples=("wire dissector robotree.lua",),
    ),
    shell(
        "wire dialect --lang LANGUAGE OUT [--xml DIALECT] [--include BASE]",
        "Write our dialect, or yours, in c, c++, csharp, java, objc, python, swift, wireshark, or xml.",
        start="wire.dialect:dialect",
        needs=("wire",),
        examples=(
            "wire dialect --lang c include/mavlink",
            "wire dialect --lang c mine --xml mine.xml",
            "wire dialect --lang python robotree.py --include ardupilotmega",
        ),
    ),
    shell(
        "wire inject --listen URL --connect URL [--loss SHARE] [--delay TIME] [--jitter TIME]"
        " [--duplication SHARE] [--seed NUMBER] [--for TIME]",
        "Relay between two programs as a bad link would; lines on standard input (cut 3s) change it.",
        start="wire.inject:inject",
        guide=("robotree.tui.wire.inject",),
        examples=(
            "wire inject --listen tcp:127.0.0.1:5770 --connect tcp:127.0.0.1:5760 --loss 20% --delay 50ms",
        ),
        alters=True,
    ),
    shell(
        "wire key FILE [--links PATTERN] [--passphrase] [--of CONTROLLER]",
        "Make a file with a signing key for --key FILE, or for $ROBOTREE_KEY."
        " --of: print the key that one controller, named by its address, gets from a file (or `realm`).",
        start="wire.security:key",
        examples=(
            "wire key cell.key",
            "wire key cell.key --links 'tcp:127.0.0.1:*' --passphrase",
            "wire key realm --of tcp:127.0.0.1:5760",
        ),
    ),
)
