"""The host's side of robots in processes of their own: their frames are judged, and carried out here.

The host answers and is present in the name of such a robot, so others see no difference. When its process
ends without being asked, the host starts another one, which goes on from the robot's folder; requests that
come meanwhile wait. A command in which the process ended twice ends, since it would end it again.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import logging
import os
import shutil
import signal
import sys
from collections.abc import Callable, Coroutine
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import msgspec

from robotree.files import private_folder, replace, sync_folder
from robotree.vr.base.address import Address
from robotree.vr.base.envelope import read_envelope, resealed, seal
from robotree.vr.base.errors import (
    CannotMove,
    GivenUp,
    NoAnswer,
    NoSuchPermit,
    NotAllowed,
    NotItsChild,
    Unreachable,
    VrError,
)
from robotree.vr.base.permissions import Isolation, Permissions
from robotree.vr.base.permit import travelling
from robotree.vr.base.presence import Held, Undo
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.base.requests import (
    AskMove,
    Call,
    Cancel,
    Create,
    Described,
    Done,
    Migrate,
    MoveDecided,
    PrepareMove,
    Raised,
    ReadEvents,
    Reload,
    Reply,
    SafeStop,
    TakeRobot,
    VerifyEvents,
    decode_reply,
    encode,
)
from robotree.vr.base.transport import ELSEWHERE, Incoming, Occupied, OnReply, Registration, Transport
from robotree.vr.core.placement import PlaceAdvice, PlacedRobot
from robotree.vr.isolation import pipe
from robotree.vr.isolation.given_up import GivenUpRobot
from robotree.vr.isolation.judge import Judge, Misbehaved
from robotree.vr.isolation.nursery import BOX, Nursery
from robotree.vr.journal.kept import APART, PAGE, stop_left, take_stop_back
from robotree.vr.lookup.registrar import Registrar
from robotree.vr.network.permit_file import permits_beside
from robotree.vr.running.runner import soon

LOOK = 0.25
"""[s] between two looks at who hangs."""
SILENT = 10.0
"""[s] without a sign of life after which a process is ended: its page holds the interpreter."""
STUBBORN = 5.0
"""[s] for which the code of a command may go on that was ended, before its process is."""
CRASHES = 2
"""Ends of a process in one command after which the command ends."""
GIVES_UP = 5
"""Ends of a process after which the robot is not started again."""
RECOVERS = 60.0
"""[s] that a process has lived after which earlier ends do not count."""
MOST_OPEN = 1000
"""Requests to a robot that are answered at the same time; what comes beyond gets no answer."""
FRAMES, BURST = 5000.0, 10000.0
"""Frames a second that a process may send for long, and at once; beyond that it waits."""
BACKLOG = 32 * 1024 * 1024
"""[bytes] that a process has not read yet after which it is ended."""
STOPS_WITHIN = 3.0
"""[s] for the process of a robot to end that has moved, or is to end."""
MOVES_WITHIN = 3600.0
"""[s] for a robot to move: as long as it is in doubt, nobody knows."""
DELETED, MOVED = "it was deleted", "it has moved to another host"
START = 20.0
"""[s] for a process to have its robot up, beyond the time that the page may take."""

_log = logging.getLogger(__name__)


def lack_for(level: Isolation) -> str:
    """Return what this system lacks for robots of a level; empty: nothing."""
    if sys.platform != "linux":
        return "it needs Linux"
    return "bubblewrap is not installed" if level == "sandbox" and BOX is None else ""


class Courier(Protocol):
    """Makes the requests anew by which a robot moves: in the name of its host, with what that knows of it."""

    key: str
    """Of the host."""

    def made_anew(
        self, kept: KeptApart, request: PrepareMove | TakeRobot | AskMove, asker: Principal
    ) -> PrepareMove | TakeRobot | AskMove:
        """Return what is sent instead; `asker`: who wants the robot to move."""
        ...

    def moment(self, place: str) -> None:
        """Pass a boundary of a move: a test may end the process here."""
        ...


class ApartSetting(NamedTuple):
    """What all robots apart of a host have in common."""

    host: str
    realm: str
    term: float
    returns: float
    limit: float
    folder: Path | None
    """Of the host's journal; None: nothing is kept."""


class KeptApart(msgspec.Struct, frozen=True):
    """What a robot apart is made of."""

    create: Create
    sender: str
    """Who has sent its page from elsewhere without a signature; empty: nobody."""
    level: Isolation
    asker: Principal
    """Who has made it."""
    chooses: dict[str, str] | None = {}
    """Kinds of the slots for which its page chooses children, by name; None: of any."""
    children: tuple[str, ...] = ()
    """Names of the robots that have been put under it."""
    parcel: pipe.Parcel | None = None
    """The robot itself, which has come from another host; None: it is in its folder."""
    left: tuple[SafeStop | Cancel, ...] = ()
    """What was ordered while it was given up: its next process obeys before anything of it goes on."""


_kept: msgspec.msgpack.Decoder[KeptApart] = msgspec.msgpack.Decoder(KeptApart)
_OF_PERMITS = (b"permit", b"vouched")
"""In the envelope of each call that names a permit, or brings what might be taken for one."""


class RobotApart:
    """One robot, through all its processes."""

    def __init__(  # what it is, and where
        self,
        kept: KeptApart,
        permissions: Permissions | None,
        setting: ApartSetting,
        transport: Transport,
        nursery: Nursery,
        on_end: Callable[[RobotApart], None],
    ) -> None:
        """Begin without a process.

        Args:
            kept: what it is made of.
            permissions: of its page; None: it is not limited.
            setting: what it has in common with others.
            transport: the host's way to the others.
            nursery: makes its processes.
            on_end: called when there will be no other process.
        """
        self.kept, self._permissions, self._setting = kept, permissions, setting
        self.name = name = kept.create.name
        self._transport, self._nursery, self._on_end = transport, nursery, on_end
        self._judge = Judge(name, permissions, chooses=kept.chooses, children=kept.children)
        self.folder = None if setting.folder is None else setting.folder / APART / name
        self.page = ""
        """Hash of its page."""
        self.abandoned: tuple[str, ...] = ()
        self.pid = 0
        """Number of its process; 0: there is none."""
        self.over = ""
        """Why there is no robot any more; empty: there is."""
        self._loop = asyncio.get_running_loop()
        self._writer: asyncio.StreamWriter | None = None
        self._up: asyncio.Future[Described] = self._loop.create_future()
        self._numbers = itertools.count(1)
        self._open: dict[int, Incoming] = {}
        self._waiting: list[tuple[int, Incoming]] = []
        self._controls: dict[int, asyncio.Future[bytes]] = {}
        self._served: Registration | None = None
        self._present: Registration | None = None
        self._subscriptions: dict[int, Registration] = {}
        self._coming: set[int] = set()
        """Numbers of subscriptions that are being made; of `_dropped` those that are not wanted any more."""
        self._dropped: set[int] = set()
        self._undo: Undo = lambda: None
        self._ended = asyncio.Event()
        self._crashes = 0
        self._held = ""
        """Why the open commands end when the next process goes on; empty: they go on."""
        self._ready = False
        """Whether its process answers."""
        self._note = ""
        """What the next process writes into the robot's log."""
        self._stubborn_since = float("inf")
        """[s] from then on code of commands runs that were ended."""
        self._leaving = self._for_good = False
        """Whether its process is to end; whether nothing of the robot stays then."""
        self._tasks: set[asyncio.Future[Any]] = set()
        self._takers = self._new_takers()
        self._stay()

    def _stay(self) -> None:
        """Begin without a move."""
        self._last_sign = 0.0
        self.given_up: GivenUpRobot | None = None
        """Answers for it when its process has ended too often; None: it goes on."""
        self.registrar: Registrar | None = None
        """Where it is listed then; None: nowhere."""
        self._left = asyncio.Event()
        """Set when its host ends."""
        self.courier: Courier | None = None
        """Makes its requests anew by which it moves; None: it does not move."""
        self.on_lost: Callable[[str], object] = lambda _: None
        """Told of its identity when it has ended for good, and could not tell the directories itself."""
        self.on_way = ""
        """Name of the host to which it is moving, as it says; empty: it stays."""
        self.came = False
        """Whether it has come from another host, as it says."""
        self.placed: PlacedRobot | None = None
        """What matters for its place, as it says; None: people alone move it."""
        self.moved = False
        """Whether it goes on in another host."""
        self._mover = ITSELF
        """Who wants it to move."""
        self._decided = asyncio.Event()
        """Clear while it has been written down that it has come, and does not count yet."""
        self._decided.set()
        self._expected = False
        """Whether it may come from another host."""
        self._loaded: asyncio.Future[None] = self._loop.create_future()
        """Whether the page is loaded of a robot that comes."""

    @property
    def address(self) -> Address | None:
        """Its address; None: it is not known yet."""
        return Address.parse(self._judge.key) if self._judge.key else None

    # -- its life ---------------------------------------------------------------------------------

    async def begin(self, *, fresh: bool) -> Described:
        """Start the first process; returns when the robot can be called.

        Args:
            fresh: whether it is a new robot; else it goes on from its folder.

        Raises:
            VrError: there is no robot; it says why.
        """
        if self.folder is not None and fresh:
            self._make_room(self.folder)
            self._write_page()
        self._for_good = fresh  # until it has been up once
        self._keep(self._live(self.kept.create if fresh else None))
        return await asyncio.shield(self._up)

    async def expect(self) -> None:
        """Start a process that loads the page of a robot which may come; returns when it has.

        Raises:
            VrError: it cannot be; it says why.
        """
        assert self.folder is not None  # noqa: S101 # a host that keeps nothing takes none
        self._make_room(self.folder)
        self._for_good = self._expected = True  # until it has come
        self._keep(self._live(self.kept.create))
        both: tuple[asyncio.Future[Any], ...] = (self._loaded, self._up)
        await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
        if not self._loaded.done():
            self._up.result()

    def _make_room(self, folder: Path) -> None:
        """Have an empty folder. What is kept there of a robot that is not back is put aside, not removed."""
        if folder.exists():
            asides = (folder.with_name(f"{self.name}.{number}") for number in itertools.count(1))
            aside = next(path for path in asides if not path.exists())
            folder.rename(aside)
            with contextlib.suppress(FileNotFoundError):  # somebody has removed it
                self._page_file.rename(aside / self._page_file.name)
            _log.warning("%s begins anew; what was kept of the one before is in %s", self.name, aside)
        self._clear(folder)  # of one that was deleted while nobody looked
        private_folder(folder)

    def _clear(self, folder: Path) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        with contextlib.suppress(OSError):
            take_stop_back(folder)

    @property
    def has_ended(self) -> bool:
        """Whether there is no process any more, and none follows."""
        return self._ended.is_set()

    def begin_arrival(self) -> None:
        """Have no process follow, and forget nothing, until it is known whether it has come."""
        self._for_good = False
        self._decided.clear()

    def keep_arrival(self, parcel: pipe.Parcel) -> None:
        """Write down what has come; it counts once the journal of the host says so, too. In any thread.

        Raises:
            OSError: it cannot be written.
        """
        kept = msgspec.structs.replace(self.kept, parcel=parcel)
        replace(self._page_file, msgspec.msgpack.encode(kept))

    def count_arrival(self, parcel: pipe.Parcel) -> None:
        """Take note that it has come for good."""
        self.kept = msgspec.structs.replace(self.kept, parcel=parcel)
        self._decided.set()

    async def end_expecting(self) -> None:
        """Be none: it does not come."""
        self._for_good = True
        self._page_file.unlink(missing_ok=True)
        self._decided.set()
        await self.leave(returns=False)

    async def arrive(self, address: Address, rank: int, within: float) -> None:
        """Have a robot go on that has come; returns when it does, or it is present at least.

        Args:
            address: of the robot.
            rank: how often it has moved.
            within: [s] to wait for its process.
        """
        self._judge.expect_own(address.key)
        await self._answer_under(address.key, rank)
        await self._announce(address.key, [])
        await self._transport.settle(within)
        if self.kept.parcel is not None:
            self._send(pipe.Arrive(self.kept.parcel))
        await asyncio.wait((self._up,), timeout=within)

    @property
    def _page_file(self) -> Path:
        assert self.folder is not None  # noqa: S101 # it is kept
        return self.folder.with_name(f"{self.name}{PAGE}")

    def _write_page(self) -> None:
        """Keep what the robot is made of beside its folder, where its process cannot write."""
        if self.folder is not None:
            path = self._page_file
            new = path.with_suffix(".new")
            new.write_bytes(msgspec.msgpack.encode(self.kept))
            new.replace(path)

    async def _live(self, create: Create | None) -> None:  # noqa: C901 # each way to end
        abandon, in_a_row = "", 0
        while not (self.over or self._leaving):
            began = self._loop.time()
            try:
                code = await self._one_process(create, abandon)
            except Misbehaved as fault:
                self.over, self._for_good = f"its process was ended: {fault}", True
                break
            except OSError as error:
                self.over = f"no process can be made for it: {error.strerror or error}"
                break
            await self._decided.wait()
            if self.moved:
                self.over = MOVED
            if self.over or self._leaving or not self._has_begun:
                break
            if self.folder is None:
                self.over = f"its process has ended ({_how(code)}), and the host keeps no robots"
                break
            create, now = None, self._loop.time()
            if self._note:  # it was we who ended it, and what else it was doing goes on
                _log.warning("%s: %s", self.name, self._note)
                continue
            if now - began > RECOVERS:
                self._crashes = in_a_row = 0
            self._crashes, in_a_row = self._crashes + 1, in_a_row + 1
            abandon, self._held = self._held, ""
            if not abandon and in_a_row >= CRASHES:
                abandon = f"its process has ended in it twice ({_how(code)})"
            if self._crashes >= GIVES_UP:
                await self._be_given_up(_how(code), abandon)
                break
            in_a_row = 0 if abandon else in_a_row
            _log.warning("the process of %s has ended (%s); it is started again", self.name, _how(code))
        await self._finish()

    async def _be_given_up(self, how: str, abandon: str) -> None:
        """Answer for the robot, which has no process any more, until it is deleted or the host ends.

        Args:
            how: its last process has ended.
            abandon: why its open commands end; empty: they go on when the host is started again.
        """
        if abandon:
            with contextlib.suppress(OSError):  # then they end when they have ended two more processes
                self._leave_order(Cancel(reason=abandon))
        error = GivenUp(robot=self.name, times=GIVES_UP, how=how, host=self._setting.host)
        _log.error("%s", error)
        robot = (await self._up).robot
        self.given_up = given_up = GivenUpRobot(robot, error, self._transport.gate, self._leave_order)
        waiting, self._waiting = self._waiting, []
        for _, incoming in waiting:
            given_up.take(incoming)
        if self.registrar is not None:
            await self.registrar.enter(given_up.listing)
        ends = [asyncio.ensure_future(each.wait()) for each in (given_up.deleted, self._left)]
        await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        for each in ends:
            each.cancel()
        if self.registrar is not None:
            await self.registrar.leave(robot.address)
        if given_up.deleted.is_set():
            self.over, self._for_good = DELETED, True
            self.on_lost(robot.identity)

    def _leave_order(self, order: SafeStop | Cancel) -> None:
        """Keep an order, on the disk, for the next process; one stop stands for all later ones.

        Raises:
            OSError: it cannot be kept.
        """
        left = self.kept.left
        if order in left or any(isinstance(one, SafeStop) for one in left if isinstance(order, SafeStop)):
            return
        kept = msgspec.structs.replace(self.kept, left=(*left, order))
        replace(self._page_file, msgspec.msgpack.encode(kept))
        self.kept = kept

    @property
    def _has_begun(self) -> bool:
        """Whether there is a robot that another process can go on with."""
        return self.kept.parcel is not None or (self._up.done() and self._up.exception() is None)

    async def _one_process(self, create: Create | None, abandon: str) -> int:
        """Have one process be the robot; returns its exit code.

        Raises:
            Misbehaved: it tried what no robot does; it has been ended.
            OSError: it cannot be made.
        """
        ended: asyncio.Future[int] = self._loop.create_future()
        boxed = self.kept.level == "sandbox"
        folder = str(self.folder or "")
        start = partial(self._nursery.start_boxed, folder) if boxed else self._nursery.start
        self.pid, own = await start(partial(_settle, ended))
        self._stubborn_since, self.abandoned = float("inf"), ()
        reader, self._writer = await asyncio.open_connection(sock=own, limit=2**20)
        self._last_sign = self._loop.time() + self._setting.limit + START
        watch = self._loop.create_task(self._watch_it())
        try:
            if self.folder is not None:  # who could not reach the process before has left the stop here
                self.kept = _stopped(self._page_file, self.kept, "its process could not be reached")
            self._send(self._first_frame(create, abandon))
            self._note = ""
            self._undo = self._transport.presence.watch("**", self._tell_presence)
            await self._read(reader)
        finally:
            watch.cancel()
            self._undo()
            if self.pid:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(self.pid, signal.SIGKILL)
            self._lose_process()
        return await ended

    def _first_frame(self, create: Create | None, abandon: str) -> pipe.BeginFrame:
        setting, identity = self._setting, self._transport.identity
        folder = "" if self.folder is None else str(self.folder)
        parcel = self.kept.parcel
        return pipe.BeginFrame(
            name=self.name,
            host=setting.host,
            realm=setting.realm,
            process=identity.process,
            user=identity.user,
            folder=folder,
            term=setting.term,
            returns=setting.returns if folder else 0.0,
            limit=setting.limit,
            create=create if parcel is None else self.kept.create,
            arrives=parcel is not None or (create is not None and self._expected),
            parcel=parcel,
            asker=self.kept.asker,
            level=self.kept.level,
            permissions=self._permissions,
            abandon=abandon,
            note=self._note,
            left=list(self.kept.left),
            rules=self._rules(),
            writable=[folder] if folder else [],
        )

    def _rules(self) -> pipe.Rules:
        gate = self._transport.gate
        text = "" if gate.policy is None else gate.policy.text
        user = None if gate.owner is None else self._transport.identity.user
        return pipe.Rules(text, gate.trouble, gate.site, gate.person, tuple(gate.roles), gate.owner, user)

    async def _watch_it(self) -> None:
        """End the process when it has been silent for too long; tell it who hangs, and the policy."""
        before: list[Held] = []
        rules, gate = self._rules(), self._transport.gate
        while True:
            await asyncio.sleep(LOOK)
            with contextlib.suppress(VrError):
                if (held := self._transport.presence.hangs("**")) != before:
                    before = held
                    self._send(pipe.Silent(held))
            if (now := self._loop.time()) >= gate.due:
                gate.refresh(now)
            if (newer := self._rules()) != rules:
                rules = newer
                self._send(rules)
            if now - self._last_sign > SILENT:
                self._held = f"it held the interpreter for {SILENT:.0f} s, so its process was ended"
                self._kill()
            elif now - self._stubborn_since > STUBBORN and not self._note:
                what = ", ".join(self.abandoned)
                self._note = f"{what} went on after it was ended, so its process was ended; a new one goes on"
                self._kill()

    def _kill(self) -> None:
        if self.pid:  # 0 would be the host's own group
            with contextlib.suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    def _lose_process(self) -> None:
        self.pid, self._ready, self.placed = 0, False, None
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        opened, self._open = self._open, {}  # who hears of its end may ask something at once
        self._judge.resumes.clear()
        for incoming in opened.values():
            self._end_without(incoming)
        for control in self._controls.values():
            if not control.done():
                control.set_exception(Unreachable(key=self.name))
        self._controls.clear()
        subscriptions, self._subscriptions = self._subscriptions, {}
        for registration in subscriptions.values():
            self._keep(registration.close())

    async def _finish(self) -> None:
        for registration in (self._present, self._served):
            if registration is not None:
                with contextlib.suppress(VrError):
                    await registration.close()
        for _, incoming in self._waiting:
            self._end_without(incoming)
        self._waiting.clear()
        if not self._up.done():
            self._up.set_exception(VrError(detail=f"{self.name} cannot be: {self.over or 'its host ends'}"))
            self._up.exception()  # who has begun it may not wait for it
        elif self.over and self.over not in {DELETED, MOVED}:
            _log.error("%s is gone: %s", self.name, self.over)
        if self._for_good and self.over not in {DELETED, MOVED} and self._judge.identity:
            self.on_lost(self._judge.identity)
        if (self._for_good or self.moved) and self.folder is not None:
            self._page_file.unlink(missing_ok=True)
            self._clear(self.folder)
        self._ended.set()
        self._on_end(self)

    def _end_without(self, incoming: Incoming) -> None:
        """End a request without an answer, or have it asked where the robot goes on."""
        if self.moved:
            incoming.pass_on()
        else:
            incoming.end(None)

    async def stop(self, reason: str, order: str) -> None:
        """Have it obey a protective stop that came while it was on its way."""
        if self._judge.key:
            sealed = seal(SafeStop(reason=reason, order=order), now=self._loop.time(), within=STOPS_WITHIN)
            self._transport.ask(self._judge.key, sealed.body, urgent=True, on_reply=lambda _: None)

    def show(self, advice: PlaceAdvice, text: str) -> None:
        """Have it say what a look at its place has shown; see `agents/placing.py`, also of the next two."""
        self._send(pipe.Place("show", advice, text))

    def begin_move(self, advice: PlaceAdvice) -> None:
        """Have it note that it moves now, and why."""
        self._send(pipe.Place("begin_move", advice, ""))

    def end_move(self, advice: PlaceAdvice, reason: str) -> None:
        """Have it note why it has not moved."""
        self._send(pipe.Place("end_move", advice, reason))

    async def migrate(self, request: Migrate, asker: Principal) -> Reply:
        """Have it go on in another host; returns when it does, and nothing of it is left here.

        Raises:
            CannotMove: it stays here; the error says why.
            VrError: likewise.
        """
        if self.courier is None or self.folder is None:
            reason = f"{self._setting.host} keeps nothing of its robots"
            raise CannotMove(robot=self.name, host=request.host, reason=reason)
        self._mover = asker
        try:
            reply = await self.control(request, asker, MOVES_WITHIN)
        except (
            Unreachable
        ):  # its process has ended meanwhile, and the next one knows no more of who has asked
            if not self.moved:
                reason = "its process has ended on the way; another one asks what became of it"
                raise CannotMove(robot=self.name, host=request.host, reason=reason) from None
            reply = Done(note=f"{self.name} has moved to {request.host}")
        finally:
            self._mover = ITSELF
        if self.moved:
            await self._await_end()
        return reply

    async def leave(self, *, returns: bool) -> None:
        """End politely; its process is ended if it takes too long."""
        self._leaving = True
        self._left.set()
        self._send(pipe.Leave(returns))
        await self._await_end()
        if not self._ended.is_set():
            self._kill()
            await self._await_end()

    async def _await_end(self) -> None:
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(STOPS_WITHIN):
                await self._ended.wait()

    async def control(
        self,
        request: Reload | Migrate | ReadEvents | VerifyEvents,
        principal: Principal,
        within: float,
        permissions: Permissions | None = None,
        chooses: dict[str, str] | None = None,
    ) -> Reply:
        """Have the robot's process answer a request to the host.

        Args:
            request: as it came.
            principal: who asks.
            within: [s] to wait.
            permissions: of the page with which it is to go on; of a `Reload` alone.
            chooses: the slots of that page, see `KeptApart`.

        Raises:
            VrError: it refuses, or does not answer.
        """
        if self.given_up is not None:
            raise self.given_up.error
        number, answer = next(self._numbers), self._loop.create_future()
        self._controls[number] = answer
        before = self._permissions
        if isinstance(request, Reload):
            self._permissions = permissions
            self._judge.chooses = chooses
            self._judge.permissions = (before, permissions)  # it turns when it comes to a boundary
        self._send(pipe.Control(number, request, principal, self._permissions))
        try:
            async with asyncio.timeout(within):
                reply = decode_reply(await answer, key=self.name)
            if isinstance(reply, Raised):
                raise reply.revive()
            if isinstance(request, Reload):
                self.kept = msgspec.structs.replace(self.kept, create=request.page, chooses=chooses)
                self._write_page()
                before = permissions
        except TimeoutError:
            raise NoAnswer(key=self.name, seconds=within) from None
        else:
            return reply
        finally:
            self._controls.pop(number, None)
            if isinstance(request, Reload):
                self._permissions, self._judge.permissions = before, (before,)
                self._judge.chooses = self.kept.chooses

    # -- to the process ---------------------------------------------------------------------------

    def _send(self, frame: pipe.PipeFrame) -> None:
        """Send a frame, on the event loop; a process that reads too little is ended."""
        if self._writer is None or self._writer.is_closing():
            return
        self._writer.write(pipe.packed(frame))
        if self._writer.transport.get_write_buffer_size() > BACKLOG:
            _log.warning("the process of %s does not read what it asked for", self.name)
            self._kill()

    def _tell_presence(self, key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        left = not there and self._transport.presence.left(key)
        self._send(pipe.Present(key, there, left))

    def _take(self, incoming: Incoming) -> None:
        """Hand a request on, from any thread."""
        soon(self._loop, partial(self._hand_on, incoming))

    def _hand_on(self, incoming: Incoming) -> None:
        number = next(self._numbers)
        if self.given_up is not None and not self.over:
            self.given_up.take(incoming)
        elif self.over or self.moved or len(self._open) + len(self._waiting) >= MOST_OPEN:
            self._end_without(incoming)
        elif not self._ready:  # it is made, or goes on after a crash
            self._waiting.append((number, incoming))
        else:
            self._pass(number, incoming)

    def _pass(self, number: int, incoming: Incoming) -> None:
        self._open[number] = incoming
        process, user = incoming.credentials
        if self._judge.note_asked(incoming.body, number):
            self._keep_children()
        body = bytes(incoming.body)
        if any(name in body for name in _OF_PERMITS):
            body = self._with_permit(body)
        self._send(pipe.Come(number, body, process, user, urgent=False))

    def _with_permit(self, body: bytes) -> bytes:
        """Put into a call the permit that it names: the process of the robot cannot read it."""
        try:
            envelope = read_envelope(body)
        except VrError:
            return body
        call = envelope.request
        if not isinstance(call, Call) or envelope.proof:  # a gateway has put it in
            return body
        permit = None
        with contextlib.suppress(NoSuchPermit):  # also where it names none
            permit = permits_beside(self._transport.gate).find(call.permit)
        call = msgspec.structs.replace(call, vouched=None if permit is None else travelling(permit))
        return msgspec.msgpack.encode(msgspec.structs.replace(envelope, request=call))

    # -- from the process -------------------------------------------------------------------------

    async def _read(self, reader: asyncio.StreamReader) -> None:
        allowance, last = BURST, self._loop.time()
        while True:
            try:
                (size,) = pipe.HEAD.unpack(await reader.readexactly(pipe.HEAD.size))
                if size > pipe.LARGEST:
                    raise Misbehaved(f"it sent {size} bytes at once")
                body = await reader.readexactly(size)
            except (asyncio.IncompleteReadError, OSError):
                return
            try:
                frame = pipe.from_robot.decode(body)
            except (msgspec.MsgspecError, UnicodeDecodeError):
                raise Misbehaved("it sent what cannot be read") from None
            now = self._loop.time()
            allowance, last = min(BURST, allowance + (now - last) * FRAMES) - 1, now
            if allowance < 0:
                await asyncio.sleep(-allowance / FRAMES)
            try:
                await self._carry_out(frame)
            except VrError as error:  # of a frame within the frame: no robot of ours sends such
                raise Misbehaved(f"it sent what cannot be used: {error}") from None

    def _new_takers(self) -> dict[type[pipe.PipeFrame], Callable[[Any], Coroutine[Any, Any, None] | None]]:
        return {
            pipe.Loaded: self._note_loaded,
            pipe.Ask: self._ask,
            pipe.ReplyBack: self._reply,
            pipe.EndBack: self._end,
            pipe.Publish: self._publish,
            pipe.Alive: self._note_alive,
            pipe.Answered: self._take_answer,
            pipe.Subscribe: self._begin_samples,
            pipe.Unsubscribe: self._end_samples,
            pipe.Serve: self._serve,
            pipe.Announce: self._be_present,
            pipe.Withdraw: self._withdraw,
            pipe.Settle: lambda frame: self._keep(self._settle(frame.number)),
            pipe.Up: self._be_up,
            pipe.FailedFrame: self._fail,
            pipe.GoneFrame: self._go,
        }

    async def _carry_out(self, frame: pipe.FromRobot) -> None:
        """Do what the robot asks for.

        Raises:
            Misbehaved: no robot does that.
        """
        self._last_sign = max(self._last_sign, self._loop.time())
        take = self._takers[type(frame)]
        if (rest := take(frame)) is not None:
            await rest

    def _ask(self, frame: pipe.Ask) -> None:
        self._judge.expect_asked(frame.key, frame.body)
        on_reply = partial(self._replied, frame.number)
        if frame.key.startswith("host/"):
            self._ask_host(frame, on_reply)
            return
        try:
            if self._judge.expect_child(frame.key, frame.body):
                self._keep_children()
        except (NotItsChild, NotAllowed) as error:
            _log.warning("%s", error)
            self._replied(frame.number, encode(Raised.of(error)))
            on_reply(None)
            return
        self._transport.ask(
            frame.key, frame.body, void_at=frame.void_at, urgent=frame.urgent, on_reply=on_reply
        )

    def _ask_host(self, frame: pipe.Ask, on_reply: OnReply) -> None:
        """Ask another host to take it, in the name of this one, or what became of it."""
        envelope, courier = read_envelope(frame.body), self.courier
        request, name = envelope.request, self.name
        if courier is None or self.moved or not isinstance(request, PrepareMove | TakeRobot | AskMove):
            on_reply(None)
            return
        anew = courier.made_anew(self.kept, request, self._mover)
        self.on_way = frame.key.split("/")[1]
        if isinstance(request, TakeRobot):
            courier.moment("out")

        def hear(body: bytes | None) -> None:
            if body is not None and not isinstance(request, PrepareMove):
                with contextlib.suppress(VrError):
                    reply = decode_reply(body, key=name)
                    if isinstance(reply, MoveDecided):
                        courier.moment("answered")
                        if reply.taken:
                            soon(self._loop, self._has_moved)
            elif body is not None:
                courier.moment("prepared")
            on_reply(body)

        body = resealed(envelope, anew, sender=courier.key)
        self._transport.ask(frame.key, body, void_at=frame.void_at, urgent=frame.urgent, on_reply=hear)

    def _has_moved(self) -> None:
        """Take note that it goes on in another host: nothing of it begins here any more."""
        if self.moved:
            return
        self.moved = True
        self._page_file.unlink(missing_ok=True)
        sync_folder(self._page_file.parent)
        if self.courier is not None:
            self.courier.moment("gone")
        self._loop.call_later(STOPS_WITHIN, self._kill)  # it leaves by itself before

    def _note_loaded(self, _: pipe.Loaded) -> None:
        if not self._loaded.done():
            self._loaded.set_result(None)

    def _keep_children(self) -> None:
        """Keep whom the robot may command: the next process of it may, too."""
        self.kept = msgspec.structs.replace(self.kept, children=tuple(sorted(self._judge.children)))
        self._write_page()

    def _reply(self, frame: pipe.ReplyBack) -> None:
        if (incoming := self._open.get(frame.number)) is not None:
            incoming.reply(frame.body)

    def _end(self, frame: pipe.EndBack) -> None:
        self._judge.note_answered(frame.number)
        if (incoming := self._open.pop(frame.number, None)) is None:
            return
        if frame.body == ELSEWHERE:
            self._end_without(incoming)
        else:
            incoming.end(frame.body)

    def _publish(self, frame: pipe.Publish) -> None:
        self._judge.expect_published(frame.key)
        self._transport.publish(frame.key, frame.body)

    def _note_alive(self, frame: pipe.Alive) -> None:
        self.abandoned = tuple(str(each)[:100] for each in frame.abandoned[:20])
        self.on_way = str(frame.on_way)[:100]
        self.came, placed = frame.came, frame.placed
        self.placed = None if placed is None or self.on_way else placed._replace(name=self.name)
        since = self._stubborn_since
        self._stubborn_since = min(since, self._loop.time()) if self.abandoned else float("inf")

    def _take_answer(self, frame: pipe.Answered) -> None:
        if (control := self._controls.get(frame.number)) is not None and not control.done():
            control.set_result(frame.body)

    def _begin_samples(self, frame: pipe.Subscribe) -> None:
        self._judge.expect_subscribed(frame.pattern)
        number = frame.number
        if number in self._subscriptions or number in self._coming:
            raise Misbehaved("it wanted to hear two under one number")
        if len(self._subscriptions) + len(self._coming) >= MOST_OPEN:
            raise Misbehaved(f"it wanted to hear more than {MOST_OPEN} others")
        self._coming.add(number)
        self._keep(self._subscribe(frame.number, frame.pattern))

    async def _end_samples(self, frame: pipe.Unsubscribe) -> None:
        if (registration := self._subscriptions.pop(frame.number, None)) is not None:
            await registration.close()
        elif frame.number in self._coming:
            self._dropped.add(frame.number)

    async def _serve(self, frame: pipe.Serve) -> None:
        self._judge.expect_own(frame.key)
        if frame.on:
            await self._answer_under(frame.key, frame.rank)
        elif self.moved and self._served is not None:
            served, self._served = self._served, None
            await served.close()

    async def _answer_under(self, key: str, rank: int) -> None:
        if self._served is None:
            self._served = await self._transport.serve(key, self._take, rank=rank)

    async def _be_present(self, frame: pipe.Announce) -> None:
        self._judge.expect_own(frame.key)
        self._send(pipe.Did(frame.number, await self._announce(frame.key, frame.unless)))

    async def _withdraw(self, frame: pipe.Withdraw) -> None:
        self._judge.expect_own(frame.key)
        present, self._present = self._present, None
        if present is not None:
            await present.close()

    def _be_up(self, frame: pipe.Up) -> None:
        reply = decode_reply(frame.description, key=self.name)
        if not isinstance(reply, Described) or reply.robot.address != self.address:
            raise Misbehaved("it described another robot")
        self.page = str(frame.page)[:64]
        self._judge.identity = self._judge.identity or reply.robot.identity
        self._ready = True
        waiting, self._waiting = self._waiting, []
        for number, incoming in waiting:
            self._pass(number, incoming)
        self._last_sign = self._loop.time()
        if self.kept.parcel is not None or self.kept.left:  # it is in its folder now
            self.kept = msgspec.structs.replace(self.kept, parcel=None, left=())
            self._write_page()
        if not self._up.done():
            self._for_good = False
            self._up.set_result(reply)

    def _fail(self, frame: pipe.FailedFrame) -> None:
        reply = decode_reply(frame.body, key=self.name)
        error = reply.revive() if isinstance(reply, Raised) else VrError(detail=f"{self.name} cannot be made")
        if self._up.done():
            self.over = str(error)
        else:
            self._up.set_exception(error)

    def _go(self, _: pipe.GoneFrame) -> None:
        self.over, self._for_good = self.over or (MOVED if self.moved else DELETED), True

    async def _announce(self, key: str, unless: list[str]) -> list[str]:
        if self._present is not None:
            return []
        try:
            self._present = await self._transport.announce(key, unless=unless)
        except Occupied as error:
            return list(error.keys)
        return []

    async def _settle(self, number: int) -> None:
        await self._transport.settle(0.1)
        self._send(pipe.Did(number, []))

    async def _subscribe(self, number: int, pattern: str) -> None:
        def take(key: str, body: bytes) -> None:
            self._send(pipe.Sampled(number, key, bytes(body)))

        try:
            registration = await self._transport.subscribe(pattern, take)
        finally:
            self._coming.discard(number)
        if number in self._dropped or self.pid == 0:
            self._dropped.discard(number)
            await registration.close()
        else:
            self._subscriptions[number] = registration

    def _replied(self, number: int, body: bytes | None) -> None:
        """Hand a reply on, in any thread."""
        frame = pipe.Replied(number, None if body is None else bytes(body))
        soon(self._loop, partial(self._send, frame))

    def _keep(self, work: Any) -> None:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


class RobotsApart:
    """All robots apart of one host."""

    def __init__(self, setting: ApartSetting, transport: Transport) -> None:
        """Begin with none."""
        self._setting, self._transport = setting, transport
        self._nursery: Nursery | None = None
        self.robots: dict[str, RobotApart] = {}
        self.courier: Courier | None = None
        """See `RobotApart.courier`."""
        self.registrar: Registrar | None = None
        """See `RobotApart.registrar`."""
        self.on_lost: Callable[[str], object] = lambda _: None
        """See `RobotApart.on_lost`."""

    def kept(self) -> list[KeptApart]:
        """Return the robots that are kept in this host's folder; what cannot be read is left out.

        They begin with the stop that was left for them while the host was away.
        """
        if self._setting.folder is None:
            return []
        found: list[KeptApart] = []
        for folder in (self._setting.folder / APART).glob("*/"):
            if "." not in folder.name and not folder.with_name(f"{folder.name}{PAGE}").exists():
                _log.error("%s is not back: its page is missing beside %s", folder.name, folder)
        for path in sorted((self._setting.folder / APART).glob(f"*{PAGE}")):
            try:
                found.append(_stopped(path, _kept.decode(path.read_bytes()), "its host was away"))
            except (OSError, msgspec.MsgspecError) as error:
                _log.error("%s is not back: %s cannot be read: %s", path.stem, path, error)
        return found

    async def begin(self, kept: KeptApart, permissions: Permissions | None, *, fresh: bool) -> Described:
        """Have a robot in a process of its own.

        Args:
            kept: what it is made of.
            permissions: of its page; None: it is not limited.
            fresh: whether it is a new one; else it goes on from its folder.

        Raises:
            VrError: it cannot be; it says why.
        """
        robot = self._new(kept, permissions)
        try:
            return await robot.begin(fresh=fresh)
        except BaseException:
            self.robots.pop(robot.name, None)
            raise

    def _new(self, kept: KeptApart, permissions: Permissions | None) -> RobotApart:
        if self._nursery is None:
            self._nursery = Nursery()
        robot = RobotApart(kept, permissions, self._setting, self._transport, self._nursery, self._forget)
        robot.courier, robot.on_lost, robot.registrar = self.courier, self.on_lost, self.registrar
        self.robots[robot.name] = robot
        return robot

    @property
    def keeps(self) -> bool:
        """Whether its robots survive their processes."""
        return self._setting.folder is not None

    async def expect(self, kept: KeptApart, permissions: Permissions | None) -> RobotApart:
        """Be ready for a robot that may come from another host; returns when its page is loaded.

        Raises:
            VrError: it cannot be; it says why.
        """
        robot = self._new(kept, permissions)
        try:
            await robot.expect()
        except BaseException:
            self.robots.pop(robot.name, None)
            raise
        return robot

    def drop(self, kept: KeptApart) -> None:
        """Forget what was kept of a robot that has not come in the end."""
        if self._setting.folder is not None:
            (self._setting.folder / APART / f"{kept.create.name}{PAGE}").unlink(missing_ok=True)

    def _forget(self, robot: RobotApart) -> None:
        if self.robots.get(robot.name) is robot:
            del self.robots[robot.name]

    async def close(self, *, returns: bool) -> None:
        """End them all, politely if they follow."""
        await asyncio.gather(*(robot.leave(returns=returns) for robot in list(self.robots.values())))
        if self._nursery is not None:
            self._nursery.close()


def _stopped(page_file: Path, kept: KeptApart, missed: str) -> KeptApart:
    """Have a robot obey a stop that was left for it: what is kept of it says so from now on.

    Args:
        page_file: what is kept of it.
        kept: the same, read.
        missed: why it did not hear the stop itself.

    Raises:
        OSError: that cannot be written, or the stop cannot be read.
    """
    folder = page_file.with_suffix("")
    if reason := stop_left(folder):
        stop = SafeStop(reason=f"{reason}, while {missed}")
        kept = msgspec.structs.replace(kept, left=(*kept.left, stop))
        replace(page_file, msgspec.msgpack.encode(kept))
        take_stop_back(folder)
    return kept


def _settle(ended: asyncio.Future[int], code: int) -> None:
    if not ended.done():
        ended.set_result(code)


def _how(code: int) -> str:
    """Return how a process has ended, for people."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
