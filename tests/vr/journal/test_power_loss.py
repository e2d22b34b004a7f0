"""A disk that loses what was not synchronised: what `sync` has returned for is there, in whatever state."""

from __future__ import annotations

import random
import threading
from pathlib import Path

import pytest

from robotree.vr.base.errors import DamagedJournal, JournalUnusable
from robotree.vr.core import events as on
from robotree.vr.core.machine import encode_state
from robotree.vr.journal import journal as journals
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.segments import OSDisk
from tests.vr.journal.test_host_journal import Kept, opened

INTENT = on.StepTaken(key="k", path="1~", step=on.StepResult("begun", None, "arm"))


class FleetingDisk(OSDisk):
    """Keeps for good what was synchronised: bytes of files, and names in folders."""

    def __init__(self, chance: random.Random) -> None:
        super().__init__()
        self._chance = chance
        self._paths: dict[int, Path] = {}
        self._lasting: dict[Path, int] = {}
        """[bytes] of each file that survive, by its path."""
        self._named: set[Path] = set()
        """Files whose names survive."""
        self._removed: dict[Path, bytes] = {}
        """Files that are gone, and come back if the power fails now."""
        self.syncs = 0
        self.slow: threading.Event | None = None
        """Until when a synchronisation takes; None: no time."""

    def create(self, path: Path) -> int:
        descriptor = super().create(path)
        self._paths[descriptor], self._lasting[path] = path, 0
        return descriptor

    def sync(self, descriptor: int) -> None:
        path = self._paths[descriptor]
        length = path.stat().st_size
        if self.slow is not None:
            self.slow.wait(10)
        super().sync(descriptor)
        self.syncs += 1
        self._lasting[path] = length

    def sync_folder(self, folder: Path) -> None:
        super().sync_folder(folder)
        self._named = set(folder.glob("*.log"))
        for path in self._removed:
            del self._lasting[path]
        self._removed.clear()

    def unlink(self, path: Path) -> None:
        self._removed[path] = path.read_bytes()[: self._lasting.get(path, 0)]
        super().unlink(path)

    def lose_power(self) -> None:
        """Leave what survives, and a part of the rest."""
        for path, length in self._lasting.items():
            if path in self._removed:
                path.write_bytes(self._removed[path])
            elif path not in self._named:
                path.unlink()
            else:
                whole = path.read_bytes()
                path.write_bytes(whole[: self._chance.randint(length, len(whole))])


def after_a_loss(journal: HostJournal, disk: FleetingDisk) -> dict[str, bytes]:
    """Have the power fail; return the states that the next host finds, by name."""
    journal._segments.close()
    disk.lose_power()
    following = opened(Path(journal.where), boot="the next")
    try:
        return {robot.name: encode_state(robot.state) for robot in following.found.robots}
    finally:
        following.close()


@pytest.mark.parametrize("seed", range(20))
def test_what_was_synchronised_survives_and_the_rest_is_lost_from_the_end(tmp_path: Path, seed: int) -> None:
    disk = FleetingDisk(random.Random(seed))
    journal = opened(tmp_path / "h", disk=disk)
    journal.begin()
    robot = Kept(journal)
    states = [encode_state(robot.core.state)]
    robot.call("k")
    robot.take(INTENT)
    states.append(encode_state(robot.core.state))
    journal.sync()
    for number in range(2, 9):
        robot.take(on.StepTaken(key="k", path=str(number), step=on.StepResult("look", None, number)))
        journal.barrier()  # it survives the process, and nothing else
        states.append(encode_state(robot.core.state))
    found = after_a_loss(journal, disk)["it"]
    assert states.index(found) >= 1


def test_without_it_an_intent_is_lost(tmp_path: Path) -> None:
    """The control: the disk of these tests loses what a barrier alone has written."""
    chance = random.Random(0)
    chance.randint = lambda least, _most: least  # type: ignore[method-assign]
    disk = FleetingDisk(chance)
    journal = opened(tmp_path / "h", disk=disk)
    journal.begin()
    robot = Kept(journal)
    robot.call("k")
    journal.sync()
    before = encode_state(robot.core.state)
    robot.take(INTENT)
    journal.barrier()
    assert after_a_loss(journal, disk) == {"it": before}


@pytest.mark.parametrize("seed", range(10))
def test_a_new_segment_is_safe_before_the_old_one_is_gone(
    tmp_path: Path, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journals, "LONG", 3000)
    disk = FleetingDisk(random.Random(seed))
    journal = opened(tmp_path / "h", disk=disk)
    journal.begin()
    robot = Kept(journal)
    for number in range(20 + seed):
        robot.call(f"k{number}")
        robot.take(on.Finish(key=f"k{number}", reply=on.Returned(key="k")))
        journal.barrier()
    journal.sync()
    assert after_a_loss(journal, disk) == {"it": encode_state(robot.core.state)}


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


def test_those_that_wait_together_wait_once_and_others_go_on_writing(tmp_path: Path) -> None:
    disk = FleetingDisk(random.Random(0))
    journal = opened(tmp_path / "h", disk=disk)
    journal.begin()
    robots = [Kept(journal, f"r{number}") for number in range(16)]
    before, disk.slow = disk.syncs, threading.Event()

    def work(robot: Kept) -> None:
        robot.call("k")
        robot.take(INTENT)
        journal.sync()

    threads = [threading.Thread(target=work, args=(robot,)) for robot in robots]
    threads[0].start()
    while not journal._held:
        pass
    for thread in threads[1:]:
        thread.start()
    other = Kept(journal, "other")
    other.call("k")
    journal.barrier()  # returns though the disk is busy
    while any(robot.core.state.calls.live.get("k") is None for robot in robots):
        pass
    disk.slow.set()
    for thread in threads:
        thread.join(20)
    assert disk.syncs - before <= 3, "the first alone, and those that came meanwhile"
    found = after_a_loss(journal, disk)
    assert all(found[robot.core.name] == encode_state(robot.core.state) for robot in robots)


def test_a_segment_that_is_full_stays_open_while_it_is_synchronised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journals, "LONG", 500)
    disk = FleetingDisk(random.Random(0))
    journal = opened(tmp_path / "h", disk=disk)
    journal.begin()
    robot = Kept(journal)
    robot.call("k")
    journal.barrier()
    disk.slow = threading.Event()
    thread = threading.Thread(target=journal.sync)
    robot.take(INTENT)
    thread.start()
    while not journal._held:
        pass
    newest = max(Path(journal.where).glob("*.log"))
    for number in range(40):
        robot.take(on.StepTaken(key="k", path=str(number + 2), step=on.StepResult("look", None, number)))
        journal.barrier()
    assert max(Path(journal.where).glob("*.log")) == newest
    disk.slow.set()
    thread.join(20)
    journal.barrier()
    robot.take(on.StepTaken(key="k", path="99", step=on.StepResult("look", None, 1)))
    journal.barrier()
    assert max(Path(journal.where).glob("*.log")) > newest
    assert not journal.suspended
    journal.sync()
    assert after_a_loss(journal, disk) == {"it": encode_state(robot.core.state)}


def test_a_disk_that_cannot_synchronise_keeps_nothing_and_says_so(tmp_path: Path) -> None:
    class Failing(FleetingDisk):
        fails = False

        def sync(self, descriptor: int) -> None:
            if self.fails:
                raise OSError(5, "Input/output error")
            super().sync(descriptor)

    disk = Failing(random.Random(0))
    journal = opened(tmp_path / "h", disk=disk)
    journal.begin()
    robot = Kept(journal)
    disk.fails = True
    robot.call("k")
    journal.sync()
    assert journal.suspended == "Input/output error"
    assert not list(Path(journal.where).glob("*.log"))
    journal.close()
