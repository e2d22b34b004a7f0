"""The wheel of this checkout, and environments to install it into."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import venv
from pathlib import Path

from tests.command_line import ran

ROOT = Path(__file__).parents[1]
WAY_OUT = ("PIP_", "UV_", "SSL_", "HTTP", "http", "NO_PROXY", "no_proxy")
"""Beginnings of the variables that say how this machine reaches a package index."""


def run(
    *words: str | Path, code: int = 0, limit: float = 500, **env: str
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end, and see that it ends with a code, before a limit [s]."""
    done = ran(words, within=limit, env={**os.environ, **env})
    assert done.returncode == code, done.stdout[-3000:] + done.stderr[-3000:]
    return done


def build(folder: Path) -> Path:
    """Build the wheel from a copy in a folder, so that the tree stays as it is; return its file."""
    source = folder / "source" / "robotree"
    listing = run("git", "-C", ROOT, "ls-files", "--cached", "--others", "--exclude-standard")
    for name in listing.stdout.splitlines():
        if (ROOT / name).is_file() and not (ROOT / name).is_symlink():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, source / name)
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", folder / "dist", source)
    return next((folder / "dist").glob("*.whl"))


def environment(folder: Path, *wanted: str | Path) -> Path:
    """Make an environment, install what `uv pip install` is given; return its programs' folder."""
    venv.create(folder, with_pip=False)
    install(folder / "bin", *wanted)
    return folder / "bin"


def install(programs: Path, *wanted: str | Path) -> None:
    """Install what `uv pip install` is given into an environment."""
    run(uv(), "pip", "install", "--quiet", "--python", programs / "python", *wanted)


def uv() -> str:
    """Return the program that `make setup` installs packages with."""
    found = shutil.which("uv") or shutil.which("uv", path=Path(sys.executable).parent)
    assert found, "`make setup` provides uv"
    return found
