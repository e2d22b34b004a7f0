"""An author's settings and declared state: read in the page, changed from outside, never lost in silence."""

from __future__ import annotations

import asyncio
from enum import Enum
from typing import Annotated, Any, Literal

import pytest

from robotree.vr import BadArgument, Child, Range, Robot, Unit, VirtualRobot, command, state
from robotree.vr.author.command import commands_of
from robotree.vr.base.errors import BrokenSource, CommandCancelled, CommandFailed, NotInControl
from robotree.vr.bundle import Bundle
from robotree.vr.core.machine import decode_state, encode_state
from tests.vr.core.conftest import Realm, refusal

Speed = Annotated[float, Unit("m/s"), Range(0.01, 0.3), "how quickly it goes"]


class Team(VirtualRobot):
    """Sorts parts."""

    speed: Speed = 0.1
    side: Literal["left", "right"] = "left"
    label: str = ""
    table: dict[str, float] = {}  # noqa: RUF012 # an ordinary attribute of a page
    picked: int = state(0)
    seen: list[str] = state([])

    @command
    def pick(self, name: str) -> float:
        """Pick one."""
        self.picked += 1
        self.seen.append(name)
        self.sleep(1.0)
        return self.speed

    @command
    def hurry(self, speed: float) -> None:
        """Choose the speed itself."""
        self.speed = speed

    @command
    def spoil(self) -> None:
        """Put into its state what cannot be kept."""
        self.picked += 1
        self.seen.append(object())  # type: ignore[arg-type] # the mistake of an author

    @command
    def note_the_end(self) -> None:
        """Note that it was cancelled."""
        try:
            self.sleep(100.0)
        finally:
            self.seen = [*self.seen, "ended"]


class Boss(VirtualRobot):
    """Commands a team."""

    team = Child("Team")

    @command
    def slow_down(self) -> None:
        """Set the speed of the team."""
        self.team.set(speed=0.02)


def test_a_typed_attribute_is_a_setting_and_a_class_shows_its_default() -> None:
    team = Team("team")
    assert (Team.speed, team.speed, team.side, Team.picked) == (0.1, 0.1, "left", 0)
    assert Team.table == {}
    assert set(team.field_values.fields) == {"speed", "side", "label", "picked", "seen"}


def test_two_robots_of_a_page_share_no_state() -> None:
    first, second = Team("a"), Team("b")
    first.seen = ["x"]
    first.speed = 0.2
    assert (second.seen, second.speed) == ([], 0.1)


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("speed: Annotated[float, Range(0, 1)] = 2.0", "default of Page: speed: 2 is out of range"),
        ("speed: Annotated[str, Unit('m')] = ''", "only numbers have a unit"),
        ("online: Annotated[int, Range(0, 1)] = 0", "every robot uses it itself"),
        ("picked = state(0)", "Page.picked needs a type: `picked: int = state(0)`"),
        ("picked: int = state('no')", "Page.picked cannot keep 'no'"),
        ("lock: Other = state(None)", "Page.lock cannot keep Other"),
        ("lock: dict[str, list[Other]] = state({})", "Page.lock cannot keep Other"),
        ("speed: 'Mising' = 0.1", "Page.speed: name 'Mising' is not defined"),
    ],
)
def test_a_setting_that_is_declared_wrongly_is_refused_when_the_page_is_loaded(body: str, says: str) -> None:
    source = f"""
from typing import Annotated
from robotree.vr import Range, Unit, VirtualRobot, state

class Other: ...

class Page(VirtualRobot):
    {body}
"""
    with pytest.raises(BrokenSource) as caught:
        Bundle(source, "page.py").load()
    assert says in str(caught.value)
    assert "line 8" in str(caught.value)


async def test_a_setting_is_changed_while_a_command_runs(realm: Realm) -> None:
    agent = await realm.start(Team("team"))
    client = realm.client(agent)
    picking = asyncio.ensure_future(client.call("pick", {"name": "nut"}))
    await asyncio.sleep(0.5)
    await client.call("set", {"speed": "20 cm/s"})
    assert await picking == 0.2
    spec = (await client.describe()).command("set")
    assert spec is not None
    assert [(parameter.name, parameter.default, parameter.unit) for parameter in spec.parameters] == [
        ("speed", 0.2, "m/s"),
        ("side", "left", ""),
        ("label", "", ""),
    ]


@pytest.mark.parametrize("wrong", [{"speed": 9}, {"speed": "3 kg"}, {"side": "up"}, {"sped": 0.2}])
async def test_refused_values_change_nothing(realm: Realm, wrong: dict[str, Any]) -> None:
    agent = await realm.start(Team("team"))
    error = await refusal(realm.client(agent).call("set", {"label": "new", **wrong}))
    assert isinstance(error, BadArgument)
    assert agent.runtime.core.state.fields["label"] == ""


async def test_the_page_sets_a_setting_itself_and_is_held_to_its_range(realm: Realm) -> None:
    agent = await realm.start(Team("team"))
    await realm.client(agent).call("hurry", {"speed": 0.3})
    assert agent.runtime.core.state.fields["speed"] == 0.3
    assert isinstance(await refusal(realm.client(agent).call("hurry", {"speed": 3.0})), BadArgument)
    assert agent.runtime.core.state.fields["speed"] == 0.3


async def test_while_a_parent_commands_it_only_the_parents_side_changes_settings(realm: Realm) -> None:
    team, boss = await realm.start(Team("team")), await realm.start(Boss("boss"))
    await realm.client(boss).enslave("team", team.address)
    error = await refusal(realm.client(team).call("set", {"speed": 0.3}))
    assert isinstance(error, NotInControl)
    await realm.client(boss).call("slow_down", {})
    assert team.runtime.core.state.fields["speed"] == 0.02


async def test_what_a_command_changes_inside_a_list_is_kept_when_it_ends(realm: Realm) -> None:
    agent = await realm.start(Team("team"))
    await realm.client(agent).call("pick", {"name": "nut"})
    await realm.client(agent).call("pick", {"name": "bolt"})
    kept = decode_state(encode_state(agent.runtime.core.state)).fields
    assert (kept["picked"], kept["seen"]) == (2, ["nut", "bolt"])
    assert (await realm.client(agent).describe()).kept == {"picked": 2, "seen": ["nut", "bolt"]}


async def test_what_a_cancelled_command_has_changed_is_kept_too(realm: Realm) -> None:
    agent = await realm.start(Team("team"))
    client = realm.client(agent)
    picking = asyncio.ensure_future(client.call("pick", {"name": "nut"}))
    await asyncio.sleep(0.5)
    await client.cancel()
    assert isinstance(await refusal(picking), CommandCancelled)
    assert agent.runtime.core.state.fields["seen"] == ["nut"]


async def test_a_command_that_ends_may_still_note_it(realm: Realm) -> None:
    agent = await realm.start(Team("team"))
    client = realm.client(agent)
    waiting = asyncio.ensure_future(client.call("note_the_end", {}))
    await asyncio.sleep(0.5)
    await client.cancel()
    assert isinstance(await refusal(waiting), CommandCancelled)
    assert agent.runtime.core.state.fields["seen"] == ["ended"]


async def test_what_cannot_be_kept_fails_its_command_and_the_rest_is_kept(realm: Realm) -> None:
    agent = await realm.start(Team("team"))
    error = await refusal(realm.client(agent).call("spoil", {}))
    assert isinstance(error, CommandFailed)
    assert "team.seen cannot keep" in str(error)
    assert (agent.runtime.core.state.fields["picked"], agent.runtime.core.state.fields["seen"]) == (1, [])


async def test_settings_can_be_changed_in_a_stop(realm: Realm) -> None:
    agent = await realm.start(Team("team"))
    await realm.client(agent).safe_stop("a hand")
    await realm.client(agent).call("set", {"speed": 0.2})
    assert agent.runtime.core.state.fields["speed"] == 0.2


def test_a_robot_without_settings_has_no_command_for_them() -> None:
    class Plain(VirtualRobot):
        """Has none."""

    from robotree.vr.author.command import commands_of

    assert "set" not in commands_of(Plain)
    assert issubclass(Plain, Robot)


class Side(Enum):
    """Of the table."""

    LEFT = "left"
    RIGHT = "right"


class Chooser(VirtualRobot):
    """Has settings that are more than a number."""

    side: Side = Side.LEFT
    other: Side | None = None
    home: Annotated[tuple[float, float], Unit("m"), Range(0, 1)] = (0.3, 0.1)
    names: tuple[str, ...] = ()

    @command
    def turn(self, side: Side) -> bool:
        """Choose the side itself."""
        self.side = side
        return self.side is side


def test_an_enum_and_a_tuple_are_settings_that_the_page_reads_as_they_are_written() -> None:
    robot = Chooser("chooser")
    assert (robot.side, robot.other, robot.home, robot.names) == (Side.LEFT, None, (0.3, 0.1), ())
    commands_of(Chooser)["set"].function(robot, side="right", other="left", home=[0.5, 1.0], names=["nut"])
    assert (robot.side, robot.other, robot.home, robot.names) == (Side.RIGHT, Side.LEFT, (0.5, 1.0), ("nut",))
    robot.side = Side.LEFT
    assert robot.field_values.values["side"] == "left"
    with pytest.raises(BadArgument, match="one of left, right"):
        robot.side = "top"  # type: ignore[assignment] # the mistake of an author
    with pytest.raises(BadArgument, match="out of range"):
        robot.home = (0.3, 2.0)


async def test_an_enum_is_set_from_outside_and_shown_as_a_choice(realm: Realm) -> None:
    agent = await realm.start(Chooser("chooser"))
    client = realm.client(agent)
    await client.call("set", {"side": "right", "home": "50 cm, 10 cm"})
    spec = (await client.describe()).command("set")
    assert spec is not None
    assert [(parameter.name, parameter.choices, parameter.default) for parameter in spec.parameters[:3]] == [
        ("side", ("left", "right"), "right"),
        ("other", ("left", "right"), None),
        ("home", (), [0.5, 0.1]),
    ]
    assert await client.call("turn", {"side": "left"}) is True
    assert agent.runtime.core.state.fields["side"] == "left"
