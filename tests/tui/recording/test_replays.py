"""A recording in the full screen: it shows each moment as it was, and nothing can be commanded."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.recording.exports import opened
from robotree.tui.recording.playback import Playback
from robotree.tui.recording.replaying import AGAIN, BesideReading, Player, Replay
from robotree.tui.recording.tape import (
    Entry,
    RecordedEnd,
    RecordedLine,
    RecordedPicture,
    RecordedState,
    Tape,
    TapeWriter,
)
from robotree.tui.recording.transport import RecordedTransport
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, CommandSpec, RobotDescription
from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import LoggedLine, State
from robotree.vr.supervision.realm_client import RealmClient
from tests.screen import press, text_of
from tests.waiting import until

NOON = 1_800_000_000.0
MOVER, ARM = Address("robot", "mover", "m"), Address("robot", "arm-1", "a")
GO = CommandSpec(name="go", doc="Go.")
FREE = RobotDescription(address=ARM, kinds=("Arm",), commands=(GO,), units={"z": "m"})
BOND = BondSpec(parent=MOVER, slot="arm", epoch=7, remaining=3.0)
BOUND = RobotDescription(address=ARM, kinds=("Arm",), commands=(GO,), units={"z": "m"}, bond=BOND)
ENTRIES = [
    Entry(NOON, FREE),
    Entry(NOON + 1, RecordedState("arm-1", State(readings={"z": 0.25}))),
    Entry(NOON + 2, RobotDescription(address=MOVER, kinds=("MoveTo",))),
    Entry(NOON + 2, RecordedState("mover", State())),
    Entry(NOON + 3, RecordedPicture("cell", "wrist", b"jpeg")),
    Entry(NOON + 4, BOUND),
    Entry(NOON + 5, RecordedState("arm-1", State(busy="go", bond=MOVER, epoch=7, readings={"z": 0.5}))),
    Entry(NOON + 6, RecordedLine("mover", LoggedLine(1, NOON + 6, "info", "the cup is [not] there"))),
    Entry(NOON + 7, RecordedEnd("mover")),
    Entry(NOON + 8, FREE),
    Entry(NOON + 60, RecordedState("arm-1", State(readings={"z": 0.75}))),
]
TAPE = Tape({"realm": "hall"}, ENTRIES, whole=True, name="it.mcap")


async def looking(at: float) -> RealmClient:
    playback = Playback(TAPE)
    playback.advance(NOON + at)
    realm_client = RealmClient(RecordedTransport(playback))
    await realm_client.start()
    return realm_client


@given(steps=st.lists(st.floats(0, 70), min_size=1, max_size=6))
def test_a_moment_is_the_same_however_one_came_there(steps: list[float]) -> None:
    walked, leapt = Playback(TAPE), Playback(TAPE)
    for step in sorted(steps):
        walked.advance(NOON + step)
    leapt.advance(walked.position)
    assert walked.listings() == leapt.listings()
    assert walked.described("arm-1") == leapt.described("arm-1")
    assert list(walked.moment()) == list(leapt.moment())


async def test_whoever_looks_sees_the_realm_of_that_moment() -> None:
    early, late = await looking(3.5), await looking(5.5)
    assert [one.name for one in early.robots()] == ["arm-1", "mover"]
    assert (await early.describe("arm-1")).readings == {"z": 0.25}
    assert (await early.look("cell")).jpeg == b"jpeg"
    assert [one.name for one in late.robots()] == ["mover"], "the arm is enslaved"
    assert [one.name for one in await late.tree()] == ["mover", "arm-1"]
    assert (await late.describe("arm-1")).busy == "go"
    for realm_client in (early, late):
        await realm_client.close()


async def test_nothing_in_a_recording_can_be_commanded() -> None:
    realm_client = await looking(5.5)
    for refused in (
        realm_client.call("mover", "go", {}),
        realm_client.delete("mover"),
        realm_client.release("mover", "arm"),
        realm_client.stop("mover"),
    ):
        with pytest.raises(VrError, match="recording"):
            await refused
    await realm_client.close()


async def test_who_listens_hears_what_comes_and_who_goes() -> None:
    playback = Playback(TAPE)
    transport = RecordedTransport(playback)
    realm_client = RealmClient(transport)
    await realm_client.start()
    heard = list[tuple[str, dict[str, float]]]()
    await realm_client.watch_state(None, lambda name, state: heard.append((name, state.readings)))
    transport.deliver(playback.advance(NOON + 6))
    assert ("arm-1", {"z": 0.5}) in heard
    assert [one.name for one in realm_client.robots()] == ["mover"]
    transport.deliver(playback.advance(NOON + 9))
    assert [one.name for one in realm_client.robots()] == ["arm-1"], "free again, and the mover has gone"
    await realm_client.close()


async def test_a_second_recording_is_chosen_by_a_key_and_shown_at_the_same_moment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    states = {"monday": 0.25, "tuesday": 0.75}
    for name, height in states.items():
        with (tmp_path / f"{name}.mcap").open("wb") as file:
            writer = TapeWriter(file, {"realm": "hall"})
            writer.description(NOON, FREE)
            for second in range(60):
                writer.state(NOON + second, "arm-1", State(readings={"z": height if second > 20 else 0.0}))
            writer.close()
    player = Player(opened(str(tmp_path / "monday.mcap")), 1.0)
    player.held = True
    realm_client = RealmClient(player.open())
    await realm_client.start()
    app = partial(Replay, player)(realm_client, realm="", readonly=True)
    async with app.run_test(size=(120, 40)) as pilot:
        await press(pilot, "equals_sign")
        await until(lambda: "tuesday.mcap" in text_of(app), "the others are offered")
        assert f"{tmp_path}/monday.mcap  " not in text_of(app)
        await press(pilot, "enter")
        await until(lambda: "all readings are as in the other" in text_of(app), "nothing differs yet")
        await press(pilot, "shift+right")
        await until(lambda: "arm-1.z  0.25 m → 0.75 m" in text_of(app), "it goes along")
        await press(pilot, "equals_sign")
        await until(lambda: not isinstance(app.screen, BesideReading), "it is closed")
    await realm_client.close()


async def test_the_screen_shows_the_banner_holds_and_leaps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    player = Player(TAPE, 1.0)
    player.held = True
    realm_client = RealmClient(player.open())
    await realm_client.start()
    app = partial(Replay, player)(realm_client, realm="", readonly=True)
    async with app.run_test(size=(120, 40)) as pilot:
        await until(lambda: "REPLAY 0:00 of 1:00" in text_of(app), "the banner is there")
        assert "held" in text_of(app)
        await press(pilot, "right")
        await until(lambda: "REPLAY 0:05" in text_of(app), "it has gone forward")
        await until(lambda: "arm: arm-1" in text_of(app), "the arm is below the mover")
        await press(pilot, "right")
        await until(lambda: "the cup is [not] there" in text_of(app), "texts are no markup")
        app.run_typed("delete arm-1")
        await until(lambda: "nothing in a recording can be commanded" in text_of(app), "it says why")
        await press(pilot, "space")
        await until(lambda: player.playback.position > NOON + 10, "it goes on")
        app.action_leap(-5.0)
    assert app.return_value == AGAIN
    assert player.begin_at >= NOON
    await realm_client.close()
