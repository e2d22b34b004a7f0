"""A panel that is a program: its process draws and asks, and is ended when it does what no panel does."""

from __future__ import annotations

import asyncio
import io
import os
import runpy
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from robotree.tui.panels import frames, outside
from robotree.tui.panels.inside import panel_class
from robotree.tui.panels.judge import MEANT, PER_KEY, PanelJudge
from robotree.tui.panels.outside import PanelProcess
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base.address import Address
from robotree.vr.base.description import CommandSpec, FieldSpec, RobotDescription
from robotree.vr.base.errors import VrError
from robotree.vr.base.permissions import Permissions
from robotree.vr.bundle import Bundle
from robotree.vr.isolation.judge import Misbehaved
from robotree.vr.world.network import MemoryNetwork
from tests.tui.panels.pages import GOOD, WORST
from tests.waiting import PATIENCE, until

EXAMPLES = Path(__file__).parents[3] / "examples"
GUIDE = RobotDescription(
    address=Address("robot", "guide", "1"),
    kinds=("Guide",),
    commands=(CommandSpec(name="wave", parameters=(FieldSpec(name="times", type="int"),)),),
)


class Shown:
    """A panel with what it has drawn and asked for."""

    def __init__(self, source: str, robot: RobotDescription = GUIDE) -> None:
        self.lines: dict[int, str] = {}
        self.asked: list[tuple[str, Mapping[str, Any]]] = []
        self.up: list[str] = []
        self.ended: list[str] = []
        self.refuses = ""
        begin = frames.BeginPanel(source, "guide.panel.py", {}, robot, 60, 12, dark=True)
        self.process = PanelProcess(begin, Permissions(streams=("cell.wrist",)), self)

    def be_up(self, frame: frames.PanelUp) -> None:
        self.up.append(frame.title)

    def be_over(self, reason: str) -> None:
        self.ended.append(reason)

    async def look(self, view: str, camera: str, width: int, height: int) -> bytes:
        self.looked = (view, camera, width, height)
        picture = io.BytesIO()
        Image.new("RGB", (8, 8), "white").save(picture, "JPEG")
        return picture.getvalue()

    async def carry_out(self, command: str, arguments: Mapping[str, Any]) -> Any:
        self.asked.append((command, arguments))
        if self.refuses:
            raise VrError(detail=self.refuses)
        return f"waved {arguments['times']} times"

    def draw_lines(self, lines: Mapping[int, list[frames.Span]]) -> None:
        self.lines |= {row: "".join(text for text, *_ in spans) for row, spans in lines.items()}

    @property
    def text(self) -> str:
        return "\n".join(self.lines[row] for row in sorted(self.lines))


@pytest.fixture
async def shown(monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[list[Shown]]:
    monkeypatch.setattr(
        outside, "SILENT", PATIENCE
    )  # on a busy machine one that lives may be silent for long
    monkeypatch.setattr(outside, "START", PATIENCE)
    panels: list[Shown] = []
    yield panels
    for panel in panels:
        panel.process.close()
    await until(lambda: not any(panel.process.pid for panel in panels))


async def test_a_panel_draws_hears_and_asks_for_commands_of_its_robot(shown: list[Shown]) -> None:
    shown.append(panel := Shown(GOOD))
    await until(lambda: "hello" in panel.text and "wave" in panel.text)
    assert panel.up == ["Waving"]
    panel.process.send(frames.SeeReadings({"battery": 42.0}, {"battery": "%"}, "idle"))
    await until(lambda: "battery 42 %" in panel.text)
    panel.process.send(frames.PressKey("w", "w"))
    await until(lambda: "waved 3 times" in panel.text)
    assert panel.asked == [("wave", {"times": 3})]
    panel.refuses = "it is tired"
    row = next(row for row, text in panel.lines.items() if "wave " in text and "waved" not in text)
    for what in ("down", "up"):
        panel.process.send(frames.UseMouse(what, panel.lines[row].index("wave") + 1, row, 1))
    await until(lambda: "no: it is tired" in panel.text)
    panel.process.send(frames.ChangeSize(20, 4))
    await until(lambda: len(panel.lines[0]) == 20)
    pid = panel.process.pid
    panel.process.close()
    await until(lambda: not panel.process.pid)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    assert not panel.ended  # it was asked for


@pytest.mark.parametrize(
    ("worst", "reason"),
    [
        pytest.param(
            "self.app._send(frames.AskCommand(1, 'reboot', {}))", "'reboot', which guide", id="forges"
        ),
        pytest.param("[self.app._send(frames.PanelAlive()) for _ in range(2000)]", "100 frames", id="floods"),
        pytest.param("time.sleep(600)", "it hung for 2 s", id="hangs"),
        pytest.param("os._exit(3)", "its process has ended", id="ends"),
        pytest.param("raise ValueError('not today')", "ValueError: not today", id="fails"),
    ],
)
async def test_a_panel_that_misbehaves_is_ended(
    shown: list[Shown], worst: str, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if "sleep" in worst:
        monkeypatch.setattr(outside, "SILENT", 2.0)
    shown.append(panel := Shown(WORST.format(worst=worst)))
    await until(lambda: bool(panel.ended))
    assert reason in panel.ended[0]
    assert not panel.asked
    await until(lambda: not panel.process.pid)


async def test_a_panel_reaches_nothing_but_its_region(shown: list[Shown], tmp_path: Path) -> None:
    secret = tmp_path / "secret"
    secret.write_text("42")
    attempts = f"""
        for attempt in (
            lambda: open({str(secret)!r}).read(),
            lambda: open('/tmp/new', 'w'),
            os.fork,
            socket.socket,
            lambda: os.kill({os.getpid()}, 0),
            lambda: bytearray(3_000_000_000),
        ):
            try:
                said = str(attempt())
            except (OSError, MemoryError) as error:
                said = type(error).__name__
            self.mount(Label(said))
    """
    shown.append(panel := Shown(WORST.format(worst=attempts.strip())))
    await until(lambda: "MemoryError" in panel.text)
    assert panel.text.count("PermissionError") == 5


async def test_a_panel_sees_the_cameras_that_its_page_may_see(shown: list[Shown]) -> None:
    cameras = "[self.mount(PanelCamera(one)) for one in ('cell.wrist', 'cell.door')]"
    source = WORST.format(worst=cameras).replace("import RobotPanel", "import PanelCamera, RobotPanel")
    shown.append(panel := Shown(source))
    await until(lambda: "does not permit the stream cell.door" in " ".join(panel.text.split()))
    await until(lambda: "▀▀" in panel.text)
    assert panel.looked[:2] == ("cell", "wrist")


async def test_a_panel_asks_for_nothing_that_nobody_meant_and_is_ended_when_it_does_not_read(
    shown: list[Shown], monkeypatch: pytest.MonkeyPatch
) -> None:
    source = GOOD.replace("self.query_one(Button).focus()", "self.action_wave()")
    shown.append(panel := Shown(source))
    await until(lambda: "no: a panel asks for wave" in panel.text)
    assert not panel.asked
    monkeypatch.setattr(outside, "BACKLOG", -1)  # as if it had not read this much
    panel.process.send(frames.PressKey("x", "x"))
    await until(lambda: panel.ended == ["it does not read what it is told"])


def test_what_is_no_panel_says_why() -> None:
    begin = frames.BeginPanel("x = 1", "guide.panel.py", {}, GUIDE, 60, 12, dark=True)
    with pytest.raises(VrError, match="it has 0 classes that derive from RobotPanel"):
        panel_class(begin)


def test_the_judge_of_a_panel() -> None:
    judge = PanelJudge(GUIDE, Permissions(streams=("cell.wrist",)), 0.0)
    wave = frames.AskCommand(1, "wave", {"times": 3})
    assert "after a key or click" in judge.refusal(wave, 0.0)
    judge.touched(1.0)
    assert "times" in judge.refusal(frames.AskCommand(1, "wave", {"times": "often"}), 1.0)
    for number in range(PER_KEY):
        assert not judge.refusal(frames.AskCommand(number, "wave", {"times": 3}), 1.0)
    assert "after a key or click" in judge.refusal(frames.AskCommand(9, "wave", {"times": 3}), 1.0)
    judge.touched(2.0)
    assert "after a key or click" in judge.refusal(
        frames.AskCommand(9, "wave", {"times": 3}), 2.0 + MEANT + 1
    )
    with pytest.raises(Misbehaved, match="twice under one number"):
        judge.refusal(wave, 2.0)
    with pytest.raises(Misbehaved, match="no screen has"):
        judge.refusal(frames.DrawnLines({-1: []}), 2.0)
    with pytest.raises(Misbehaved, match="bytes at once"):
        judge.expect_size(frames.LARGEST + 1)
    for _ in range(7):
        judge.expect_pace(1_000_000, 3.0)
    with pytest.raises(Misbehaved, match="2 MB a second"):
        judge.expect_pace(2_000_000, 3.0)
    judge.expect_pace(2_000_000, 10.0)


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.panel.py")), ids=lambda path: path.name)
async def test_the_programs_of_the_examples_are_shown(shown: list[Shown], path: Path) -> None:
    page = await asyncio.to_thread(Bundle.read, path.with_name(path.name.replace(".panel.py", ".py")))
    assert path.name in page.files  # it travels with its page
    agent = RobotAgent(page.create("one"), MemoryNetwork().join("one"))
    shown.append(panel := Shown(page.files[path.name].decode(), agent.description()))
    await until(lambda: bool(panel.up) and len(panel.text.split()) > 5)
    assert not panel.ended


def test_the_panel_of_the_arm_has_the_keys_of_tele_operation_for_the_fingers() -> None:
    panel = runpy.run_path(str(EXAMPLES / "teleop.panel.py"))["HandDrive"]
    keys = {key: action for key, action, _ in panel.BINDINGS}
    assert (keys["o"], keys["O"]) == ("grip('open')", "grip('close')")
    assert "c" not in keys, "on every other page it cancels"
