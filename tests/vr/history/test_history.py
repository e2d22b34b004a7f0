"""The history of what robots do: its file, the thread that fills it, and what is read from it."""

from __future__ import annotations

import sqlite3
import sys
import time
from collections.abc import Iterator
from itertools import cycle
from pathlib import Path
from typing import Any

import pytest

from robotree.tui.errors import NotInstalled
from robotree.tui.line.past import export_spans
from robotree.vr.base.address import Address
from robotree.vr.base.errors import HistoryUnusable
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import Call, Raised, ReadEvents, Returned
from robotree.vr.core import events as on
from robotree.vr.core.machine import RobotCore
from robotree.vr.history import writer as writers
from robotree.vr.history.file import HistoryFile
from robotree.vr.history.writer import HistoryWriter
from robotree.vr.supervision.past import CallSpan, explain, last_motion, spans_of
from tests.vr.cores import new_core
from tests.waiting import wait_until

# -- the file: a chain of hashes that shows what is missing or changed, within bounds --------------


def event(kind: Any, robot: str, key: str, unix: float = 1.0, **more: Any) -> HistoryEvent:
    return HistoryEvent(kind=kind, unix=unix, robot=robot, key=key, **more)


def called(key: str, robot: str = "arm", unix: float = 100.0, **more: Any) -> HistoryEvent:
    return event("accepted", robot, key, unix, command="go", **more)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """A file with ten events."""
    path = tmp_path / "history.db"
    file = HistoryFile(path, writes=True)
    for number in range(1, 11):
        file.append([called(f"k{number}", unix=100.0 + number)])
    file.close()
    return path


def spoil(path: Path, order: str) -> str:
    """Change the file behind its back; return what an examination says."""
    connection = sqlite3.connect(path)
    with connection:
        connection.execute(order)
    connection.close()
    file = HistoryFile(path)
    try:
        return file.verify().fault
    finally:
        file.close()


def test_what_was_written_is_verified_to_the_last_event(path: Path) -> None:
    file = HistoryFile(path)
    found = file.verify()
    file.close()
    assert (found.count, found.first, found.fault) == (10, 1, "")
    assert len(found.last_hash) == 64


@pytest.mark.parametrize(
    ("order", "fault"),
    [
        ("DELETE FROM event WHERE number = 4", "event 4 is missing"),
        ("DELETE FROM event WHERE number = 1", "event 1 is missing"),
        ("DELETE FROM event WHERE number > 8", "event 9 is missing"),
        ("UPDATE event SET body = replace(body, 'k5', 'kX') WHERE number = 5", "event 5 was changed"),
        ("UPDATE event SET body = CAST(body AS BLOB), unix = 7 WHERE number = 6", "event 6 was changed"),
        ("UPDATE event SET robot = 'leg' WHERE number = 7", "event 7 was changed"),
        ("UPDATE event SET hash = x'00' WHERE number = 10", "event 10 was changed"),
    ],
)
def test_the_first_event_that_is_missing_or_changed_is_named(path: Path, order: str, fault: str) -> None:
    assert spoil(path, order).startswith(fault)


def test_a_chain_whose_oldest_events_were_deleted_for_their_age_is_still_verified(path: Path) -> None:
    file = HistoryFile(path, writes=True)
    assert file.trim(now=1000.0, oldest=1000.0 - 104.5) == 4
    found = file.verify()
    assert (found.count, found.first, found.fault) == (6, 5, "")
    file.append([called("k11")])
    assert file.verify().fault == ""
    file.close()
    assert spoil(path, "DELETE FROM event WHERE number = 5").startswith("event 5 is missing")


def test_a_file_that_grows_beyond_its_bound_loses_its_oldest_events(tmp_path: Path) -> None:
    file = HistoryFile(tmp_path / "history.db", writes=True)
    largest = 1_000_000
    for batch in range(60):
        file.append([called(f"{batch}/{number}", arguments="x" * 1000) for number in range(100)])
        while file.trim(now=200.0, largest=largest):
            pass
    assert (tmp_path / "history.db").stat().st_size < 2 * largest
    file.append([called("last")])
    assert file.verify().fault == ""
    file.close()


def test_the_last_motion_of_a_robot_comes_with_all_that_led_to_it(tmp_path: Path) -> None:
    file = HistoryFile(tmp_path / "history.db", writes=True)
    file.append([called("a", "team"), called("a/1", "arm"), called("b", "team"), called("b/2/1", "arm")])
    file.append([called("c", "team")])
    found = file.read(ReadEvents(robot="arm", last=True))
    assert [event.event.key for event in found.events] == ["b", "b/2/1"]
    assert file.read(ReadEvents(robot="leg", last=True)).events == ()
    file.close()


def test_of_more_events_than_asked_for_the_latest_come_and_the_rest_is_named(path: Path) -> None:
    file = HistoryFile(path)
    found = file.read(ReadEvents(robot="arm", most=3, since=105.0))
    assert [event.event.key for event in found.events] == ["k8", "k9", "k10"]
    assert found.more
    file.close()


def test_a_file_that_is_none_is_refused_in_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "history.db"
    path.write_bytes(b"no database at all" * 100)
    with pytest.raises(HistoryUnusable, match=r"file is not a database.; the robots run on"):
        HistoryFile(path, writes=True)


# -- the thread that fills it: it lags, loses nothing in silence, and stops no robot ---------------


ANNA = Principal("anna", 7, "caller/x", "pts/3")


class Robot:
    """A machine whose events are kept."""

    def __init__(self, history: HistoryWriter, name: str = "arm") -> None:
        self.core: RobotCore = history.machine_of(new_core(name).state)

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
def history(tmp_path: Path) -> Iterator[HistoryWriter]:
    history = HistoryWriter(tmp_path / "h1")
    history.start()
    yield history
    history.close()


def test_a_call_is_kept_with_who_asked_and_how_it_ended(history: HistoryWriter) -> None:
    history.page_of = {"arm": "cafe"}.get  # type: ignore[assignment]
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


def test_a_call_that_only_reads_is_not_kept(history: HistoryWriter) -> None:
    robot = Robot(history)
    robot.go("r", reads=True)
    robot.end("r")
    robot.go("k")
    assert [event.key for event in kept(history)] == ["k"]


def test_of_a_call_that_was_asked_twice_one_acceptance_and_one_end_are_kept(history: HistoryWriter) -> None:
    robot = Robot(history)
    robot.go("k")
    robot.go("k")
    robot.end("k")
    robot.go("k")
    assert [event.kind for event in kept(history)] == ["accepted", "ended"]


def test_a_lease_that_ends_by_silence_is_kept_as_one_that_is_released(history: HistoryWriter) -> None:
    robot, parent = Robot(history), Address("robot", "team", "1" * 16)
    now = time.monotonic()
    robot.core.handle(
        on.ParentAsked(parent=parent, slot="arm", lineage=("team",), term=1.0, unix=5.0), now
    )  # fmt: skip
    robot.core.handle(on.Tick(unix=9.0), now + 100.0)
    begin, end = kept(history)
    assert (begin.kind, begin.parent, begin.text) == ("lease", "team", "team commands it")
    assert end.text.startswith("team commands it no more: ")


def test_one_order_to_stop_that_comes_twice_is_one_stop(history: HistoryWriter) -> None:
    robot = Robot(history)
    for _ in range(2):
        order = on.StopAsked(reason="anna@pts/3's protective stop", order="o", principal=ANNA)
        robot.core.handle(order, time.monotonic())
    assert [(event.kind, event.person) for event in kept(history)] == [("stop", "anna@pts/3")]


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


# -- why a robot moved: the tree of calls is the tree of keys, across hosts -------------------------


ASKED = event("accepted", "team", "k", person="anna@pts/3", caller="anna@pts/3")
STEP = event("accepted", "arm", "k/2/1", 2.0, caller="team", line=12, epoch=7)
END = event("ended", "arm", "k/2/1", 3.0)
HEARD = event("answered", "team", "k/2/1", 4.0)


def test_a_motion_leads_up_to_the_person_across_hosts() -> None:
    chain = explain("k/2/1", [("host h1", ASKED), ("host h2", STEP), ("host h2", END), ("host h1", HEARD)])
    assert chain is not None
    assert [(link.call.robot, link.source, link.step) for link in chain.links] == [
        ("arm", "host h2", "2/1"),
        ("team", "host h1", ""),
    ]
    assert (chain.links[0].ended, chain.links[0].answered) == (END, HEARD)
    assert (chain.person, chain.missing) == ("anna@pts/3", "")


def test_a_caller_of_which_nothing_is_kept_is_named() -> None:
    chain = explain("k/2/1", [("host h2", STEP)])
    assert chain is not None
    assert (chain.missing, chain.person) == ("team", "")


def test_of_a_key_that_nobody_knows_nothing_is_said() -> None:
    assert explain("k/3", [("host h1", ASKED)]) is None


def test_the_last_motion_is_the_latest_of_all_hosts() -> None:
    assert last_motion(
        [STEP, event("accepted", "arm", "old", 1.5), event("ended", "arm", "x", 9.0)], "arm"
    ) == ("k/2/1")
    assert last_motion([ASKED], "arm") == ""


# -- a command with all that it caused is one trace ------------------------------------------------


def call(robot: str, key: str, begin: float, error: str = "") -> list[HistoryEvent]:
    return [
        event("accepted", robot, key, begin, command="go", caller="anna@pts/3"),
        event("ended", robot, key, begin + 1.5, command="go", error=error),
    ]


def test_robots_that_export_apart_give_one_trace() -> None:
    (parent,), (child,) = spans_of(call("team", "k", 1.0)), spans_of(call("arm", "k/1", 2.0, "Busy"))
    assert parent.trace == child.trace
    assert (parent.parent, child.parent) == (0, parent.span)
    assert (child.name, child.end - child.begin, child.error) == ("arm.go", 1_500_000_000, "Busy: ")
    (other,) = spans_of(call("team", "l", 1.0))
    assert other.trace != parent.trace


def test_a_call_that_goes_on_is_no_span_yet() -> None:
    assert spans_of(call("arm", "k", 1.0)[:1]) == []


def test_without_the_sdk_one_sentence_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace", None)
    spans: list[CallSpan] = []
    with pytest.raises(NotInstalled, match="pip install opentelemetry-sdk"):
        export_spans(spans)
