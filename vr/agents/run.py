"""A host, or a lookup service, as a process: up until it is cancelled, and then down in order."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import sys
from collections.abc import Callable
from pathlib import Path

from robotree.vr.agents.host import Host
from robotree.vr.base.address import check_name
from robotree.vr.base.transport import Transport
from robotree.vr.core.bonds import DEFAULT_TERM
from robotree.vr.core.machine import RobotCore
from robotree.vr.history.writer import HistoryWriter
from robotree.vr.journal.journal import HostJournal
from robotree.vr.journal.outlet import Outlet
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.local import join
from robotree.vr.running.heard import listening
from robotree.vr.running.process import Process
from robotree.vr.running.runner import Runner, runner_of

Ready = Callable[[str], None]
"""Called with the key of an agent that runs."""


TURN = 0.001
"""[s] after which a thread that computes lets the others have a turn (CPython's own value is 0.005).

Authors' commands run in threads beside the loop that keeps the leases. With one that never pauses, a
neighbour's call takes 4 ms instead of 15 ms; with four, 25 ms instead of 84 ms (docs/decisions/0006).
"""


ARRIVAL = 60.0
"""[s] for the one robot of a host to come: who has started the host may have been killed since."""


RETURNS = 10.0
"""[s] that the children of a host's robots wait for it after a crash."""


def _boot() -> str:
    """Return what the kernel calls the present start of the machine (random(4)); empty: it does not say."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


def _settle_interpreter() -> None:
    """Make the process fit for authors' commands beside its loop."""
    sys.setswitchinterval(TURN)
    gc.freeze()  # what is imported never goes: no collection needs to look at it again


def _nobody(_: str) -> None:
    """Hear that it is ready, and do nothing."""


async def run_host(
    name: str,
    *,
    realm: str | None = None,
    term: float = DEFAULT_TERM,
    only: str = "",
    keep: Path | None = None,
    past: Path | None = None,
    returns: float = RETURNS,
    ready: Ready = _nobody,
) -> None:
    """Be a host in a realm until cancelled; one that runs one robot alone: until that has ended.

    Args:
        name: of the host, unique in the realm.
        realm: None: `$ROBOTREE_REALM`, else `default`.
        term: [s] of the leases that its robots grant and ask for.
        only: name of the one robot that it runs; empty: it runs any number.
        keep: folder in which it keeps its robots, and what they did; None: they end with it.
        past: folder in which it keeps what they did, if it does not keep them; None: nobody does.
        returns: [s] that the children of its robots wait for it after a crash.
        ready: told the key once robots can be made, and those that were kept are back.

    Raises:
        BadName: that cannot be a name.
        DuplicateName: a living host has the name.
        TransportError: the realm cannot be joined.
        JournalError: the folder, or what is kept in it, cannot be used.
    """
    for one in (name, only or name):
        check_name(one)
    _settle_interpreter()
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(listening())
        runner = runner_of(asyncio.get_running_loop())
        journal, history = _kept_in(keep, past, runner, stack)
        process: Process = Process(runner, journal, history.machine_of if history else RobotCore)
        transport: Transport = await join(realm)
        stack.push_async_callback(transport.close)
        if journal is not None:
            transport = kept_by(journal, process, transport, returns)
        registrar = Registrar(transport)
        stack.push_async_callback(registrar.close)
        host = Host(
            transport, name, registrar=registrar, term=term, process=process, only=only, journal=journal
        )
        stack.push_async_callback(host.close)
        await host.start()
        await host.restore()
        if history is not None:
            host.keeps_history(history)
        ready(host.address.key)
        if only:
            await host.deserted(ARRIVAL)
        else:
            await asyncio.get_running_loop().create_future()


def kept_by(
    journal: HostJournal, process: Process, transport: Transport, returns: float = RETURNS
) -> Transport:
    """Have a process go on after a crash, from its journal; returns its way to the others.

    Args:
        journal: of the process; its `Process` was made with it.
        process: whose commands go on.
        transport: the way to the others.
        returns: [s] that the children of its robots wait for it.
    """
    process.life, process.returns, process.keeps_steps = journal.life, returns, True
    process.sync = journal.sync
    return Outlet(transport, journal.barrier)


def _kept_in(
    keep: Path | None, past: Path | None, runner: Runner, stack: contextlib.AsyncExitStack
) -> tuple[HostJournal | None, HistoryWriter | None]:
    """Open what a host keeps of its robots, and of what they did; `stack` closes both."""
    folder = keep or past
    if folder is None:
        return None, None
    history = HistoryWriter(folder, runner.now, runner.unix)
    if keep is None:
        stack.callback(history.close)
        return None, history
    journal = HostJournal(keep, runner, boot=_boot(), machine_of=history.machine_of)
    began = journal.found.began
    history.replayed(0.0 if began is None else began.unix - began.now)
    history.before_writing = journal.barrier
    stack.callback(history.close)
    stack.callback(journal.close)
    return journal, history


async def run_lookup(name: str, *, realm: str | None = None, ready: Ready = _nobody) -> None:
    """Be a lookup service in a realm until cancelled.

    Args:
        name: of the service, unique in the realm.
        realm: None: `$ROBOTREE_REALM`, else `default`.
        ready: told the key once it answers.

    Raises:
        BadName: that cannot be a name.
        DuplicateName: a living lookup service has the name.
        TransportError: the realm cannot be joined.
    """
    check_name(name)
    async with contextlib.AsyncExitStack() as stack:
        transport = await join(realm)
        stack.push_async_callback(transport.close)
        service = LookupService(transport, name)
        stack.push_async_callback(service.close)
        await service.start()
        ready(service.address.key)
        await asyncio.get_running_loop().create_future()
