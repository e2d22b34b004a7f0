"""What a start of the command line loads: help must be there at once, and a list soon."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
from pathlib import Path

from robotree.tui.exit_codes import DONE, USAGE
from robotree.tui.line import actions
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.local import join

HELP = {
    "robotree": [],
    "robotree.tui": ["cli", "errors", "exit_codes", "terminal"],
    "robotree.tui.line": [
        "action", "actions", "checking", "grammar", "keys", "manual", "page_keys", "surface", "values",
    ],
    "robotree.tui.line.actions": [
        file.stem for file in Path(actions.__file__).parent.glob("*.py") if file.stem != "__init__"
    ],
    "robotree.tui.processes": ["realm"],
}  # fmt: skip
"""The modules of robotree that `--help` may load, by folder."""

LIST = {
    "robotree",
    "robotree.client.joining",
    "robotree.files",
    "robotree.tui",
    "robotree.tui.line",
    "robotree.tui.line.actions",
    "robotree.tui.processes",
    "robotree.tui.seen",
    "robotree.vr",
    "robotree.vr.author",
    "robotree.vr.base",
    "robotree.vr.core",
    "robotree.vr.exchange",
    "robotree.vr.lookup",
    "robotree.vr.network",
    "robotree.vr.supervision",
}
"""The folders of robotree of which `ls` may load modules."""

OTHERS = {"msgspec", "typing_extensions"}
"""Packages of other people that `ls` may load."""

SLOW = {"asyncio", "dataclasses", "inspect", "json", "logging", "socket", "ssl", "subprocess", "threading"}
"""Modules of Python's own that help does without: each takes milliseconds."""

NOT_FOR_A_LIST = {"ctypes", "random", "secrets", "tempfile"}
"""Modules of Python's own that are not needed to ask who is there."""

TRACED = """
import sys
bare = set(sys.modules)
from robotree.tui.cli import main
codes = [main(line.split()) for line in sys.argv[1:]]
print(codes)
print(*sorted(set(sys.modules) - bare))
"""


def traced(*lines: str) -> tuple[list[int], set[str]]:
    """Carry out lines in a process of its own; their exit codes, and what they have loaded."""
    start = [sys.executable, "-c", TRACED, *lines]
    done = subprocess.run(start, capture_output=True, text=True, check=True)
    *_, codes, modules = done.stdout.splitlines()
    return json.loads(codes), set(modules.split())


def ours(modules: set[str]) -> set[str]:
    return {module for module in modules if module.partition(".")[0] == "robotree"}


def strange(modules: set[str]) -> set[str]:
    """Packages that are neither ours nor Python's."""
    return {module.partition(".")[0] for module in modules} - sys.stdlib_module_names - {"robotree"}


def test_help_loads_the_registry_and_what_prints_it() -> None:
    codes, modules = traced("--help", "help create", "ls --help", "help wire", "fly")
    assert codes == [DONE] * 4 + [USAGE]
    allowed = {f"{folder}.{name}" for folder, names in HELP.items() for name in names} | set(HELP)
    assert ours(modules) <= allowed
    assert not strange(modules)
    assert not modules & SLOW


def test_the_version_needs_no_agents() -> None:
    codes, modules = traced("--version")
    assert codes == [DONE]
    assert not strange(modules)
    assert not {module for module in modules if module.startswith("robotree.vr")}


async def test_a_list_loads_what_asks_and_nothing_of_what_answers(place: Path) -> None:
    transport = await join("test", root=place / "robotree")
    lookup = LookupService(transport, "lookup-1")
    await lookup.start()
    codes, modules = await asyncio.to_thread(traced, "ls --realm test")
    await lookup.close()
    await transport.close()
    assert codes == [DONE], "it has met the lookup service"
    assert not {name for name in ours(modules) if not {name, name.rpartition(".")[0]} & LIST}
    assert strange(modules) <= OTHERS
    assert not modules & NOT_FOR_A_LIST
