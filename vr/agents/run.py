"""A host, or a lookup service, as a process: up until it is cancelled, and then down in order."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import logging
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from robotree.files import private_folder
from robotree.vr.agents.host import Host
from robotree.vr.agents.standby import AFTER, BEAT, StandBy
from robotree.vr.base.address import check_name
from robotree.vr.base.errors import JournalError
from robotree.vr.base.permissions import Isolation
from robotree.vr.base.transport import Transport
from robotree.vr.bundle.admission import Gate
from robotree.vr.bundle.loader import LIMIT
from robotree.vr.core.bonds import DEFAULT_TERM
from robotree.vr.core.machine import RobotCore
from robotree.vr.history.writer import HistoryWriter
from robotree.vr.isolation.apart import ApartSetting, RobotsApart
from robotree.vr.journal.files import FilePlace
from robotree.vr.journal.journal import HostJournal, explained
from robotree.vr.journal.outlet import Outlet
from robotree.vr.journal.store import LogPlace, LogStore, own
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.lookup.service import LookupService
from robotree.vr.network.local import join
from robotree.vr.network.rendezvous import realm_name
from robotree.vr.orders.ledger import ORDERS, Ledger
from robotree.vr.orders.store import Records
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


DEPOSED = 1
"""Exit code of a host whose robots another host has."""


RETURNS = 10.0
"""[s] that the children of a host's robots wait for it after a crash."""


_log = logging.getLogger(__name__)


def _boot() -> str:
    """Return what the kernel calls the present start of the machine (random(4)); empty: it does not say."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    except OSError:
        return ""


def _nobody(_: str) -> None:
    """Hear that it is ready, and do nothing."""


class Keeping(NamedTuple):
    """Where a host keeps its robots, and whose they are."""

    place: LogPlace
    standby_for: str = ""
    """Name of the host whose robots are kept there, and for which this one stands by; empty: its own."""
    after: float = AFTER
    """[s] without a sign of life of who has them after which this host has them."""


async def run_host(  # noqa: PLR0913 # what people may choose
    name: str,
    *,
    realm: str | None = None,
    only: str = "",
    keep: Keeping | None = None,
    past: Path | None = None,
    returns: float = RETURNS,
    gate: Gate | None = None,
    isolate: Isolation = "none",
    most: int | None = None,
    ready: Ready = _nobody,
) -> None:
    """Be a host in a realm until cancelled; one that runs one robot alone: until that has ended.

    Args:
        name: of the host, unique in the realm.
        realm: None: `$ROBOTREE_REALM`, else `default`.
        only: name of the one robot that it runs; empty: it runs any number.
        keep: where it keeps its robots; None: they end with it. If another host has them, this one stands by.
        past: folder in which it keeps what they did; None: nobody does.
        returns: [s] that the children of its robots wait for it after a crash.
        gate: decides which pages run; None: this user's own alone.
        isolate: where its robots run for which nobody asks for another level.
        most: how many robots it runs at most; None: any number.
        ready: told the key once robots can be made, and those that were kept are back; or once it stands by.

    Raises:
        BadName: that cannot be a name.
        DuplicateName: a living host has the name.
        TransportError: the realm cannot be joined.
        JournalError: the folder, or what is kept in it, cannot be used.
    """
    of = _expect_names(name, only, keep)
    sys.setswitchinterval(TURN)  # authors' commands run beside the loop
    gc.freeze()  # what is imported never goes: no collection needs to look at it again
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(listening())
        runner, transport = runner_of(asyncio.get_running_loop()), await _joined(realm, stack)
        log, ready = await _taken(keep, transport, name, ready, stack)
        journal, history = kept_in(log, past, runner, stack)
        process: Process = Process(runner, journal, history.machine_of if history else RobotCore)
        transport = transport if journal is None else kept_by(journal, process, transport, returns)
        registrar = Registrar(transport)
        stack.push_async_callback(registrar.close)
        ledger = None if journal is None else _ledger_in(past, log, stack)
        host = Host(transport, name, registrar=registrar, process=process, only=only,
                    journal=journal, gate=gate, ledger=ledger)  # fmt: skip
        host.instead_of, host.log_folder = "" if of == name else of, _folder_of(keep)
        setting = ApartSetting(name, realm_name(realm), DEFAULT_TERM, returns, LIMIT, host.log_folder)
        host.apart, host.isolate, host.most = RobotsApart(setting, transport), isolate, most
        stack.push_async_callback(host.close)
        await _live(host, history, ready, alone=bool(only))


async def _joined(realm: str | None, stack: contextlib.AsyncExitStack) -> Transport:
    """Enter a realm, which `stack` leaves."""
    transport = await join(realm)
    stack.push_async_callback(transport.close)
    return transport


def _expect_names(name: str, only: str, keep: Keeping | None) -> str:
    """Return the name of the host whose robots it keeps.

    Raises:
        BadName: one that was given cannot be a name.
    """
    of = name if keep is None else keep.standby_for or name
    for each in (name, only or name, of):
        check_name(each)
    return of


def _folder_of(keep: Keeping | None) -> Path | None:
    """Return the folder in which a host keeps its robots; None: it keeps them elsewhere, or not at all."""
    return keep.place.folder if keep is not None and isinstance(keep.place, FilePlace) else None


async def _live(host: Host, history: HistoryWriter | None, ready: Ready, *, alone: bool) -> None:
    """Be a host until it is cancelled, or until the only robot has ended."""
    await host.start()
    await host.restore()
    host.finds_places()
    if history is not None:
        host.keeps_history(history)
    ready(host.address.key)
    if alone:
        await host.deserted(ARRIVAL)
    else:
        await asyncio.get_running_loop().create_future()


def place_of(folder: Path | None, url: str, log: str) -> LogPlace | None:
    """Return where a host keeps its robots; only what that needs is imported.

    Args:
        folder: on this machine; None: they are not kept there.
        url: of a database of PostgreSQL, which is used instead; empty: none is.
        log: name of the log in the database.

    Raises:
        ImportError: psycopg is not installed.
    """
    if url:
        from robotree.vr.journal.postgres import PostgresPlace

        return PostgresPlace(url, log)
    return None if folder is None else FilePlace(folder, boot=_boot())


async def _taken(
    keep: Keeping | None, transport: Transport, name: str, ready: Ready, stack: contextlib.AsyncExitStack
) -> tuple[LogStore | None, Ready]:
    """Become the owner of the log, at once or when its owner is away for too long; `stack` closes its place.

    Returns:
        The log, None without one; who is still to be told that the host is ready.
    """
    if keep is None:
        return None, ready
    stack.callback(keep.place.close)
    with explained(keep.place.where):
        owner = await asyncio.to_thread(keep.place.look)
    others = owner is not None and owner.lives and owner.host != name
    if not (others or keep.standby_for):
        with explained(keep.place.where):
            return await asyncio.to_thread(own, keep.place, name), ready
    host = StandBy(transport, name, keep.place, of=keep.standby_for or name, after=keep.after)
    await host.start()
    try:
        if owner is not None and owner.host != name:
            _log.warning("%s has the robots; %s stands by for it", owner.host, name)
        ready(host.address.key)
        return await host.take_over(), _nobody
    finally:
        await host.close()


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


def kept_in(
    log: LogStore | None, past: Path | None, runner: Runner, stack: contextlib.AsyncExitStack
) -> tuple[HostJournal | None, HistoryWriter | None]:
    """Read what a host keeps of its robots, and open what it keeps of what they did; `stack` closes both."""
    history = None if past is None else HistoryWriter(past, runner.now, runner.unix)
    if log is None:
        if history is not None:
            stack.callback(history.close)
        return None, history
    machine_of = RobotCore if history is None else history.machine_of
    journal = HostJournal(log, runner, boot=_boot(), machine_of=machine_of)
    stack.callback(journal.close)
    journal.on_lost = _end_at_once
    stack.callback(_beating(journal).set)
    if history is not None:
        began = journal.found.began
        history.replayed(0.0 if began is None else began.unix - began.now)
        history.before_writing = journal.barrier
        stack.callback(history.close)
    return journal, history


def _ledger_in(folder: Path | None, log: LogStore | None, stack: contextlib.AsyncExitStack) -> Ledger:
    """Open what a process knows of its robots' orders, in the database of its journal if there is one."""
    if isinstance(log, Records):
        kept = Ledger(log)
        if folder is not None and (folder / ORDERS).exists():  # it had no database before
            kept.take_over(folder / ORDERS)
        return kept
    if folder is not None:
        private_folder(folder)
    ledger = Ledger(None if folder is None else folder / ORDERS)
    stack.callback(ledger.close)
    return ledger


def _beating(journal: HostJournal) -> threading.Event:
    """Show those who stand by that this process lives, until the event is set."""
    over = threading.Event()

    def beat() -> None:
        with contextlib.suppress(JournalError):  # it has ended this process
            while not over.wait(BEAT):
                journal.beat()

    threading.Thread(target=beat, name="journal beats", daemon=True).start()
    return over


def _end_at_once(error: JournalError) -> None:
    """End this process without a farewell: what it would say of its robots is not true any more."""
    with contextlib.suppress(OSError):
        os.write(2, f"robotree: {error}\n".encode())
    os._exit(DEPOSED)


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
        transport = await _joined(realm, stack)
        service = LookupService(transport, name)
        stack.push_async_callback(service.close)
        await service.start()
        ready(service.address.key)
        await asyncio.get_running_loop().create_future()
