"""Stories of the thread that fills the history: it lags, loses nothing in silence, and stops no robot."""

from __future__ import annotations

import time
from itertools import cycle
from pathlib import Path

import pytest

from robotree.vr.base.address import Address
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import Call, Raised, ReadEvents, Returned
from robotree.vr.core import events as on
from robotree.vr.core.bonds import GrantedLease, Slots
from robotree.vr.core.machine import Calls, RobotCore, RobotState
from robotree.vr.core.stop import Stop
from robotree.vr.history import writer as writers
from robotree.vr.history.file import HistoryFile
from robotree.vr.history.writer import HistoryWriter
from tests.waiting import wait_until

ANNA = Principal("anna", 7, "caller/x", "pts/3")


class Robot:
    """A machine whose events are kept."""

    def __init__(self, history: HistoryWriter, name: str = "arm") -> None:
        address = Address("robot", name, "0" * 16)
        lease = GrantedLease.free(name, unix=1.0)
        state = RobotState(
            address=address, home="h", lease=lease, slots=Slots(name), calls=Calls(), stop=Stop()
        )
        self.core: RobotCore = history.machine_of(state)

    def go(self, key: str, *, reads: bool = False, caller: str = "anna@pts/3", line: int = 0) -> None:
        call = Call(key=key, command="go", arguments={"x": 0.3}, deadline=9.0, caller=caller, line=line)
        now = time.monotonic()
        self.core.handle(
            on.Invoke(call=call, arguments={}, deadline_at=now + 9, reads=reads, principal=ANNA), now
        )

    def end(self, key: str, reply: Returned | Raised | None = None) -> None:
        self.core.handle(on.Finish(key=key, reply=reply or Returned(key=key, value=1)), time.monotonic())


def kept(history: HistoryWriter, robot: str = "arm") -> list[HistoryEvent]:
    return [event.event for event in history.read(ReadEvents(robot=robot), within=20.0).events]


@pytest.fixture
def history(tmp_path: Path) -> HistoryWriter:
    return HistoryWriter(tmp_path / "h1")


def test_a_call_is_kept_with_who_asked_and_how_it_ended(history: HistoryWriter) -> None:
    history.page_of = {"arm": "cafe"}.get  # type: ignore[assignment]
    history.start()
    robot = Robot(history)
    robot.go("k", line=12)
    robot.end("k", Raised(error="CommandFailed", data={"robot": "arm", "command": "go", "detail": "stuck"}))
    accepted, ended = kept(history)
    assert (accepted.kind, accepted.key, accepted.command) == ("accepted", "k", "go")
    assert accepted.arguments == {"x": 0.3}
    assert (accepted.person, accepted.process, accepted.page, accepted.line) == (
        "anna@pts/3", 7, "cafe", 12,
    )  # fmt: skip
    assert abs(accepted.unix - time.time()) < 60
    assert (ended.kind, ended.error) == ("ended", "CommandFailed")
    assert accepted.unix <= ended.began <= ended.unix
    history.close()


def test_a_call_that_only_reads_is_not_kept(history: HistoryWriter) -> None:
    history.start()
    robot = Robot(history)
    robot.go("r", reads=True)
    robot.end("r")
    robot.go("k")
    assert [event.key for event in kept(history)] == ["k"]
    history.close()


def test_of_a_call_that_was_asked_twice_one_acceptance_and_one_end_are_kept(history: HistoryWriter) -> None:
    history.start()
    robot = Robot(history)
    robot.go("k")
    robot.go("k")
    robot.end("k")
    robot.go("k")
    assert [event.kind for event in kept(history)] == ["accepted", "ended"]
    history.close()


def test_a_lease_that_ends_by_silence_is_kept_as_one_that_is_released(history: HistoryWriter) -> None:
    history.start()
    robot, parent = Robot(history), Address("robot", "team", "1" * 16)
    now = time.monotonic()
    robot.core.handle(
        on.ParentAsked(parent=parent, slot="arm", lineage=("team",), term=1.0, unix=5.0), now
    )  # fmt: skip
    robot.core.handle(on.Tick(unix=9.0), now + 100.0)
    begin, end = kept(history)
    assert (begin.kind, begin.parent, begin.text) == ("lease", "team", "team commands it")
    assert end.text.startswith("team commands it no more: ")
    history.close()


def test_one_order_to_stop_that_comes_twice_is_one_stop(history: HistoryWriter) -> None:
    history.start()
    robot = Robot(history)
    for _ in range(2):
        order = on.StopAsked(reason="anna@pts/3's protective stop", order="o", principal=ANNA)
        robot.core.handle(order, time.monotonic())
    assert [(event.kind, event.person) for event in kept(history)] == [("stop", "anna@pts/3")]
    history.close()


def test_what_did_not_fit_into_the_queue_is_counted_in_the_file(tmp_path: Path) -> None:
    history = HistoryWriter(tmp_path, longest=10)
    robot = Robot(history)
    for number in range(15):
        robot.go(f"k{number}")
    history.start()
    assert len(kept(history)) == 10
    missed = kept(history, "")
    assert [event.text for event in missed] == ["5 events are missing: there were too many at once"]
    history.close()


def test_a_damaged_file_is_one_sentence_and_the_robots_run_on(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writers, "AGAIN", 0.05)
    path = tmp_path / "history.db"
    path.write_bytes(b"no database at all" * 100)
    history = HistoryWriter(tmp_path)
    history.start()
    robot = Robot(history)
    robot.go("k")
    wait_until(lambda: bool(history.trouble))
    robot.end("k")
    assert [record.getMessage() for record in caplog.records if record.levelname == "ERROR"] == [
        f"what robots do is not kept at the moment: {history.trouble}"
    ]
    assert str(path) in history.trouble
    path.unlink()
    robot.go("l")
    wait_until(lambda: not history.trouble and not history.waiting)
    assert {"k", "l"} == {event.key for event in kept(history)}
    history.close()


def test_a_disk_that_is_full_leaves_events_out_and_says_how_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writers, "AGAIN", 0.05)
    history = HistoryWriter(tmp_path, longest=10)
    full = [True]
    append = HistoryFile.append

    def refuse(file: HistoryFile, events: list[HistoryEvent]) -> None:
        if full[0]:
            file._file.execute("PRAGMA max_page_count = 1")
        large = [HistoryEvent(kind="stop", unix=1.0, robot="x" * 5000)] if full[0] else []
        append(file, [*events, *large])

    monkeypatch.setattr(HistoryFile, "append", refuse)
    history.start()
    robot = Robot(history)
    for number in range(15):
        robot.go(f"k{number}")
    wait_until(lambda: bool(history.trouble))
    assert "full" in history.trouble
    full[0] = False
    robot.go("last")
    wait_until(lambda: not history.trouble and not history.waiting)
    assert kept(history)[-1].key in {"last", "k14", "k9"}
    assert "events are missing" in kept(history, "")[0].text
    history.close()


def test_what_stands_in_the_journal_and_not_in_the_file_is_written_by_the_next_process(
    tmp_path: Path,
) -> None:
    before = HistoryWriter(tmp_path)
    robot = Robot(before)
    robot.go("k")
    before.start()
    assert len(kept(before)) == 1
    before.close()
    history = HistoryWriter(tmp_path)  # its process was killed; the journal has both again
    again = Robot(history)
    again.go("k")
    again.end("k")
    history.replayed(time.time() - time.monotonic())
    history.start()
    wait_until(lambda: len(kept(history)) == 2)
    assert [event.kind for event in kept(history)] == ["accepted", "ended"]
    history.close()


def test_moments_are_right_when_the_process_is_interrupted_between_two_clocks(tmp_path: Path) -> None:
    """Else events of two hosts stand in the wrong order on a busy machine."""
    time_now, interruptions = [0.0], cycle([0.3, 0.2, 0.3, 0.2, 0.0])

    def now() -> float:
        time_now[0] += next(interruptions)
        return time_now[0]

    history = HistoryWriter(tmp_path / "h1", now=now, unix=lambda: 1000.0 + time_now[0])
    Robot(history).core.handle(on.StopAsked(reason="fire", principal=ANNA), 7.0)
    history.start()
    (stop,) = kept(history)
    history.close()
    assert stop.unix == pytest.approx(1007.0)
