"""What a plan does with robots that already stand somewhere, in which order, and what `save` says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

import msgspec
import pytest

from robotree.tui.errors import BadRealmFile
from robotree.tui.line import manual
from robotree.tui.processes.programs import Program
from robotree.tui.realm_file import saving
from robotree.tui.realm_file.applying import bring_about
from robotree.tui.realm_file.content import ProcessEntry
from robotree.tui.realm_file.pages import pages_of
from robotree.tui.realm_file.plan import Page, Plan, plan
from robotree.tui.realm_file.present import Controller, Present, Process
from robotree.tui.realm_file.reading import read_file
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, RobotDescription, SlotSpec
from robotree.vr.base.group import RobotGroup

if TYPE_CHECKING:
    from tui.conftest import Realm

PAGE = Page("/pages/a.py", "0123456789")


def address(name: str) -> Address:
    return Address("robot", name, "1")


def realm(bonds: Mapping[str, Mapping[str, str]]) -> Present:
    """Virtual robots on one host: the children in their slots, by parent."""
    parents = {
        child: (parent, slot) for parent, held in bonds.items() for slot, child in held.items() if child
    }
    robots = {
        name: RobotDescription(
            address=address(name),
            kinds=("Robot",),
            host="host-1",
            slots=tuple(
                SlotSpec(
                    name=slot,
                    kind="Robot",
                    group=slot.partition("[")[0] if "[" in slot else "",
                    child=address(child) if child else None,
                )
                for slot, child in held.items()
            ),
            bond=BondSpec(parent=address(parents[name][0]), slot=parents[name][1], epoch=1, remaining=1)
            if name in parents
            else None,
        )
        for name, held in bonds.items()
    }
    return Present(realm="cell", robots=robots, pages=dict.fromkeys(robots, PAGE.hash))


def planned(robots: str, there: Present, *, prune: bool = False) -> Plan:
    wanted = read_file(f"robots:\n{robots}", "cell.yaml")
    return plan(wanted, there, {robot.name: PAGE for robot in wanted.robots}, prune=prune)


def in_order(found: Plan) -> list[str]:
    """The lines as they could be done one after the other; a circle of needs leaves some out."""
    over: list[str] = []
    left = {step.id: step for step in found.steps}
    while ready := next((one for one in left.values() if not one.needs & left.keys()), None):
        over.append(ready.text)
        del left[ready.id]
    assert not left, "these wait for each other"
    return over


def test_two_children_change_places() -> None:
    there = realm({"left": {"arm": "a"}, "right": {"arm": "b"}, "a": {}, "b": {}})
    found = planned(
        """
  left: {page: a.py, slots: {arm: b}}
  right: {page: a.py, slots: {arm: a}}
  a: {page: a.py}
  b: {page: a.py}
""",
        there,
    )
    assert not found.against
    lines = in_order(found)
    assert sorted(lines[:2]) == ["release left.arm", "release right.arm"]
    assert sorted(lines[2:]) == ["enslave left.arm b", "enslave right.arm a"]


def test_a_child_that_its_parent_takes_back_just_now_is_left_alone() -> None:
    there = realm({"team": {"arm": "a"}, "a": {}})
    team = there.robots["team"]
    lost = msgspec.structs.replace(team, slots=(SlotSpec(name="arm", kind="Robot"),))
    there = msgspec.structs.replace(there, robots={**there.robots, "team": lost})
    found = planned("  team: {page: a.py, slots: {arm: a}}\n  a: {page: a.py}\n", there, prune=True)
    assert not found.steps
    assert not found.against


def test_a_parent_becomes_the_child_of_its_child() -> None:
    there = realm({"up": {"arm": "down"}, "down": {"arm": ""}})
    found = planned("  down: {page: a.py, slots: {arm: up}}\n  up: {page: a.py, slots: {arm: []}}\n", there)
    assert in_order(found) == ["release up.arm", "enslave down.arm up"]
    again = planned("  down: {page: a.py, slots: {arm: up}}\n  up: {page: a.py}\n", there, prune=True)
    assert in_order(again) == ["release up.arm", "enslave down.arm up"]


def test_the_lowest_robot_becomes_the_highest() -> None:
    there = realm({"a": {"arm": "b"}, "b": {"arm": "c"}, "c": {"arm": "d"}, "d": {"arm": ""}})
    found = planned(
        """
  d: {page: a.py, slots: {arm: a}}
  c: {page: a.py, slots: {arm: d}}
  b: {page: a.py, slots: {arm: []}}
  a: {page: a.py, slots: {arm: b}}
""",
        there,
    )
    assert in_order(found) == ["release b.arm", "enslave d.arm a"]


def test_a_group_gets_what_it_lacks_and_keeps_what_it_has() -> None:
    there = realm({"team": {"arms[0]": "a", "arms[1]": "x", "arms[2]": ""}, "a": {}, "b": {}, "x": {}})
    text = "  team: {page: a.py, slots: {arms: [b, a]}}\n  a: {page: a.py}\n  b: {page: a.py}\n"
    found = planned(text, there)
    assert [step.text for step in found.steps] == ["enslave team.arms b"]
    assert found.left == ("x is not in the file",)
    (said,) = found.against
    assert said.startswith(
        "x stays in team.arms[1], for x is not in the file: `robotree release team.arms[1]`"
    )
    assert in_order(planned(text, there, prune=True)) == [
        "delete x",
        "release 'team.arms[1]'",
        "enslave team.arms b",
    ]


def test_what_is_not_in_the_file_is_deleted_from_the_top() -> None:
    there = realm({"top": {"arm": "middle"}, "middle": {"arm": "kept"}, "kept": {}})
    found = planned("  kept: {page: a.py}\n", there, prune=True)
    assert in_order(found) == ["delete top", "delete middle"]
    assert planned("  kept: {page: a.py}\n", there).left == (
        "top is not in the file",
        "middle is not in the file",
    )


def test_what_a_robot_needs_is_there_before_it() -> None:
    found = planned(
        """
  top: {page: a.py, slots: {arm: middle}}
  middle: {page: a.py, role: butler, slots: {arm: low}}
  low: {page: a.py}
""",
        Present(realm="cell"),
    )
    lines = in_order(found)
    assert lines.index("enslave middle.arm low") < lines.index("role middle butler")
    assert lines.index("role middle butler") < lines.index("enslave top.arm middle")


def test_a_robot_that_does_not_answer_is_named_and_not_made_again() -> None:
    there = Present(realm="cell", silent={"one": "process 4711"})
    found = planned("  one: {page: a.py, role: butler}\n  two: {page: a.py, slots: {arm: one}}\n", there)
    assert [step.text for step in found.steps] == ["create /pages/a.py as two"]
    assert found.against == (
        "one runs in process 4711 and does not answer: end that, then apply the file again",
    )


def test_a_robot_on_another_host_moves_to_the_one_of_the_file_before_anything_else() -> None:
    found = planned("  one: {page: a.py, host: host-2}\n", realm({"one": {}}))
    (step,) = found.steps
    assert (step.text, step.needs) == ("migrate one to host-2", {"host host-2"})
    assert found.against == ()


def test_a_robot_that_a_stand_by_host_has_taken_over_is_where_the_file_says() -> None:
    taken = msgspec.structs.replace(realm({"one": {}}), instead={"host-1": "host-2"})
    found = planned("  one: {page: a.py, host: host-2}\n", taken)
    assert (found.steps, found.against) == ((), ())


def test_a_robot_without_a_host_waits_for_those_that_take_it_and_not_for_one_that_stands_by() -> None:
    wanted = read_file(
        "hosts:\n  h1:\n  h2: {standby-for: h1, after: 5s}\nrobots:\n  one: {page: a.py}\n", "cell.yaml"
    )
    found = plan(wanted, Present(realm="cell"), {"one": PAGE})
    assert {step.text for step in found.steps} >= {"host h1", "host h2 --standby-for h1 --after 5s"}
    (made,) = [step for step in found.steps if step.text.startswith("create")]
    assert made.needs == {"host h1"}


def test_a_child_waits_for_the_parent_that_its_host_brings_back() -> None:
    """Its parent is away: what was kept is not released before the host had its chance."""
    text = (
        "hosts: [host-1]\nrobots:\n  up: {page: a.py, host: host-1, slots: {arm: low}}\n  low: {page: a.py}\n"
    )
    wanted = read_file(text, "cell.yaml")
    both = realm({"up": {"arm": "low"}, "low": {}})
    alone = {"low": both.robots["low"]}
    pages = dict.fromkeys(("up", "low"), PAGE)

    def said(keepers: frozenset[str]) -> list[str]:
        there = Present(realm="cell", robots=alone, pages=both.pages, keepers=keepers)
        return [step.described for step in plan(wanted, there, pages).steps]

    assert said(frozenset({"host-1"})) == [
        "+ host host-1",
        "+ create /pages/a.py as up on host-1   (unless host-1 brings it back)",
        "+ enslave up.arm low   (unless host-1 brings it back)",
    ]
    assert said(frozenset()) == [
        "+ host host-1",
        "+ create /pages/a.py as up on host-1",
        "- release up.arm",
        "+ enslave up.arm low",
    ]


GROUPS = """\
groups:
  carriers: [rover-1, rover-2]
  strong: {where: kind = Rover & battery > 30, near: hall}
"""


def test_groups_of_the_file_are_made_and_changed_and_others_go_only_when_pruned() -> None:
    wanted = read_file(GROUPS, "cell.yaml")
    kept = RobotGroup(name="carriers", names=("rover-1", "rover-2"))
    other = RobotGroup(name="others", names=("arm-1",))
    there = Present(realm="cell", groups={"carriers": kept, "others": other})
    found = plan(wanted, there, {})
    (line,) = [step.line for step in found.steps]
    assert line is not None
    assert (line.verb, line.text("GROUP")) == ("group", "strong")
    assert line.text("--where") == "(kind = Rover & battery > 30) and near 'hall'"
    assert found.left == ("group others is not in the file",)
    changed = Present(realm="cell", groups={"carriers": RobotGroup(name="carriers", names=("rover-1",))})
    assert [step.sign for step in plan(wanted, changed, {}).steps] == ["~", "+"]
    ended = [step.line for step in plan(wanted, there, {}, prune=True).steps if step.sign == "-"]
    assert [line.text("GROUP") for line in ended if line] == ["others"]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("groups:\n  strong: {where: battery >}\n", "2: .*battery >"),
        ("groups:\n  strong: {}\n", "2: .*it has nobody"),
        ("groups:\n  strong: {of: [r1]}\n", "2: .*of"),
        ("robots:\n  a: {page: a.py}\ngroups:\n  a: [r1]\n", "4: .*also a robot"),
    ],
)
def test_a_group_that_cannot_be_is_told_with_its_line(text: str, why: str) -> None:
    with pytest.raises(BadRealmFile, match=why):
        read_file(text, "cell.yaml")


# -- `save` says what a file of a realm cannot bring about again -----------------------------------


@pytest.mark.parametrize(
    ("address", "by_chance"),
    [
        ("tcp:127.0.0.1:40000", True),
        ("tcp:localhost:59999", True),
        ("tcp:[::1]:32768", True),
        ("tcp:127.0.0.1:5760", False),
        ("tcp:192.168.1.20:40000", False),
        ("serial:/dev/ttyUSB0?baud=40000", False),
    ],
)
def test_a_port_that_was_free_by_chance_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, address: str, *, by_chance: bool
) -> None:
    ports = tmp_path / "range"
    ports.write_text("32768\t60999\n")
    monkeypatch.setattr(saving, "_RANGE", ports)
    words = ("proxy", "arm", "arm-1", "--connect", address)
    process = Process(manual.shell().parse(words), Program(1, words, tmp_path, ""))
    _, notes = saving.saved(Present(realm="r", processes={process.id: process}), tmp_path / "cell.yaml")
    assert [f"arm-1 connects to {address}, a port that was free by chance" in note for note in notes] == (
        [True] if by_chance else []
    )


def test_a_host_whose_robots_another_one_has_is_in_the_file_and_has_them_there(tmp_path: Path) -> None:
    words = ("host", "h2", "--standby-for", "h1", "--journal", "postgresql://db/robots")
    process = Process(manual.shell().parse(words), Program(1, words, tmp_path, ""))
    robot = RobotDescription(
        address=Address("robot", "one", "1"), kinds=("Robot",), host="h2", page=str(tmp_path / "a.py")
    )
    there = Present(realm="r", processes={process.id: process}, robots={"one": robot}, instead={"h2": "h1"})
    file, notes = saving.saved(there, tmp_path / "cell.yaml")
    assert "h1 does not run; it is in the file, for h2 has its robots" in notes
    hosts = {one.name: {key: word.text for key, word in one.facets.items()} for one in file.processes}
    assert hosts == {
        "h1": {"journal": "postgresql://db/robots"},
        "h2": {"standby-for": "h1", "journal": "postgresql://db/robots"},
    }
    (entry,) = file.robots
    assert entry.host is not None
    assert entry.host.text == "h1"


# -- a realm that changes while a plan is carried out ----------------------------------------------

SLOW_PAGE = '''
"""Two who stand above each other."""
from robotree.vr import Child, VirtualRobot


class Walker(VirtualRobot):
    """Stands below."""


class Leader(VirtualRobot):
    """Stands above."""

    walker = Child("Walker", "walks", optional=True)
'''
WANTED = """
robots:
  first: {page: "team.py:Leader"}
  second: {page: "team.py:Leader", slots: {walker: walks}}
  walks: {page: "team.py:Walker"}
"""


class Nobody:
    """Starts nothing: all processes are there."""

    controllers: ClassVar[Mapping[str, Controller]] = {}

    async def start(self, entry: ProcessEntry, words: Sequence[str], environment: Mapping[str, str]) -> str:
        raise AssertionError((entry, words, environment))


async def test_a_slot_that_was_emptied_meanwhile_is_released_already(realm: Realm, tmp_path: Path) -> None:
    page = tmp_path / "team.py"
    page.write_text(SLOW_PAGE)
    (tmp_path / "cell.yaml").write_text(WANTED)
    client = realm.realm_client
    for name, kind in (("first", "Leader"), ("second", "Leader"), ("walks", "Walker")):
        await client.create(str(page), name, wanted=kind)
    await client.enslave("first", "walker", "walks")
    wanted = read_file(WANTED, str(tmp_path / "cell.yaml"))
    planned: list[str] = []

    async def agree(found: Plan) -> None:
        planned.extend(step.text for step in found.steps)
        await client.release("first", "walker")  # as another person does, or a lease that ends

    _, done = await bring_about(wanted, pages_of(wanted), client, Nobody(), lambda _: None, agree)
    assert planned == ["release first.walker", "enslave second.walker walks"]
    assert [(one.outcome, one.reason) for one in done] == [("done", ""), ("done", "")]
    assert (await client.describe("walks")).bond is not None
