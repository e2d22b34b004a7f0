"""The companion's evening, played by the real processes without a person."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from tests.command_line import ROBOTREE


@pytest.mark.soak
@pytest.mark.e2e
@pytest.mark.timeout(900)
def test_an_evening_with_three_visitors_ends_well(tmp_path: Path) -> None:
    runtime = tmp_path / "run"
    runtime.mkdir(mode=0o700)
    home = {"XDG_RUNTIME_DIR": str(runtime), "XDG_STATE_HOME": str(tmp_path / "state")}
    words = (*ROBOTREE, "demo", "companion", "--headless", "--speedup", "3")
    played = subprocess.run(
        (*words, "--pictures", str(tmp_path / "pictures")),
        env={**os.environ, **home},
        capture_output=True,
        text=True,
        check=False,
    )
    verdict = json.loads(played.stdout.splitlines()[-1])
    assert played.returncode == 0, played.stderr
    assert verdict["ok"]
    assert (verdict["greeted"], verdict["cups"], verdict["dropped"], verdict["left_early"]) == (3, 2, 1, 1)
    assert (verdict["role_changes"], verdict["stops"], verdict["refused"]) == (1, 1, 3)
    assert (verdict["interrupted"], verdict["spoken"]) == (1, "by mouth and ears")
    assert (verdict["orders"], verdict["errands"], verdict["chosen"]) == (1, 1, "cart-2")
    assert verdict["because"].startswith("cart-2 is free"), verdict["because"]
    assert "cart-1 carries out move" in verdict["because"], "it was asked for a bid, too"
    assert verdict["peak_force_n"] < 60
