"""The demo of an assistant, played by the real processes without a person."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from pathlib import Path

import pytest

from tests.command_line import ROBOTREE


@pytest.mark.e2e
@pytest.mark.timeout(400)
def test_an_assistant_closes_the_lever_with_one_permit_and_does_nothing_else() -> None:
    with tempfile.TemporaryDirectory(prefix="rt-") as name:
        home: dict[str, str] = {}
        for variable, part in (("XDG_RUNTIME_DIR", "run"), ("XDG_STATE_HOME", "state")):
            (Path(name) / part).mkdir(mode=0o700)
            home[variable] = str(Path(name) / part)
        played = subprocess.run(
            (*ROBOTREE, "demo", "mcp", "--headless", "--speedup", "4"),
            env={**os.environ, **home},
            capture_output=True,
            text=True,
            check=False,
        )
    assert played.returncode == 0, played.stderr
    verdict = json.loads(played.stdout.splitlines()[-1])
    assert (verdict["ok"], verdict["permits"], verdict["stray"], verdict["trouble"]) == (True, 1, 0, "")
    assert verdict["refused"] == 6
    assert verdict["moved"] > 0.3
    assert verdict["lever_angle_rad"] > 0.75
    assert "said yes" in verdict["why"]
