"""The array of n typed children: a team of rovers, one of which is lost and comes back."""

from __future__ import annotations

from typing import Any

import pytest

from robotree.tui.line.action import Where
from robotree.tui.line.actions import shapes
from robotree.tui.line.carrying import Refusal, Silent, carry_out
from robotree.tui.line.grammar import parse, split
from robotree.tui.seen import forest, status, wording
from robotree.tui.session.conditions import Scene, condition
from robotree.vr import Child, Children, VirtualRobot, command
from robotree.vr.base.description import SlotSpec, lacking
from robotree.vr.base.errors import GroupFull, NoSuchSlot, SlotEmpty
from robotree.vr.core.bonds import Slots
from robotree.vr.supervision.realm_client import RealmClient
from tests.vr.core.conftest import Realm, refusal
from tests.vr.core.crew import Rover


class Team(VirtualRobot):
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


async def team(realm: Realm, rovers: int) -> tuple[Any, ...]:
    robots = [Team("team"), *(Rover(f"rover-{number}") for number in range(1, rovers + 1))]
    return tuple([await realm.start(robot) for robot in robots])


async def test_a_line_binds_several_rovers_and_the_team_is_ready(realm: Realm) -> None:
    boss, *_ = await team(realm, 3)
    assert status.words(boss.description(), status.lacks_of(boss.description())) == "needs rovers: Rover x 2"
    said = await typed(realm, "enslave team.rovers rover-1 rover-2")
    assert said.text == "team.rovers commands rover-1, rover-2"
    assert lacking(boss.description().slots) == ()
    assert await realm.client(boss).call("forward", {"x": 1}) == 2
    assert await realm.client(boss).call("who", {}) == "0:rover-1 1:rover-2"


async def test_a_team_of_one_says_what_it_still_needs(realm: Realm) -> None:
    boss, *_ = await team(realm, 1)
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
    boss, first, second, _ = await team(realm, 3)
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
    boss, first, second, _ = await team(realm, 3)
    await typed(realm, "enslave team.rovers rover-1 rover-2 rover-3")
    for agent in (first, second):
        realm.kill(agent)
    await realm.until(lambda: sum(slot.child is None for slot in boss.description().slots) == 3)
    await realm.start(Rover("rover-2"))
    await typed(realm, "enslave team.rovers rover-2")
    assert await realm.client(boss).call("who", {}) == "1:rover-2 2:rover-3"


async def test_one_or_all_are_released(realm: Realm) -> None:
    boss, *_ = await team(realm, 3)
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
    boss, *_ = await team(realm, 4)
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
