"""What one looks at: robots, their readings and alarms, their pages, their past, and this machine."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import ANYWHERE, LOOK, About, Action, Where

line = partial(Action, group=LOOK)
anywhere = partial(Action, group=LOOK, where=ANYWHERE)
of_robot = partial(Action, group=LOOK, where=ANYWHERE, about=About.ROBOT)
shell = partial(Action, group=LOOK, where=Where.SHELL)

VERBS = (
    line(
        "ls [--views | --hosts | --lookups]",
        "List the free robots (enslaved ones: `tree`).",
        run="line.verbs:ls",
        examples=("ls", "ls --views --json"),
    ),
    anywhere(
        "tree",
        "Show the robots as trees: each below its parent, with its slot.",
        run="line.verbs:tree",
        key="t",
    ),
    of_robot(
        "show NAME",
        "Describe a robot: kinds, commands, slots, parent.",
        run="line.ordering:show_or_remember",
        right="see",
        key="i",
        examples=("show arm-1",),
    ),
    line(
        "groups [GROUP]",
        "List the groups, or the members of one: who they are now, how, and why they are in it.",
        run="line.groups:groups",
        examples=("groups", "groups cleaners --json"),
    ),
    line(
        "space ls [NAME] [KIND]",
        "List the spaces, or what is in one: its entries, the oldest first, and its fences.",
        run="line.verbs:space_ls",
        examples=("space ls", "space ls jobs", "space ls jobs Delivery --json"),
    ),
    line(
        "stubs NAME [--out FILE]",
        "Print the interface of a robot as Python, for `Child` in a page, which editors understand.",
        run="line.verbs:stubs",
        right="see",
        writes=True,
        examples=("stubs arm-1", "stubs painter --out painter_kind.py"),
    ),
    line(
        "look VIEW [FILE] [--camera CAMERA] [--size SIZE]",
        "Fetch a picture of a workspace into a JPEG file.",
        run="line.verbs:look",
        right="see",
        writes=True,
        examples=("look cell before.jpg --camera wrist --size 640x360",),
    ),
    shell(
        "watch [NAME] [--within TIME]",
        "Print each change of state until it is interrupted.",
        run="line.verbs:watch",
        right="see",
        examples=("watch arm-1 --json",),
    ),
    anywhere(
        "log [NAME] [--follow]",
        "Print what the code of a robot says (print, warnings, logging), and its commands: who asked,"
        " how they ended, how long they waited and ran; --follow: go on until it is interrupted."
        " Without NAME: of all robots.",
        run="line.verbs:log",
        right="see",
        key="g",
        examples=("log team", "log team --follow --json"),
    ),
    of_robot(
        "history NAME [--since WHEN] [--verify | --otel]",
        "Print what a robot did, also before its host was started again: who asked, under which lease,"
        " how each command ended. --since: 10min, 14:30 or 2026-11-24T14:30. --verify: examine what is kept"
        " where the robot lives, and name the first event that is missing or changed. --otel: export its"
        " calls as spans of OpenTelemetry.",
        run="line.past:history",
        right="see",
        key="H",
        examples=("history arm-1 --since 10min", "history team --verify"),
    ),
    of_robot(
        "why NAME|KEY",
        "Print who asked for the last motion of a robot, or for the command of a key: each step with its"
        " lease, the line of the page and the times, up to the person at the top.",
        run="line.past:why",
        right="see",
        key="W",
        examples=("why arm-1", "why arm-1 --json"),
    ),
    of_robot(
        "where NAME",
        "Show where a robot is in its page: the line, the calls of its children with their results and"
        " times. On the screen it can be paused, stepped and continued there.",
        run="line.standing:where",
        right="see",
        key="z",
        examples=("where lever", "where lever --json"),
    ),
    shell(
        "info",
        "Print versions, paths, what the terminal can, and the realm.",
        start="diagnosis.doctor:info",
        examples=("info", "info --json"),
    ),
    shell(
        "doctor [NAME]",
        "Check why a robot is not seen: prints each result and what to do.",
        start="diagnosis.doctor:doctor",
        examples=("doctor", "doctor arm-1"),
    ),
    shell(
        "completion SHELL [WORD …]",
        "Print the script that completes lines of robotree in bash, zsh or fish; with words behind `--`:"
        " what the last of them may become.",
        start="line.shells:complete",
        examples=("completion bash", "completion bash -- call arm-1."),
        guide=("robotree.tui.line.shells",),
    ),
    shell(
        "man",
        "Print the manual page of all verbs; `robotree man | man -l -` shows it.",
        start="line.shells:man",
        examples=("man",),
    ),
    line(
        "alarms",
        "List the alarms, after a look at the readings: how each is, since when, who acknowledged it.",
        run="line.alarming:alarms",
        examples=("alarms", "alarms --json"),
    ),
    line(
        "alarms watch [--for TIME]",
        "Judge the alarms until Ctrl-C, where no screen runs: those that are raised meanwhile are kept,"
        " and wait until you acknowledge them. It prints each that changes.",
        run="line.alarming:watch",
        right="see",
        where=Where.SHELL,
        alters=True,
        examples=("alarms watch", "alarms watch --for 8h --json"),
    ),
    line(
        "alarm above ROBOT.READING LIMIT",
        "Raise an alarm when a reading is above a LIMIT: in its row, the log and by the bell of each"
        " screen of yours, until you acknowledge it. It is kept. Angles in degrees.",
        run="line.alarming:alarm",
        right="see",
        alters=True,
        examples=("alarm above arm-1.fz 20",),
    ),
    line(
        "alarm below ROBOT.READING LIMIT",
        "Raise an alarm when a reading is below a LIMIT (`alarm above`).",
        run="line.alarming:alarm",
        right="see",
        alters=True,
        examples=("alarm below rover-1.battery 30",),
    ),
    line(
        "alarm ack [ROBOT.READING]",
        "Acknowledge an alarm, or all: you have seen it.",
        run="line.alarming:alarm_ack",
        alters=True,
        examples=("alarm ack arm-1.fz", "alarm ack"),
    ),
    line(
        "alarm clear ROBOT.READING",
        "Take an alarm away.",
        run="line.alarming:alarm_clear",
        alters=True,
        examples=("alarm clear arm-1.fz",),
    ),
)
