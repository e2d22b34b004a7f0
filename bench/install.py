"""What an installation takes: size and time of the core and of each extra, each in an environment of its own.

    python bench/install.py

Each is installed with uv from the local wheel and the versions of requirements.lock, once without a cache,
which measures the network too, and once more from uv's cache. Sizes are of the files, without the empty
environment.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from robotree.vr.base.extras import MODULES
from tests.wheel import ROOT, build, environment


def size(folder: Path) -> float:
    """Return the size of all files below a folder [MB]."""
    return sum(path.lstat().st_size for path in folder.rglob("*") if path.is_file()) / 1e6


def installed(wheel: Path, extra: str, *options: str) -> tuple[float, float]:
    """Install the core with one extra; return its size [MB] and the time that it took [s]."""
    with tempfile.TemporaryDirectory() as folder:
        empty, full = Path(folder, "empty"), Path(folder, "full")
        environment(empty, "--dry-run", wheel)
        wanted = f"{wheel}[{extra}]" if extra else str(wheel)
        began = time.monotonic()
        environment(full, *options, "--constraints", ROOT / "requirements.lock", wanted)
        return size(full) - size(empty), time.monotonic() - began


def main() -> None:
    """Print one line for each."""
    with tempfile.TemporaryDirectory() as folder:
        wheel = build(Path(folder))
        for extra in ("", *MODULES, "all"):
            megabytes, fresh = installed(wheel, extra, "--no-cache")
            _, again = installed(wheel, extra)
            print(f"| {f'`[{extra}]`' if extra else 'core'} | {megabytes:.0f} | {fresh:.1f} | {again:.1f} |")


if __name__ == "__main__":
    main()
