"""The wheel, installed alone, is the whole product; without extras it runs robots and hosts."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import shlex
import struct
import subprocess
import sys
import termios
import threading
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.metadata import requires
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from PIL import Image, ImageChops

from robotree.protocol.tools.capture.mcap import McapWriter
from robotree.tui.line.actions import ACTIONS
from tests.command_line import ran
from tests.wheel import ROOT, build, environment, install, run, uv

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
        return ran([installed / "robotree", *words], cwd=tmp_path, within=120, env=environment)

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


# -- the core alone: a verb that needs more says so in one sentence -------------------------------

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


@pytest.mark.soak
def test_the_core_has_nothing_of_an_extra(core: Path) -> None:
    code = "from robotree.vr.base.extras import MODULES as m; from importlib.util import find_spec as f\n"
    code += "print([one for all in m.values() for one in all if f(one)])"
    assert run(core / "python", "-c", code).stdout.strip() == "[]"


@pytest.mark.soak
def test_the_test_kit_without_its_extra_names_the_command_that_installs_it(core: Path) -> None:
    said = run(core / "python", "-c", "from robotree.testing import rehearse", code=1).stderr.splitlines()[-1]
    assert said.startswith(
        "ImportError: greenlet and pytest (robotree[testing]) is not installed; install it: `"
    )


@pytest.mark.soak
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


@pytest.mark.soak
@pytest.mark.usefixtures("place")
def test_a_verb_without_its_extra_names_the_command_that_installs_it(core: Path) -> None:
    for action in ACTIONS:
        words = shlex.split(next(iter(action.examples), action.verb))
        for extra in action.needs:
            said = said_without(core / "robotree", *words)
            assert said.startswith(f"robotree: `robotree {action.verb}` needs "), said
            assert said.endswith(f"'robotree[{extra}]'`")
            assert len(said.splitlines()) == 1


@pytest.mark.soak
@pytest.mark.usefixtures("place")
def test_an_option_that_needs_an_extra_says_so_too(core: Path, tmp_path: Path) -> None:
    recording = tmp_path / "a.mcap"
    with recording.open("wb") as file:
        writer = McapWriter(file)
        writer.write(0, b"\xfd" + bytes(11))
        writer.close()
    for words in (("decode", recording), ("decode", recording, "--xml", recording)):
        assert "(robotree[wire]); install it: " in said_without(core / "robotree", "wire", *words)


@pytest.mark.soak
@pytest.mark.usefixtures("place")
def test_the_command_that_is_named_installs_the_extra(wheel: Path, tmp_path: Path) -> None:
    programs = core_alone(tmp_path, wheel)
    check = (programs / "robotree", "rules", "check", "examples/guide.yaml")
    command = said_without(*check).split("`")[-2]
    run(uv(), *shlex.split(command.removeprefix("uv ")), "--constraints", ROOT / "requirements.lock")
    assert "is good" in run(*check).stdout
