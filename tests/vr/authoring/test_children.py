"""The children of a page: an array of them, limits of their calls, and the readings that they publish."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, ClassVar

import pytest

from robotree.kinds import Arm, Rover
from robotree.testing import Fake, Page, rehearse
from robotree.testing.team import Team
from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.carrying import Refusal, Silent, carry_out
from robotree.tui.line.grammar import parse, split
from robotree.tui.seen import forest, status, wording
from robotree.tui.session.conditions import Scene, condition
from robotree.vr import (
    Child,
    Children,
    ChildTimeout,
    CommandCancelled,
    CommandFailed,
    DeadlineExceeded,
    SlotEmpty,
    VirtualRobot,
    command,
)
from robotree.vr.base.description import SlotSpec, lacking
from robotree.vr.base.errors import GroupFull, NoSuchSlot
from robotree.vr.core.bonds import Slots
from robotree.vr.supervision.realm_client import RealmClient
from tests.vr.core.conftest import Realm, refusal
from tests.vr.core.crew import Rover as CrewRover

# -- the array of n typed children: a team of rovers, one of which is lost and comes back ----------


class Drivers(VirtualRobot):
    """Drives all its rovers."""

    rovers = Children("Rover", "those that drive", least=2, most=3)
    scout = Child("Rover", optional=True)

    @command
    def forward(self, x: float) -> int:
        for rover in self.rovers:
            rover.move(x=x)
        return len(self.rovers)

    @command(effect="read")
    def who(self) -> str:
        return " ".join(f"{index}:{rover}" for index, rover in self.rovers.items())

    @command(effect="read")
    def place_of(self, index: int) -> float:
        x: float = self.rovers[index].get_info().x
        return x

    @command(effect="read")
    def alone(self) -> bool:
        return not self.rovers and not self.scout


async def typed(realm: Realm, line: str) -> Any:
    """Carry out a line as the prompt, the command line and a session do."""
    realm_client = RealmClient(realm.operator)
    await realm_client.start()
    try:
        return await carry_out(realm_client, parse(split(line), shapes(Where.PROMPT), {}), Silent())
    finally:
        await realm_client.close()


async def drivers(realm: Realm, rovers: int) -> tuple[Any, ...]:
    robots = [Drivers("team"), *(CrewRover(f"rover-{number}") for number in range(1, rovers + 1))]
    return tuple([await realm.start(robot) for robot in robots])


async def test_a_line_binds_several_rovers_and_the_team_is_ready(realm: Realm) -> None:
    boss, *_ = await drivers(realm, 3)
    assert status.words(boss.description(), status.lacks_of(boss.description())) == "needs rovers: Rover x 2"
    said = await typed(realm, "enslave team.rovers rover-1 rover-2")
    assert said.text == "team.rovers commands rover-1, rover-2"
    assert lacking(boss.description().slots) == ()
    assert await realm.client(boss).call("forward", {"x": 1}) == 2
    assert await realm.client(boss).call("who", {}) == "0:rover-1 1:rover-2"


async def test_a_team_of_one_says_what_it_still_needs(realm: Realm) -> None:
    boss, *_ = await drivers(realm, 1)
    await typed(realm, "enslave team.rovers rover-1")
    description = boss.description()
    assert status.needs(status.lacks_of(description)) == "needs rovers: Rover"
    assert [slot.name for slot in description.slots] == ["rovers[0]", "rovers[1]", "scout"]
    assert forest.drawing(forest.forest([description])).splitlines()[2:] == [
        "├─ rovers[1]: empty (takes Rover)",
        "└─ scout: empty (takes Rover, optional)",
    ]
    assert "scout      Rover  empty, optional" in wording.portrait(description)


async def test_a_lost_rover_leaves_a_gap_that_can_be_filled_again(realm: Realm) -> None:
    boss, first, second, _ = await drivers(realm, 3)
    await typed(realm, "enslave team.rovers rover-1 rover-2")
    realm.kill(first)
    await realm.until(lambda: boss.description().slots[0].child is None)
    assert await realm.client(boss).call("who", {}) == "1:rover-2", "a child keeps its index"
    assert await realm.client(boss).call("forward", {"x": 1}) == 1, "iteration skips the gap"
    assert second.robot.x == pytest.approx(1)
    error = await refusal(realm.client(boss).call("place_of", {"index": 0}))
    assert isinstance(error, SlotEmpty)
    assert "team.rovers[0] is empty (rover-1 has ended" in str(error)
    await typed(realm, "enslave team.rovers rover-3")
    assert await realm.client(boss).call("who", {}) == "0:rover-3 1:rover-2"


async def test_a_rover_that_comes_back_has_its_old_index(realm: Realm) -> None:
    boss, first, second, _ = await drivers(realm, 3)
    await typed(realm, "enslave team.rovers rover-1 rover-2 rover-3")
    for agent in (first, second):
        realm.kill(agent)
    await realm.until(lambda: sum(slot.child is None for slot in boss.description().slots) == 3)
    await realm.start(CrewRover("rover-2"))
    await typed(realm, "enslave team.rovers rover-2")
    assert await realm.client(boss).call("who", {}) == "1:rover-2 2:rover-3"


async def test_one_or_all_are_released(realm: Realm) -> None:
    boss, *_ = await drivers(realm, 3)
    await typed(realm, "enslave team.rovers rover-1 rover-2 rover-3")
    await typed(realm, "release team.rovers[1]")
    assert await realm.client(boss).call("who", {}) == "0:rover-1 2:rover-3"
    scene = Scene(robots={"team": boss.description()})
    assert condition("team.rovers[1] empty").judge(scene).holds
    assert condition("team.rovers[2] holds rover-3").judge(scene).holds
    await typed(realm, "release team.rovers")
    assert await realm.client(boss).call("alone", {})
    said = await typed(realm, "release team.rovers")
    assert isinstance(said, Refusal)
    assert isinstance(said.error, SlotEmpty)


async def test_what_is_too_many_is_refused_and_the_others_stay(realm: Realm) -> None:
    boss, *_ = await drivers(realm, 4)
    said = await typed(realm, "enslave team.rovers rover-1 rover-2 rover-3 rover-4")
    assert isinstance(said.error, GroupFull)
    assert str(said) == "team.rovers already holds 3, as many as it takes; release one first"
    assert await realm.client(boss).call("who", {}) == "0:rover-1 1:rover-2 2:rover-3"
    said = await typed(realm, "enslave team.scout rover-4 rover-1")
    assert "takes one robot" in str(said)
    error = await refusal(realm.client(boss).call("place_of", {"index": 3}))
    assert "team has no rovers[3]; it has rovers[0] to [2]" in str(error)
    error = await refusal(realm.client(boss).enslave("rovers[3]", boss.address))
    assert isinstance(error, NoSuchSlot)


def group(least: int = 0, most: int = 1000) -> Slots:
    return Slots.empty(
        "team", [SlotSpec(name="rovers", kind="Rover", group="rovers", least=least, most=most)]
    )


def test_a_large_group_keeps_only_the_slots_that_matter() -> None:
    assert list(group().by_name) == ["rovers[0]"]
    assert list(group(least=3).by_name) == ["rovers[0]", "rovers[1]", "rovers[2]"]
    assert group()["rovers[999]"].state == "empty"
    with pytest.raises(NoSuchSlot, match=r"it has: rovers\[0…999\]"):
        group()["rovers[1000]"]


def test_a_group_of_impossible_size_is_refused() -> None:
    for least, most in ((-1, 2), (3, 2), (0, 0), (0, 1001)):
        with pytest.raises(TypeError, match="`least` is 0 or more"):
            Children("Rover", least=least, most=most)


# -- a limit for one call of a child, and one line for all children of a group ---------------------


class Hasty(VirtualRobot):
    """Gives its arm little time."""

    arm = Child("Arm")

    @command
    def go(self, limit: str) -> str:
        """Go, and say what came of it."""
        try:
            self.arm.go_to(x=0.3, y=0, z=0.3, twist=0, within=limit)
        except ChildTimeout as error:
            return str(error)
        return "done"

    @command
    def race(self) -> None:
        """Go beside the block."""
        with self.together() as both:
            both.start(self.arm.go_to, x=0.3, y=0, z=0.3, twist=0, within="500 ms")


class Patient(VirtualRobot):
    """Gives its arm all the time that it has itself."""

    arm = Child(Arm)

    @command
    def go(self) -> None:
        """Go, without a limit."""
        self.arm.go_to(x=0.3, y=0, z=0.3, twist=0, within=None)
        self.arm.grip.start(action="open", within=None).result()


class Impatient(VirtualRobot):
    """Waits a second for its arm, does something else, and looks again."""

    arm = Child(Arm)

    @command
    def go(self) -> bool:
        """Return whether the arm was still on its way a second after the waiting had ended."""
        going = self.arm.go_to.start(x=0.3, y=0, z=0.3, twist=0)
        try:
            going.result(1)
        except TimeoutError:
            self.sleep(1)
            return not going.done
        return False


class Slow(VirtualRobot):
    """A page that takes its time."""

    @command
    def work(self) -> None:
        """Take long."""
        self.sleep(30)


class Above(VirtualRobot):
    """A page above a page."""

    slow = Child("Slow")

    @command
    def go(self) -> None:
        """Give it a second."""
        self.slow.work(within=1)


class Squad(VirtualRobot):
    """Rovers that move together."""

    rovers = Children("Rover", least=0)

    @command
    def advance(self) -> int:
        """Move all."""
        return len(self.rovers.move(x=0.2, y=0))


def test_a_call_within_its_limit_is_done() -> None:
    team = rehearse(Hasty, arm=Fake(Arm, takes=1.0))
    assert team.call("go", limit="2 s") == "done"


def test_a_call_that_is_late_is_cancelled_and_named_with_its_limit() -> None:
    team = rehearse(Hasty, arm=Fake(Arm, takes=10.0))
    before = team.now
    said = team.call("go", limit="2 s")
    assert said.startswith("arm.go_to was not done within the 2 s that its caller gave it, and was cancelled")
    assert team.now - before == pytest.approx(2.0, abs=0.1)
    team.wait(0.5)
    assert not team.describe("arm").busy


def test_a_result_that_was_waited_for_too_long_leaves_the_child_at_work_until_the_command_ends() -> None:
    team = rehearse(Impatient, arm=Fake(Arm, takes=30.0))
    before = team.now
    assert team.call("go") is True
    assert team.now - before == pytest.approx(2.0, abs=0.2)
    team.wait(0.5)
    assert not team.describe("arm").busy, "what a command has started ends with it"


def test_none_is_no_limit() -> None:
    team = rehearse(Patient, arm=Fake(Arm, takes=30.0))
    team.call("go", within=100)
    assert team.commanded == [
        ("arm", "go_to", {"x": 0.3, "y": 0, "z": 0.3, "twist": 0}),
        ("arm", "grip", {"action": "open"}),
    ]


def test_a_page_below_is_cancelled_too() -> None:
    team = rehearse(Above, slow=Page(Slow))
    with pytest.raises(ChildTimeout, match=r"slow\.work was not done within the 1 s"):
        team.call("go")
    team.wait(0.5)
    assert not team.describe("slow").busy


def test_a_child_that_hangs_keeps_its_parent_no_longer_than_the_limit() -> None:
    team = rehearse(Hasty, arm=Fake(Arm, takes=10.0).freeze("go_to", lasts=1.8))
    before = team.now
    assert "within the 1 s" in team.call("go", limit="1 s")
    assert team.now - before == pytest.approx(1.0, abs=0.1)


def test_a_part_of_a_block_that_is_late_fails_the_block() -> None:
    team = rehearse(Hasty, arm=Fake(Arm, takes=10.0))
    with pytest.raises(ChildTimeout, match="within the 500 ms"):
        team.call("race")


def test_a_limit_that_is_no_time_is_refused_with_the_line() -> None:
    team = rehearse(Hasty, arm=Fake(Arm))
    with pytest.raises(Exception, match=r"arm\.go_to: within: .*test_children\.py, line"):
        team.call("go", limit="2 kg")


def test_all_of_a_group_move_at_the_same_time() -> None:
    team = rehearse(Squad, rovers=[Fake(Rover, takes=1.0), Fake(Rover, takes=1.0)])
    before = team.now
    assert team.call("advance") == 2
    assert team.now - before < 1.5


def test_the_first_of_a_group_that_fails_cancels_the_others() -> None:
    team = rehearse(Squad, rovers=[Fake(Rover, takes=20.0), Fake(Rover).refuse("move", why="stuck")])
    before = team.now
    with pytest.raises(CommandFailed, match="stuck"):
        team.call("advance")
    assert team.now - before < 5


# -- readings of children as they publish them: a loop over them, and `wait_until` -----------------


class Lift(VirtualRobot):
    """Goes up by 0.1 m in a second."""

    reading_units: ClassVar = {"height": "m"}

    def readings(self) -> dict[str, float]:
        """Return its height."""
        return {"height": getattr(self, "_height", 0.0)}

    @command
    def rise(self, seconds: float) -> None:
        """Go up."""
        for step in range(round(seconds / 0.05)):
            self.sleep(0.05)
            self._height = 0.005 * (step + 1)

    @command(effect="read")
    def where(self) -> float:
        """Return its height."""
        return getattr(self, "_height", 0.0)


class Watcher(VirtualRobot):
    """Watches a lift."""

    lift = Child("Lift")

    @command
    def heights(self, hz: float, seconds: float) -> list[list[float]]:
        """Return when which height was read, while the lift goes up."""
        moving = self.lift.rise.start(seconds=seconds)
        begun, found = self.now(), []
        for reading in self.lift.readings(hz=hz):
            found.append([self.now() - begun, reading.height])
            if moving.done:
                return found
        return found

    @command
    def until(self, height: float, limit: float) -> float:
        """Return after how many seconds the lift was as high, and end its motion."""
        moving = self.lift.rise.start(seconds=5)
        begun = self.now()
        self.wait_until(lambda: self.lift.readings.height >= height, within=limit)
        moving.cancel()
        return self.now() - begun

    @command
    def wait_for_height(self, height: float) -> None:
        """Wait without a limit."""
        self.wait_until(lambda: self.lift.readings["height"] >= height)

    @command
    def follow(self) -> None:
        """Read for ever."""
        for _ in self.lift.readings():
            pass

    @command
    def latest(self) -> float:
        """Return the latest height."""
        return self.lift.readings.height

    @command
    def count_steps(self) -> None:
        """Wait, ask, read three times, ask."""
        self.lift.rise.start(seconds=2)
        self.wait_until(lambda: self.lift.readings.height > 0.1)
        self.lift.where()
        for number, _ in enumerate(self.lift.readings(), 1):
            if number == 3:
                break
        self.lift.where()

    @command
    def ask_in_the_condition(self) -> None:
        """Ask in the condition."""
        self.wait_until(lambda: self.lift.where() > 0)

    @command
    def look_at_nothing(self) -> None:
        """Look at something that nobody publishes."""
        self.wait_until(lambda: False)


@pytest.fixture
def team() -> Team:
    """Return a watcher above a lift, each in a process of its own."""
    return rehearse(Watcher, lift=Page(Lift))


def keys(team: Team, name: str) -> list[str]:
    return [step.key.rpartition("/")[2] for step in team.steps if step.command == name]


def test_each_reading_is_new_and_there_are_not_more_than_asked_for(team: Team) -> None:
    quick = team.call("heights", hz=50, seconds=3)
    times = [at for at, _ in quick]
    heights = [height for _, height in quick]
    assert 20 <= len(quick) <= 32, "the lift publishes ten times a second"
    assert heights == sorted(heights)
    assert heights[-1] == pytest.approx(0.3, abs=0.02)
    slow = [at for at, _ in team.call("heights", hz=2, seconds=3)]
    assert all(later - at >= 0.5 - 1e-6 for at, later in pairwise(slow))
    assert 4 <= len(slow) <= 8
    assert len(times) > len(slow)


def test_nobody_asks_the_child_for_its_readings(team: Team) -> None:
    asked: list[str] = []
    team.world.network.on_message = lambda _source, _target, kind, _key, _body: asked.append(kind)
    team.call("until", height=0.1, limit=4)
    before = asked.count("ask")
    team.call("heights", hz=50, seconds=3)
    assert asked.count("sample") >= 30
    assert asked.count("ask") - before < 12, "the call, and renewals of the lease"


def test_the_wait_ends_when_the_child_publishes_it(team: Team) -> None:
    assert team.call("until", height=0.1, limit=4) == pytest.approx(1.1, abs=0.15)


def test_a_wait_is_one_step_and_a_reading_is_one_step(team: Team) -> None:
    team.call("count_steps")
    assert keys(team, "rise") == ["1"]
    assert keys(team, "where") == ["3", "7"]


def test_what_does_not_become_true_in_time_is_told_with_the_limit(team: Team) -> None:
    with pytest.raises(CommandFailed, match=r"TimeoutError: the condition was not true within 0\.5 s"):
        team.call("until", height=9.0, limit=0.5)
    with pytest.raises(DeadlineExceeded):
        team.call("wait_for_height", height=9.0, within=2.0)


@pytest.mark.parametrize("name", ["follow", "wait_for_height"])
@pytest.mark.parametrize(
    ("act", "error"),
    [
        (lambda team: team.cancel(), CommandCancelled),
        (lambda team: team.stop(), CommandCancelled),
        (lambda team: team.lose("lift"), SlotEmpty),
        (lambda team: team.release("lift"), SlotEmpty),
    ],
)
def test_it_ends_with_the_command_and_with_the_child(
    team: Team, name: str, act: Callable[[Team], None], error: type[Exception]
) -> None:
    going = team.start(name, **({"height": 9.0} if name == "wait_for_height" else {}))
    team.wait(1.5)
    act(team)
    team.wait(5.0)
    assert going.done
    with pytest.raises(error):
        going.result()


def test_nothing_is_taken_when_the_command_has_ended(team: Team) -> None:
    runtime = team._agents[""].runtime
    team.call("latest")
    team.wait(0.1)
    assert not any(runtime._bereft.values())
    assert not any("state" in pattern for pattern, _ in team._processes[""].transport._subscriptions.values())


def test_the_condition_calls_nothing_and_reads_something(team: Team) -> None:
    with pytest.raises(CommandFailed, match="only reads; call commands before or after it"):
        team.call("ask_in_the_condition")
    with pytest.raises(CommandFailed, match="has read no readings of a child"):
        team.call("look_at_nothing")
    assert team.call("latest") == 0.0
