"""Why a robot is not ready: every reason is told, and how a stop was confirmed."""

from __future__ import annotations

from pathlib import Path

import pytest

from robotree.tui.errors import CannotRestart
from robotree.tui.processes import restarting
from robotree.tui.processes.restarting import StartedLine, note_started, start_again
from robotree.tui.screen.pages.enslave import openings
from robotree.tui.seen.readiness import reasons
from robotree.tui.seen.store import Store
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, RobotDescription, SlotSpec
from robotree.vr.base.presence import Held
from robotree.vr.base.requests import State

PICK = Address("robot", "pick", "1")
PARENT = Address("robot", "lever", "1")
TROUBLE = State(
    bond=PARENT,
    online=False,
    stopped=True,
    stop_reason="somebody asked for it",
    abandoned=("defy",),
    busy="go_to",
    caller="operator",
)


def store_of(*states: State, bond: BondSpec | None = None) -> Store:
    store = Store()
    slots = (SlotSpec(name="arm", kind="Arm"), SlotSpec(name="spare", kind="Rover"))
    robot = RobotDescription(
        address=PICK,
        kinds=("Pick",),
        host="host-1",
        slots=slots if bond else (),
        bond=bond,
        attributes={"controller": "tcp:127.0.0.1:5760"},
    )
    store.take_descriptions([robot], 0.0)
    for at, state in enumerate(states):
        store.take_state("pick", state, float(at))
    return store


def test_a_free_robot_at_rest_is_ready() -> None:
    assert reasons(store_of(State()), "pick", 1.0) == ()


def test_a_robot_is_not_ready_when_one_below_it_is_not() -> None:
    store = store_of(State())
    lever = RobotDescription(
        address=PARENT, kinds=("Lever",), slots=(SlotSpec(name="mover", kind="Pick", child=PICK),)
    )
    bond = BondSpec(parent=PARENT, slot="mover", epoch=1, remaining=5)
    arm = SlotSpec(name="arm", kind="Arm")
    pick = RobotDescription(address=PICK, kinds=("Pick",), slots=(arm,), bond=bond)
    store.take_descriptions([lever, pick], 0.0)
    assert reasons(store, "lever", 1.0) == ("pick: slot arm is empty, it takes Arm",)
    store.take_state("pick", State(online=False, bond=PARENT, stopped=True), 1.0)
    assert reasons(store, "lever", 1.0) == (
        "pick: offline: its controller does not answer",
        "pick: slot arm is empty, it takes Arm",
    )
    assert [opening.path for opening in openings(store, "lever")] == ["pick.arm"], "e at the parent fills it"


def test_all_reasons_are_told_and_not_only_the_worst() -> None:
    store = store_of(State(), TROUBLE, bond=BondSpec(parent=PARENT, slot="pick", epoch=1, remaining=5))
    assert reasons(store, "pick", 4.0) == (
        "offline: its controller at tcp:127.0.0.1:5760 does not answer",
        "somebody asked for it, for 3 s",
        "defy ignores cancel and still runs: restart host host-1",
        "slot arm is empty, it takes Arm",
        "slot spare is empty, it takes Rover",
        "commanded by lever: command that one, or release this one",
    )


def test_a_resume_settles_a_robot_that_hung_during_the_stop() -> None:
    store = store_of(State())
    store.begin_stop("", 1.0)
    store.end_stop([], {"pick": "in process 7, which hangs"}, 2.0)
    assert store.settle_stop() == [], "it may still move"
    store.take_silent([Held(PICK.key, "process 7", "")], 2.0)
    store.take_descriptions(list(store.descriptions.values()), 3.0)
    assert store.settle_stop() == ["pick"], "it answers again"
    assert store.stop is not None
    assert not store.stop.open


def test_a_command_of_somebody_else_is_told_with_its_caller() -> None:
    assert reasons(store_of(State(busy="go_to", caller="night-shift")), "pick", 1.0) == (
        "go_to runs, asked for by night-shift",
    )


def test_a_stop_is_told_with_its_age_and_the_time_of_its_confirmation() -> None:
    store = store_of(State())
    store.begin_stop("pick", 1.0)
    assert reasons(store, "pick", 1.1) == ()
    store.take_state("pick", State(stopped=True), 1.25)
    store.take_state("pick", State(stopped=True), 20.0)
    assert reasons(store, "pick", 21.25) == ("protective stop, for 20 s, confirmed after 0.25 s",)
    store.take_state("pick", State(), 22.0)
    assert reasons(store, "pick", 23.0) == ()


def test_a_stop_that_is_not_confirmed_says_so() -> None:
    store = store_of(State(), State(stopped=True))
    store.begin_stop("pick", 2.0)
    assert reasons(store, "pick", 3.0) == ("protective stop, for 2 s, NOT CONFIRMED: asked, no answer yet",)


def test_a_stop_that_was_in_force_before_has_lasted_at_least_as_long_as_it_was_seen() -> None:
    assert reasons(store_of(State(stopped=True)), "pick", 3.0) == ("protective stop, for at least 3 s",)


def test_a_robot_that_hangs_is_told_with_its_remedy() -> None:
    store = store_of(State())
    store.take_descriptions([], 1.0)
    store.take_silent([Held(PICK.key, "process 4711", "`kill -9 4711` ends it")], 2.0)
    assert reasons(store, "pick", 3.0) == ("`kill -9 4711` ends it",)


# -- a process that has gone is started again only by a line that was noted for it -----------------


@pytest.fixture
def started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """The lines that were started, in a home without systemd."""
    found: list[tuple[str, ...]] = []
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(restarting.shutil, "which", lambda _: None)
    monkeypatch.setattr(
        restarting,
        "start_detached",
        lambda realm, _, words, environment: found.append((realm, *words, *environment)),
    )
    return found


async def test_what_was_noted_is_started_with_its_words_and_variables(started: list[tuple[str, ...]]) -> None:
    note_started("cell", "host", "host-1", StartedLine(["host", "host-1", "--most", "3"]))
    note_started("cell", "proxy", "arm-1", StartedLine(["proxy", "arm", "arm-1"], {"ROBOTREE_KEY": "realm"}))
    assert "as `apply` started it" in await start_again("cell", "host-1")
    await start_again("cell", "arm-1")
    assert started == [
        ("cell", "host", "host-1", "--most", "3"),
        ("cell", "proxy", "arm", "arm-1", "ROBOTREE_KEY"),
    ]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"host host-1": {"words": ["demo"]}}', "\0"])
async def test_a_file_with_nonsense_starts_nothing(
    started: list[tuple[str, ...]], tmp_path: Path, text: str
) -> None:
    (tmp_path / "robotree" / "cell").mkdir(parents=True, mode=0o700)
    (tmp_path / "robotree" / "cell" / "started.json").write_text(text)
    with pytest.raises(CannotRestart, match="host-1 is not started again: it is no service of systemd here"):
        await start_again("cell", "host-1")
    assert started == []
