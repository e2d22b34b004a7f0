"""The record of running processes is complete, whatever happens to the realm's folder while it is read."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from robotree import files
from robotree.vr.base.os_files import OSFiles
from robotree.vr.network import rendezvous
from robotree.vr.network.link import Channel
from robotree.vr.network.mesh import Mesh
from robotree.vr.network.rendezvous import Rendezvous

KEY = "robot/arm-1/1"

Change = Callable[["Frozen"], None]


class Frozen:
    """A process that holds a robot and answers nobody; its socket accepts what the kernel accepts."""

    def __init__(self, root: Path) -> None:
        self.place = Rendezvous("test", root)
        self.doors = [self.place.register()]
        self.place.hold(KEY)

    def lose_its_folder(self) -> None:
        shutil.rmtree(self.place.directory, ignore_errors=True)

    def lose_its_list(self) -> None:
        (self.place.directory / f"{self.place.tag}.held").unlink(missing_ok=True)

    def lose_its_name(self) -> None:
        (self.place.directory / f"{self.place.tag}.sock").unlink(missing_ok=True)

    def come_again(self) -> None:
        self.doors.append(self.place.register())
        self.doors.pop(0).close()

    def close(self) -> None:
        for door in self.doors:
            door.close()


@pytest.fixture
def frozen(tmp_path: Path) -> Iterator[Frozen]:
    process = Frozen(tmp_path / "r")
    yield process
    process.close()


class Steps:
    """Counts the steps in which the record is read, and changes something before one of them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.done, self.at, self.change = 0, -1, lambda: None
        for owner, name in (
            (rendezvous, "listening"),
            (os, "scandir"),
            (files, "read"),
            (OSFiles, "lives"),
        ):
            monkeypatch.setattr(owner, name, self._counted(getattr(owner, name)))

    def _counted(self, step: Callable[..., object]) -> Callable[..., object]:
        def counted(*args: object, **options: object) -> object:
            self.done += 1
            if self.done == self.at:
                self.at = -1  # the change is made once
                self.change()
            return step(*args, **options)

        return counted


def lose_and_come(frozen: Frozen) -> None:
    frozen.lose_its_folder()
    frozen.come_again()


@pytest.mark.parametrize("met_before", [False, True])
@pytest.mark.parametrize(
    ("before", "change"),
    [
        (None, Frozen.lose_its_folder),
        (None, Frozen.lose_its_list),
        (None, Frozen.lose_its_name),
        (None, lose_and_come),
        (Frozen.lose_its_folder, Frozen.come_again),
        (Frozen.lose_its_list, Frozen.lose_its_name),
        (Frozen.lose_its_name, Frozen.come_again),
    ],
)
def test_a_change_of_the_folder_at_any_step_hides_no_process(
    *,
    before: Change | None,
    change: Change,
    met_before: bool,
    frozen: Frozen,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    newcomer = Mesh(Rendezvous("test", frozen.place.directory.parent))
    if met_before:
        newcomer._dial_all()  # it does not answer the greeting
        assert frozen.place.tag in newcomer._peers
    steps = Steps(monkeypatch)
    newcomer.held("robot/*/*")
    most = steps.done
    assert most > 2
    for step in range(1, most + 2):
        frozen.come_again()
        if before is not None:
            before(frozen)
        steps.done, steps.at, steps.change = 0, step, lambda: change(frozen)
        found = newcomer.held("robot/*/*")
        assert [one for one in found if one.key in {KEY, ""}], f"missed at step {step} of {most}"
    newcomer.close()


@pytest.mark.parametrize("channel", list(Channel))
def test_a_stop_is_left_for_a_process_of_which_one_channel_is_known(frozen: Frozen, channel: Channel) -> None:
    """A newcomer may have said hello on either channel first; only what is urgent comes in order."""
    newcomer = Mesh(Rendezvous("test", frozen.place.directory.parent))
    newcomer._dial_all()
    links = newcomer._peers[frozen.place.tag].links
    links.pop(channel).close()
    replies: list[bytes | None] = []
    newcomer.ask(KEY, b"halt", void_at=math.inf, urgent=True, on_reply=replies.append)
    assert replies == [None], "nobody waits for it"
    heard = b""
    for _ in Channel:
        with frozen.doors[0].accept()[0] as line:
            heard += line.recv(65536)
    assert (b"halt" in heard) == (channel is not Channel.URGENT)
    newcomer.close()
