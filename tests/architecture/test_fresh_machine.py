"""The README's two commands on a minimal Debian testing, which has the newest Python of all systems.

The machine is a folder of debootstrap's with the last commit of this checkout. Its processes have mounts and
process numbers of their own, so nothing is left of them when a command has ended.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

import pytest

from tests.wheel import ROOT, WAY_OUT, run

pytestmark = [pytest.mark.soak, pytest.mark.e2e, pytest.mark.story, pytest.mark.timeout(7200)]

MIRROR = "http://deb.debian.org/debian"
PACKAGES = "ca-certificates,git,make,python3-venv"
OWN_NETWORK = ("/etc/hosts", "/etc/pip.conf", "/etc/ssl/certs/ca-certificates.crt")
"""Files that say how this machine reaches a package index."""
APART = ("unshare", "--mount", "--pid", "--fork", "--kill-child")
ENTER = """
mount -t proc proc "$0/proc"; mount -t sysfs sys "$0/sys"
mount --rbind /dev "$0/dev"; mount -t tmpfs run "$0/run"
exec chroot "$0" env -i -C /root/robotree HOME=/root LANG=C.UTF-8 TERM=xterm PATH="$PATH" "$@"
"""
LONGEST_SUITE = 5400.0
"""[s] for `make test` on two busy cores."""


def why_not() -> str:
    """Return why no such system can be set up here, as one sentence; "": it can."""
    if os.geteuid() != 0:
        return "only root can set up a Debian by debootstrap"
    for program in ("debootstrap", "unshare"):
        if not shutil.which(program):
            return f"this machine has no {program}"
    if subprocess.run([*APART, "true"], capture_output=True, check=False).returncode:
        return "this machine lets nobody make mounts of his own"
    try:
        urlopen(f"{MIRROR}/dists/testing/Release", timeout=20).close()  # noqa: S310 # a constant
    except (URLError, OSError) as error:
        return f"{MIRROR} cannot be reached: {error}"
    return ""


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    if reason := why_not():
        pytest.skip(reason)
    root = tmp_path_factory.mktemp("fresh") / "root"
    run(
        *APART,
        "debootstrap",
        "--variant=minbase",
        f"--include={PACKAGES}",
        "testing",
        root,
        MIRROR,
        limit=1800,
    )
    for file in map(Path, OWN_NETWORK):
        if file.is_file():
            shutil.copy(file, root / file.relative_to("/"))
    run("git", "clone", "--quiet", ROOT, root / "root" / "robotree")
    yield root
    shutil.rmtree(root)


def at(machine: Path, *words: str, code: int = 0, limit: float = 900.0) -> subprocess.CompletedProcess[str]:
    """Run a command in the fresh checkout."""
    settings = [f"{name}={value}" for name, value in os.environ.items() if name.startswith(WAY_OUT)]
    path = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
    return run(*APART, "sh", "-ec", ENTER, machine, *settings, *words, code=code, limit=limit, PATH=path)


def test_make_demo_names_the_one_package_that_is_missing_and_then_plays(machine: Path) -> None:
    without = at(machine, "make", "demo", code=2)
    (command,) = set(re.findall(r"install it: `(.*?)`", without.stderr))
    assert command == "apt-get install libgomp1"
    at(machine, "apt-get", "-o", "Acquire::Check-Valid-Until=false", "update")  # a mirror may be late
    at(machine, *shlex.split(command), "--yes")
    verdict = json.loads(at(machine, "make", "demo").stdout.splitlines()[-1])
    assert verdict["ok"] is True
    assert verdict["lever_angle_rad"] > 0.75


def test_make_test_is_green(machine: Path) -> None:
    played = at(machine, "make", "test", limit=LONGEST_SUITE)
    assert len(re.findall(r"=+ \d+ passed", played.stdout)) == 2, (
        "the suite, and what measures speed after it"
    )
