"""`make setup` on a stranger's machine, and the README's two commands on a minimal Debian testing.

That has the newest Python of all systems. The machine is a folder of debootstrap's with the last commit of
this checkout; its processes have mounts and process numbers of their own, so nothing is left of them when a
command has ended. On a system without what no wheel brings, the verbs name the package to install before
they begin.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

import pytest

from tests.command_line import ran
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
    uv = ran([str(clone / ".venv/bin/uv"), "--version"], check=True)
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


ROBOTREE = Path(sys.executable).with_name("robotree")


def hidden() -> tuple[str, ...]:
    """Return the beginning of a line that runs a program without libgomp; skip the test if there is none."""
    lines = subprocess.run(["/sbin/ldconfig", "-p"], capture_output=True, text=True, check=False).stdout
    files = [line.split(" => ")[1] for line in lines.splitlines() if "libgomp.so.1 " in line]
    hide = "; ".join(f"mount --bind /dev/null {file}" for file in files)
    begin = ("unshare", "--user", "--map-root-user", "--mount", "sh", "-ec", f'{hide}\nexec "$@"', "sh")
    if not shutil.which("unshare") or subprocess.run([*begin, "true"], check=False).returncode:
        pytest.skip("this machine lets nobody make a mount namespace")
    return begin


@pytest.mark.e2e
@pytest.mark.usefixtures("place")
def test_a_missing_library_of_the_system_is_named_with_its_package() -> None:
    begin = hidden()
    for words in (["sim", "arm", "--listen", "tcp:127.0.0.1:0"], ["demo", "--headless"]):
        said = run(*begin, ROBOTREE, *words, code=1).stderr.strip()
        assert said == (
            f"robotree: `robotree {words[0]}` needs the system's library libgomp.so.1; "
            "install it: `apt-get install libgomp1`"
        )
    found = json.loads(run(*begin, ROBOTREE, "doctor", "--json", code=1).stdout)["checks"]
    (bad,) = (one for one in found if one["check"] == "extras" and one["grade"] == "bad")
    assert (bad["result"], bad["remedy"]) == (
        "robotree[sim] needs the system's library libgomp.so.1, which is not there",
        "apt-get install libgomp1",
    )
    at_setup = run(*begin, sys.executable, "-m", "robotree.tui.line.installed").stderr
    assert at_setup.strip().endswith("libgomp.so.1 is not installed; install it: `apt-get install libgomp1`")


# -- a fresh machine ---------------------------------------------------------------------------------

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


@pytest.mark.soak
@pytest.mark.e2e
@pytest.mark.timeout(7200)
def test_make_demo_names_the_one_package_that_is_missing_and_then_plays(machine: Path) -> None:
    without = at(machine, "make", "demo", code=2)
    (command,) = set(re.findall(r"install it: `(.*?)`", without.stderr))
    assert command == "apt-get install libgomp1"
    at(machine, "apt-get", "-o", "Acquire::Check-Valid-Until=false", "update")  # a mirror may be late
    at(machine, *shlex.split(command), "--yes")
    verdict = json.loads(at(machine, "make", "demo").stdout.splitlines()[-1])
    assert verdict["ok"] is True
    assert verdict["lever_angle_rad"] > 0.75


@pytest.mark.soak
@pytest.mark.e2e
@pytest.mark.timeout(7200)
def test_make_test_is_green(machine: Path) -> None:
    played = at(machine, "make", "test", limit=LONGEST_SUITE)
    assert len(re.findall(r"=+ \d+ passed", played.stdout)) == 2, (
        "the suite, and what measures speed after it"
    )
