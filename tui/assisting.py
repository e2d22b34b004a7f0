"""The verbs about assistants: `robotree mcp`, and the keys of those who may use it.

robotree assistant invite claude
robotree mcp --robots 'arm-*'
robotree mcp --http 7333
robotree mcp --rehearse
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import shutil
import time
from collections.abc import AsyncGenerator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from robotree.client.joining import joined
from robotree.tui import demo, exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import plain
from robotree.tui.processes.crew import Crew
from robotree.tui.processes.realm import anybody_met, nothing_to_ask
from robotree.tui.processes.state_files import needed_file
from robotree.tui.seen import wording
from robotree.tui.terminal import answer, note
from robotree.vr.base.errors import AssistantUnknown
from robotree.vr.network.policy_file import POLICY

if TYPE_CHECKING:
    from robotree.assistants.record import Entry
    from robotree.assistants.seat import Floor

NAME = re.compile(r"[A-Za-z0-9_-]{1,24}")
KEY = "ROBOTREE_MCP_KEY"
TWIN = "-twin"
"""Ends the name of the realm in which a rehearsal takes place, before the number of its process."""
NOTED = 20
"""Lines of the record of an assistant that are shown."""


# -- keys ------------------------------------------------------------------------------------------


def folder_of(realm: str) -> Path:
    """Return the folder in which a realm keeps its things.

    Raises:
        NoPlaceForState: it cannot be made.
    """
    return needed_file(realm, POLICY).parent


def invite(line: Line, realm: str) -> int:
    """Make the key of an assistant."""
    from robotree.assistants.keys import AssistantKeys
    from robotree.tui.sites.policies import expect_to_administrate, gate_of

    expect_to_administrate(realm)
    name = line.text("NAME")
    if not NAME.fullmatch(name):
        raise ValueRefused(
            "NAME", f"{name!r} cannot be the name of an assistant: up to 24 letters, digits, - and _"
        )
    key = AssistantKeys(folder_of(realm)).invite(name)
    policy = gate_of(realm).policy
    hints = [] if policy is not None and name in policy.assistants else [
        f"the policy of realm {realm} says nothing of it yet, so it may only stop: `robotree policy set FILE`"
    ]  # fmt: skip
    note(f"the key of {name}, for 90 days; it is shown only now. {' '.join(hints)}".rstrip())
    answer(key, lambda: {"assistant": name, "key": key, "realm": realm})
    return exit_codes.DONE


def revoke(line: Line, realm: str) -> int:
    """Take the key of an assistant back."""
    from robotree.assistants.keys import AssistantKeys
    from robotree.tui.sites.policies import expect_to_administrate

    expect_to_administrate(realm)
    name = line.text("NAME")
    AssistantKeys(folder_of(realm)).revoke(name)
    answer(f"the key of {name} is good no more; what it does ends within a second", lambda: {"revoked": name})
    return exit_codes.DONE


def assistants(line: Line, realm: str) -> int:
    """List the assistants that have keys, or what one has asked."""
    from robotree.assistants.keys import AssistantKeys
    from robotree.assistants.record import Record
    from robotree.tui.sites.policies import gate_of

    folder, now = folder_of(realm), time.time()
    if name := line.text("NAME"):
        if not NAME.fullmatch(name):
            raise ValueRefused("NAME", f"{name!r} cannot be the name of an assistant")
        entries = Record(folder, name).entries(NOTED)
        told_of = [_entry_row(one) for one in entries]
        text = wording.columns(told_of) if told_of else f"nothing is kept of {name}"
        answer(text, lambda: [plain(one) for one in entries])
        return exit_codes.DONE
    keys, policy = AssistantKeys(folder).all(), gate_of(realm).policy
    told = policy.assistants if policy is not None else {}
    data: list[dict[str, Any]] = [
        {
            "name": each,
            "key": each in keys and now < keys[each].ends,
            "days": round((keys[each].ends - now) / 86400) if each in keys else 0,
            "roles": [held.role for held in told[each].roles] if each in told else [],
        }
        for each in sorted({*keys, *told})
    ]
    rows = [("ASSISTANT", "KEY", "ROLES")]
    for each in data:
        key, roles = f"for {each['days']} days" if each["key"] else "none", ", ".join(each["roles"])
        rows.append((each["name"], key, roles or "none"))
    answer(wording.columns(rows) if data else "no assistant has a key", lambda: data)
    return exit_codes.DONE


def _entry_row(entry: Entry) -> tuple[str, str, str, str]:
    at = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(entry.unix))
    what = ".".join(filter(None, (entry.robot, entry.command)))
    return at, entry.became, what, entry.text or (f"«{entry.why}»" if entry.why else "")


# -- serving ---------------------------------------------------------------------------------------


async def mcp(line: Line, realm: str) -> int:
    """Serve assistants until their client closes its end, or until this is interrupted."""
    from robotree.assistants.keys import AssistantKeys
    from robotree.assistants.serving import over_http, over_stdio

    port = line.text("--http")
    if port and not (port.isdigit() and int(port) < 65536):
        raise ValueRefused("--http", "a port is a number from 0 to 65535; 0 takes one that is free")
    keys, key = AssistantKeys(folder_of(realm)), os.environ.pop(KEY, "")
    if not port:
        if not key:
            raise AssistantUnknown(detail=f"no key is in ${KEY}, and without one nobody is served over stdio")
        keys.proved(key)  # nobody joins anything before that
    if not anybody_met(realm):
        raise nothing_to_ask(realm)
    async with _floor(line, realm) as floor:
        if port:
            await over_http(
                floor, keys, int(port), lambda address: answer(f"ready {address}", lambda: {"ready": address})
            )
        else:
            await over_stdio(floor, keys, key)
    return exit_codes.DONE


@contextlib.asynccontextmanager
async def _floor(line: Line, realm: str) -> AsyncGenerator[Floor]:
    from robotree.assistants.serving import floor_of

    pattern, folder = line.text("--robots", "*"), folder_of(realm)
    if not line.flag("--rehearse"):
        async with joined(realm) as realm_client, floor_of(realm_client, folder, pattern) as floor:
            yield floor
        return
    async with (
        twin_of(realm, line.text("--cell")) as twin,
        joined(twin) as realm_client,
        floor_of(realm_client, folder_of(twin), pattern, rehearses_for=folder) as floor,
    ):
        yield floor


@contextlib.asynccontextmanager
async def twin_of(realm: str, cell: str = "") -> AsyncGenerator[str]:
    """Run a twin of a realm's cell, with simulated controllers and the same policy, for the time of a block.

    Args:
        realm: the real one.
        cell: a realm file to take instead of what runs there now; empty: what runs.

    Yields:
        The name of the realm of the twin.
    """
    twin = f"{realm}{TWIN}-{os.getpid()}"
    home = folder_of(twin)
    try:
        file = home / "cell.yaml"
        if cell:
            file = Path(cell)
        else:
            await _save(realm, file)
        policy = folder_of(realm) / POLICY
        if await asyncio.to_thread(policy.is_file):
            await asyncio.to_thread(shutil.copyfile, policy, home / POLICY)
        async with Crew(twin) as crew:
            note(f"a twin of realm {realm} begins: this takes some seconds …")
            await demo.cast(crew, file=file)
            note(f"the twin is ready; nothing that is done in it moves a robot of realm {realm}")
            yield twin
    finally:
        await asyncio.to_thread(shutil.rmtree, home, ignore_errors=True)


async def _save(realm: str, file: Path) -> None:
    """Write what runs in a realm into a file."""
    from robotree.files import replace
    from robotree.tui.realm_file.present import controllers, present
    from robotree.tui.realm_file.saving import saved
    from robotree.tui.realm_file.writing import write_file

    async with joined(realm) as realm_client:
        there = await present(realm_client, controllers(realm))
    found, notes = await asyncio.to_thread(saved, there, file)
    for each in notes:
        note(each)
    await asyncio.to_thread(replace, file, write_file(found, comments=[]).encode())
