"""Alarms on readings."""

from __future__ import annotations

from functools import partial

from robotree.tui.line.action import LOOK, Action, Where

line = partial(Action, group=LOOK)

VERBS = (
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
