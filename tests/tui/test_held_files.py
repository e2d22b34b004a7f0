"""What a process needs before it begins: its own file of leases, and descriptors for its event loop."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import pytest

from robotree.tui import exit_codes
from robotree.tui.errors import StateInUse
from robotree.tui.processes.state_files import kept_by_one
from tests.command_line import ROBOTREE, ran, robotree


def test_two_controllers_do_not_share_a_file_of_leases(tmp_path: Path) -> None:
    file = tmp_path / "fence.json"
    with kept_by_one(file):
        with (
            pytest.raises(StateInUse, match=f"a controller that runs keeps its leases in {file}; end it"),
            kept_by_one(file),
        ):
            pytest.fail("it begins")
        with kept_by_one(tmp_path / "other.json"), kept_by_one(None):
            pass
        words = ("sim", "rover", "--listen", "tcp:127.0.0.1:0", "--state", file)
        said = robotree(*words)
        assert said.returncode == exit_codes.REFUSED
        assert said.stderr.strip().endswith("and another --state FILE"), said.stderr
        assert not file.exists(), "nothing has begun"
    with kept_by_one(file):
        pass  # the next one may have it


@pytest.mark.usefixtures("place")
@pytest.mark.parametrize("free", [5, 6, 8, 10])
def test_a_stop_with_hardly_any_descriptor_says_only_what_a_person_can_use(free: int) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_NOFILE, (free, free))

    said = ran([*ROBOTREE, "stop"], preexec_fn=limit, within=60)
    *reason, nobody = said.stderr.splitlines()
    because = "robotree: the stop asks one process after another, because too many open files"
    assert reason == [because] or (not reason and free > 5)
    assert nobody.startswith("robotree: nobody is in realm 'default'")
    assert said.returncode == exit_codes.NOBODY


@pytest.mark.parametrize(
    ("module", "extra", "line"),
    [
        ("greenlet", "testing", "from robotree.testing import Fake"),
        ("mujoco", "sim", "from robotree.testing import cell; cell('arm')"),
    ],
)
def test_the_test_kit_without_an_extra_names_the_command_that_installs_it(
    module: str, extra: str, line: str
) -> None:
    code = f"import sys; sys.modules['{module}'] = None\n{line}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    last = done.stderr.strip().splitlines()[-1]
    assert last.startswith(f"ImportError: {module} (robotree[{extra}]) is not installed; install it: `"), last
    assert last.endswith(f"'robotree[{extra}]'`")
