"""`make setup` on a stranger's machine: no uv, an empty home, and later a lock that has lost a package."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.wheel import ROOT, WAY_OUT, run

STRAY = "stray"


@pytest.fixture
def stranger(tmp_path: Path) -> dict[str, str]:
    """An environment with `make` and `python3` and nothing else."""
    tools = tmp_path / "bin"
    tools.mkdir()
    for tool in ("make", "sh", "awk", "touch", "test", "echo", "env"):
        (tools / tool).symlink_to(shutil.which(tool) or f"/bin/{tool}")
    (tools / "python3").symlink_to(Path(sys.base_prefix) / "bin" / "python3")
    (tmp_path / "home").mkdir()
    kept = {name: value for name, value in os.environ.items() if name.startswith(WAY_OUT)}
    return {**kept, "PATH": str(tools), "HOME": str(tmp_path / "home")}


def stray(clone: Path) -> Path:
    """Put a package into the clone's environment that no lock knows."""
    (site,) = (clone / ".venv" / "lib").glob("python3*/site-packages")
    folder = site / f"{STRAY}-1.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {STRAY}\nVersion: 1.0\n")
    (folder / "RECORD").write_text("".join(f"{folder.name}/{name},,\n" for name in ("METADATA", "RECORD")))
    return folder


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_setup_needs_nothing_but_make_and_python_and_keeps_to_the_lock(
    tmp_path: Path, stranger: dict[str, str]
) -> None:
    clone = tmp_path / "clone"
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)  # noqa: S607 # any git

    def make(target: str) -> None:
        done = subprocess.run(
            ["make", target],  # noqa: S607 # the stranger's
            cwd=clone,
            env=stranger,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr

    def version() -> str:
        words = [str(clone / ".venv" / "bin" / "robotree"), "--version"]
        return subprocess.run(words, env=stranger, capture_output=True, text=True, check=True).stdout

    make("setup")
    assert version().startswith("robotree ")
    pinned = next(
        one for one in (clone / "requirements.lock").read_text().splitlines() if one.startswith("uv==")
    )
    uv = subprocess.run(
        [str(clone / ".venv/bin/uv"), "--version"], capture_output=True, text=True, check=True
    )
    assert uv.stdout.split()[1] == pinned.partition("==")[2].split()[0]

    left_over = stray(clone)
    (clone / "requirements.lock").touch()
    make("setup")
    assert not left_over.exists(), "what the lock does not have goes"
    assert version().startswith("robotree "), "robotree itself stays"


def test_make_lets_python_keep_what_it_has_compiled() -> None:
    show = ("--eval", 'show: ; @echo "[$$PYTHONDONTWRITEBYTECODE]"', "show")
    shown = run("make", "--no-print-directory", "-C", ROOT, *show, PYTHONDONTWRITEBYTECODE="1")
    assert shown.stdout == "[]\n"
