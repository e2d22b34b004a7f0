"""How far a command is, as its callers and everybody else see it."""

from __future__ import annotations

import math
from typing import Any

import pytest

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.running.process import Process


class Arm(Robot):
    """Says what it does."""

    @command
    def pick(self) -> None:
        for step in range(1, 4):
            self.progress(step / 3, f"{step} of 3")
            self.sleep(1)


class Picker(VirtualRobot):
    """Lets an arm work."""

    arm = Child("Arm")

    @command
    def silent(self) -> None:
        self.arm.pick()

    @command
    def talks(self) -> None:
        self.progress(0.5, "second box")
        self.arm.pick()
        self.progress(1.0, "done")

    @command
    def quick(self) -> None:
        for step in range(1, 7):
            self.progress(step / 6, f"{step} of 6")

    @command
    def floods(self) -> None:
        for step in range(1, 1001):
            self.progress(step / 1000, f"{step} of 1000")


@pytest.fixture(params=["a process each", "one process"])
async def picker(request: pytest.FixtureRequest, realm: Any) -> Any:
    if request.param == "one process":
        realm.shared = Process(realm.runner)
    picker, arm = await realm.start(Picker("picker")), await realm.start(Arm("arm-1"))
    await realm.client(picker).enslave("arm", arm.address)
    return picker


async def heard(realm: Any, picker: Any, command: str) -> list[tuple[float, str]]:
    """Return what a caller hears of a command's progress."""
    found: list[tuple[float, str]] = []
    await realm.client(picker).call(command, {}, on_progress=lambda share, text: found.append((share, text)))
    return found


async def test_what_a_child_says_is_shown_while_its_parent_waits(realm: Any, picker: Any) -> None:
    told = await heard(realm, picker, "silent")
    assert [text for _, text in told] == [f"arm-1: {step} of 3" for step in (1, 2, 3)]
    assert all(math.isnan(share) for share, _ in told), "how far the child is, is not how far its parent is"


async def test_it_stands_behind_what_the_parent_itself_says(realm: Any, picker: Any) -> None:
    assert await heard(realm, picker, "talks") == [
        (0.5, "second box"),
        *((0.5, f"second box; arm-1: {step} of 3") for step in (1, 2, 3)),
        (1.0, "done"),
    ]
    assert not picker.runtime.runs
    assert not picker.runtime.frames


async def test_each_of_six_quick_steps_is_told(realm: Any, picker: Any) -> None:
    assert [text for _, text in await heard(realm, picker, "quick")] == [f"{n} of 6" for n in range(1, 7)]


async def test_of_a_flood_of_progress_the_last_is_told(realm: Any, picker: Any) -> None:
    told = await heard(realm, picker, "floods")
    assert told[-1] == (1.0, "1000 of 1000")
    assert len(told) < 100
