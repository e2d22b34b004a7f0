"""The verbs whose process is an agent, and `apply`, which starts them.

This is the composition root: with the demos and the tools of the wire the only place that may start the other
rooms. What an agent needs is imported when it is wanted: a lookup service loads no simulation.
"""

from __future__ import annotations

import asyncio
import os
import shutil
from collections.abc import Callable, Coroutine
from functools import partial
from typing import TYPE_CHECKING, Any

from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.processes.serving import serve
from robotree.tui.processes.state_files import (
    directory_folder,
    fence_file,
    history_folder,
    journal_folder,
    kept_by_one,
    needed_file,
    site_of,
)
from robotree.tui.terminal import note
from robotree.tui.wire.security import openness, securing

if TYPE_CHECKING:
    from robotree.tui.line.carrying import Program
    from robotree.vr.agents.run import Ready

Agent = Callable[[Line, str, "Ready"], Coroutine[Any, Any, None]]
"""Is an agent in a realm until it is cancelled."""


def agent(run: Agent, *, foreign: bool = False) -> Program:
    """Make a program of an agent.

    Args:
        run: the agent.
        foreign: whether authors' code runs in its process: pages, or proxies.
    """

    def program(line: Line, realm: str) -> int:
        asyncio.run(serve(partial(run, line, realm), tether=line.flag("--tether"), foreign=foreign))
        return exit_codes.DONE

    return program


async def apply(line: Line, realm: str) -> int:
    """Bring about the realm of a file."""
    from robotree.proxy.kinds import KINDS
    from robotree.tui.realm_file import verbs

    return await verbs.apply(line, realm, {"proxy": KINDS})


@agent
async def sim(line: Line, _realm: str, ready: Ready) -> None:
    """Be the controller of a simulated robot."""
    from robotree.sim.controller.fence_file import FenceFile
    from robotree.sim.serving.server import serve

    url = line.text("--listen")
    file = fence_file(line.text("--state"), url)
    with kept_by_one(file):
        async with securing(line) as security:
            memory = FenceFile(file, reset=line.flag("--reset-epoch"))
            if memory.trouble:
                note(memory.trouble)

            def listens(address: str) -> None:
                if not security.signed:
                    note(openness(address))
                ready(address)

            if line.text("--log"):
                _log_goals(line.text("--log"))
            speedup = values.factor(line.text("--speedup", "1"))
            kind = line.text("KIND")
            await serve(kind, url, ready=listens, speedup=speedup, security=security, memory=memory)


def _log_goals(given: str) -> None:
    """Write each goal that the simulated controller begins and ends into a file, behind what is there.

    Raises:
        ValueRefused: the file cannot be opened.
    """
    import logging
    from pathlib import Path

    from robotree.files import opened
    from robotree.sim.firmware import goals

    try:
        descriptor = opened(Path(given).expanduser(), os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW)
    except OSError as error:
        raise ValueRefused("--log", f"{given} cannot be written: {error.strerror}") from None
    handler = logging.StreamHandler(os.fdopen(descriptor, "w", buffering=1))
    handler.setFormatter(logging.Formatter("%(created).3f %(message)s"))
    log = logging.getLogger(goals.__name__)
    log.addHandler(handler)
    log.setLevel(logging.DEBUG)
    log.propagate = False


@partial(agent, foreign=True)
async def proxy(line: Line, realm: str, ready: Ready) -> None:
    """Be the proxy of a robot's controller."""
    from robotree.proxy.agent import run_proxy

    kind, name, url = line.text("KIND"), line.text("NAME"), line.text("--connect")
    take_over = line.flag("--take-over")
    component = _component(line.text("--component", "1"))
    async with securing(line) as security:
        await run_proxy(
            kind,
            name,
            url,
            realm=realm,
            security=security,
            take_over=take_over,
            component=component,
            keep=history_folder(realm, name),
            ready=ready,
        )


def _component(text: str) -> int:
    """A MAVLink component id, 1 to 255."""
    return values.whole("N", text, 1, 255, "is no component; write a number from 1 to 255")


def _cameras(text: str) -> dict[str, int]:
    """Components by the names of cameras, from `left=101,right=102`."""
    found: dict[str, int] = {}
    for each in text.split(","):
        name, _, component = each.partition("=")
        if not name.strip():
            raise ValueRefused("LIST", f"{each!r} names no camera; write NAME=COMPONENT, such as left=101")
        found[name.strip()] = _component(component)
    return found


@agent
async def view(line: Line, realm: str, ready: Ready) -> None:
    """Offer the pictures of a controller's cameras."""
    from robotree.proxy.agent import run_view

    async with securing(line) as security:
        await run_view(
            line.text("NAME"),
            line.text("--connect"),
            realm=realm,
            security=security,
            cameras=_cameras(line.text("--cameras", "cell=100,wrist=101")),
            ready=ready,
        )


@partial(agent, foreign=True)
async def host(line: Line, realm: str, ready: Ready) -> None:
    """Run virtual robots."""
    from robotree.tui.bundles import gate_of
    from robotree.vr.agents.run import Keeping, place_of, run_host
    from robotree.vr.agents.standby import AFTER

    name, only, of = line.text("NAME"), line.text("--only"), line.text("--standby-for")
    after = values.duration(line.text("--after")) if line.text("--after") else AFTER
    _check_standing_by(line, after)
    folder = None if only else journal_folder(realm, of or name)
    if folder is not None and line.flag("--forget"):
        shutil.rmtree(folder, ignore_errors=True)
        folder = None
    place = place_of(folder, line.text("--journal"), f"{realm}/{of or name}")
    await run_host(
        name,
        realm=realm,
        only=only,
        keep=None if place is None else Keeping(place, of, after),
        past=history_folder(realm, only) if only else folder,
        gate=gate_of(line, realm),
        isolate=values.isolation(line.text("--isolate")) or "none",
        most=values.number_of("--most", line.text("--most")),
        ready=ready,
    )


def _check_standing_by(line: Line, after: float) -> None:
    """Refuse what a stand-by host, or one with a journal elsewhere, cannot be told."""
    from robotree.vr.agents.standby import SHORTEST_AFTER

    name, of, url = line.text("NAME"), line.text("--standby-for"), _database(line, "--journal")
    if after < SHORTEST_AFTER:
        raise ValueRefused(
            "TIME", f"{after:g} s is too short to know that a host is away; write 2.5s or more"
        )
    if of == name:
        raise ValueRefused("HOST", f"{name} cannot stand by for itself; write the name of another host")
    if url and (line.text("--only") or line.flag("--forget")):
        raise ValueRefused("URL", "a host with --only or --forget keeps nothing; leave --journal out")


def _database(line: Line, option: str) -> str:
    """Return the database that an option names; empty: none."""
    from robotree.vr.space.run import POSTGRES

    url = line.text(option)
    if url and not url.startswith(POSTGRES):
        raise ValueRefused("URL", f"{url!r} is no database; write postgresql://HOST/DATABASE")
    return url


@agent
async def lookup(line: Line, realm: str, ready: Ready) -> None:
    """Be a lookup service."""
    from robotree.vr.agents.run import run_lookup

    await run_lookup(line.text("NAME"), realm=realm, ready=ready)


@agent
async def directory(line: Line, realm: str, ready: Ready) -> None:
    """Be a lookup service with a memory."""
    from robotree.vr.orders.run import run_directory

    name, url = line.text("NAME"), _database(line, "--store")
    folder = directory_folder(realm, name)
    await run_directory(name, folder, realm=realm, site=site_of(realm), database=url, ready=ready)


@agent
async def space(line: Line, realm: str, ready: Ready) -> None:
    """Be a space."""
    from robotree.vr.space.run import run_space

    name, durability = line.text("NAME"), line.text("--durability", "process")
    if durability not in {"process", "power"}:
        raise ValueRefused("CLASS", f"{durability!r} is none; write process or power")
    store = line.text("--store") or needed_file(realm, f"{name}.space.db")
    await run_space(name, str(store), durability=durability, realm=realm, ready=ready)


@agent
async def gateway(line: Line, realm: str, ready: Ready) -> None:
    """Link this machine to the other sites of the realm."""
    from robotree.tui.sites.running import run_gateway

    await run_gateway(line, realm, ready)


def hub(line: Line, realm: str) -> int | Coroutine[Any, Any, int]:
    """Run a hub, or print how one is configured."""
    from robotree.tui.sites import running

    return running.print_config(line) if line.flag("--print-config") else agent(running.run_hub)(line, realm)
