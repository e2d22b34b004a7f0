"""How long `why` takes in a file with a day of 1,000 robots, and what filling the file costs a call.

python bench/why.py [--robots 1000] [--calls 1440]

A robot is called once a minute, by a parent whose command it is a step of: two calls and two ends. The bound
is 1 s. The cost of a call is measured on a machine with and without a queue, alternately.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from statistics import median

from measuring import apart, options

from robotree.vr.base.address import Address
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.requests import Call, ReadEvents, Returned
from robotree.vr.core import events as on
from robotree.vr.core.bonds import GrantedLease, Slots
from robotree.vr.core.machine import Calls, RobotCore, RobotState
from robotree.vr.core.stop import Stop
from robotree.vr.history.file import HistoryFile
from robotree.vr.history.writer import HistoryWriter
from robotree.vr.supervision.past import explain, last_motion

DAY = 24 * 3600.0
CALLS = 2000
"""Calls in one part of a measurement."""


def fill(file: HistoryFile, robots: int, calls: int) -> int:
    """Write a day of robots; returns how many events."""
    begin, count = time.time() - DAY, 0
    for turn in range(calls):
        events: list[HistoryEvent] = []
        for robot in range(0, robots, 2):
            key, unix = f"{robot:08x}{turn:08x}", begin + turn * DAY / calls
            parent, child = f"team-{robot}", f"arm-{robot + 1}"
            common = {"page": "ab" * 32, "within": 120.0}
            events += [
                HistoryEvent(
                    kind="accepted", unix=unix, robot=parent, key=key, command="fetch", person="anna@pts/3",
                    arguments={"place": "shelf 3"}, caller="anna@pts/3", process=4711, **common,
                ),
                HistoryEvent(
                    kind="accepted", unix=unix + 0.1, robot=child, key=f"{key}/2", command="go_to", epoch=7,
                    arguments={"x": 0.31, "y": 0.12, "z": 0.2}, caller=parent, line=12, **common,
                ),
                HistoryEvent(
                    kind="ended", unix=unix + 2.0, robot=child, key=f"{key}/2", command="go_to",
                    began=unix + 0.1,
                ),
                HistoryEvent(
                    kind="ended", unix=unix + 2.1, robot=parent, key=key, command="fetch", began=unix,
                    value=1.0,
                ),
            ]  # fmt: skip
        file.append(events)
        count += len(events)
    return count


def why(path: Path, robot: str) -> float:
    """Return the time [s] of one answer, as a host gives it twice, each time with a new connection."""
    begun = time.perf_counter()
    found = _read(path, ReadEvents(robot=robot, last=True))
    key = last_motion(found, robot)
    chain = explain(key, [("host h", event) for event in _read(path, ReadEvents(key=key))])
    taken = time.perf_counter() - begun
    if chain is None or chain.person != "anna@pts/3":
        raise SystemExit(f"{robot}: a wrong answer")
    return taken


def _read(path: Path, request: ReadEvents) -> list[HistoryEvent]:
    file = HistoryFile(path)
    try:
        return [event.event for event in file.read(request).events]
    finally:
        file.close()


def core(history: HistoryWriter | None) -> RobotCore:
    """Make a machine; None: nobody keeps its events."""
    lease = GrantedLease.free("arm", unix=1.0)
    state = RobotState(
        address=Address("robot", "arm", "0" * 16), home="h", lease=lease, slots=Slots("arm"), calls=Calls(),
        stop=Stop(),
    )  # fmt: skip
    return RobotCore(state) if history is None else history.machine_of(state)


def cost(machine: RobotCore) -> float:
    """Return the time [us] that a call takes in a machine: accepted, and ended."""
    begun = time.perf_counter()
    for number in range(CALLS):
        now, key = time.monotonic(), f"k{begun}{number}"
        call = Call(key=key, command="go", arguments={"x": 1.0}, deadline=9.0)
        machine.handle(on.Invoke(call=call, arguments={"x": 1.0}, deadline_at=now + 9.0), now)
        machine.handle(on.Finish(key=key, reply=Returned(key=key)), now)
    return (time.perf_counter() - begun) / CALLS * 1e6


def main() -> None:
    """Measure, and print one JSON line."""
    given = options(__doc__, robots=1000, calls=1440)
    with apart() as folder:
        path = folder / "history.db"
        file = HistoryFile(path, writes=True)
        begun = time.perf_counter()
        count = fill(file, given.robots, given.calls)
        filled = time.perf_counter() - begun
        file.close()
        answers = sorted(why(path, f"arm-{1 + 2 * (number % (given.robots // 2))}") for number in range(200))
        file = HistoryFile(path)
        begun = time.perf_counter()
        fault = file.verify().fault
        verified = time.perf_counter() - begun
        file.close()
        plain, kept, thread = core(None), list[float](), list[float]()
        bare: list[float] = []
        for number in range(9):  # alternately: with a queue alone, and with the thread that empties it
            bare.append(cost(plain))
            history = HistoryWriter(folder / str(number))
            kept.append(cost(core(history)))
            history.start()
            thread.append(cost(core(history)))
            history.close()
        print(json.dumps({
            "events": count, "file_mb": round(path.stat().st_size / 1e6),
            "fill_us": round(filled / count * 1e6, 1),
            "why_p50_ms": round(median(answers) * 1e3, 2), "why_max_ms": round(answers[-1] * 1e3, 2),
            "verify_s": round(verified, 1), "fault": fault,
            "call_us": round(median(bare), 1), "call_queued_us": round(median(kept), 1),
            "call_written_us": round(median(thread), 1),
        }))  # fmt: skip


if __name__ == "__main__":
    main()
