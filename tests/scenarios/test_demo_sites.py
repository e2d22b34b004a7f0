"""The demo of several machines, played by the real processes without a person."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robotree.tui import exit_codes
from robotree.tui.cli import main
from tests.command_line import robotree


@pytest.mark.speed  # the hub must be back before a lease of 5 s ends, which beside other tests it is not
@pytest.mark.timeout(400)
@pytest.mark.usefixtures("place")
def test_the_lever_is_closed_from_another_site_while_the_hub_between_them_is_killed() -> None:
    played = robotree("demo", "sites", "--headless", "--delay", "150", "--speedup", "4", within=300)
    assert played.returncode == exit_codes.DONE, played.stdout[-2000:] + played.stderr[-2000:]
    verdict = json.loads(played.stdout.splitlines()[-1])
    assert verdict["ok"] is True
    assert (verdict["delay_ms"], verdict["hub_kills"]) == (150, 1)
    assert (verdict["twice"], verdict["lost"], verdict["doubts"], verdict["trouble"]) == (0, 0, 0, "")
    assert verdict["lever_angle_rad"] > 0.75
    assert 0 < verdict["peak_force_n"] < 35
    assert {"lever", "mover", "plant:arm-1"} <= set(verdict["stopped"])
    assert verdict["stop_s"] > 0.3, "an order goes there and its confirmation comes back"
    assert not Path(played.stderr.partition("XDG_RUNTIME_DIR=")[2].partition(" ")[0]).exists()


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["sites", "--delay", "301"], "from 0 to 300"),
        (["sites", "--delay", "soon"], "from 0 to 300"),
        (["sites", "--can"], "course of its own"),
        (["--delay", "150"], "only `demo sites`"),
        (["plant"], "cell, companion, sites"),
    ],
)
def test_what_the_demo_cannot_do_is_refused_before_anything_begins(
    words: list[str], reason: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", *words, "--headless"]) != exit_codes.DONE
    assert reason in capsys.readouterr().err
