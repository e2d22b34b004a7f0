"""`robotree demo compose --headless`: a cup is carried once by hand, and twice by the page made of that."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from tests.command_line import ROBOTREE

# minutes of a simulated arm; tests/tui/composing has the parts of it in virtual time
pytestmark = [pytest.mark.soak, pytest.mark.e2e, pytest.mark.timeout(660)]


def test_one_showing_becomes_a_page_that_carries_the_cup_also_from_another_place(tmp_path: Path) -> None:
    words = (*ROBOTREE, "demo", "compose", "--headless", "--speedup", "4", "--pictures", str(tmp_path))
    played = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False, cwd=tmp_path)
    verdict = json.loads(played.stdout.splitlines()[-1])
    assert verdict["ok"], played.stderr
    assert verdict["moved"]
    assert verdict["moved_again"]
    assert verdict["lines"] <= 40
    assert verdict["steps"] < verdict["shown"] / 3
    assert {"cup.py", "cup.panel.yaml", "test_cup.py"} <= {path.name for path in tmp_path.iterdir()}
