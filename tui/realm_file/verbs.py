"""`robotree save FILE` and `robotree apply FILE`.

robotree save cell.yaml
robotree save cell.yaml --force
robotree apply cell.yaml --dry-run
robotree apply cell.yaml
"""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from robotree import files
from robotree.client.joining import joined
from robotree.tui import exit_codes
from robotree.tui.errors import BadRealmFile, ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.processes.detached import start_detached
from robotree.tui.processes.realm import anybody_met, nothing_to_ask
from robotree.tui.processes.restarting import StartedLine, note_started
from robotree.tui.processes.state_files import kept_hosts
from robotree.tui.realm_file.applying import Done, bring_about
from robotree.tui.realm_file.content import NAMELESS, ProcessEntry, RealmFile
from robotree.tui.realm_file.pages import pages_of
from robotree.tui.realm_file.plan import Plan, plan
from robotree.tui.realm_file.present import Controller, Present, controllers, keep_controller, present
from robotree.tui.realm_file.reading import Kinds, read_file
from robotree.tui.realm_file.saving import saved
from robotree.tui.realm_file.writing import write_file
from robotree.tui.terminal import answer, aside, complain, note, typed
from robotree.vr.base.address import ROLES

LARGEST = 1_000_000
"""[bytes] of a realm file."""
MARKS = {"done": "✓", "failed": "✗", "kept back": "·"}
"""Before a step, by what became of it."""


class Detached:
    """Starts processes that go on when this one ends."""

    def __init__(self, realm: str) -> None:
        """Take the realm in which they live."""
        self._realm = realm

    @property
    def controllers(self) -> Mapping[str, Controller]:
        return controllers(self._realm)

    async def start(self, entry: ProcessEntry, words: Sequence[str], environment: Mapping[str, str]) -> str:
        name = f"{entry.verb}-{entry.name}".replace(" ", "-")
        started = await asyncio.to_thread(start_detached, self._realm, name, words, environment)
        line = StartedLine(list(words), dict(environment))
        await asyncio.to_thread(note_started, self._realm, entry.verb, entry.name, line)
        if entry.verb == NAMELESS:
            keep_controller(self._realm, entry.name, Controller(started.process.pid, started.address))
        return started.address


# -- save ------------------------------------------------------------------------------------------


async def save(line: Line, realm: str) -> int:
    """Write what runs in a realm into a file.

    Args:
        line: understood.
        realm: which.

    Returns:
        The exit code.
    """
    path = Path(os.path.expanduser(line.text("FILE")))  # noqa: ASYNC240, PTH111 # no file is opened
    if not line.flag("--force") and await asyncio.to_thread(path.is_file):
        raise ValueRefused("FILE", f"{path} is there already; give another name, or --force to replace it")
    if not anybody_met(realm):
        raise nothing_to_ask(realm)
    async with joined(realm) as realm_client:
        if not any(realm_client.directory.present(role) for role in ROLES):
            raise nothing_to_ask(realm)
        there = await present(realm_client, controllers(realm))
    found, notes = await asyncio.to_thread(saved, there, path)
    comment = (
        f"Realm {realm}, written by `robotree save`; `robotree apply {path.name}` brings it about again."
    )
    await asyncio.to_thread(files.replace, path, write_file(found, comments=[comment]).encode())
    count = f"{len(found.processes)} processes, {len(found.robots)} virtual robots"
    data = {"file": str(path), "processes": len(found.processes), "robots": len(found.robots), "notes": notes}
    answer(f"{path}  {count}", lambda: data)
    for one in notes:
        complain(one)
    return exit_codes.NOBODY if there.silent else exit_codes.DONE


# -- apply -----------------------------------------------------------------------------------------


async def apply(line: Line, realm: str, kinds: Kinds) -> int:
    """Bring about what a file says.

    Args:
        line: understood.
        realm: in which.
        kinds: of controllers and proxies that there are.

    Returns:
        The exit code.
    """
    path, dry = line.text("FILE"), line.flag("--dry-run")
    wanted = await asyncio.to_thread(read_realm_file, path, kinds)
    pages = await asyncio.to_thread(pages_of, wanted)
    prune, starter = line.flag("--prune"), Detached(realm)
    if dry and not anybody_met(realm):  # joining would leave an empty folder behind
        nobody = Present(realm=realm, controllers=starter.controllers, keepers=kept_hosts(realm))
        found = plan(wanted, nobody, pages, prune=prune)
        _show(found)
        return _tell(found, [], dry=True)

    async def agree(found: Plan) -> None:
        _show(found)
        if prune and not line.flag("--yes"):
            await _confirm(found)

    async with joined(realm) as realm_client:
        if dry:
            found = plan(wanted, await present(realm_client, starter.controllers), pages, prune=prune)
            _show(found)
            return _tell(found, [], dry=True)
        found, done = await bring_about(wanted, pages, realm_client, starter, _report, agree, prune=prune)
    return _tell(found, done, dry=False)


def read_realm_file(path: str, kinds: Kinds | None = None) -> RealmFile:
    """Read a realm file from the disk; see `reading.read_file`. Blocks.

    Raises:
        BadRealmFile: it cannot be read, or something in it cannot be meant.
    """
    try:
        text = files.text(Path(path).expanduser(), LARGEST)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise BadRealmFile(path, 0, f"it cannot be read: {reason}") from None
    return read_file(text, path, kinds)


async def _confirm(found: Plan) -> None:
    """Ask a person whether what the file does not name may be ended.

    Raises:
        ValueRefused: it may not, or nobody can be asked.
    """
    ending = [step.text for step in found.steps if step.sign == "-"]
    if not ending:
        return
    if not sys.stdin.isatty():
        raise ValueRefused("--prune", "give --yes, too, where nobody can be asked; nothing was ended")
    note(f"this ends what is marked with -: {len(ending)}. Type yes to go on:")
    if (await typed()).strip() != b"yes":
        raise ValueRefused("--prune", "nothing was ended")


# -- what people and programs are told -------------------------------------------------------------


def _show(found: Plan) -> None:
    for step in found.steps:
        aside(step.described)
    for one in found.left:
        aside(f"  {one}")


def _report(done: Done) -> None:
    aside(f"{MARKS[done.outcome]} {done.step.text}{': ' + done.reason if done.reason else ''}")


def _tell(found: Plan, done: Sequence[Done], *, dry: bool) -> int:
    """Print what came of a plan, and return the exit code."""
    bad = [one for one in done if one.outcome != "done"]
    ok = not bad and not found.against
    if not found.steps:
        text = "nothing to change"
    elif dry:
        text = f"{len(found.steps)} steps; nothing was changed (--dry-run)"
    else:
        text = f"{len(done) - len(bad)} of {len(done)} steps are done"
    text += f"; not in the file, and left as it is: {len(found.left)} (--prune ends it)" if found.left else ""
    outcomes = {one.step.text: one for one in done}
    data: dict[str, Any] = {
        "ok": ok,
        "changed": len(done) - len(bad),
        "steps": [
            {
                "sign": step.sign,
                "line": step.text,
                "outcome": outcomes[step.text].outcome if step.text in outcomes else "planned",
                "reason": outcomes[step.text].reason if step.text in outcomes else "",
            }
            for step in found.steps
        ],
        "left": list(found.left),
        "against": list(found.against),
    }
    answer(text, lambda: data)
    for one in found.against:
        complain(one)
    return exit_codes.DONE if ok else exit_codes.REFUSED
