"""A disk that loses what was not synchronised: what `sync` has returned for is there, in whatever state."""

from __future__ import annotations

import random
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from robotree.vr.base.errors import DamagedJournal, JournalUnusable
from robotree.vr.core import events as on
from robotree.vr.core.machine import encode_state
from robotree.vr.journal import journal as journals
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.segments import OSDisk
from robotree.vr.world.disk import MemoryDisk
from tests.vr.journal.test_host_journal import Clock, Kept, opened
from tests.waiting import wait_until

INTENT = on.StepTaken(key="k", path="1~", step=on.StepResult("begun", None, "arm"))


class Disk(MemoryDisk):
    """A disk in memory that counts synchronisations."""

    syncs = 0
    slow: threading.Event | None = None
    """Until when a synchronisation takes; None: no time."""
    fails = False

    def sync(self, descriptor: int) -> None:
        if self.fails:
            raise OSError(5, "Input/output error")
        length = len(self._content(descriptor).data)
        if self.slow is not None:
            self.slow.wait(10)
        super().sync(descriptor)
        self._content(descriptor).synced = length
        self.syncs += 1


def begun(disk: Disk) -> HostJournal:
    journal = HostJournal(Path("/h"), Clock(), boot="this", disk=disk)
    journal.begin()
    return journal


def after_a_loss(disk: Disk, chance: Any) -> dict[str, bytes]:
    """Have the power fail; return the states that the next host finds, by name."""
    disk.end()
    disk.medium.lose_power(chance)
    following = HostJournal(Path("/h"), Clock(), boot="the next", disk=MemoryDisk(disk.medium))
    return {robot.name: encode_state(robot.state) for robot in following.found.robots}


@pytest.mark.parametrize("seed", range(30))
def test_what_was_synchronised_survives_and_the_rest_is_lost_from_the_end(seed: int) -> None:
    disk = Disk()
    journal = begun(disk)
    robot = Kept(journal)
    states = [encode_state(robot.core.state)]
    robot.call("k")
    robot.take(INTENT)
    states.append(encode_state(robot.core.state))
    journal.sync()
    for number in range(2, 60):
        robot.take(on.StepTaken(key="k", path=str(number), step=on.StepResult("look", None, number)))
        journal.barrier()  # it survives the process, and nothing else
        states.append(encode_state(robot.core.state))
    found = after_a_loss(disk, random.Random(seed))["it"]
    assert states.index(found) >= 1


def test_without_it_an_intent_is_lost() -> None:
    """The control: the disk of these tests loses what a barrier alone has written."""
    disk = Disk()
    journal = begun(disk)
    robot = Kept(journal)
    robot.call("k")
    journal.sync()
    before = encode_state(robot.core.state)
    robot.take(INTENT)
    journal.barrier()
    worst = SimpleNamespace(randint=min, random=lambda: 1.0, choice=max)
    assert after_a_loss(disk, worst) == {"it": before}


@pytest.mark.parametrize("seed", range(10))
def test_a_new_segment_is_safe_before_the_old_one_is_gone(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(journals, "LONG", 3000)
    disk = Disk()
    journal = begun(disk)
    robot = Kept(journal)
    for number in range(20 + seed):
        robot.call(f"k{number}")
        robot.take(on.Finish(key=f"k{number}", reply=on.Returned(key="k")))
        journal.barrier()
    journal.sync()
    assert after_a_loss(disk, random.Random(seed)) == {"it": encode_state(robot.core.state)}


class EndsInIts(OSDisk):
    """A disk on which the process ends before it removes its first file."""

    def unlink(self, path: Path) -> None:
        raise OSError(5, "the process has ended", str(path))


def two_files(folder: Path, boots: tuple[str, str]) -> dict[str, bytes]:
    """Leave an older file whose end the power has torn, and a newer one that is whole; returns its states."""
    older = opened(folder, boot=boots[0])
    older.begin()
    Kept(older).call("k")
    older.close()
    (torn,) = folder.glob("*.log")
    found = opened(folder, boot=boots[1], disk=EndsInIts())
    (robot,) = found.found.robots
    found.made(robot.key, robot.name, robot.page, lambda enter: enter(robot.state))
    with pytest.raises(JournalUnusable):
        found.begin()
    found.close()
    data = torn.read_bytes()
    torn.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    return {robot.name: encode_state(robot.state)}


def test_a_torn_log_is_read_again_when_the_host_that_followed_has_ended_before_it_was_removed(
    tmp_path: Path,
) -> None:
    states = two_files(tmp_path / "h", boots=("before the loss", "after it"))
    following = opened(tmp_path / "h", boot="after it")
    assert {robot.name: encode_state(robot.state) for robot in following.found.robots} == states
    following.close()


def test_an_older_file_is_refused_that_no_loss_of_power_can_have_torn(tmp_path: Path) -> None:
    two_files(tmp_path / "h", boots=("this", "this"))
    with pytest.raises(DamagedJournal, match=r"00000001\.log"):
        opened(tmp_path / "h", boot="this")


def test_those_that_wait_together_wait_once_and_others_go_on_writing() -> None:
    disk = Disk()
    journal = begun(disk)
    robots = [Kept(journal, f"r{number}") for number in range(16)]
    before, disk.slow = disk.syncs, threading.Event()

    def work(robot: Kept) -> None:
        robot.call("k")
        robot.take(INTENT)
        journal.sync()

    threads = [threading.Thread(target=work, args=(robot,)) for robot in robots]
    threads[0].start()
    wait_until(lambda: journal._held)
    for thread in threads[1:]:
        thread.start()
    other = Kept(journal, "other")
    other.call("k")
    journal.barrier()  # returns though the disk is busy
    wait_until(lambda: all("k" in robot.core.state.calls.live for robot in robots))
    disk.slow.set()
    for thread in threads:
        thread.join(20)
    assert disk.syncs - before <= 3, "the first alone, and those that came meanwhile"
    found = after_a_loss(disk, random.Random(0))
    assert all(found[robot.core.name] == encode_state(robot.core.state) for robot in robots)


def test_a_segment_that_is_full_stays_open_while_it_is_synchronised(monkeypatch: pytest.MonkeyPatch) -> None:
    disk = Disk()
    journal = begun(disk)
    robot = Kept(journal)
    robot.call("k")
    robot.take(INTENT)
    journal.barrier()
    monkeypatch.setattr(journals, "LONG", journal.size + 200)
    disk.slow = threading.Event()
    thread = threading.Thread(target=journal.sync)
    thread.start()
    wait_until(lambda: journal._held)
    newest = max(disk.names(Path("/h")))
    for number in range(40):
        robot.take(on.StepTaken(key="k", path=str(number + 2), step=on.StepResult("look", None, number)))
        journal.barrier()
    assert max(disk.names(Path("/h"))) == newest
    disk.slow.set()
    thread.join(20)
    journal.barrier()
    robot.take(on.StepTaken(key="k", path="99", step=on.StepResult("look", None, 1)))
    journal.barrier()
    assert max(disk.names(Path("/h"))) > newest
    assert not journal.suspended
    journal.sync()
    assert after_a_loss(disk, random.Random(0)) == {"it": encode_state(robot.core.state)}


def test_a_disk_that_cannot_synchronise_keeps_nothing_and_says_so() -> None:
    disk = Disk()
    journal = begun(disk)
    robot = Kept(journal)
    disk.fails = True
    robot.call("k")
    journal.sync()
    assert journal.suspended == "Input/output error"
    assert disk.names(Path("/h")) == []
