"""The wheel, installed alone, is the whole product."""

from __future__ import annotations

import json
import re
import zipfile
from pathlib import Path

import pytest
from PIL import Image, ImageChops

from tests.wheel import ROOT, build, environment, run

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(540)]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("wheel"))


def test_nothing_but_robotree_lands_in_site_packages(wheel: Path) -> None:
    roots = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {root for root in roots if not root.endswith(".dist-info")} == {"robotree"}


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The programs of an environment with the wheel and all its extras."""
    lock = ROOT / "requirements.lock"
    return environment(tmp_path_factory.mktemp("env"), "--constraints", lock, f"{wheel}[all]")


def test_an_author_tests_a_page_of_the_guide_in_an_empty_folder(installed: Path, tmp_path: Path) -> None:
    guide = (ROOT / "docs" / "guide" / "tests.md").read_text()
    name, body = re.findall(r"^```python (test_\w+\.py)\n(.*?)^```$", guide, re.MULTILINE | re.DOTALL)[0]
    (tmp_path / name).write_text(body)
    done = run(installed / "python", "-m", "pytest", "-q", "--rootdir", tmp_path, tmp_path, PYTHONPATH="")
    assert "1 passed" in done.stdout
    shown = run(
        installed / "python", "-m", "pytest", "--help", "--rootdir", tmp_path, tmp_path, PYTHONPATH=""
    )
    assert "--robotree-seed" in shown.stdout


def test_the_wheel_alone_closes_the_lever_with_one_command(
    installed: Path, tmp_path: Path, place: Path
) -> None:
    """The thesis' chapter 4.2, played by real processes."""
    done = run(
        *(
            installed / "robotree",
            "demo",
            "--speedup",
            "6",
            "--pictures",
            tmp_path,
        ),  # without a terminal
        XDG_RUNTIME_DIR=str(place),
        PYTHONPATH="",
    )
    verdict = json.loads(done.stdout.splitlines()[-1])
    assert verdict["ok"] is True
    assert verdict["lever_angle_rad"] > 0.75
    assert 0 < verdict["peak_force_n"] < 35
    assert verdict["wall_s"] > 0
    with Image.open(tmp_path / "before.jpg") as before, Image.open(tmp_path / "after.jpg") as after:
        assert ImageChops.difference(before, after).getbbox(), "the lever moved, so the pictures differ"
