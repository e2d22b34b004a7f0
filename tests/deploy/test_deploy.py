"""What `deploy` brings: systemd's units, the compose file, and the backup of docs/lab.md."""

from __future__ import annotations

import configparser
import json
import os
import re
import shlex
import shutil
import socket
import tarfile
from pathlib import Path
from typing import Any

import pytest
import yaml

from robotree.tui import exit_codes
from robotree.tui.line import manual
from robotree.tui.processes.crew import Crew
from robotree.tui.processes.serving import MANAGER, tell_the_manager
from tests.command_line import ran, within_realm

# -- the units of systemd start what the guide says, and systemd understands them -----------------

ROOT = Path(__file__).parents[2]
UNITS = sorted((ROOT / "deploy").glob("robotree*"))
SERVICES = [unit for unit in UNITS if unit.suffix == ".service"]
GUIDE = (ROOT / "docs" / "lab.md").read_text()
VALUES = {
    "${KIND}": "arm",
    "${CONNECT}": "tcp:127.0.0.1:5760",
    "${LISTEN}": "tls:0.0.0.0:7447",
    "%i": "arm-1",
    "%h": "/home/anna",
}


def sections(unit: Path) -> configparser.RawConfigParser:
    """Read a unit; a key may stand in it several times."""
    found = configparser.RawConfigParser(strict=False)
    found.optionxform = str  # type: ignore[assignment, method-assign]
    found.read_string(unit.read_text())
    return found


@pytest.mark.parametrize("unit", SERVICES, ids=lambda unit: unit.name)
def test_a_service_starts_a_line_that_robotree_understands(unit: Path) -> None:
    service = sections(unit)["Service"]
    line = service["ExecStart"]
    for name, value in VALUES.items():
        line = line.replace(name, value)
    program, *words = shlex.split(line.replace("$OPTIONS", ""))
    assert program == "/home/anna/.local/bin/robotree"
    found = manual.shell().parse(words)
    kind = unit.stem.removeprefix("robotree-").partition("@")[0]
    assert found.verb == {"realm": "apply", "space": "space serve"}.get(kind, kind)


@pytest.mark.parametrize("unit", SERVICES, ids=lambda unit: unit.name)
def test_a_service_is_started_again_when_it_crashes_and_counts_as_started_when_it_is_ready(
    unit: Path,
) -> None:
    service = sections(unit)["Service"]
    if unit.name.startswith("robotree-realm@"):
        assert (service["Type"], service["RemainAfterExit"]) == ("oneshot", "yes")
    else:
        assert (service["Type"], service["Restart"]) == ("notify", "on-failure")
        assert sections(unit)["Install"]["WantedBy"] == "robotree.target"


def test_the_guide_names_every_unit_and_every_file_that_a_unit_reads() -> None:
    for unit in UNITS:
        assert unit.name in GUIDE
        for line in unit.read_text().splitlines():
            if line.startswith("EnvironmentFile="):
                name = line.rpartition("/")[2].replace("%i", "NAME")
                assert name in GUIDE, f"{unit.name} reads {name}"


@pytest.mark.skipif(not shutil.which("systemd-analyze"), reason="systemd is not installed")
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_systemd_understands_a_unit(unit: Path, tmp_path: Path) -> None:
    """It names keys that it does not know and programs that are not there, and nothing else is said."""
    program = tmp_path / ".local" / "bin" / "robotree"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\n")
    program.chmod(0o700)
    units = tmp_path / "units"
    shutil.copytree(ROOT / "deploy", units)
    instance = units / unit.name.replace("@.", "@one.")
    done = ran(
        [str(shutil.which("systemd-analyze")), "--user", "verify", str(instance)],
        env={**os.environ, "HOME": str(tmp_path), "XDG_RUNTIME_DIR": str(tmp_path)},
    )
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("name", ["a path", "no file"])
def test_a_manager_is_told_once(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = str(tmp_path / "manager") if name == "a path" else f"@robotree-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(path.replace("@", "\0"))
        manager.setblocking(False)
        monkeypatch.setenv(MANAGER, path)
        tell_the_manager()
        assert manager.recv(100) == b"READY=1"
        assert MANAGER not in os.environ, "what it starts must not speak for it"
        tell_the_manager()
        with pytest.raises(BlockingIOError):
            manager.recv(100)


@pytest.mark.e2e
async def test_a_process_says_to_its_manager_that_it_is_up(
    place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(place / "manager"))
        monkeypatch.setenv(MANAGER, str(place / "manager"))
        async with Crew("services", place) as crew:
            await crew.start("lookup", "lookup-1")
            assert manager.recv(100) == b"READY=1"


# -- the compose file -----------------------------------------------------------------------------

COMPOSE = Path(__file__).parents[2] / "deploy" / "compose.yaml"
COMPOSED: dict[str, dict[str, Any]] = yaml.safe_load(COMPOSE.read_text())["services"]
VERBS = {"hub": "hub", "gateway": "gateway", "lookup": "lookup", "host": "host", "robot": "proxy"}
BESIDE = sorted(set(VERBS) - {"hub", "gateway"})


def test_each_service_starts_a_line_that_robotree_understands() -> None:
    lines = {name: re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", COMPOSED[name]["command"]) for name in COMPOSED}
    assert {name: manual.shell().parse(shlex.split(line)).verb for name, line in lines.items()} == VERBS


@pytest.mark.parametrize("name", BESIDE)
def test_a_process_of_a_site_shares_sockets_and_process_numbers_with_its_gateway(name: str) -> None:
    service = COMPOSED[name]
    assert service["network_mode"] == service["pid"] == "service:gateway"
    assert service["volumes"] == COMPOSED["gateway"]["volumes"]


def test_a_site_opens_no_port_and_the_hub_has_no_key_of_the_realm() -> None:
    assert [name for name, service in COMPOSED.items() if "ports" in service] == ["hub"]
    assert not set(COMPOSED["hub"]["volumes"]) & set(COMPOSED["gateway"]["volumes"])


# -- the backup: what is restored is there again, with its state, and begins stopped --------------

robotree = within_realm("backup")
COUNTER = """
from robotree.vr import VirtualRobot, command, state

class Counter(VirtualRobot):
    count: int = state(0)

    @command
    def add(self) -> int:
        self.count += 1
        return self.count
"""


async def say(*words: str) -> Any:
    code, out, err = await robotree(*words, "--json")
    assert code == exit_codes.DONE, (words, out, err)
    return json.loads(out or "null")


@pytest.mark.e2e
async def test_what_is_restored_has_its_state_and_begins_stopped(place: Path, tmp_path: Path) -> None:
    page = tmp_path / "counter.py"
    page.write_text(COUNTER)
    async with Crew("backup", place) as crew:
        await crew.start_all(("lookup", "lookup-1"), ("host", "host-1"))
        await say("create", str(page), "as", "counter")
        assert await say("call", "counter.add") == 1
        assert (await say("stop"))["stopped"] == ["counter"]
    state = Path(os.environ["XDG_STATE_HOME"], "robotree")
    with tarfile.open(tmp_path / "lab.tgz", "w:gz") as archive:
        archive.add(state, "robotree")
    shutil.rmtree(state)
    with tarfile.open(tmp_path / "lab.tgz") as archive:
        archive.extractall(state.parent, filter="data")
    async with Crew("backup", place) as crew:
        await crew.start_all(("lookup", "lookup-1"), ("host", "host-1"))
        code, _, said = await robotree("call", "counter.add")
        assert code == exit_codes.REFUSED
        assert "counter is stopped" in said
        assert await say("history", "counter", "--verify")
        assert (await say("resume"))["resumed"] == ["counter"]
        assert await say("call", "counter.add") == 2
