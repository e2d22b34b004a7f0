"""Every verb against a real realm client: what it tells people, what it tells programs, what it refuses."""

from __future__ import annotations

import asyncio
import json
import re
from inspect import iscoroutinefunction, signature
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from PIL import Image

from robotree.tui import exit_codes
from robotree.tui.errors import SomeSilent, ValueRefused
from robotree.tui.exit_codes import NOBODY, code_of
from robotree.tui.line import grammar
from robotree.tui.line.action import SCREEN, Where
from robotree.tui.line.actions import ACTIONS, shapes
from robotree.tui.line.carrying import function_of, program_of
from robotree.tui.line.grammar import parse
from robotree.tui.line.shell import Console, obey
from robotree.tui.line.sources import shipped
from robotree.tui.line.verbs import Outcome
from robotree.tui.terminal import answering
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.errors import (
    BadArgument,
    BrokenSource,
    CommandFailed,
    DuplicateName,
    NoSuchHost,
    NoSuchRobot,
    NoSuchView,
    NotInControl,
    NoVirtualRobot,
    SlotOccupied,
    StillBonded,
    VrError,
    WrongKind,
)
from robotree.vr.base.order import KnownAgent
from robotree.vr.base.presence import Held
from robotree.vr.lookup.chronicle import Chronicle
from robotree.vr.orders.service import DirectoryService
from robotree.vr.orders.store import OrderStore
from robotree.vr.supervision.realm_client import RealmClient
from robotree.vr.world.testing import until

if TYPE_CHECKING:
    from conftest import Realm

EXAMPLES = Path(__file__).parents[2] / "examples"


class Listener:
    """Hears verbs while they go on."""

    def __init__(self) -> None:
        self.heard: list[tuple[float, str]] = []
        self.outcomes: list[Outcome] = []
        self.warnings: list[str] = []

    def progress(self, fraction: float, text: str) -> None:
        self.heard.append((fraction, text))

    def warn(self, text: str) -> None:
        self.warnings.append(text)

    def outcome(self, outcome: Outcome) -> None:
        self.outcomes.append(outcome)


async def do(realm: Realm, text: str, listener: Listener | None = None) -> Outcome:
    line = grammar.parse(grammar.split(text), shapes(Where.SHELL), {"json": ""})
    outcome = await function_of(line.verb)(realm.realm_client, line, listener or Listener())
    json.dumps(outcome.data)
    return outcome


async def made(realm: Realm) -> None:
    """The tree of the thesis: lever over mover over arm."""
    for text in (
        f"create '{EXAMPLES / 'move_to.py'}' as mover",
        f"create '{EXAMPLES / 'open_close_lever.py'}:OpenCloseLever' as lever on host-1",
        "enslave mover.arm arm-1",
        "enslave lever.mover mover",
    ):
        await do(realm, text)


async def test_ls_lists_robots_views_hosts_and_lookups(realm: Realm) -> None:
    robots = await do(realm, "ls")
    assert [one["address"]["name"] for one in robots.data] == ["arm-1", "rover-1"]
    assert robots.text.splitlines()[0].split() == ["NAME", "KIND", "STATE", "LINK", "HOST", "ABOUT"]
    assert "An arm of paper" in robots.text
    assert [one["address"]["name"] for one in (await do(realm, "ls --views")).data] == ["cell"]
    assert (await do(realm, "ls --hosts")).data == [
        {
            "name": "host-1",
            "robots": [],
            "stands_by": "",
            "instead_of": "",
            "trouble": "",
            "load": None,
            "ways": {},
        }
    ]
    assert (await do(realm, "ls --lookups")).data == [{"name": "lookup-1"}]


async def test_ls_tells_real_and_simulated_robots_apart_as_the_screen_does(realm: Realm) -> None:
    kinds = {"yes": "Arm (sim)", "no": "Arm (real)", "": "Arm"}
    for number, told in enumerate(kinds):
        arm = type(realm.arm)(f"other-{number}")
        if told:
            arm.attributes["simulated"] = told
        await realm.robot(arm)
    await until(lambda: len(realm.realm_client.robots()) == 5, "all are listed")
    rows = (await do(realm, "ls")).text.splitlines()
    assert [re.split(r" {2,}", row)[1] for row in rows if row.startswith("other-")] == [*kinds.values()]


async def test_who_is_no_script_explains_no_rule(realm: Realm) -> None:
    with pytest.raises(ValueRefused, match="arm-1 is no script; it is of kind Arm"):
        await do(realm, "rules explain arm-1 greet")


GROUP = """
from robotree.vr import Children, VirtualRobot, command

class Team(VirtualRobot):
    \"""Arms.\"""
    arms = Children("Arm", least=1)

    @command
    def count(self) -> int:
        \"""How many.\"""
        return len(self.arms)
"""


async def test_of_several_children_it_says_who_is_bound_and_who_is_not_before_the_refusal(
    realm: Realm, tmp_path: Path
) -> None:
    (tmp_path / "team.py").write_text(GROUP)
    await do(realm, f"create '{tmp_path / 'team.py'}' as team")
    listener = Listener()
    with pytest.raises(NoSuchRobot, match="nobody"):
        await do(realm, "enslave team.arms arm-1 nobody ghost", listener)
    assert listener.warnings == ["team.arms: arm-1 is bound now; nobody, ghost are not:"]
    assert (await do(realm, "call team.count")).data == 1


async def silence(realm: Realm, monkeypatch: pytest.MonkeyPatch, *names: str, late: tuple[str, ...]) -> None:
    """Have robots not answer; those of `late` are late, too."""
    robots = list(await realm.realm_client.tree())
    answering = [robot for robot in robots if robot.name not in names]
    held = [Held(robot.address.key, "", "") for robot in robots if robot.name in late]

    async def tree() -> list[RobotDescription]:
        return answering

    monkeypatch.setattr(realm.realm_client, "tree", tree)
    monkeypatch.setattr(realm.realm_client, "late", lambda: held)


async def test_ls_says_that_a_robot_is_late_which_has_not_answered_yet(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    await silence(realm, monkeypatch, "arm-1", late=("arm-1", "rover-1"))
    assert [one["state"] for one in (await do(realm, "ls")).data] == ["late", "free"]


async def test_a_robot_that_runs_and_does_not_answer_makes_lists_incomplete_and_the_exit_code_tells(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As in a flood of connections: its process is not late, does not hang, and has not answered in time."""
    await silence(realm, monkeypatch, "arm-1", late=())
    for verb, said in (("ls", "arm-1    Arm    does not answer"), ("tree", "arm-1  does not answer")):
        listed = await do(realm, verb)
        assert re.search(re.sub(" +", " +", said), listed.text), listed.text
        assert isinstance(listed.doubt, SomeSilent)
        assert code_of(listed.doubt) == NOBODY
        assert "arm-1 in arm-1" in str(listed.doubt)


async def test_tree_says_that_a_robot_is_late_which_has_not_answered_yet(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    await made(realm)
    await silence(realm, monkeypatch, "arm-1", "rover-1", late=("arm-1", "rover-1"))
    drawn = await do(realm, "tree")
    assert drawn.text.splitlines()[-2:] == ["   └─ arm: arm-1 (late)", "rover-1  late"]
    assert drawn.doubt is None


async def test_ls_says_how_each_robot_is_and_cancel_ends_what_it_does(realm: Realm) -> None:
    assert (await do(realm, "cancel arm-1")).text == "arm-1: it carried nothing out"
    await do(realm, "stop rover-1")
    realm.arm.pace = 1.0
    running = asyncio.create_task(do(realm, "call arm-1.go_to x=0.3 y=0 z=0.3 twist=0"))
    await until(lambda: bool(realm.arm.calls), "the arm moves")
    listed = await do(realm, "ls")
    assert [one["state"] for one in listed.data] == ["busy: go_to", "STOPPED"]
    assert [row.split("  ")[0] for row in listed.text.splitlines()] == ["NAME", "arm-1", "rover-1"]
    assert all(state in listed.text for state in ("busy: go_to", "STOPPED"))
    assert all("state" not in one for one in (await do(realm, "ls --views")).data), "a view has none"
    await do(realm, "cancel arm-1")
    with pytest.raises(VrError, match="cancelled"):
        await running


async def test_ls_and_tree_show_who_hangs_and_the_exit_code_tells(realm: Realm) -> None:
    realm.network.lease = 0.2
    realm.network.freeze(realm.members["rover-1"])
    await until(lambda: len(realm.realm_client.directory.present("robot")) == 1, "it is silent")
    listed = await do(realm, "ls")
    assert {one["address"]["name"]: one["state"] for one in listed.data} == {
        "arm-1": "free",
        "rover-1": "HANGS (rover-1)",
    }
    assert listed.doubt is not None
    assert code_of(listed.doubt) == NOBODY
    assert "rover-1 hangs in rover-1: thaw rover-1" in str(listed.doubt)
    drawn = await do(realm, "tree")
    assert "rover-1  HANGS (rover-1)" in drawn.text
    assert drawn.doubt is not None
    realm.network.thaw(realm.members["rover-1"])


async def test_of_who_hangs_the_list_shows_what_was_last_known(realm: Realm) -> None:
    store = OrderStore(None)
    directory = DirectoryService(realm.network.join("directory-1"), "directory-1", store)
    await directory.start()
    await do(realm, f"create '{EXAMPLES / 'move_to.py'}' as mover on host-1")
    await until(lambda: "mover" in {each.name for each in store.agents.values()}, "it is remembered")
    realm.network.lease = 0.2
    realm.network.freeze(realm.members["host-1"])
    await until(lambda: len(realm.realm_client.directory.present("robot")) == 2, "it is silent")

    async def mover() -> list[str]:
        return next(row.split() for row in (await do(realm, "ls")).text.splitlines() if "mover" in row)

    assert (await mover())[1] == "MoveTo"
    assert "host-1" in await mover()
    await directory.close()
    assert (await mover())[1] == "?"
    assert "host-1" in await mover(), "the host that hangs with it"
    realm.network.thaw(realm.members["host-1"])


async def test_show_tells_readings_without_waiting_for_the_next_state(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def nothing_comes(*_: object) -> None:
        raise AssertionError("it listens")

    monkeypatch.setattr(realm.realm_client, "watch_state", nothing_comes)
    realm.arm.pose["x"] = 0.41
    assert (await do(realm, "show arm-1")).data["readings"]["x"] == 0.41


async def test_a_reading_that_is_no_number_is_null_for_programs(
    realm: Realm, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(realm.arm, "readings", lambda: {"x": float("nan"), "y": 1.0})
    listener = Listener()
    watching = asyncio.create_task(do(realm, "watch arm-1", listener))
    await until(lambda: bool(listener.outcomes), "a state")
    watching.cancel()
    assert listener.outcomes[0].data["readings"] == {"x": None, "y": 1.0}
    assert "NaN" not in json.dumps(listener.outcomes[0].data)


async def test_tree_draws_who_commands_whom(realm: Realm) -> None:
    await made(realm)
    outcome = await do(realm, "tree")
    assert outcome.text.splitlines() == [
        "lever (OpenCloseLever)",
        "└─ mover: mover (MoveTo)",
        "   └─ arm: arm-1 (Arm)",
        "rover-1 (Rover)",
    ]
    assert outcome.data[0]["children"][0]["children"][0]["name"] == "arm-1"


async def test_show_describes_commands_with_units_and_ranges(realm: Realm) -> None:
    outcome = await do(realm, "show arm-1")
    assert "go_to(x: m, y: m, z: m, twist: rad, speed: m/s = 0.1)" in outcome.text
    assert "@place  table" in outcome.text
    assert outcome.data["commands"][0]["name"]
    assert "called" not in outcome.text
    await do(realm, "call arm-1.get_info")
    assert re.search(r"get_info\(.* called 1x  ", (await do(realm, "show arm-1")).text)


async def test_show_finds_an_enslaved_robot_and_names_its_parent(realm: Realm) -> None:
    await made(realm)
    assert "mover.arm" in (await do(realm, "show arm-1")).text
    assert "[" not in (await do(realm, "ls")).text
    assert "arm-1" not in (await do(realm, "ls")).text


async def test_call_carries_out_a_command_tells_progress_and_returns_the_result(realm: Realm) -> None:
    listener = Listener()
    outcome = await do(realm, "call arm-1.go_to x='45 cm' y=0 z=0.3 twist='90 deg'", listener)
    assert outcome.text == "arm-1.go_to is done"
    assert listener.heard[0] == (0.1, "9 to go")
    assert realm.arm.pose["x"] == pytest.approx(0.45)
    info = await do(realm, "call arm-1.get_info")
    assert info.data["x"] == pytest.approx(0.45)
    assert ["x", "0.45"] in [line.split() for line in info.text.splitlines()]


async def test_a_text_that_looks_like_a_number_stays_a_text_where_a_text_is_wanted(realm: Realm) -> None:
    assert (await do(realm, "call arm-1.shout text=12 times=2 loud=true")).data == "1212"


async def test_release_and_delete_give_the_children_back(realm: Realm) -> None:
    await made(realm)
    assert "lever.mover is empty" in (await do(realm, "release lever.mover")).text
    assert "mover is deleted" in (await do(realm, "delete mover")).text
    await until(lambda: "arm-1" in {robot.name for robot in realm.realm_client.robots()}, "the arm is listed")


async def test_look_writes_a_picture(realm: Realm, tmp_path: Path) -> None:
    outcome = await do(realm, f"look cell '{tmp_path / 'a.jpg'}' --camera wrist --size 320x180")
    assert outcome.data["camera"] == "wrist"
    with Image.open(tmp_path / "a.jpg") as picture:
        assert picture.size == (320, 180)


async def test_stop_and_resume_name_whom_they_reached_the_enslaved_too(realm: Realm) -> None:
    await realm.create("move_to.py", "mover")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    stopped = await do(realm, "stop")
    assert (stopped.text, stopped.data["stopped"]) == (
        "stopped: arm-1, mover, rover-1", ["arm-1", "mover", "rover-1"],
    )  # fmt: skip
    with pytest.raises(VrError):
        await do(realm, "call rover-1.move x=0 y=0")
    assert (await do(realm, "resume rover-1")).data == {"resumed": ["rover-1"]}
    await do(realm, "call rover-1.move x=0 y=0")
    outcome = await do(realm, "resume")
    assert (outcome.text, outcome.data) == ("resumed: arm-1, mover", {"resumed": ["arm-1", "mover"]})
    assert (await do(realm, "resume")).text == "no robot was stopped"
    assert (await do(realm, "resume rover-1")).text == "rover-1 was not stopped"


async def test_resume_of_a_robot_that_never_was_is_refused_while_a_stop_of_all_holds_those_that_are_away(
    realm: Realm,
) -> None:
    store = OrderStore(None)
    directory = DirectoryService(realm.network.join("directory-1"), "directory-1", store)
    await directory.start()
    away = RobotDescription(address=Address("robot", "rover-2", "1"), kinds=("Rover", "Robot"))
    store.put(agents=[KnownAgent(name="rover-2", identity="a", robot=away)])
    await until(lambda: bool(realm.realm_client.orders.directories), "the directory is seen")
    await do(realm, "stop")
    with pytest.raises(NoSuchRobot, match="no robot named 'ghost'"):
        await do(realm, "resume ghost")
    assert (await do(realm, "resume rover-2")).text == "rover-2 is away: what was ordered may begin again"
    await directory.close()


USES = """
import time
from pathlib import Path

from robotree.vr import Child, VirtualRobot, command

class Holder(VirtualRobot):
    arm = Child("Arm")

    @command
    def watch_it(self) -> None:
        Path(__file__).with_name("runs").touch()
        while True:
            time.sleep(0.01)
"""


async def test_a_release_says_which_command_may_be_using_the_child(realm: Realm, tmp_path: Path) -> None:
    (tmp_path / "holder.py").write_text(USES)
    await do(realm, f"create '{tmp_path / 'holder.py'}' as holder")
    await do(realm, "enslave holder.arm arm-1")
    running = asyncio.create_task(do(realm, "call holder.watch_it"))
    await until((tmp_path / "runs").exists, "it runs")
    said = (await do(realm, "release holder.arm")).text
    assert said == "holder.arm is empty; holder.watch_it may be using it: `robotree cancel holder` ends that"
    await do(realm, "cancel holder")
    await asyncio.gather(running, return_exceptions=True)
    await do(realm, "enslave holder.arm arm-1")
    assert (await do(realm, "release holder.arm")).text == "holder.arm is empty"


async def test_a_place_without_a_slot_is_told_which_slots_there_are(realm: Realm) -> None:
    await realm.create("move_to.py", "mover")
    for verb in ("release mover", "enslave mover arm-1"):
        with pytest.raises(ValueRefused, match=r"'mover' names no slot; its slots are mover\.arm"):
            await do(realm, verb)


async def test_watch_tells_states_until_its_time_is_over(realm: Realm) -> None:
    listener = Listener()
    realm.arm.pace = 0.02
    watching = asyncio.create_task(do(realm, "watch arm-1 --within 500ms", listener))
    await do(realm, "call arm-1.go_to x=0.3 y=0 z=0.3 twist=0")
    await watching
    assert any("busy: go_to" in outcome.text for outcome in listener.outcomes)
    assert all(outcome.data["name"] == "arm-1" for outcome in listener.outcomes)


REFUSED: list[tuple[str, type[VrError], str]] = [
    ("show nobody", NoSuchRobot, "no robot named 'nobody'"),
    ("call arm-1.fly", VrError, "no command 'fly'"),
    ("call arm-1.go_to x=9 y=0 z=0 twist=0", BadArgument, "from -0.8 to 0.8"),
    ("call arm-1.go_to x=nan y=0 z=0 twist=0", BadArgument, "not a number"),
    ("call arm-1.go_to x='3 kg' y=0 z=0 twist=0", BadArgument, "give it in m"),
    ("call arm-1.go_to y=0 z=0 twist=0", BadArgument, "is missing"),
    ("call arm-1.go_to x=0.3 y=0 x=0.4", ValueRefused, "x is given twice"),
    ("call arm-1.go_to @shelf @desk", ValueRefused, "@shelf and @desk: a robot goes to one place"),
    ("create {move_to} as a --isolate jail", ValueRefused, "'jail' is no level of isolation"),
    ("call arm-1.stumble", CommandFailed, "a stone [/x] lay there"),
    ("create nowhere.py as a", VrError, "cannot read"),
    ("create {readme} as a", BrokenSource, "cannot be loaded"),
    ("create {conftest} as a", NoVirtualRobot, "defines no virtual robot"),
    ("create {move_to} as arm-1", DuplicateName, "already running"),
    ("create {move_to} as 'a.b'", VrError, "cannot be a name"),
    ("create {move_to} as a on nowhere", NoSuchHost, "no host named"),
    ("enslave mover.arm rover-1", WrongKind, "takes a robot of kind Arm"),
    ("enslave mover.leg rover-1", VrError, "no child slot 'leg'"),
    ("enslave mover.arm mover", VrError, "mover"),
    ("release mover.arm", VrError, "empty"),
    ("delete arm-1", VrError, "arm-1"),
    ("look hall", NoSuchView, "no view named"),
    ("look cell a.jpg --camera ceiling", VrError, "ceiling"),
]


async def test_what_cannot_be_done_is_refused_in_one_sentence_and_loses_nothing(realm: Realm) -> None:
    await do(realm, f"create '{EXAMPLES / 'move_to.py'}' as mover")
    realm.arm.calls.clear()
    paths = {
        "readme": EXAMPLES.parent / "README.md",
        "conftest": Path(__file__).with_name("test_status.py"),
        "move_to": EXAMPLES / "move_to.py",
    }
    for text, error, says in REFUSED:
        with pytest.raises(error) as refusal:
            await do(realm, text.format(**paths))
        assert says in str(refusal.value)
        assert "\n" not in str(refusal.value)
        assert {"arm-1", "rover-1", "mover"} == {robot.name for robot in realm.realm_client.robots()}
    assert "go_to" not in realm.arm.calls, "nothing moves"


async def test_a_service_takes_no_name_of_a_robot_that_is_away_and_one_that_is_refused_leaves_nothing(
    realm: Realm,
) -> None:
    """The rover could not come back under its name, and its orders would wait for ever."""
    store, service = OrderStore(None), EXAMPLES / "services" / "greeter.py"
    directory = DirectoryService(realm.network.join("directory-1"), "directory-1", store)
    await directory.start()
    rover = RobotDescription(address=Address("robot", "rover-2", "1"), kinds=("Rover", "Robot"))
    store.put(agents=[KnownAgent(name="rover-2", identity="a", robot=rover)])
    with pytest.raises(ValueRefused, match="rover-2 is a Rover that is away and could not come back"):
        await do(realm, f"service '{service}' rover-2 on host-1")
    other = RobotDescription(address=Address("robot", "desk-greet", "1"), kinds=("Rover", "Robot"))
    store.put(agents=[KnownAgent(name="desk-greet", identity="b", robot=other)])
    with pytest.raises(ValueRefused, match="desk-greet is a Rover that is away and could not come back"):
        await do(realm, f"service '{service}' desk on host-1")
    assert not {robot.name for robot in realm.realm_client.robots()} & {"desk", "desk-greet"}
    await do(realm, f"create '{EXAMPLES / 'move_to.py'}' as greeter-greet")
    with pytest.raises(DuplicateName, match="greeter-greet"):
        await do(realm, f"service '{service}' greeter on host-1")
    known = [each for each in store.agents.values() if each.name == "greeter"]
    assert all(each.deleted for each in known), "it is not remembered as one that is away"
    assert "greeter" not in {robot.name for robot in realm.realm_client.robots()}
    await directory.close()


async def test_an_enslaved_robot_obeys_and_ends_through_its_parent_alone(realm: Realm) -> None:
    await made(realm)
    for text, error in (
        ("call arm-1.hold", NotInControl),
        ("delete mover", StillBonded),
        ("enslave mover.arm rover-1", SlotOccupied),
    ):
        with pytest.raises(error, match=r"mover|lever"):
            await do(realm, text)


def test_every_verb_of_a_script_has_a_function() -> None:
    for action in ACTIONS:
        assert not action.where & Where.SCRIPT or function_of(action.verb)


def test_every_verb_leads_to_the_function_that_its_declaration_names() -> None:
    for action in ACTIONS:
        assert action.run or action.start or action.group == SCREEN, action.verb
        if action.run:
            assert iscoroutinefunction(function_of(action.verb)), action.verb
            assert len(signature(function_of(action.verb)).parameters) == 3, action.verb
        assert len(signature(program_of(action.verb)).parameters) == 2, action.verb


async def test_an_empty_log_says_that_it_is_empty(realm: Realm, monkeypatch: pytest.MonkeyPatch) -> None:
    said = await do(realm, "log arm-1")
    assert [one["text"] for one in said.data] == ["arm-1 (robot, arm-1) has come"]
    monkeypatch.setattr(Chronicle, "lines", ())
    said = await do(realm, "log arm-1")
    assert (said.data, said.text) == ([], "arm-1 has logged nothing")


async def test_show_and_watch_tell_readings_with_their_units(realm: Realm) -> None:
    shown = await do(realm, "show arm-1")
    assert "j1     14.32 °" in shown.text, "as on the screen"
    assert "age    0.125 s" in shown.text
    assert "width  0.08 m" in shown.text
    assert "tx     -0.01\n" in shown.text, "a reading without a unit stands alone"
    assert shown.data["readings"]["j1"] == 0.25
    assert shown.data["units"]["j1"] == "rad"
    listener = Listener()
    watching = asyncio.create_task(do(realm, "watch --within 2s", listener))
    await until(lambda: any(outcome.data["name"] == "arm-1" for outcome in listener.outcomes), "its state")
    assert any("j1=14.32 °" in outcome.text for outcome in listener.outcomes)
    watching.cancel()


def test_examples_are_found_in_the_wheel_whatever_folder_they_lie_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert shipped("examples/guide.yaml").exists()
    assert shipped("examples/companion/companion.py").exists()
    assert not shipped("examples/../secret.py").exists()


async def test_how_long_control_lasts_is_told_in_words_of_people(realm: Realm) -> None:
    for given, told in (("45s", "45 s"), ("90min", "90 min"), ("1h", "1 h")):
        with sitting_at("pts/3"):
            assert (await do(realm, f"control get arm-1 --for {given}")).text.endswith(f" for {told}")


# -- lists without a lookup service: known robots are shown, marked as possibly old ----------------


async def newcomer(realm: Realm) -> RealmClient:
    """A realm client that came after the last lookup service had gone: nobody ever told it a list."""
    await realm.create("move_to.py", "mover")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    realm.network.kill(realm.members["lookup-1"])
    await until(lambda: realm.realm_client.stale, "the lookup service has gone")
    realm_client = RealmClient(realm.network.join("newcomer"))
    await realm_client.start()
    return realm_client


@pytest.mark.parametrize("words", [["ls"], ["ls", "--views"]])
async def test_without_a_lookup_service_what_is_known_is_listed_as_stale(
    words: list[str], realm: Realm, capsys: pytest.CaptureFixture[str]
) -> None:
    realm_client = await newcomer(realm)
    line = parse(words, shapes(Where.SHELL), {})
    assert await obey(realm_client, line, Console(as_json=False)) == exit_codes.NOBODY
    people = capsys.readouterr()
    assert "no lookup service answers; this list may be old" in people.err
    listed = [row.split()[0] for row in people.out.splitlines()]
    assert listed == (["NAME", "cell"] if "--views" in words else ["NAME", "mover", "rover-1"])
    assert all("stale" in row for row in people.out.splitlines()[1:])

    with answering(as_json=True):
        assert await obey(realm_client, line, Console(as_json=True)) == exit_codes.NOBODY
    programs = capsys.readouterr()
    data = json.loads(programs.out)
    assert data
    assert all(one["stale"] is True for one in data)
    assert json.loads(programs.err)["error"] == "OldList"
    await realm_client.close()


async def test_who_saw_the_last_lookup_service_go_still_knows_its_list_which_was_not_in_doubt(
    realm: Realm, capsys: pytest.CaptureFixture[str]
) -> None:
    line = parse(["ls"], shapes(Where.SHELL), {})
    assert await obey(realm.realm_client, line, Console(as_json=False)) == exit_codes.DONE
    said = capsys.readouterr()
    assert "stale" not in said.out
    assert said.err == ""
    realm.network.kill(realm.members["lookup-1"])
    await until(lambda: realm.realm_client.stale, "the lookup service has gone")
    assert await obey(realm.realm_client, line, Console(as_json=False)) == exit_codes.NOBODY
    rows = capsys.readouterr().out.splitlines()
    assert [row.split()[0] for row in rows] == ["NAME", "arm-1", "rover-1"]
