"""Parents and children: chapter 3 of the thesis, and what it left out."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Iterator
from typing import Annotated, Any, ClassVar

import pytest

from robotree.vr import Child, Robot, Unit, VirtualRobot, VrError, command
from robotree.vr.agents.children import REUNION
from robotree.vr.base.address import Address
from robotree.vr.base.envelope import opened
from robotree.vr.base.errors import (
    CommandCancelled,
    CycleOfBonds,
    LeaseDenied,
    NoAnswer,
    NoSuchSlot,
    NotInControl,
    SlotEmpty,
    SlotOccupied,
    StaleEpoch,
    StillBonded,
    Unreachable,
    WrongKind,
)
from robotree.vr.base.requests import Petition
from robotree.vr.exchange.client import RobotClient
from robotree.vr.running.frame import LONGEST_END
from robotree.vr.world.network import MemoryTransport
from tests.vr.core.conftest import member

TERM = 5.0


class Rover(Robot):
    """A rover."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.x = 0.0

    @command
    def move(self, x: Annotated[float, Unit("m")]) -> float:
        self.sleep(abs(x))
        self.x += x
        return self.x


class Pair(VirtualRobot):
    """Two rovers as one."""

    left = Child("Rover")
    right = Child("Rover")

    @command
    def move(self, x: float) -> None:
        self.left.move(x=x)
        self.right.move(x=x)

    @command
    def spin(self) -> None:
        while True:
            pass

    test_is_over: ClassVar[threading.Event]

    @command
    def hang(self) -> None:
        self.test_is_over.wait()


@pytest.fixture(autouse=True)
def hanging() -> Iterator[None]:
    """What hangs in a test ends with it."""
    Pair.test_is_over = threading.Event()
    yield
    Pair.test_is_over.set()


class Box(VirtualRobot):
    """Takes anything, also another box."""

    inner = Child("Robot")

    @command
    def touch(self) -> str:
        return str(self.inner)


async def bound(realm: Any, **options: Any) -> tuple[Any, Any]:
    rover, pair = await realm.start(Rover("rover"), **options), await realm.start(Pair("pair"), **options)
    await realm.until(lambda: realm.listed() == ["pair", "rover"])
    await realm.client(pair).enslave("left", rover.address)
    return rover, pair


# -- enslaving and releasing -----------------------------------------------------------------------


async def test_an_enslaved_robot_leaves_the_lookup_and_comes_back_when_released(realm: Any) -> None:
    rover, pair = await bound(realm)
    assert await realm.until(lambda: realm.listed() == ["pair"]) < 1.0
    description = await realm.client(rover).describe()
    assert description.bond is not None
    assert (description.bond.parent, description.bond.slot) == (pair.address, "left")
    assert 0 < description.bond.remaining <= TERM
    after = await realm.client(pair).free("left")
    assert after.slot("left").child is None
    assert after.slot("left").lost == ""
    assert await realm.until(lambda: realm.listed() == ["pair", "rover"]) < 1.0


async def test_only_the_parent_commands_but_anybody_may_ask_and_stop(realm: Any) -> None:
    rover, _ = await bound(realm)
    client = realm.client(rover)
    for question in (client.call("move", {"x": 1}), client.cancel(), client.resume(), client.decide("done")):
        with pytest.raises(NotInControl, match=r"rover is commanded by pair; .*`robotree release pair.left`"):
            await question
    with pytest.raises(StaleEpoch):
        await client.call("move", {"x": 1}, epoch=7)
    assert (await client.describe()).name == "rover"
    await client.safe_stop("look out")


async def test_the_commands_of_a_bond_end_with_it(realm: Any) -> None:
    rover, pair = await bound(realm)
    moving = asyncio.create_task(realm.client(pair).call("move", {"x": 30}))
    await realm.until(lambda: rover.description().busy == "move")
    await realm.client(pair).free("left")
    with pytest.raises(SlotEmpty):
        await moving
    assert rover.description().busy == ""
    assert rover.robot.x == 0


async def test_the_commands_of_an_operator_end_when_a_parent_takes_over(realm: Any) -> None:
    rover, pair = await realm.start(Rover("rover")), await realm.start(Pair("pair"))
    moving = asyncio.create_task(realm.client(rover).call("move", {"x": 30}))
    await realm.until(lambda: rover.description().busy == "move")
    await realm.client(pair).enslave("left", rover.address)
    with pytest.raises(CommandCancelled, match="pair has enslaved rover"):
        await moving


@pytest.mark.parametrize(
    ("slot", "child", "error", "sentence"),
    [
        ("middle", "rover", NoSuchSlot, "pair has no child slot 'middle'; it has: left, right"),
        ("left", "other", SlotOccupied, "pair.left already holds rover; release it first"),
        ("right", "rover", LeaseDenied, "rover is already enslaved by pair; release it there first: `robo"),
        ("right", "box", WrongKind, "pair.right takes a robot of kind Rover; box is of kind Box"),
        ("right", "pair", CycleOfBonds, "pair cannot enslave pair"),
        ("right", "dead", Unreachable, "nobody answers at robot/dead/1"),
    ],
)  # fmt: skip
async def test_a_bond_that_cannot_be_is_refused_in_one_sentence(
    realm: Any, slot: str, child: str, error: type[VrError], sentence: str
) -> None:
    rover, pair = await bound(realm)
    others = [await realm.start(Rover("other")), await realm.start(Box("box"))]
    addresses = {agent.robot.name: agent.address for agent in (rover, pair, *others)}
    with pytest.raises(error) as refused:
        await realm.client(pair).enslave(slot, addresses.get(child, Address("robot", "dead", "1")))
    assert str(refused.value).startswith(sentence)
    await realm.client(pair).enslave("right", addresses["other"])  # nothing is lost


@pytest.mark.parametrize("count", [2, 3])
async def test_a_ring_of_robots_that_closes_at_once_opens_again(realm: Any, count: int) -> None:
    boxes = [await realm.start(Box(f"box-{number}")) for number in range(count)]
    ring = zip(boxes, [*boxes[1:], boxes[0]], strict=True)
    questions = [realm.client(parent).enslave("inner", child.address) for parent, child in ring]
    answers = await asyncio.gather(*questions, return_exceptions=True)
    assert count > 2 or any(isinstance(answer, CycleOfBonds) for answer in answers), "of two one sees it"
    await realm.until(lambda: realm.listed() != [], within=2 * TERM)
    await asyncio.sleep(TERM)
    assert None in [box.description().bond for box in boxes]


# -- loss ------------------------------------------------------------------------------------------


async def test_a_killed_parent_loses_its_child_within_a_second(realm: Any) -> None:
    rover, pair = await bound(realm)
    await realm.until(lambda: realm.listed() == ["pair"])
    realm.kill(pair)
    assert await realm.until(lambda: realm.listed() == ["rover"]) < 1.0
    await realm.client(rover).call("move", {"x": 1})


@pytest.mark.parametrize(
    ("ends", "reason"), [("kill", "pair has ended"), ("pause", "pair hangs: its process")]
)
async def test_a_parent_that_hangs_is_not_said_to_have_ended(
    realm: Any, caplog: pytest.LogCaptureFixture, ends: str, reason: str
) -> None:
    caplog.set_level("INFO")
    rover, pair = await bound(realm, term=1000.0)
    realm.kill(pair) if ends == "kill" else realm.network.pause(pair.transport)
    await realm.until(lambda: rover.description().bond is None)
    assert f"rover is free again: {reason}" in caplog.text


async def test_a_silent_parent_loses_its_child_within_the_term(realm: Any) -> None:
    """Its process is stopped: it is still seen by those who look, but it does not renew."""
    realm.network.lease = 1000.0
    rover, pair = await bound(realm)
    realm.network.freeze(pair.transport)
    assert await realm.until(lambda: rover.description().bond is None) <= TERM
    await realm.until(lambda: "rover" in realm.listed(), within=0.1)
    epoch = rover.runtime.core.state.lease.epoch
    realm.network.thaw(pair.transport)
    await realm.until(lambda: rover.description().bond is not None, within=TERM)
    await realm.until(lambda: pair.description().slot("left").child == rover.address, within=1.0)
    assert pair.description().slot("left").lost == "", "it has its child again, under a new lease"
    assert rover.runtime.core.state.lease.epoch > epoch


async def test_an_operator_can_fill_the_slot_while_its_lost_child_is_asked_to_return(realm: Any) -> None:
    realm.network.lease = 1000.0
    rover, pair = await bound(realm)
    spare = await realm.start(Rover("spare"))
    realm.network.freeze(pair.transport)
    await realm.until(lambda: rover.description().bond is None)
    realm.network.freeze(rover.transport)  # it will not answer
    realm.network.thaw(pair.transport)
    slot = pair.runtime.core.state.slots["left"]
    await realm.until(lambda: slot.asked == rover.address, within=TERM)
    await realm.client(pair).enslave("left", spare.address)
    realm.network.thaw(rover.transport)
    with pytest.raises(TimeoutError):
        await realm.until(lambda: rover.description().bond is not None, within=TERM)
    assert pair.description().slot("left").child == spare.address


async def test_a_child_that_was_used_meanwhile_does_not_return(realm: Any) -> None:
    realm.network.lease = 1000.0
    rover, pair = await bound(realm)
    realm.network.freeze(pair.transport)
    await realm.until(lambda: rover.description().bond is None)
    await realm.client(rover).call("move", {"x": 1})
    realm.network.thaw(pair.transport)
    await realm.until(lambda: pair.description().slot("left").lost != "", within=TERM)
    with pytest.raises(TimeoutError):
        await realm.until(lambda: rover.description().bond is not None, within=TERM)
    assert "did not answer for 5 s" in pair.description().slot("left").lost
    rebound = await realm.client(pair).enslave("left", rover.address)
    assert rebound.slot("left").lost == "", "whoever asks for it gets it"


async def test_a_running_command_through_a_lost_bond_fails_at_once(realm: Any) -> None:
    rover, pair = await bound(realm)
    moving = asyncio.create_task(realm.client(pair).call("move", {"x": 50}))
    await realm.until(lambda: rover.description().busy == "move")
    began = realm.runner.now()
    realm.kill(rover)
    with pytest.raises(VrError):
        await moving
    assert realm.runner.now() - began < 0.5


async def test_a_robot_made_again_under_the_old_name_is_not_commanded_by_mistake(realm: Any) -> None:
    rover, pair = await bound(realm)
    realm.kill(rover)
    again = await realm.start(Rover("rover"))
    with pytest.raises(SlotEmpty):
        await realm.client(pair).call("move", {"x": 1})
    assert again.description().bond is None
    assert again.robot.x == 0


@pytest.mark.real_threads
async def test_a_parent_whose_command_never_returns_keeps_its_children(realm: Any) -> None:
    rover, pair = await bound(realm, term=1.0)
    epoch = rover.description().epoch
    stuck = asyncio.create_task(realm.client(pair).call("spin", {}, deadline=2.5))
    await asyncio.sleep(2.0)
    assert not stuck.done()
    assert rover.description().epoch == epoch
    assert rover.description().bond is not None
    with pytest.raises(VrError):
        await stuck
    assert rover.description().epoch == epoch


async def test_a_name_can_be_used_again_as_soon_as_its_robot_is_deleted(realm: Any) -> None:
    box = await realm.start(Box("box"))
    await realm.client(box).delete()
    again = await realm.start(Box("box"))
    assert (await realm.client(again).describe()).address == again.address != box.address


# -- ends ------------------------------------------------------------------------------------------


async def test_an_enslaved_robot_cannot_be_deleted(realm: Any) -> None:
    top, box = await realm.start(Box("top")), await realm.start(Box("box"))
    await realm.client(top).enslave("inner", box.address)
    with pytest.raises(StillBonded, match=r"box is enslaved by top; delete top or release top.inner first"):
        await realm.client(box).delete()
    await realm.client(top).free("inner")
    await realm.client(box).delete()


async def test_a_deleted_robot_tells_its_children_first(realm: Any) -> None:
    rover, pair = await bound(realm)
    await realm.client(pair).delete()
    assert rover.description().bond is None
    await asyncio.wait_for(pair.closed.wait(), 1.0)
    assert await realm.until(lambda: realm.listed() == ["rover"]) < 1.0
    with pytest.raises(Unreachable):
        await realm.client(pair).describe()


@pytest.mark.real_threads
@pytest.mark.parametrize(
    ("trouble", "left"), [("spin", ""), ("hang", "its hang ignores every cancel and still runs; restart ")]
)
async def test_a_robot_whose_command_hangs_can_be_deleted_and_says_what_is_left(
    realm: Any, trouble: str, left: str
) -> None:
    rover, pair = await bound(realm)
    stuck = asyncio.create_task(realm.client(pair).call(trouble, {}))
    await realm.until(lambda: pair.description().busy == trouble)
    began = realm.runner.now()
    first, second = await asyncio.gather(*(realm.client(pair).delete() for _ in range(2)))
    assert first == second
    assert first.startswith(left) if left else not first
    assert realm.runner.now() - began < 2.0
    await asyncio.gather(stuck, return_exceptions=True)
    assert isinstance(stuck.exception(), VrError)
    assert rover.description().bond is None


@pytest.mark.real_threads
async def test_a_delete_whose_asker_goes_away_is_carried_out_all_the_same(realm: Any) -> None:
    rover, pair = await bound(realm)
    stuck = asyncio.create_task(realm.client(pair).call("spin", {}))
    await realm.until(lambda: pair.description().busy == "spin")
    asker = realm.network.join("asker")
    deleting = asyncio.create_task(RobotClient(asker, pair.address).delete())
    await realm.until(lambda: pair.description().busy == "" or not pair.open, within=1.0)
    deleting.cancel()
    for task in pair.transport._tasks:  # as when its own transport is closed
        task.cancel()
    await realm.until(pair.closed.is_set, within=LONGEST_END + 1.0)
    assert rover.description().bond is None
    await realm.until(lambda: not realm.operator.presence.keys("robot/pair/*"))  # the news is on its way
    await asyncio.gather(stuck, deleting, return_exceptions=True)


async def test_a_process_that_ends_in_order_leaves_nothing_behind(realm: Any) -> None:
    rover, pair = await bound(realm)
    await pair.close()
    await pair.close()
    assert rover.description().bond is None
    assert await realm.until(lambda: realm.listed() == ["rover"]) < 1.0
    await asyncio.sleep(0.01)
    assert realm.operator.presence.keys("robot/*/*") == [rover.address.key]


async def test_a_robot_that_is_freed_and_changes_while_it_ends_is_not_listed_again(realm: Any) -> None:
    """It ends for as long as its child does not confirm its release."""
    rover, pair = await bound(realm)
    box = await realm.start(Box("box"))
    await realm.client(box).enslave("inner", pair.address)
    await realm.until(lambda: realm.listed() == ["box"])
    arrived: list[str] = []
    realm.directory.on_change(lambda change: arrived.append(change.kind))
    realm.network.pause(member(rover))
    ending = asyncio.create_task(pair.close())
    await realm.until(lambda: not pair.open)
    await realm.client(box).free("inner")
    assert pair.description().bond is None
    pair.notify()
    await ending
    assert "arrived" not in arrived
    realm.network.resume(member(rover))


# -- a lease whose answer is lost: the child is not bound to a parent that does not know of it -----


class Forgetful(MemoryTransport):
    """Loses the answers to petitions on their way back."""

    def request(
        self, key: str, body: bytes, *, timeout: float, urgent: bool = False, void_at: float = 0.0
    ) -> AsyncIterator[bytes]:
        replies = super().request(key, body, timeout=timeout, urgent=urgent, void_at=void_at)
        asked = opened(body, self.identity, "it", self.loop.time()).request
        return self._lose(key, replies, timeout) if isinstance(asked, Petition) else replies

    async def _lose(self, key: str, replies: AsyncIterator[bytes], timeout: float) -> AsyncIterator[bytes]:
        self.lost = [reply async for reply in replies]
        await asyncio.sleep(timeout)
        raise NoAnswer(key=key, seconds=timeout)
        yield b""


@pytest.mark.parametrize("how", ["it waits in vain", "its asker goes away"])
async def test_a_child_that_its_parent_does_not_know_it_has_is_free_again(realm: Any, how: str) -> None:
    rover = await realm.start(Rover("rover"), term=600.0)
    transport = Forgetful(realm.network, "pair")
    realm.network.enter(transport)
    pair = await realm.start(Pair("pair"), transport, term=600.0)
    enslaving = asyncio.create_task(pair._children.enslave("left", rover.address))
    await realm.until(lambda: rover.description().bond is not None)
    if how == "its asker goes away":
        enslaving.cancel()
    with pytest.raises((NoAnswer, asyncio.CancelledError)):
        await enslaving
    await realm.until(lambda: rover.description().bond is None, within=1.0)
    assert pair.description().slot("left").child is None
    transport.__class__ = MemoryTransport  # type: ignore[assignment] # the way is good again
    await realm.client(pair).enslave("left", rover.address)
    assert rover.description().bond is not None


async def test_a_petition_that_comes_after_it_was_taken_back_is_refused(realm: Any) -> None:
    """The child's process was stopped; when it goes on, it finds the petition and its retraction."""
    rover = await realm.start(Rover("rover"), term=600.0)
    pair = await realm.start(Pair("pair"), term=600.0)
    realm.network.lease = 1000.0
    realm.network.freeze(rover.transport)
    with pytest.raises(NoAnswer):
        await realm.client(pair, patience=20.0).enslave("left", rover.address)
    await asyncio.sleep(1.0)
    realm.network.thaw(rover.transport)
    await asyncio.sleep(1.0)
    assert rover.description().bond is None
    await realm.client(pair).enslave("left", rover.address)


async def test_a_child_whose_link_is_just_coming_back_is_waited_for(realm: Any) -> None:
    """One of the two hung for longer than the network's lease, and has just woken."""
    rover = await realm.start(Rover("rover"))
    pair = await realm.start(Pair("pair"))
    realm.network.cut(pair.transport, rover.transport)
    await asyncio.sleep(2 * realm.network.lease)
    enslaving = asyncio.create_task(realm.client(pair).enslave("left", rover.address))
    await asyncio.sleep(REUNION / 2)
    realm.network.heal(pair.transport, rover.transport)
    await enslaving
    assert rover.description().bond is not None


async def test_the_wait_for_a_link_is_no_part_of_the_lease(realm: Any) -> None:
    rover = await realm.start(Rover("rover"), term=1.0)
    pair = await realm.start(Pair("pair"), term=1.0)
    realm.network.cut(pair.transport, rover.transport)
    await asyncio.sleep(2 * realm.network.lease)
    enslaving = asyncio.create_task(realm.client(pair).enslave("left", rover.address))
    await asyncio.sleep(1.5)
    realm.network.heal(pair.transport, rover.transport)
    await enslaving
    await asyncio.sleep(3.0)
    assert pair.description().slot("left").child == rover.address
    assert rover.description().bond is not None


async def test_a_child_that_is_dead_is_not_waited_for(realm: Any) -> None:
    rover = await realm.start(Rover("rover"))
    pair = await realm.start(Pair("pair"))
    realm.network.kill(rover.transport)
    asked = realm.runner.now()
    with pytest.raises(Unreachable):
        await realm.client(pair).enslave("left", rover.address)
    assert realm.runner.now() - asked < REUNION / 2


async def test_a_child_whose_link_stays_away_is_given_up(realm: Any) -> None:
    rover = await realm.start(Rover("rover"))
    pair = await realm.start(Pair("pair"))
    realm.network.cut(pair.transport, rover.transport)
    await asyncio.sleep(2 * realm.network.lease)
    asked = realm.runner.now()
    with pytest.raises(Unreachable):
        await realm.client(pair).enslave("left", rover.address)
    assert REUNION <= realm.runner.now() - asked < REUNION + 1
