"""A paused robot stops before its next step, takes one when it is let, and goes on where it stood."""

from __future__ import annotations

import asyncio
import math
from typing import Annotated, Any

import pytest

from robotree.vr import Child, CommandCancelled, DeadlineExceeded, Robot, Unit, VirtualRobot, command
from robotree.vr.base.errors import NothingHeld, NotInControl, NotPaused, NotVirtual
from robotree.vr.core import events as on
from robotree.vr.core.stop import PauseState


class Arm(Robot):
    """Moves for a second."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.moves: list[float] = []

    @command
    def go_to(self, x: float) -> None:
        self.moves.append(x)
        self.sleep(1)

    @command
    def turn(self, y: float, twist: Annotated[float, Unit("rad")]) -> None:
        """Stay where it is."""


class Painter(VirtualRobot):
    """Draws with an arm."""

    arm = Child("Arm")

    @command
    def line(self) -> str:
        for x in (0.1, 0.2, 0.3):
            self.arm.go_to(x=x)
        return "drawn"

    @command
    def waits(self) -> None:
        self.sleep(5)
        self.arm.go_to(x=1 / 3)

    @command
    def turns(self) -> None:
        self.arm.turn(y=-3.4e-12, twist=math.pi / 4)

    @command
    def both(self) -> None:
        with self.together() as both:
            both.start(self.arm.go_to, x=1.0)
            both.start(self.dab, 2.0)

    @command
    def cleans(self) -> None:
        try:
            self.sleep(1)
            self.arm.go_to(x=1.0)
        finally:
            with self.cleanup(within=3):
                self.arm.go_to(x=-1.0)

    def dab(self, x: float) -> None:
        self.arm.go_to(x=x)
        self.arm.go_to(x=-x)


class Studio(VirtualRobot):
    """Has a painter below it."""

    painter = Child("Painter")

    @command
    def work(self) -> str:
        return str(self.painter.line())

    @command
    def twice(self) -> None:
        self.sleep(1)
        self.painter.line()


class Gallery(VirtualRobot):
    """Has a studio below it."""

    studio = Child("Studio")


def begin(
    realm: Any, agent: Any, name: str, deadline: float = 60.0, said: list[str] | None = None
) -> asyncio.Task[Any]:
    def note(_: float, text: str) -> None:
        if said is not None:
            said.append(text)

    return asyncio.create_task(realm.client(agent).call(name, {}, deadline=deadline, on_progress=note))


def held(agent: Any) -> str:
    return str(agent.description().held)


async def until_held(realm: Any, agent: Any, step: str) -> None:
    await realm.until(lambda: held(agent) == step)


async def until_paused(realm: Any, agent: Any, *, paused: bool = True) -> None:
    await realm.until(lambda: bool(agent.description().paused) == paused)


@pytest.fixture
async def painter(homes: Any) -> Any:
    return await homes.team(Painter("painter"), arm=Arm("arm"))


async def test_a_paused_robot_ends_its_present_step_and_stops_before_the_next(
    homes: Any, painter: Any
) -> None:
    said: list[str] = []
    task = begin(homes, painter, "line", said=said)
    await homes.until(lambda: painter.arm.robot.moves == [0.1])
    note = await homes.client(painter).pause()
    assert note.startswith("the deadline of line goes on: ")
    await until_held(homes, painter, "step 2: arm.go_to(x=0.2)")
    await asyncio.sleep(10)
    assert painter.arm.robot.moves == [0.1]
    assert any(text.endswith("before step 2: arm.go_to(x=0.2); its deadline goes on") for text in said)
    await homes.client(painter).go_on()
    assert await task == "drawn"
    assert painter.arm.robot.moves == [0.1, 0.2, 0.3]
    assert not (painter.description().paused)
    assert not (held(painter))


async def test_one_step_passes_at_a_time(homes: Any, painter: Any) -> None:
    client = homes.client(painter)
    await client.pause()
    task = begin(homes, painter, "line")
    for number, x in enumerate((0.1, 0.2, 0.3), 1):
        await until_held(homes, painter, f"step {number}: arm.go_to(x={x})")
        assert await client.step() == f"painter takes step {number}: arm.go_to(x={x})"
        await homes.until(lambda x=x: painter.arm.robot.moves[-1:] == [x])
        with pytest.raises(NothingHeld, match="the present step of line goes on"):
            await client.step()
    assert await task == "drawn"
    with pytest.raises(NothingHeld, match="it carries nothing out"):
        await client.step()


@pytest.mark.parametrize("how", ["cancel", "stop", "deadline"])
async def test_a_paused_command_is_ended_at_once_and_the_pause_stays(
    homes: Any, painter: Any, how: str
) -> None:
    client, loop = homes.client(painter), asyncio.get_running_loop()
    await client.pause()
    task = begin(homes, painter, "line", deadline=2.0 if how == "deadline" else 60.0)
    await until_held(homes, painter, "step 1: arm.go_to(x=0.1)")
    began = loop.time()
    if how == "cancel":
        await client.cancel(reason="enough")
    elif how == "stop":
        await client.safe_stop("a hand")
    reason = {"cancel": "enough", "stop": "a hand", "deadline": "within its deadline"}[how]
    with pytest.raises(DeadlineExceeded if how == "deadline" else CommandCancelled, match=reason):
        await task
    assert loop.time() - began < (2.1 if how == "deadline" else 0.1)
    await client.resume()
    assert painter.description().paused
    assert painter.arm.robot.moves == []


async def test_a_clean_up_does_not_wait(homes: Any, painter: Any) -> None:
    task = begin(homes, painter, "cleans")
    await homes.until(lambda: painter.description().busy == "cleans")
    await homes.client(painter).pause()
    await until_held(homes, painter, "step 2: arm.go_to(x=1.0)")
    await homes.client(painter).cancel(reason="enough")
    with pytest.raises(CommandCancelled):
        await task
    assert painter.arm.robot.moves == [-1.0]


async def test_parts_of_a_command_pause_each(homes: Any, painter: Any) -> None:
    client = homes.client(painter)
    await client.pause()
    task = begin(homes, painter, "both")
    await until_held(homes, painter, "step 1: arm.go_to(x=1.0)")
    await client.step()
    await until_held(homes, painter, "step 2/1: arm.go_to(x=2.0)")
    await homes.until(lambda: painter.arm.robot.moves == [1.0])
    await client.step()
    await until_held(homes, painter, "step 2/2: arm.go_to(x=-2.0)")
    assert painter.arm.robot.moves == [1.0, 2.0]
    await client.step()
    await task
    assert painter.arm.robot.moves == [1.0, 2.0, -2.0]


async def test_a_sleep_is_a_step(homes: Any, painter: Any) -> None:
    await homes.client(painter).pause()
    task = begin(homes, painter, "waits")
    await homes.until(lambda: held(painter).startswith("step 1: sleep"))
    await homes.client(painter).step()
    await until_held(homes, painter, "step 2: arm.go_to(x=0.3333)")
    await homes.client(painter).go_on()
    await task


async def test_the_step_before_which_it_waits_has_angles_in_degrees_and_no_noise(
    homes: Any, painter: Any
) -> None:
    await homes.client(painter).pause()
    task = begin(homes, painter, "turns")
    await until_held(homes, painter, "step 1: arm.turn(y=0.0, twist=45deg)")
    await homes.client(painter).go_on()
    await task


# -- trees -----------------------------------------------------------------------------------------


@pytest.fixture
async def studio(homes: Any, painter: Any) -> Any:
    agent = await homes.start(Studio("studio"))
    await homes.client(agent).enslave("painter", painter.address)
    agent.painter = painter
    return agent


async def test_the_command_of_a_virtual_child_pauses_too_and_takes_the_steps(homes: Any, studio: Any) -> None:
    painter, client = studio.painter, homes.client(studio)
    task = begin(homes, studio, "work")
    await homes.until(lambda: painter.arm.robot.moves == [0.1])
    await client.pause()
    await until_held(homes, painter, "step 2: arm.go_to(x=0.2)")
    assert held(studio) == ""
    assert await client.step() == "painter takes step 2: arm.go_to(x=0.2)"
    await until_held(homes, painter, "step 3: arm.go_to(x=0.3)")
    await client.go_on()
    assert await task == "drawn"


async def test_a_step_into_the_command_of_a_child_stops_before_its_first_step(
    homes: Any, studio: Any
) -> None:
    client = homes.client(studio)
    await client.pause()
    task = begin(homes, studio, "work")
    await until_held(homes, studio, "step 1: painter.line()")
    await client.step()
    await until_held(homes, studio.painter, "step 1: arm.go_to(x=0.1)")
    assert studio.painter.arm.robot.moves == []
    await client.go_on()
    await task


async def test_only_who_may_command_a_robot_pauses_it(homes: Any, studio: Any) -> None:
    painter = homes.client(studio.painter)
    for order in (painter.pause, painter.step, painter.go_on):
        with pytest.raises(NotInControl):
            await order()
    await homes.client(studio).pause()
    await until_paused(homes, studio.painter)
    for order in (painter.pause, painter.step, painter.go_on):
        with pytest.raises(NotInControl):
            await order()
    assert studio.painter.description().paused


async def test_the_pause_of_a_parent_ends_with_its_bond_also_further_down(homes: Any, studio: Any) -> None:
    gallery = await homes.start(Gallery("gallery"))
    await homes.client(gallery).enslave("studio", studio.address)
    await homes.client(gallery).pause()
    await until_paused(homes, studio.painter)
    await homes.client(gallery).free("studio")
    await until_paused(homes, studio.painter, paused=False)
    assert not studio.description().paused
    await begin(homes, studio, "work")


async def test_a_child_that_comes_to_a_paused_parent_is_paused(homes: Any, painter: Any) -> None:
    studio = await homes.start(Studio("studio"))
    await homes.client(studio).pause()
    await homes.client(studio).enslave("painter", painter.address)
    await until_paused(homes, painter)


def test_the_pause_of_a_child_from_before_its_bond_ends_with_a_continue_of_its_parent() -> None:
    pause = PauseState()
    pause.begin("Ann")
    assert not pause.hear("", 3), "its parent is not paused, and was not since they are bound"
    assert pause.in_force == "Ann"
    assert pause.hear("", 4)
    assert not pause.in_force


async def test_a_child_that_did_not_hear_of_a_pause_hears_of_it_by_the_next_renewal(
    realm: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    painter = await realm.team(Painter("painter"), arm=Arm("arm"))
    studio = await realm.start(Studio("studio"))
    await realm.client(studio).enslave("painter", painter.address)
    lost: list[Any] = []
    with monkeypatch.context() as patch:
        patch.setattr(studio.runtime, "ask", lambda *request, **_: lost.append(request))
        await realm.client(studio).pause()
    assert lost
    assert not painter.description().paused
    await until_paused(realm, painter)


async def test_a_renewal_that_comes_late_ends_no_pause(homes: Any, studio: Any) -> None:
    painter = studio.painter
    lease, before = painter.runtime.lease, studio.runtime.look(lambda state: state.pause.changes)
    await homes.client(studio).pause()
    await until_paused(homes, painter)
    late = on.Prolong(parent=lease.parent, epoch=lease.epoch, lineage=lease.lineage, pauses=before)
    painter.runtime.post(late)
    assert painter.description().paused


async def test_what_is_no_page_cannot_be_paused_and_what_is_not_paused_takes_no_single_step(
    homes: Any, painter: Any
) -> None:
    with pytest.raises(NotVirtual, match="pause its parent"):
        await homes.client(painter.arm).pause()
    with pytest.raises(NotPaused):
        await homes.client(painter).step()
    await homes.client(painter).go_on()


async def test_the_log_says_who_paused_it(homes: Any, painter: Any) -> None:
    client = homes.client(painter)
    await client.pause()
    begin(homes, painter, "line").add_done_callback(lambda done: done.exception())
    await until_held(homes, painter, "step 1: arm.go_to(x=0.1)")
    await client.step()
    await client.go_on()
    lines = [line.text for line in painter.runtime.log.since(0)]
    for begin_of in ("paused by ", "takes step 1: arm.go_to(x=0.1), ordered by ", "goes on, ordered by "):
        assert any(text.startswith(begin_of) for text in lines), lines


async def test_no_wake_up_is_lost_when_a_pause_ends_at_the_moment_of_a_step(homes: Any, painter: Any) -> None:
    """Whatever the order: a command of which no pause is in force goes on."""
    for delay in (0.0, 0.001, 0.5, 0.999, 1.0, 1.001, 1.002):
        task = begin(homes, painter, "line")
        await asyncio.sleep(delay)
        painter.runtime.post(on.PauseAsked(by="a test"))
        painter.runtime.post(on.ContinueAsked())
        assert await asyncio.wait_for(task, 10) == "drawn"
