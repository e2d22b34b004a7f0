"""A recording in the full screen: it shows each moment as it was, and nothing can be commanded."""

from __future__ import annotations

import io
from collections.abc import AsyncGenerator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from functools import partial
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from textual.pilot import Pilot

from robotree.tui.processes.alarm_file import alarms_of
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
from robotree.tui.screen.pages.main import main_page
from robotree.tui.screen.widgets.cameras import PictureView
from robotree.tui.seen.watched import Alarm
from robotree.vr.base.address import Address
from robotree.vr.base.description import BondSpec, CommandSpec, RobotDescription
from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import LoggedLine, Picture, State
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


def file_of_a_day(folder: Path) -> str:
    """Write a recording of an arm on a host, which is stopped at its end, with a picture and two lines."""
    stream, name = io.BytesIO(), folder / "day.mcap"
    Image.new("RGB", (48, 27), (255, 0, 0)).save(stream, "JPEG")
    arm = RobotDescription(address=ARM, kinds=("Arm",), commands=(GO,), units={"z": "m"}, host="host-1")
    with name.open("wb") as file:
        writer = TapeWriter(file, {"realm": "hall"})
        writer.description(NOON, arm)
        writer.line("arm-1", LoggedLine(1, NOON + 1, "info", "the first line"))
        writer.picture(NOON + 2, "cell", Picture(jpeg=stream.getvalue(), width=48, height=27, camera="top"))
        writer.line("arm-1", LoggedLine(2, NOON + 8, "info", "the second line"))
        writer.state(NOON + 9, "arm-1", State(readings={"z": 0.5}))
        writer.state(NOON + 20, "arm-1", State(readings={"z": 0.5}, stopped=True))
        writer.close()
    return str(name)


@asynccontextmanager
async def shown(tape: Tape, at: float = 0.0) -> AsyncGenerator[tuple[Replay, Pilot[int]]]:
    """Replay a recording, held at a time [s]."""
    player = Player(tape, 1.0)
    player.held = True
    player.begin_at = NOON + at
    realm_client = RealmClient(player.open())
    await realm_client.start()
    app = partial(Replay, player)(realm_client, realm="", readonly=True)
    async with app.run_test(size=(120, 40)) as pilot:
        await until(lambda: "REPLAY" in text_of(app) and "arm-1" in text_of(app), "the list is there")
        yield app, pilot
    assert app.errors == []
    await realm_client.close()


def replayed(folder: Path, at: float) -> AbstractAsyncContextManager[tuple[Replay, Pilot[int]]]:
    """Replay that file, held at a time [s], with what this person has kept in the folder."""
    return shown(opened(file_of_a_day(folder)), at)


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
    async with shown(opened(str(tmp_path / "monday.mcap"))) as (app, pilot):
        await press(pilot, "equals_sign")
        await until(lambda: "tuesday.mcap" in text_of(app), "the others are offered")
        assert f"{tmp_path}/monday.mcap  " not in text_of(app)
        await press(pilot, "enter")
        await until(lambda: "all readings are as in the other" in text_of(app), "nothing differs yet")
        await press(pilot, "shift+right")
        await until(lambda: "arm-1.z  0.25 m → 0.75 m" in text_of(app), "it goes along")
        await press(pilot, "equals_sign")
        await until(lambda: not isinstance(app.screen, BesideReading), "it is closed")


async def test_the_screen_shows_the_banner_holds_and_leaps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    async with shown(TAPE) as (app, pilot):
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
        await until(lambda: app.player.playback.position > NOON + 10, "it goes on")
        app.action_leap(-5.0)
    assert app.return_value == AGAIN
    assert app.player.begin_at >= NOON


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path


async def test_each_line_of_a_log_is_shown_once(folder: Path) -> None:
    async with replayed(folder, at=5.0) as (app, pilot):
        await press(pilot, "g")
        await press(pilot, "right")
        await until(lambda: "the second line" in text_of(app), "it was said meanwhile")
        said = [entry.text for entry in app.store.entries]
        assert [text for text in said if "line" in text] == [
            "arm-1: the first line",
            "arm-1: the second line",
        ]


@pytest.mark.parametrize("at", [0.0, 5.0])
async def test_the_pictures_of_a_recording_are_beside_the_list(folder: Path, at: float) -> None:
    async with replayed(folder, at=at) as (app, pilot):
        await press(pilot, "right")
        await until(lambda: "1 free · 1 view · 1 host" in text_of(app), "both are counted")
        picture = main_page(app).query_one("#picture-box").query_one(PictureView)
        await until(lambda: picture.frames > 0 and "▀" in text_of(app), "it is drawn")
        await press(pilot, "v")
        await until(lambda: "cell / top" in text_of(app), "the page of the pictures has it, too")


async def test_the_keys_of_pages_open_them_in_a_replay_or_say_why_not(folder: Path) -> None:
    async with replayed(folder, at=5.0) as (app, pilot):
        for key, pane in (("v", "views"), ("g", "log"), ("l", "robots"), ("F", "plan")):
            await press(pilot, key)
            assert main_page(app).pane == pane
            assert app.screen is main_page(app)
        app.run_typed("views")
        assert main_page(app).pane == "views"
        await press(pilot, "l")
        for key, why in (
            ("A", "a recording holds no orders"),
            ("P", "a recording holds no permits"),
            ("Q", "a recording holds no messages of wires"),
            ("z", "a recording does not hold where robots are in their pages"),
            ("H", "a recording keeps no history"),
        ):
            await press(pilot, key)
            await until(lambda why=why: why in text_of(app), why)
            assert app.screen is main_page(app)
        await press(pilot, "q")
        await until(lambda: not app.is_running, "the first key leaves")


async def test_the_words_of_a_replay_are_about_the_recording_not_about_robots(folder: Path) -> None:
    async with replayed(folder, at=5.0) as (app, pilot):
        app.run_typed("stop")
        await until(lambda: "nothing in a recording can be commanded; space holds" in text_of(app), "why")
        for key in ("R", "n"):
            await press(pilot, key)
        assert [entry.text for entry in app.store.entries][-2:] == [
            "nothing in a recording can be commanded"
        ] * 2
        app.player.go_to(NOON + 20)
        await until(lambda: "PROTECTIVE STOP: arm-1" in text_of(app), "it was stopped then")
        assert "resumes" not in text_of(app)
        await press(pilot, "question_mark")
        await until(lambda: "Hold the recording, or let it go on" in text_of(app), "the help of a replay")
        assert "stops every robot" not in text_of(app)
        assert "resumes" not in text_of(app)


async def test_the_palette_of_a_replay_offers_its_own_keys_and_no_stop(folder: Path) -> None:
    async with replayed(folder, at=5.0) as (app, _):
        offered = {command.title: command for command in app.get_system_commands(app.screen)}
        assert not [title for title in offered if "stop" in title]
        offered["Recording: hold, go on  (space)"].callback()
        assert not app.player.held


async def test_living_alarms_do_not_judge_a_recording(folder: Path) -> None:
    alarm = Alarm(robot="arm-1", reading="z", sign=">", limit=0.1)
    kept = [alarms_of(realm) for realm in ("default", "hall")]
    for file in kept:
        file.change(lambda alarms: alarms.update({alarm.name: alarm}))
    async with replayed(folder, at=5.0) as (app, pilot):
        app.player.go_to(NOON + 70)
        await press(pilot, "U")
        app.run_typed("alarms")
        await until(lambda: "those of then are in the log" in text_of(app), "why there are none")
        assert not app.store.watched.alarms
    assert [file.all()[0].state for file in kept] == ["calm", "calm"]
