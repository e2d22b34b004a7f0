"""The wheel without extras runs robots and hosts; a verb that needs more says so in one sentence."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import requires
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from robotree.protocol.tools.capture.mcap import McapWriter
from robotree.tui.line.actions import ACTIONS
from tests.wheel import ROOT, build, environment, install, run, uv

pytestmark = [pytest.mark.soak, pytest.mark.e2e, pytest.mark.timeout(540)]
SIMULATOR = Path(sys.executable).with_name("robotree")
"""Of this checkout, with all extras: it stands for a controller, which has nothing of robotree."""


def core_packages(package: str = "robotree") -> set[str]:
    """Names of what a package needs without extras, and of what those need."""
    found: set[str] = set()
    for wanted in map(Requirement, requires(package) or []):
        name = canonicalize_name(wanted.name)
        if name not in found and (wanted.marker is None or wanted.marker.evaluate({"extra": ""})):
            found |= {name} | core_packages(name)
    return found


def core_lock() -> str:
    """The part of the lock, with its hashes, that the core needs."""
    parts = re.split(r"^(?=[a-z])", (ROOT / "requirements.lock").read_text(), flags=re.MULTILINE)
    wanted = core_packages()
    return "".join(part for part in parts if canonicalize_name(part.partition("==")[0]) in wanted)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("wheel"))


def core_alone(folder: Path, wheel: Path) -> Path:
    """Make an environment with the wheel and the core's part of the lock; return its programs' folder."""
    lock = folder / "core.lock"
    lock.write_text(core_lock())
    programs = environment(folder / "env", "--require-hashes", "--no-deps", "-r", lock)
    install(programs, "--no-deps", wheel)
    return programs


@pytest.fixture(scope="module")
def core(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return core_alone(tmp_path_factory.mktemp("core"), wheel)


@contextmanager
def agent(program: Path, *words: str) -> Iterator[str]:
    """Run an agent until the block ends; give what it says when it is ready."""
    with subprocess.Popen([program, *words], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout
            said = process.stdout.readline()
            assert said.startswith("ready")
            yield said
        finally:
            process.terminate()


def said_without(program: Path, *words: str | Path) -> str:
    """What a verb says of what it lacks: one sentence, and nothing has begun."""
    done = run(program, *words, code=1)
    assert not done.stdout
    return done.stderr.strip()


def test_the_core_has_nothing_of_an_extra(core: Path) -> None:
    code = "from robotree.vr.base.extras import MODULES as m; from importlib.util import find_spec as f\n"
    code += "print([one for all in m.values() for one in all if f(one)])"
    assert run(core / "python", "-c", code).stdout.strip() == "[]"


def test_the_test_kit_without_its_extra_names_the_command_that_installs_it(core: Path) -> None:
    said = run(core / "python", "-c", "from robotree.testing import rehearse", code=1).stderr.splitlines()[-1]
    assert said.startswith(
        "ImportError: greenlet and pytest (robotree[testing]) is not installed; install it: `"
    )


@pytest.mark.usefixtures("place")
def test_robots_hosts_and_those_who_ask_them_need_the_core_alone(core: Path, tmp_path: Path) -> None:
    robotree = core / "robotree"

    def ask(*words: str) -> Any:
        return json.loads(run(robotree, *words, "--json").stdout)

    with (
        agent(SIMULATOR, "sim", "arm", "--listen", "tcp:127.0.0.1:0", "--state", "none", "--open") as said,
        agent(robotree, "lookup", "lookup-1"),
        agent(robotree, "host", "host-1"),
        agent(robotree, "proxy", "arm", "arm-1", "--connect", said.split()[1], "--open"),
    ):
        assert [one["address"]["name"] for one in ask("ls")] == ["arm-1"]
        ask("create", "examples/move_to.py", "as", "mover")
        ask("enslave", "mover.arm", "arm-1")
        here = ask("call", "mover.get_info")
        place = {name: here[name] for name in ("x", "y", "z", "twist")}
        place["z"] += 0.02
        ask("call", "mover.move", *(f"{name}={value}" for name, value in place.items()))
        assert ask("call", "mover.get_info")["z"] == pytest.approx(place["z"], abs=0.01)
        cell = tmp_path / "cell.yaml"
        assert all("free by chance" in note for note in ask("save", str(cell))["notes"])
        assert ask("apply", str(cell)) == {"ok": True, "changed": 0, "steps": [], "left": [], "against": []}
        ask("stop")
        assert [ask("show", name)["stopped"] for name in ("arm-1", "mover")] == [True, True]
        refused = run(robotree, "call", "mover.move", *(f"{n}={v}" for n, v in place.items()), code=1)
        assert "stopped" in refused.stderr
        script = run(robotree, "create", ROOT / "examples" / "guide.yaml", "as", "guide", code=1).stderr
        assert "guide.yaml cannot be loaded: on this host clips (robotree[scripts])" in script
        assert len(script.splitlines()) == 1
        ask("resume")


@pytest.mark.usefixtures("place")
def test_a_verb_without_its_extra_names_the_command_that_installs_it(core: Path) -> None:
    for action in ACTIONS:
        words = shlex.split(next(iter(action.examples), action.verb))
        for extra in action.needs:
            said = said_without(core / "robotree", *words)
            assert said.startswith(f"robotree: `robotree {action.verb}` needs "), said
            assert said.endswith(f"'robotree[{extra}]'`")
            assert len(said.splitlines()) == 1


@pytest.mark.usefixtures("place")
def test_an_option_that_needs_an_extra_says_so_too(core: Path, tmp_path: Path) -> None:
    recording = tmp_path / "a.mcap"
    with recording.open("wb") as file:
        writer = McapWriter(file)
        writer.write(0, b"\xfd" + bytes(11))
        writer.close()
    for words in (("decode", recording), ("decode", recording, "--xml", recording)):
        assert "(robotree[wire]); install it: " in said_without(core / "robotree", "wire", *words)


@pytest.mark.usefixtures("place")
def test_the_command_that_is_named_installs_the_extra(wheel: Path, tmp_path: Path) -> None:
    programs = core_alone(tmp_path, wheel)
    check = (programs / "robotree", "rules", "check", "examples/guide.yaml")
    command = said_without(*check).split("`")[-2]
    run(uv(), *shlex.split(command.removeprefix("uv ")), "--constraints", ROOT / "requirements.lock")
    assert "is good" in run(*check).stdout
