"""The journal of a host: what stands in it after each event, and what it does when the disk takes nothing."""

from __future__ import annotations

import os
import shutil
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from robotree.vr.base.address import Address
from robotree.vr.base.errors import CopiedJournal, DamagedJournal, JournalUnusable, OtherJournal
from robotree.vr.base.principal import Credentials
from robotree.vr.base.requests import Call, Returned
from robotree.vr.base.transport import Incoming
from robotree.vr.core import events as on
from robotree.vr.core.machine import encode_state
from robotree.vr.journal import journal as journals
from robotree.vr.journal import records
from robotree.vr.journal.files import FilePlace
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.outlet import Outlet
from robotree.vr.journal.records import KeptPage
from robotree.vr.journal.segments import OSDisk
from robotree.vr.running.child_call import ChildCall
from robotree.vr.world.disk import Medium, MemoryDisk
from tests.vr.cores import new_core

PAGE = KeptPage("class It(VirtualRobot): ...", "/it.py")


class Clock:
    """A clock that stands still."""

    unix_now, now_now = 1000.0, 10.0
    lock = staticmethod(threading.Lock)

    def now(self) -> float:
        return self.now_now

    def unix(self) -> float:
        return self.unix_now


class FullDisk(OSDisk):
    """A disk on which there is room only for a while."""

    room = True

    def write(self, descriptor: int, data: Any) -> int:
        if not self.room:
            raise OSError(28, "No space left on device")
        return super().write(descriptor, data)

    def create(self, path: Path) -> int:
        if not self.room:
            raise OSError(28, "No space left on device")
        return super().create(path)


class Kept:
    """A robot whose events go to a journal."""

    def __init__(self, journal: HostJournal, name: str = "it") -> None:
        self.core, self.journal = new_core(name), journal
        self.key = self.core.state.address.key
        journal.made(self.key, name, PAGE, lambda query: query(self.core.state))

    def take(self, event: Any) -> None:
        self.core.handle(event, 1.0)
        self.journal.append(self.key, 1.0, event)

    def call(self, key: str) -> None:
        call = Call(key=key, command="go", deadline=9.0)
        self.take(on.Invoke(call=call, arguments={"x": 1.0}, deadline_at=9.0))


def opened(folder: Path, boot: str = "this", **options: Any) -> HostJournal:
    return HostJournal(folder, Clock(), boot=boot, **options)


@pytest.fixture
def journal(tmp_path: Path) -> HostJournal:
    journal = opened(tmp_path / "h")
    journal.begin()
    return journal


def reopened(journal: HostJournal) -> dict[str, bytes]:
    """Close a journal; return the states that the next host finds, by name."""
    journal.close()
    following = opened(Path(journal.where))
    try:
        return {robot.name: encode_state(robot.state) for robot in following.found.robots}
    finally:
        following.close()


def test_the_next_host_finds_the_state_after_all_that_has_happened(journal: HostJournal) -> None:
    robot = Kept(journal)
    robot.call("k")
    look = on.StepResult("look", None, 3.5)
    robot.take(on.StepTaken(key="k", path="1", step=look))
    robot.take(
        on.StepTaken(
            key="k", path="2", step=on.StepResult("call", ["arm", "go", {}], None, Returned(key="k/2"))
        )
    )
    robot.take(on.Finish(key="k", reply=Returned(key="k", value=[1])))
    robot.call("l")
    assert reopened(journal) == {"it": encode_state(robot.core.state)}


def test_a_host_that_ended_before_anything_happened_was_away_since_it_began(tmp_path: Path) -> None:
    """As one that is killed twice, the second time as it comes back."""
    journal = opened(tmp_path / "h")
    journal.begin()
    journal.close()
    following = opened(tmp_path / "h")
    assert following.found.began is not None
    assert following.found.latest == following.found.began.now
    following.close()


def test_a_robot_that_was_deleted_is_not_found(journal: HostJournal) -> None:
    one, other = Kept(journal, "one"), Kept(journal, "other")
    journal.gone(one.key)
    assert list(reopened(journal)) == [other.core.name]


def test_a_new_segment_says_what_the_older_ones_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journals, "LONG", 2000)
    journal = opened(tmp_path / "h")
    journal.begin()
    robot, other = Kept(journal), Kept(journal, "other")
    for number in range(60):
        robot.call(f"k{number}")
        robot.take(on.Finish(key=f"k{number}", reply=Returned(key="k")))
        journal.barrier()
    journal.gone(other.key)
    assert len(list(Path(journal.where).glob("*.log"))) == 1
    assert sum(file.stat().st_size for file in Path(journal.where).glob("*.log")) < 40_000
    assert reopened(journal) == {"it": encode_state(robot.core.state)}


def test_what_nobody_waited_for_may_be_lost_and_what_somebody_waited_for_is_there(tmp_path: Path) -> None:
    journal = opened(tmp_path / "h")
    journal.begin()
    robot = Kept(journal)
    journal.barrier()
    waited = encode_state(robot.core.state)
    robot.call("k")
    folder, _ = Path(journal.where), journal._segments.close()  # the process ends here
    following = opened(folder)
    assert [encode_state(kept.state) for kept in following.found.robots] == [waited]
    following.close()


def test_a_page_counts_when_the_robot_has_turned_to_it(journal: HostJournal) -> None:
    robot, other = Kept(journal), Kept(journal, "other")
    news = KeptPage("class It(VirtualRobot): 'news'", "/it.py")
    for each in (robot, other):
        journal.offered(each.key, news)
    robot.take(on.PageReloaded(slots=(), fields={}))
    journal.close()
    following = opened(Path(journal.where))
    assert [kept.page for kept in following.found.robots] == [news, PAGE]
    following.close()


def test_a_robot_that_was_on_its_way_and_has_not_moved_is_here(journal: HostJournal) -> None:
    robots = [Kept(journal, name) for name in ("back", "away")]
    for each in robots:
        journal.out(each.key, "t", "h2", "log", "secret")
    journal.back(robots[0].key)
    journal.close()
    following = opened(Path(journal.where))
    assert [kept.out is None for kept in following.found.robots] == [True, False]
    following.close()


def test_an_event_that_its_robot_refuses_now_is_damage(journal: HostJournal) -> None:
    robot = Kept(journal)
    robot.call("k")
    other = on.Invoke(call=Call(key="k", command="melt", deadline=9.0), arguments={}, deadline_at=9.0)
    journal.append(robot.key, 1.0, other)
    journal.close()
    with pytest.raises(DamagedJournal, match="it took Invoke and now refuses it"):
        opened(Path(journal.where))


def test_a_full_disk_keeps_nothing_and_says_so_and_later_all_again(tmp_path: Path) -> None:
    disk = FullDisk()
    journal = opened(tmp_path / "h", disk=disk)
    journal.begin()
    robot = Kept(journal)
    journal.barrier()
    disk.room = False
    robot.call("k")
    journal.barrier()
    assert journal.trouble == (
        "its robots would not survive its end now (No space left on device); make room on that disk"
    )
    assert not list(Path(journal.where).glob("*.log"))  # an old one would repeat what is done from now on
    robot.take(on.Finish(key="k", reply=Returned(key="k")))
    disk.room = True
    Clock.now_now += journals.AGAIN + 1.0
    journal.barrier()
    assert not journal.trouble
    robot.call("l")
    assert reopened(journal) == {"it": encode_state(robot.core.state)}


PREPARED: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "a FIFO as the log": ("00000001.log", os.mkfifo, "it is a FIFO, not a file"),
    "a link as the log": ("00000001.log", lambda path: path.symlink_to(path.parent), "it is a symbolic link"),
    "a folder as the log": ("00000001.log", Path.mkdir, "it is a folder, not a file"),
    "a FIFO as the lock": ("lock", os.mkfifo, "it is a FIFO, not a file"),
    "a link as the lock": ("lock", lambda path: path.symlink_to("/dev/null"), "it is a symbolic link"),
    "a folder as the lock": ("lock", Path.mkdir, "it is a folder, not a file"),
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("prepared", PREPARED)
def test_what_lies_in_the_place_of_a_file_is_named_with_what_to_do(tmp_path: Path, prepared: str) -> None:
    name, prepare, reason = PREPARED[prepared]
    (tmp_path / "h").mkdir(mode=0o700)
    prepare(tmp_path / "h" / name)
    with pytest.raises(JournalUnusable, match=f"{name}.*{reason}.*move away what is there.*--forget"):
        opened(tmp_path / "h")


def test_a_link_to_nothing_as_the_folder_is_named_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "h").symlink_to("nowhere")
    with pytest.raises(JournalUnusable, match=r"it is a symbolic link to what is not there.*move away"):
        opened(tmp_path / "h")


def test_a_disk_that_is_full_from_the_start_is_named_with_what_to_do(tmp_path: Path) -> None:
    journal = opened(tmp_path / "h")
    journal.begin()
    robot = Kept(journal)
    journal.close()
    disk = FullDisk()
    disk.room = False
    following = opened(tmp_path / "h", disk=disk)
    with pytest.raises(JournalUnusable, match=r"no space left on device.*make room on that disk"):
        following.begin()
    assert reopened(following) == {"it": encode_state(robot.core.state)}, "what is kept stays"


def test_the_next_host_says_that_nothing_was_kept(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    disk = FullDisk()
    journal = opened(tmp_path / "h", disk=disk)
    journal.begin()
    robot = Kept(journal)
    disk.room = False
    robot.call("k")
    journal.barrier()
    assert reopened(journal) == {}
    assert "the robots of the last host are not back: the disk was full" in caplog.text


def test_a_copy_of_the_folder_of_another_host_is_refused(tmp_path: Path) -> None:
    journal = opened(tmp_path / "h1")
    journal.begin()
    journal.close()
    shutil.copytree(tmp_path / "h1", tmp_path / "h2")
    with pytest.raises(CopiedJournal, match=r"h2 is a copy of what host h1 keeps.*start host h1"):
        opened(tmp_path / "h2")
    opened(tmp_path / "h1").close()


def test_another_version_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journals, "VERSION", 99)
    journal = opened(tmp_path / "h")
    journal.begin()
    journal.close()
    assert records.VERSION == 1
    with pytest.raises(OtherJournal, match="format 99"):
        opened(Path(journal.where))


def test_after_a_restart_of_the_machine_moments_are_as_far_away_as_before(journal: HostJournal) -> None:
    journal.close()
    clock = Clock()
    clock.unix_now, clock.now_now = 1060.0, 5.0  # a minute later, on a clock that began anew
    following = HostJournal(Path(journal.where), clock, boot="another")
    # a moment 30 s ahead then (40) is 30 s ago now (-25): 65 s less on this clock
    assert following.shift == pytest.approx((1000.0 - Clock.now_now) - (1060.0 - 5.0))
    following.close()


@pytest.mark.parametrize(("boot", "jump"), [("this", -3600.0), ("this", 3600.0), ("another", -3600.0)])
def test_a_clock_that_jumped_makes_nothing_happen_in_the_future(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, boot: str, jump: float, journal: HostJournal
) -> None:
    robot = Kept(journal)
    robot.call("k")
    began = Clock.now_now
    journal.close()
    clock = Clock()
    clock.unix_now, clock.now_now = Clock.unix_now + jump, began + 5.0
    following = HostJournal(tmp_path / "h", clock, boot=boot)
    if boot == "this":
        assert following.shift == 0.0
        assert not caplog.text
    else:
        assert following.shift == pytest.approx(5.0)  # the last moment that is known is now
        assert "the clock of this machine was set back since" in caplog.text
    following.close()


@pytest.mark.parametrize("method", ["lock", "create"])
def test_a_disk_that_is_read_only_is_named_with_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    opened(tmp_path / "h").close()

    def refuse(_: object, path: Path) -> int:
        raise OSError(30, "Read-only file system", str(path))

    monkeypatch.setattr(OSDisk, method, refuse)
    with pytest.raises(JournalUnusable, match=r"h.* cannot be used \(read-only file system\).*--forget"):
        opened(tmp_path / "h").begin()


def test_a_second_end_within_the_first_write_of_the_next_life_loses_nothing() -> None:
    medium, ends = Medium(), {"write": 0}

    class Ended(BaseException):
        pass

    def moment(name: str) -> None:
        ends["write"] -= name == "within write"
        if name == "within write" and ends["write"] == 0:
            raise Ended

    def life(writes: int) -> HostJournal:
        ends["write"] = writes
        return HostJournal(Path("/h"), Clock(), boot="this", disk=MemoryDisk(medium, moment=moment))

    journal = life(3)
    journal.begin()
    robot = Kept(journal)
    journal.barrier()
    waited = encode_state(robot.core.state)
    robot.call("k")
    with pytest.raises(Ended):
        journal.barrier()
    for _ in range(2):
        medium.locks.clear()
        with pytest.raises(Ended):
            life(1).begin()
    medium.locks.clear()
    assert [encode_state(kept.state) for kept in life(9).found.robots] == [waited]


def test_several_threads_write_and_nothing_is_lost(journal: HostJournal) -> None:
    robots = [Kept(journal, f"r{number}") for number in range(4)]

    def work(robot: Kept) -> None:
        for number in range(200):
            robot.call(f"k{number}")
            robot.take(on.Finish(key=f"k{number}", reply=Returned(key="k")))
            journal.barrier()

    threads = [threading.Thread(target=work, args=(robot,)) for robot in robots]
    began = time.monotonic()
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert time.monotonic() - began < 60
    assert reopened(journal) == {robot.core.name: encode_state(robot.core.state) for robot in robots}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("prepare", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
def test_what_lies_in_the_place_of_an_owner_is_an_error_at_once(
    tmp_path: Path, prepare: Callable[[Path], object]
) -> None:
    for strange in ("01.owner", "x.owner"):
        prepare(tmp_path / strange)
    assert FilePlace(tmp_path).look() is None
    prepare(tmp_path / "1.owner")
    with pytest.raises(OSError, match=r"it is a (FIFO|symbolic link), not a file"):
        FilePlace(tmp_path).look()


def test_a_log_that_can_neither_be_written_nor_removed_ends_its_host() -> None:
    disk, ends = MemoryDisk(), list[bool]()
    journal = HostJournal(Path("/h"), Clock(), boot="this", disk=disk)
    journal.end_process = lambda: ends.append(True)
    journal.begin()
    robot = Kept(journal)
    disk.medium.broken = True
    robot.call("k")
    journal.barrier()
    assert ends == [True]


# -- nothing leaves before its cause is written ----------------------------------------------------


class Wire:
    """A transport that notes what leaves by it."""

    presence: Any = None
    identity: Any = None

    def __init__(self, order: list[str]) -> None:
        self.order = order
        self.take: Any = None

    def __getattr__(self, name: str) -> Any:
        return lambda *_values, **_options: self.order.append(name)

    async def serve(self, _key: str, take: Any, **_: Any) -> Any:
        self.take = take

    async def announce(self, _key: str, **_: Any) -> Any:
        self.order.append("announce")

    async def close(self) -> None:
        self.order.append("close")


async def test_whatever_leaves_is_written_before() -> None:
    order: list[str] = []
    wire = Wire(order)
    outlet = Outlet(wire, lambda: order.append("written"))  # type: ignore[arg-type] # as far as it is used here
    outlet.ask("k", b"", on_reply=lambda _: None)
    outlet.request("k", b"", timeout=1.0)
    outlet.publish("k", b"")
    await outlet.announce("k")
    await outlet.serve("k", lambda incoming: (incoming.reply(b""), incoming.end(b""))[0])
    wire.take(
        Incoming(
            b"",
            Credentials(1, 1),
            lambda _: order.append("reply"),
            lambda _: order.append("end"),
            lambda _: None,
        )
    )
    await outlet.close()
    left = ("ask", "request", "publish", "announce", "reply", "end", "close")
    assert order == [word for each in left for word in ("written", each)]


def test_a_number_is_given_back_when_the_result_of_its_call_is_kept() -> None:
    order: list[str] = []
    frame: Any = SimpleNamespace(
        keeps=True,
        keep_step=lambda _path, _step: order.append("kept"),
        worker=SimpleNamespace(wake=lambda: None),
    )
    call = ChildCall(frame, "arm", "k/1", Address("robot", "arm", "1"), "go", None, passes_on=False)
    call._leave = (lambda: order.append("given back"),)
    call.settle(Returned(key="k/1"))
    assert order == ["kept", "given back"]
