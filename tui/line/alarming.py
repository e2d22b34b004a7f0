"""The verbs about alarms: thresholds of readings, and their acknowledgement."""

from __future__ import annotations

import os
import time
from math import isfinite, radians
from typing import TYPE_CHECKING

from robotree.tui.errors import AlarmsUnusable, NoSuchAlarm, ValueRefused
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome, Teller, plain
from robotree.tui.processes.alarm_file import AlarmFile, alarms_of
from robotree.tui.seen import instruments
from robotree.tui.seen.watched import Alarm, Sign, WatchedReadings, acknowledged, judged, judging
from robotree.vr.base.readable import IN_DEGREES, apart, entered

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.requests import State
    from robotree.vr.supervision.realm_client import RealmClient

PAUSE = 0.2
"""[s] between two looks whether a reading has passed a threshold."""
WORDS = {">": "above", "<": "below"}
SIGNS: dict[str, Sign] = {"alarm above": ">", "alarm below": "<"}


async def alarm(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Raise an alarm when a reading is above or below a limit; the second word of the verb says which."""
    robot, reading = values.dotted(line.text("ROBOT.READING"), "ROBOT.READING")
    described = await realm_client.describe(robot)
    if reading not in described.readings:
        known = ", ".join(sorted(described.readings)) or "none"
        raise ValueRefused("ROBOT.READING", f"{robot} has no reading {reading}; it has {known}")
    unit = instruments.unit_of(reading, described.units)
    limit = _limit(line.text("LIMIT"), unit)
    made = Alarm(
        robot=robot,
        reading=reading,
        sign=SIGNS[line.verb],
        limit=limit,
        unit=unit,
        by=_me(),
        since=time.time(),
    )

    def change(alarms: dict[str, Alarm]) -> None:
        alarms[made.name] = made

    alarms_of(realm_client.realm).change(change)
    return Outcome(plain(made), f"an alarm is raised when {words(made)}")


async def alarm_clear(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Take an alarm away."""
    name = line.text("ROBOT.READING")

    def change(alarms: dict[str, Alarm]) -> None:
        if alarms.pop(name, None) is None:
            raise NoSuchAlarm(name, alarms)

    alarms_of(realm_client.realm).change(change)
    return Outcome({"cleared": name}, f"{name} raises no alarm any more")


async def alarm_ack(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Acknowledge one alarm, or all."""
    wanted, now = line.text("ROBOT.READING"), time.time()
    by, done = _me(), list[str]()
    file = alarms_of(realm_client.realm)
    await _look(realm_client, file)

    def change(alarms: dict[str, Alarm]) -> None:
        if wanted and wanted not in alarms:
            raise NoSuchAlarm(wanted, alarms)
        for name, alarm in alarms.items():
            if alarm.open and wanted in {"", name}:
                alarms[name] = acknowledged(alarm, by, now)
                done.append(name)

    file.change(change)
    return Outcome(
        {"acknowledged": done}, f"acknowledged: {', '.join(done)}" if done else "nothing to acknowledge"
    )


async def alarms(realm_client: RealmClient, _line: Line, _teller: Teller) -> Outcome:
    """List the alarms, after a look at the readings."""
    file = alarms_of(realm_client.realm)
    await _look(realm_client, file)
    found = file.all()
    rows = [{**plain(one), "name": one.name, "state": one.state} for one in found]
    return Outcome(rows, "\n".join(map(row, found)) or "no alarm is set: `alarm above ROBOT.READING LIMIT`")


async def watch(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Judge the alarms as readings come, until it is interrupted or the time is over, without a screen."""
    import asyncio

    file, watched, trouble = alarms_of(realm_client.realm), WatchedReadings(), False
    file.all()  # one that cannot be used from the beginning is refused

    def take(name: str, state: State) -> None:
        watched.take(name, state.readings, time.time())

    def judge() -> None:
        nonlocal trouble
        passed, before = watched.passed, dict(watched.alarms)
        try:
            after = file.change(judging(passed, 0.0)) if passed else file.all()
        except AlarmsUnusable as error:  # an editor may be writing it: what has passed waits until it is good
            if not trouble:
                teller.warn(f"{error}. Until then the alarms of before are judged")
            trouble = True
            return
        trouble = False
        passed.clear()
        watched.take_alarms(after)
        for alarm in after:
            if alarm.state != "calm" and alarm != before.get(alarm.name):
                teller.outcome(Outcome({**plain(alarm), "state": alarm.state}, row(alarm)))

    limit = values.duration(line.text("--for")) if line.text("--for") else None
    watching = await realm_client.watch_state(None, take)
    try:
        async with asyncio.timeout(limit):
            while True:
                judge()
                await asyncio.sleep(PAUSE)
    except TimeoutError:
        pass
    finally:
        await watching.close()
    return Outcome(None)


async def _look(realm_client: RealmClient, file: AlarmFile) -> None:
    """Judge the alarms by what the robots read now: no screen may run that does."""
    from robotree.vr.base.errors import VrError

    now, readings = time.time(), dict[str, float]()
    for robot in {alarm.robot for alarm in file.all()}:
        try:
            described = await realm_client.describe(robot)
        except VrError:  # it is away: nothing new is known
            continue
        readings |= {
            f"{robot}.{name}": value for name, value in described.readings.items() if isfinite(value)
        }
    if not readings:
        return

    def change(alarms: dict[str, Alarm]) -> None:
        for name, alarm in alarms.items():
            if name in readings:
                alarms[name] = judged(alarm, readings[name], now)

    file.change(change)


def _me() -> str:
    """Return the person at this terminal: `anna@pts/3`."""
    from robotree.vr.base.envelope import this_terminal
    from robotree.vr.base.principal import user_name

    return f"{user_name(os.geteuid())}@{this_terminal()}"


def _limit(text: str, unit: str) -> float:
    """Read a limit in the unit in which a reading is shown: angles in degrees.

    Raises:
        ValueRefused: it is no number.
    """
    shown = IN_DEGREES.get(unit, unit)
    number = values.scalar(text.strip().removesuffix(shown).strip() if shown else text.strip())
    if isinstance(number, str | bool):
        what = f"a number in {shown}" if shown else "a number"
        raise ValueRefused("LIMIT", f"{text!r} is no limit; write {what}")
    return radians(number) if unit in IN_DEGREES else float(number)


# -- in words --------------------------------------------------------------------------------------


def words(alarm: Alarm) -> str:
    """Write what an alarm is about: `arm-1.fz is above 20 N`."""
    return f"{alarm.name} is {WORDS[alarm.sign]} {entered(alarm.limit, alarm.unit)}"


def row(alarm: Alarm) -> str:
    """Write an alarm as a line."""
    value, _ = apart(alarm.value, alarm.limit, alarm.unit)
    clock = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(alarm.raised)) if alarm.raised else ""
    match alarm.state:
        case "calm":
            tail = f"last raised {clock}" if clock else "never raised"
        case "acknowledged":
            tail = f"since {clock}, acknowledged by {alarm.acknowledged_by}"
        case "raised":
            tail = f"since {clock}, at {value}"
        case "over":
            tail = f"raised {clock} at {value}, over since, not acknowledged"
    return f"{alarm.state:12} {words(alarm)}; {tail}"
