"""The wheel, installed alone, is the whole product."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import shlex
import struct
import subprocess
import termios
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
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


@pytest.fixture
def demo(
    installed: Path, tmp_path: Path, place: Path
) -> Iterator[Callable[..., subprocess.CompletedProcess[str]]]:
    """The demo on a terminal, in an empty folder; gives what runs `robotree` in a second terminal there."""
    screen, inside = os.openpty()
    fcntl.ioctl(inside, termios.TIOCSWINSZ, struct.pack("HHHH", 40, 140, 0, 0))
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(place), "PYTHONPATH": "", "TERM": "xterm-256color"}

    def type_line(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [installed / "robotree", *words],
            cwd=tmp_path,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
            timeout=120,
            env=environment,
        )

    process = subprocess.Popen(
        [installed / "robotree", "demo"],
        cwd=tmp_path,
        stdin=inside,
        stdout=inside,
        stderr=inside,
        env=environment,
    )
    os.close(inside)

    def draw() -> None:
        with contextlib.suppress(OSError):  # the terminal is gone with its program
            while os.read(screen, 65536):
                pass

    drawing = threading.Thread(target=draw)
    drawing.start()
    latest = time.monotonic() + 120
    while not {"arm-1", "rover-1"} <= set(type_line("ls").stdout.split()):
        assert time.monotonic() < latest, "the demo lists no robots"
        time.sleep(0.5)  # each question is a process, beside those that begin
    yield type_line
    process.terminate()
    process.wait(60)
    drawing.join()
    os.close(screen)


def test_a_newcomer_follows_the_first_chapter_in_an_empty_folder(
    demo: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    chapter = (ROOT / "docs" / "guide" / "first-robot.md").read_text()
    ((name, body),) = re.findall(r"^```python (\w+\.py)\n(.*?)^```$", chapter, re.MULTILINE | re.DOTALL)
    (tmp_path / name).write_text(body)
    typed = re.findall(r"^robotree (.*)$", chapter, re.MULTILINE)
    assert typed[0] == "demo"
    for line in typed[1:]:
        words, _, remark = line.partition("#")
        done = demo(*shlex.split(words))
        assert (done.returncode == 0) == ("refused" not in remark), f"{line}: {done.stderr}"
    assert {"waver.py", "test_waver.py"} <= {path.name for path in tmp_path.iterdir()}
    assert "greeter" not in demo("ls").stdout


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
