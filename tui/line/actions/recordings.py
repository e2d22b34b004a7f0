"""Recordings of a realm: made, shown, compared, and written in other formats."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import LOOK, Action, Where

shell = partial(Action, group=LOOK, where=Where.SHELL)

VERBS = (
    shell(
        "record FILE [NAME …] [--for TIME] [--pictures RATE]",
        "Record a realm into FILE.mcap until Ctrl-C: states, readings, logs, who asked for what, and"
        " RATE pictures a second of each camera (2; 0: none). NAME: of these robots alone. Foxglove opens the"
        " file, too.",
        run="recording.recorder:record",
        right="see",
        needs=("wire",),
        examples=("record monday.mcap", "record lever.mcap lever arm-1 --for 2min --pictures 5"),
    ),
    shell(
        "recording FILE [--at TIME]",
        "Print what a recording holds, and its logs; --at: how each robot was, this long after the"
        " beginning.",
        start="recording.exports:recording",
        needs=("wire",),
        examples=("recording monday.mcap", "recording monday.mcap --at 12s"),
    ),
    shell(
        "recording compare FILE OTHER",
        "Print where two recordings differ: commands are aligned by what was asked; of each, whether it"
        " ended otherwise, took longer, or left other readings.",
        start="recording.exports:compare",
        needs=("wire",),
        examples=("recording compare monday.mcap tuesday.mcap",),
    ),
    shell(
        "replay FILE [--from TIME] [--speed SPEED] [--beside OTHER]",
        "Show a recording in the full screen: space holds it, left and right go back and forward by 5 s,"
        " with shift by 30 s, `[` and `]` make it slower and faster, `=` compares. Nothing in it can be"
        " commanded. --beside: on top stands what was otherwise in OTHER at the command that ended last.",
        start="recording.replaying:replay",
        needs=("wire", "tui"),
        examples=("replay monday.mcap --from 2min --speed 4",),
    ),
    shell(
        "foxglove [--port PORT] [--pictures RATE] [--look-only] [--for TIME]",
        "Serve the realm to Foxglove until Ctrl-C, at an address of this machine (PORT, else 8765; 0: a"
        " free one) with a token: readings, logs, pictures, transforms, and the robots' commands as services,"
        " which end with the client that calls them. --look-only: without commands.",
        run="recording.foxglove_server:foxglove",
        alters=True,
        needs=("wire", "foxglove"),
        examples=("foxglove", "foxglove --port 0 --look-only"),
        guide=("robotree.tui.recording.foxglove_server",),
    ),
    shell(
        "export session FILE [OUT]",
        "Print what persons asked for in a recording as a session script, or write it into OUT:"
        " `robotree run` plays it again, and --junit makes a test of it.",
        start="recording.exports:session",
        needs=("wire",),
        examples=("export session monday.mcap monday.session",),
    ),
    shell(
        "export lerobot FILE [OUT] [--fps NUMBER]",
        "Write a recording as a LeRobot data set (version 3.0) into the new folder OUT: each command"
        " that a person asked for and that was done is an episode, with NUMBER (10) frames a second of all"
        " readings and pictures.",
        start="recording.exports:lerobot",
        needs=("wire", "lerobot"),
        examples=("export lerobot monday.mcap monday --fps 20",),
        guide=("robotree.tui.recording.lerobot",),
    ),
    shell(
        "export report FILE [OUT]",
        "Write a recording as Markdown with pictures: who was there, what was asked, what was read.",
        start="recording.exports:report_of",
        needs=("wire",),
        examples=("export report monday.mcap monday.md",),
    ),
)
