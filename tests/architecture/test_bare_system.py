"""On a system without what no wheel brings, the verbs name the package to install before they begin."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.wheel import run

pytestmark = pytest.mark.e2e
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
