"""The controller in JavaScript, made as its README says: node-mavlink from npm, once, and the messages."""

from __future__ import annotations

import fcntl
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "examples" / "controller_js"
NODE, NPM, MAKE = (shutil.which(name) for name in ("node", "npm", "make"))


def made(folder: Path) -> list[str]:
    """Make the controller in a clean folder; returns how it is started. The test is skipped without node."""
    if NODE is None or NPM is None or MAKE is None:
        pytest.skip("there is no node, no npm or no make here")
    with (SOURCE / ".npmrc").open() as lock:  # several processes run tests
        fcntl.flock(lock, fcntl.LOCK_EX)
        _make(SOURCE, "node_modules/.ready")
    for name in ("controller.js", "rules.js", "package.json", "Makefile"):
        shutil.copy(SOURCE / name, folder)
    (folder / "node_modules").symlink_to(SOURCE / "node_modules")
    _make(folder, "robotree.js", f"ROBOTREE={sys.executable} -m robotree.tui")
    return [NODE, str(folder / "controller.js")]


def _make(folder: Path, *words: str) -> None:
    done = subprocess.run([str(MAKE), "-C", folder, *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
