"""Two operators at their own terminals: the thesis' lever is closed with one hand-over, and a key is held."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from robotree.tui import exit_codes
from tests.command_line import robotree
from tests.ports import free_port
from tests.terminal import ENTER, Sitting, Terminal
from tests.waiting import PATIENCE

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("place")]

EACH = 0.5
"""[s] between two questions: each is a process beside those that are waited for."""
EXAMPLES = Path(__file__).parents[2] / "examples"
SAW = """
from robotree.vr import Child, VirtualRobot, command

class Saw(VirtualRobot):
    "A saw."

    def __init__(self, *args, **given):
        super().__init__(*args, **given)
        self.turned = 0

    def readings(self) -> dict[str, float]:
        return {"turned": float(self.turned)}

    @command(attended=True)
    def turn(self) -> None:
        "Turn while somebody holds a key."
        while True:
            self.sleep(0.05)
            self.turned += 1
"""


def say(*words: str | Path, code: int = exit_codes.DONE) -> Any:
    done = robotree("--realm", "cell", *words, "--json")
    assert done.returncode == code, done.stderr
    return json.loads(done.stdout) if done.stdout.strip() else None


def up(terminals: list[Terminal], *agents: tuple[str, ...]) -> None:
    """Start agents, each in a terminal, and wait until they are there."""
    crew = [Sitting("cell", *words) for words in agents]
    terminals += crew
    for each in crew:
        each.shows(b"ready ")


def by_name(found: list[dict[str, Any]], name: str) -> dict[str, Any]:
    return next(each for each in found if each["robot"] == name)


def test_the_lever_is_closed_by_two_operators_with_one_hand_over(terminals: list[Terminal]) -> None:
    address = f"tcp:127.0.0.1:{free_port()}"
    up(
        terminals,
        ("sim", "arm", "--listen", address, "--state", "none", "--speedup", "4", "--open"),
        ("lookup", "l1"),
        ("host", "h1"),
        ("proxy", "arm", "arm-1", "--connect", address, "--open"),
    )
    anna = Sitting("cell", "supervise")
    terminals.append(anna)
    anna.shows(b"arm-1")
    say("create", EXAMPLES / "move_to.py", "as", "mover")
    say("create", EXAMPLES / "open_close_lever.py", "as", "lever")
    say("enslave", "mover.arm", "arm-1")
    say("enslave", "lever.mover", "mover")
    ben = Sitting("cell", "supervise")
    terminals.append(ben)
    ben.shows(b"lever")
    anna.types(f":control get lever{ENTER}", sees="you have control of lever")
    ben.types(f":call lever.close{ENTER}", sees=f"{anna.name} has control of lever; ask for it")
    anna.types(f":call lever.open{ENTER}", sees="lever")
    anna.shows(b"is done", b"open by", b"lever.open")
    anna.shown = b""
    ben.types(f":say may I have the lever?{ENTER}", sees="")
    anna.shows(b"says: may I have the lever?")
    ben.types(f":control ask lever{ENTER}", sees="is asked for control of lever")
    anna.shows(f"{ben.name} asks for control of lever".encode())
    held = say("who")
    assert {each["person"] for each in held["operators"]} == {anna.name, ben.name}
    assert by_name(held["control"], "lever")["operator"] == anna.name
    assert by_name(held["control"], "lever")["wanted_by"] == ben.name
    ben.shown = b""
    anna.types(f":control offer lever{ENTER}", sees="has control of lever")
    ben.shows(b"you have control of lever")
    ben.types(f":call lever.close{ENTER}", sees="lever")
    deadline = time.monotonic() + 3 * PATIENCE  # a simulated arm moves as fast as the machine computes
    while (lever := say("show", "lever"))["calls"].get("close", 0) < 1 or lever.get("busy"):
        assert time.monotonic() < deadline
        time.sleep(EACH)
    anna.types(f":call lever.open{ENTER}", sees=f"{ben.name} has control of lever; ask for it")
    ben.leave()
    deadline = time.monotonic() + 60
    while say("who")["control"]:
        assert time.monotonic() < deadline, "who vanishes loses what was theirs"
        time.sleep(EACH)
    assert "lever.close" not in say("who")["operators"]


def test_a_held_key_at_the_screen_and_at_the_command_line_and_none_in_a_session(
    terminals: list[Terminal], tmp_path: Path
) -> None:
    (tmp_path / "saw.py").write_text(SAW)
    up(terminals, ("lookup", "l1"), ("host", "h1"))
    deadline = time.monotonic() + 60
    while robotree("--realm", "cell", "create", tmp_path / "saw.py", "as", "saw").returncode:
        assert time.monotonic() < deadline
        time.sleep(EACH)

    def turned() -> float:
        return float(say("show", "saw")["readings"]["turned"])

    (tmp_path / "a.session").write_text("try call saw.turn\nexpect refused NobodyAttends\n")
    say("run", tmp_path / "a.session")
    refused = robotree("--realm", "cell", "call", "saw.turn")
    assert refused.returncode == exit_codes.REFUSED
    assert refused.stderr.count("\n") == 1
    assert "goes on only while somebody holds a key" in refused.stderr
    assert turned() == 0
    line = Sitting("cell", "call", "saw.turn")
    terminals.append(line)
    line.shows(b"goes on while you hold a key")
    time.sleep(2.5)  # longer than a command goes on without a key
    assert turned() == 0, "before the first key nothing moves"
    for _ in range(30):
        line.presses("k")
        time.sleep(0.1)
    assert turned() > 20
    line.shows(b"nobody has held a key for 2 s")
    line.wait()
    screen = Sitting("cell", "supervise")
    terminals.append(screen)
    screen.shows(b"saw")
    before = turned()
    screen.types(f":call saw.turn{ENTER}", sees="Hold any letter")
    for _ in range(30):
        screen.presses("k")
        time.sleep(0.1)
    assert turned() > before + 20
    os.kill(screen.pid, signal.SIGSTOP)
    deadline = time.monotonic() + 60
    while say("show", "saw").get("busy"):
        assert time.monotonic() < deadline, "a screen that is stopped holds no key"
        time.sleep(EACH)
    os.kill(screen.pid, signal.SIGCONT)
