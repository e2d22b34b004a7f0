"""Session scripts, trials and drills."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import PROCESS, Action, Where

shell = partial(Action, group=PROCESS, where=Where.SHELL)
line = partial(Action, group=PROCESS)

VERBS = (
    shell(
        "run FILE [--junit FILE]",
        "Play a script of verbs and `expect CONDITION within TIME` (- for standard input);"
        " --junit: write the steps as a JUnit report, too.",
        start="session.playing:play",
        examples=("run examples/close_lever.session", "run -", "run trial.session --junit trial.xml"),
        guide=("robotree.tui.session.script", "robotree.tui.session.conditions"),
    ),
    shell(
        "test [PATH …] [--select EXPRESSION] [--exitfirst] [--junit FILE] [--collect-only]",
        "Play the trials of FOLDERs and FILEs (*.session) as a test suite; FILE::NAME is one of them."
        " -k (--select): only those whose names fit, such as `lift and not slow`; -x (--exitfirst): end at"
        " the first that fails. The exit code is 0 if all held, 1 if one did not, 2 for Ctrl-C or a line that"
        " cannot be understood, 5 if there was none.",
        start="session.suite:test",
        examples=(
            "test examples/trials",
            "test examples/trials -k 'lift and not drill' -x",
            "test 'examples/trials/lift.session::there and back' --junit trials.xml",
        ),
        guide=("robotree.tui.session.script", "robotree.tui.session.conditions"),
    ),
    line(
        "fault cut ROBOT [--for TIME]",
        "For a drill, let nothing cross the link between a robot's proxy and its controller, for a TIME"
        " or until the session ends.",
        run="session.faults:fault_on_link",
        start="session.faults:begin",
        alters=True,
        right="command",
        examples=("fault cut arm-1 --for 3s",),
        guide=("robotree.tui.session.faults",),
    ),
    line(
        "fault delay ROBOT TIME [--for TIME]",
        "For a drill, let everything on a robot's link take a TIME longer, each way.",
        run="session.faults:fault_on_link",
        start="session.faults:begin",
        alters=True,
        right="command",
        examples=("fault delay arm-1 200ms --for 10s",),
    ),
    line(
        "fault freeze NAME [--for TIME]",
        "For a drill, stop the process of a robot, host or lookup of yours on this machine, and continue"
        " it in the end.",
        run="session.faults:fault_freeze",
        start="session.faults:begin",
        alters=True,
        examples=("fault freeze host-1 --for 2s",),
    ),
    line(
        "fault kill NAME",
        "For a drill, kill the process of a robot, host or lookup of yours on this machine; only what"
        " keeps it (the demo, systemd) starts it again.",
        run="session.faults:fault_kill",
        start="session.faults:begin",
        alters=True,
        examples=("fault kill host-1",),
    ),
    Action(
        "fault end",
        "End all faults that were begun from here.",
        group=PROCESS,
        where=Where.PROMPT | Where.SCRIPT,
        run="session.faults:fault_end",
        alters=True,
        examples=("fault end",),
    ),
)
