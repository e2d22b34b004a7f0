"""The thesis' chapter 4.2, played by the real processes from one command."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from PIL import Image, ImageChops

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(300)]


def test_one_command_closes_the_lever(tmp_path: Path) -> None:
    runtime = tmp_path / "run"
    runtime.mkdir(mode=0o700)
    done = subprocess.run(
        [sys.executable, "-m", "robotree.tui", "demo", "--headless", "--pictures", str(tmp_path)],
        env={**os.environ, "XDG_RUNTIME_DIR": str(runtime)},
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    verdict = json.loads(done.stdout.splitlines()[-1])
    assert verdict["ok"] is True
    assert verdict["lever_angle_rad"] > 0.75
    assert 0 < verdict["peak_force_n"] < 35
    assert verdict["wall_s"] > 0
    with Image.open(tmp_path / "before.jpg") as before, Image.open(tmp_path / "after.jpg") as after:
        assert ImageChops.difference(before, after).getbbox(), "the lever moved, so the pictures differ"
