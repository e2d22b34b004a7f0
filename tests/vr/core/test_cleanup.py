"""What a command may still do with its children when it has been asked to end, and what goes on after it."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from robotree.vr import (
    Child,
    CommandCancelled,
    CommandFailed,
    DeadlineExceeded,
    Failed,
    Robot,
    SlotEmpty,
    VirtualRobot,
    VrError,
    command,
)
from robotree.vr.base.errors import NotInControl


class Gripper(Robot):
    """Holds something."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.done: list[str] = []

    @command
    def carry(self, seconds: float = 20.0) -> None:
        self.sleep(seconds)
        self.done.append("carried")

    @command
    def open(self, seconds: float = 1.0) -> None:
        self.sleep(seconds)
        self.done.append("open")


class Porter(VirtualRobot):
    """Carries things, and puts them down whatever happens."""

    gripper = Child("Gripper")

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.saw: list[Any] = []

    @command
    def carry(self, opens: float = 1.0, *, fails: bool = False) -> None:
        try:
            if fails:
                self.sleep(1)
                raise Failed("it slips")
            self.gripper.carry()
        finally:
            self.put_down(opens)

    def put_down(self, opens: float) -> None:
        try:
            with self.cleanup(within=3):
                self.gripper.open(opens)
                self.progress(1.0, "put down")
            self.saw.append("clean")
        except VrError as error:
            self.saw.append(str(error))
            raise

    @command
    def goes_on(self) -> str:
        """A cancel that comes during the clean-up waits for its end."""
        with self.cleanup(within=3):
            self.gripper.open(2)
        self.saw.append("clean")
        self.sleep(1)
        return "too late"

    @command
    def starts(self) -> None:
        """What runs beside the command ends before the clean-up begins."""
        try:
            self.gripper.carry.start()
            self.sleep(60)
        finally:
            self.put_down(1)

    @command
    def swallows(self) -> None:
        try:
            self.gripper.carry()
        except CommandCancelled:
            with self.cleanup(within=1):
                while True:
                    self.sleep(0.2)

    @command
    def long(self, within: float) -> None:
        with self.cleanup(within=within):
            self.sleep(1)

    # -- what goes on ------------------------------------------------------------------------------

    @command
    def detaches(self, seconds: float = 10.0) -> None:
        self.gripper.carry.start(seconds).detach()

    @command
    def detaches_and_fails(self) -> None:
        self.gripper.carry.start(10).detach()
        raise Failed("enough")

    @command
    def detaches_one_of_two(self) -> Any:
        with self.together() as both:
            both.start(self.gripper.carry, 10).detach()
        return both.results

    @command
    def tells(self) -> None:
        self.gripper.carry.tell(10)

    @command
    def starts_and(self, then: str) -> None:
        self.gripper.carry.start(10)
        self.sleep(1)
        if then == "raises":
            raise Failed("enough")
        if then != "returns":
            self.sleep(60)


@pytest.fixture
async def porter(homes: Any) -> Any:
    return await homes.team(Porter("porter"), gripper=Gripper("gripper"))


def begin(
    realm: Any, porter: Any, command: str, deadline: float = 60.0, **arguments: Any
) -> asyncio.Task[Any]:
    return asyncio.create_task(realm.client(porter).call(command, arguments, deadline=deadline))


async def carrying(realm: Any, porter: Any) -> None:
    await realm.until(lambda: porter.gripper.description().busy == "carry")


# -- clean-up --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "options", "error", "sentence"),
    [
        ("carry", {}, CommandCancelled, "porter.carry was cancelled: enough"),
        ("carry", {"deadline": 2.0}, DeadlineExceeded, "porter.carry"),
        ("carry", {"fails": True}, Failed, "it slips"),
        ("starts", {}, CommandCancelled, "enough"),  # what runs beside it ends before its clean-up
    ],
)
async def test_a_clean_up_commands_the_child_and_has_its_own_time(
    realm: Any, porter: Any, command: str, options: dict[str, Any], error: type[VrError], sentence: str
) -> None:
    task = begin(realm, porter, command, **options)
    if not options:
        await carrying(realm, porter)
        await realm.client(porter).cancel(reason="enough")
    with pytest.raises(error, match=sentence):
        await task
    assert (porter.gripper.robot.done, porter.robot.saw) == (["open"], ["clean"])


async def test_a_clean_up_that_takes_too_long_is_ended(realm: Any, porter: Any) -> None:
    task = begin(realm, porter, "carry", opens=30)
    await carrying(realm, porter)
    await realm.client(porter).cancel(reason="enough")
    with pytest.raises(CommandCancelled):
        await task
    (said,) = porter.robot.saw
    assert said.startswith(
        "porter.carry failed: its clean-up was not done in the time that the author gave it"
    )
    assert said.endswith("before that: porter.carry was cancelled: enough")
    await realm.until(lambda: not porter.gripper.description().busy, within=1.0)
    assert porter.gripper.robot.done == []


async def test_after_a_protective_stop_nothing_moves_any_more(realm: Any, porter: Any) -> None:
    task = begin(realm, porter, "carry")
    await carrying(realm, porter)
    await realm.client(porter).safe_stop("a hand")
    with pytest.raises(CommandCancelled, match="a hand"):
        await task
    assert porter.gripper.robot.done == []
    assert porter.robot.saw == [
        "porter.carry was cancelled: a hand; after that no clean-up may move anything"
    ]


@pytest.mark.parametrize("order", ["safe_stop", "cancel"])
async def test_a_protective_stop_or_a_second_cancel_ends_a_clean_up_at_once(
    realm: Any, porter: Any, order: str
) -> None:
    task = begin(realm, porter, "carry", opens=2.5)
    await carrying(realm, porter)
    await realm.client(porter).cancel(reason="enough")
    await realm.until(lambda: porter.gripper.description().busy == "open")
    await getattr(realm.client(porter), order)(reason="I mean it")
    with pytest.raises(CommandCancelled, match="enough"):
        await asyncio.wait_for(task, 1.0)
    assert porter.robot.saw == ["porter.carry was cancelled: I mean it"]
    await realm.until(lambda: not porter.gripper.description().busy, within=1.0)
    assert porter.gripper.robot.done == []


async def test_a_caller_who_withdraws_twice_ends_no_clean_up(realm: Any, porter: Any) -> None:
    task = begin(realm, porter, "carry")
    await carrying(realm, porter)
    key = next(iter(porter.runtime.core.state.calls.live))
    for _ in range(2):
        await realm.client(porter).cancel(key, reason="the caller gave up")
    with pytest.raises(CommandCancelled):
        await task
    assert porter.robot.saw == ["clean"]


async def test_when_its_parent_is_lost_a_robot_cleans_nothing_up(realm: Any, porter: Any) -> None:
    class Chief(VirtualRobot):
        porter = Child("Porter")

        @command
        def carry(self) -> None:
            self.porter.carry()

    chief = await realm.start(Chief("chief"))
    await realm.client(chief).enslave("porter", porter.address)
    task = begin(realm, chief, "carry")
    await carrying(realm, porter)
    await realm.client(chief).free("porter")
    with pytest.raises(SlotEmpty):
        await task
    await realm.until(lambda: bool(porter.robot.saw), within=1.0)
    assert porter.robot.saw[0].endswith("after that no clean-up may move anything")
    assert porter.gripper.robot.done == []


async def test_a_cancel_during_a_clean_up_waits_for_its_end(realm: Any, porter: Any) -> None:
    task = begin(realm, porter, "goes_on")
    await realm.until(lambda: porter.gripper.description().busy == "open")
    await realm.client(porter).cancel(reason="enough")
    with pytest.raises(CommandCancelled):
        await task
    assert (porter.gripper.robot.done, porter.robot.saw) == (["open"], ["clean"])


async def test_a_clean_up_without_end_is_ended(realm: Any, porter: Any) -> None:
    task = begin(realm, porter, "swallows")
    await carrying(realm, porter)
    await realm.client(porter).cancel(reason="enough")
    with pytest.raises(CommandCancelled):
        await asyncio.wait_for(task, 2.0)
    assert not porter.description().abandoned


@pytest.mark.parametrize("within", [0.0, -1.0, 1000.0])
async def test_a_clean_up_has_a_limit(realm: Any, porter: Any, within: float) -> None:
    with pytest.raises(CommandFailed, match=r"a clean-up takes more than 0 and at most 60 s"):
        await begin(realm, porter, "long", within=within)


# -- what a command has started ends with it, unless it is detached -------------------------------


@pytest.mark.parametrize("how", ["returns", "raises", "cancel", "stop", "deadline"])
async def test_what_a_command_has_started_ends_with_it(realm: Any, porter: Any, how: str) -> None:
    client = realm.client(porter)
    task = begin(realm, porter, "starts_and", 3.0 if how == "deadline" else 60.0, then=how)
    await carrying(realm, porter)
    if how == "cancel":
        await client.cancel()
    elif how == "stop":
        await client.safe_stop("a hand")
    await asyncio.wait([task])
    assert (task.exception() is None) == (how == "returns")
    await realm.until(lambda: not porter.gripper.description().busy, within=0.5)
    assert porter.gripper.robot.done == []


@pytest.mark.parametrize("command", ["detaches", "tells", "detaches_and_fails", "detaches_one_of_two"])
async def test_what_is_detached_goes_on(realm: Any, porter: Any, command: str) -> None:
    task = begin(realm, porter, command)
    await asyncio.wait([task], timeout=1.0)
    assert task.done()
    assert porter.gripper.description().busy == "carry"
    await realm.until(lambda: porter.gripper.robot.done == ["carried"], within=11.0)


@pytest.mark.parametrize("command", ["detaches", "tells"])
async def test_an_operator_cancels_at_the_child_what_was_detached(
    realm: Any, porter: Any, command: str
) -> None:
    await begin(realm, porter, command)
    await realm.client(porter.gripper).cancel(reason="enough")
    await realm.until(lambda: not porter.gripper.description().busy, within=1.0)
    with pytest.raises(NotInControl):
        await realm.client(porter.gripper).cancel(reason="again")


async def test_an_operator_does_not_cancel_at_the_child_what_its_parent_waits_for(
    realm: Any, porter: Any
) -> None:
    task = begin(realm, porter, "carry")
    await carrying(realm, porter)
    with pytest.raises(NotInControl):
        await realm.client(porter.gripper).cancel(reason="mine")
    assert porter.gripper.description().busy == "carry"
    task.cancel()


@pytest.mark.parametrize("how", ["stop", "release"])
async def test_a_stop_and_the_end_of_the_bond_end_what_was_detached(
    realm: Any, porter: Any, how: str
) -> None:
    await begin(realm, porter, "detaches")
    if how == "stop":
        await realm.client(porter).safe_stop("a hand")
    else:
        await realm.client(porter).free("gripper")
    await realm.until(lambda: not porter.gripper.description().busy, within=1.0)
    assert porter.gripper.robot.done == []
