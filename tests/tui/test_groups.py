"""Groups: made, shown, and given orders as one; partial failure is told."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from robotree.tui.errors import BadLine, SomeFailed
from robotree.tui.exit_codes import REFUSED, code_of
from robotree.tui.line.action import Where
from robotree.tui.line.carrying import Refusal, Silent, carry_out
from robotree.tui.line.completion import candidates, words_of
from robotree.tui.line.groups import _Prefixed
from robotree.tui.line.surface import Surface
from robotree.tui.line.verbs import Outcome
from robotree.vr import Robot, command
from robotree.vr.base.errors import BadGroup, DuplicateName, GroupEmpty, NoSuchGroup, RequirementUnreadable
from robotree.vr.network.policy_file import PolicyFile

if TYPE_CHECKING:
    from conftest import Realm

pytestmark = pytest.mark.usefixtures("carts")


class Cart(Robot):
    """A cart."""

    def __init__(self, name: str, battery: float, place: str) -> None:
        super().__init__(name, {"place": place})
        self.battery, self.stopped_by = battery, ""

    def readings(self) -> dict[str, float]:
        return {"battery": self.battery}

    def safe_stop(self, reason: str) -> None:
        self.stopped_by = reason

    @command(effect="read")
    def weigh(self) -> dict[str, float]:
        """Tell what is on each axle."""
        return {"front": 1.0, "back": 2.0}

    @command
    def load(self, kilos: float) -> float:
        """Take something on."""
        if kilos > self.battery:
            raise ValueError("too heavy")
        return kilos


async def did(realm: Realm, *words: str) -> Outcome:
    found = await said(realm, *words)
    assert isinstance(found, Outcome), found
    return found


async def said(realm: Realm, *words: str) -> Outcome | Refusal:
    return await carry_out(realm.realm_client, Surface(Where.SCRIPT).parse(words), Silent())


@pytest.fixture
async def carts(realm: Realm, tmp_path: Path) -> list[Cart]:
    realm.network.gate = PolicyFile(tmp_path)
    realm.members["operator"].gate = realm.network.gate
    found = [Cart("c1", 80.0, "hall"), Cart("c2", 20.0, "hall"), Cart("c3", 60.0, "shed")]
    for cart in found:
        await realm.robot(cart)
    return found


def names(outcome: Outcome) -> list[str]:
    return [one["name"] for one in outcome.data["members"]]


async def test_a_group_is_by_names_by_rule_and_by_place(realm: Realm) -> None:
    assert names(await did(realm, "group", "two", "c1", "c3")) == ["c1", "c3"]
    assert names(await did(realm, "group", "strong", "--where", "kind=Cart & battery>30")) == ["c1", "c3"]
    assert names(await did(realm, "group", "hall", "--near", "hall")) == ["c1", "c2"]
    assert names(await did(realm, "group", "mixed", "c2", "--where", "battery > 70", "--near", "hall")) == [
        "c1",
        "c2",
    ]
    assert names(await did(realm, "group", "both", "--where", "in strong and in hall")) == ["c1"]
    shown = await did(realm, "groups", "strong")
    assert "battery 80" in shown.text
    listed = await did(realm, "groups")
    assert [one["name"] for one in listed.data] == ["both", "hall", "mixed", "strong", "two"]
    assert "group two: c1, c3" in (await did(realm, "tree")).text
    await did(realm, "group", "two", "--delete")
    missing = await said(realm, "groups", "two")
    assert isinstance(missing, Refusal)
    assert isinstance(missing.error, NoSuchGroup)


async def test_members_that_are_away_are_shown(realm: Realm) -> None:
    shown = await did(realm, "group", "some", "c1", "nobody")
    assert [(one["name"], one["state"]) for one in shown.data["members"]] == [
        ("c1", "free"),
        ("nobody", "away"),
    ]


async def test_a_command_goes_to_all_and_partial_failure_is_told(realm: Realm) -> None:
    await did(realm, "group", "carts", "--where", "kind = Cart")
    done = await did(realm, "call", "carts.load", "kilos=10")
    assert done.doubt is None
    assert {one["name"]: one["result"] for one in done.data["members"]} == {
        "c1": 10.0,
        "c2": 10.0,
        "c3": 10.0,
    }
    part = await did(realm, "call", "carts.load", "kilos=50")
    assert [(one["name"], one["ok"]) for one in part.data["members"]] == [
        ("c1", True),
        ("c2", False),
        ("c3", True),
    ]
    assert isinstance(part.doubt, SomeFailed)
    assert "1 of 3 robots of group carts did not do it: c2: " in str(part.doubt)
    reason = part.data["members"][1]["detail"]
    assert f"{part.text} {part.doubt}".count(reason) == 1, "each reason is told once"
    assert code_of(part.doubt) == REFUSED


@pytest.mark.parametrize(
    ("progress", "told"),
    [((0.0, ""), []), ((0.5, ""), [(0.5, "c1")]), ((0.0, "looks"), [(0.0, "c1: looks")])],
)
def test_a_member_that_has_only_begun_says_nothing(
    progress: tuple[float, str], told: list[tuple[float, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[tuple[float, str]] = []
    monkeypatch.setattr(Silent, "progress", lambda _, *told: heard.append(told))
    _Prefixed(Silent(), "c1").progress(*progress)
    assert heard == told


async def test_an_answer_of_several_parts_is_shown_whole_for_each_member(realm: Realm) -> None:
    await did(realm, "group", "carts", "--where", "kind = Cart")
    done = await did(realm, "call", "carts.weigh")
    assert [line.split() for line in done.text.splitlines()] == [
        ["c1", "done", "front", "1,", "back", "2"],
        ["c2", "done", "front", "1,", "back", "2"],
        ["c3", "done", "front", "1,", "back", "2"],
    ]


async def test_a_named_member_that_is_away_is_a_failure(realm: Realm) -> None:
    await did(realm, "group", "some", "c1", "nobody")
    part = await did(realm, "call", "some.load", "kilos=1")
    assert isinstance(part.doubt, SomeFailed)
    assert [one for one, _ in part.doubt.failed] == ["nobody"]


async def test_a_stop_of_a_group_stops_its_members_and_nobody_else(realm: Realm, carts: list[Cart]) -> None:
    await did(realm, "group", "hall", "--near", "hall")
    await did(realm, "stop", "hall")
    assert [bool(cart.stopped_by) for cart in carts] == [True, True, False]
    await did(realm, "resume", "hall")
    assert not (await realm.realm_client.describe("c1")).stopped


async def test_a_stop_by_rule_reaches_who_may_be_a_member(
    realm: Realm, carts: list[Cart], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who does not describe itself could fulfil the rule: it is stopped, and gets no other order."""
    tree = realm.realm_client.tree

    async def without_c3() -> Any:
        return [robot for robot in await tree() if robot.name != "c3"]

    monkeypatch.setattr(realm.realm_client, "tree", without_c3)
    await did(realm, "group", "strong", "--where", "kind = Cart and battery > 30")
    assert [one["name"] for one in (await did(realm, "call", "strong.load", "kilos=1")).data["members"]] == [
        "c1"
    ]
    await did(realm, "stop", "strong")
    assert carts[0].stopped_by
    assert not carts[1].stopped_by
    assert carts[2].stopped_by


async def test_what_cannot_be_a_group_is_refused_in_one_sentence(realm: Realm) -> None:
    for words, error in [
        (("group", "c1", "c2"), DuplicateName),
        (("group", "bad", "--where", "battery >"), RequirementUnreadable),
        (("group", "bad", "--where", "in nobody"), NoSuchGroup),
        (("group", "bad", "--where", "in bad"), RequirementUnreadable),
        (("group", "bad", "bad"), BadGroup),
        (("group", "bad", "c1", "--delete"), BadLine),
        (("group", "bad", "--delete"), NoSuchGroup),
    ]:
        refusal = await said(realm, *words)
        assert isinstance(refusal, Refusal), words
        assert isinstance(refusal.error, error), (words, refusal.error)
        assert "\n" not in str(refusal)
    await did(realm, "group", "none", "--where", "battery > 99")
    empty = await said(realm, "call", "none.load", "kilos=1")
    assert isinstance(empty, Refusal)
    assert isinstance(empty.error, GroupEmpty)


async def test_a_robot_comes_before_a_group_of_its_name(realm: Realm) -> None:
    await did(realm, "group", "late", "c1", "c2")
    late = Cart("late", 50.0, "hall")
    await realm.robot(late)
    assert (await did(realm, "call", "late.load", "kilos=3")).data == 3.0


def test_groups_are_completed() -> None:
    words = words_of(
        [], free=["r1"], views=[], hosts=[], verbs=Surface(Where.PROMPT).shapes, groups=["cleaners"]
    )
    assert "cleaners" in candidates("stop c", words)
    assert "cleaners" in candidates("groups c", words)
    assert "r1" in candidates("group cleaners r", words)
    assert "where" in candidates("enslave a.b w", words)
