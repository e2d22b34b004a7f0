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
from typing import Any, NamedTuple

import msgspec

from robotree.files import private_folder
from robotree.vr.base.address import Address
from robotree.vr.base.errors import NoAnswer, NotItsChild, Unreachable, VrError
from robotree.vr.base.permissions import Isolation, Permissions
from robotree.vr.base.presence import Held, Undo
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import (
    Create,
    Described,
    Raised,
    ReadEvents,
    Reload,
    Reply,
    VerifyEvents,
    decode_reply,
    encode,
)
from robotree.vr.base.transport import Incoming, Occupied, Registration, Transport
from robotree.vr.isolation import pipe
from robotree.vr.isolation.judge import Judge, Misbehaved
from robotree.vr.isolation.nursery import BOX, Nursery

APART = "apart"
"""Name of the folder of all robots apart, in the folder of their host's journal."""
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
DELETED = "it was deleted"
START = 20.0
"""[s] for a process to have its robot up, beyond the time that the page may take."""

_log = logging.getLogger(__name__)


def lack_for(level: Isolation) -> str:
    """Return what this system lacks for robots of a level; empty: nothing."""
    if sys.platform != "linux":
        return "it needs Linux"
    return "bubblewrap is not installed" if level == "sandbox" and BOX is None else ""


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


_kept: msgspec.msgpack.Decoder[KeptApart] = msgspec.msgpack.Decoder(KeptApart)
_PAGE = ".page"
"""Suffix of the file of a `KeptApart`."""


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
        self._last_sign = 0.0
        self._takers = self._new_takers()

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
            shutil.rmtree(self.folder, ignore_errors=True)  # of one that was deleted while nobody looked
            private_folder(self.folder)
            self._write_page()
        self._for_good = fresh  # until it has been up once
        self._keep(self._live(self.kept.create if fresh else None))
        return await asyncio.shield(self._up)

    def _write_page(self) -> None:
        """Keep what the robot is made of beside its folder, where its process cannot write."""
        if self.folder is not None:
            path = self.folder.with_name(f"{self.name}{_PAGE}")
            new = path.with_suffix(".new")
            new.write_bytes(msgspec.msgpack.encode(self.kept))
            new.replace(path)

    async def _live(self, create: Create | None) -> None:
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
            if self.over or self._leaving or not self._up.done() or self._up.exception() is not None:
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
            if self._crashes >= GIVES_UP:
                self.over = f"its process has ended {GIVES_UP} times ({_how(code)})"
                break
            abandon, self._held = self._held, ""
            if not abandon and in_a_row >= CRASHES:
                abandon = f"its process has ended in it twice ({_how(code)})"
            in_a_row = 0 if abandon else in_a_row
            _log.warning("the process of %s has ended (%s); it is started again", self.name, _how(code))
        await self._finish()

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
            create=create,
            asker=self.kept.asker,
            level=self.kept.level,
            permissions=self._permissions,
            abandon=abandon,
            note=self._note,
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
        self.pid, self._ready = 0, False
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        opened, self._open = self._open, {}
        for incoming in opened.values():
            incoming.end(None)
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
            incoming.end(None)
        self._waiting.clear()
        if not self._up.done():
            self._up.set_exception(VrError(detail=f"{self.name} cannot be: {self.over or 'its host ends'}"))
        elif self.over and self.over != DELETED:
            _log.error("%s is gone: %s", self.name, self.over)
        if self._for_good and self.folder is not None:
            self.folder.with_name(f"{self.name}{_PAGE}").unlink(missing_ok=True)
            shutil.rmtree(self.folder, ignore_errors=True)
        self._ended.set()
        self._on_end(self)

    async def leave(self, *, returns: bool, within: float = 3.0) -> None:
        """End politely; its process is ended if it takes too long."""
        self._leaving = True
        self._send(pipe.Leave(returns))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within):
                await self._ended.wait()
        if not self._ended.is_set():
            self._kill()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(within):
                    await self._ended.wait()

    async def control(
        self,
        request: Reload | ReadEvents | VerifyEvents,
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

    def _soon(self, frame: pipe.PipeFrame) -> None:
        """Send a frame, from any thread."""
        with contextlib.suppress(RuntimeError):  # the loop is closed
            self._loop.call_soon_threadsafe(self._send, frame)

    def _tell_presence(self, key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        left = not there and self._transport.presence.left(key)
        self._send(pipe.Present(key, there, left))

    def _take(self, incoming: Incoming) -> None:
        """Hand a request on, from any thread."""
        with contextlib.suppress(RuntimeError):
            self._loop.call_soon_threadsafe(self._hand_on, incoming)

    def _hand_on(self, incoming: Incoming) -> None:
        number = next(self._numbers)
        if self.over or len(self._open) + len(self._waiting) >= MOST_OPEN:
            incoming.end(None)
        elif not self._ready:  # it is made, or goes on after a crash
            self._waiting.append((number, incoming))
        else:
            self._pass(number, incoming)

    def _pass(self, number: int, incoming: Incoming) -> None:
        self._open[number] = incoming
        process, user = incoming.credentials
        if self._judge.note_asked(incoming.body):
            self._keep_children()
        self._send(pipe.Come(number, bytes(incoming.body), process, user, urgent=False))

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
            pipe.Settle: self._settle_soon,
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
        try:
            if self._judge.expect_child(frame.key, frame.body):
                self._keep_children()
        except NotItsChild as error:
            _log.warning("%s", error)
            self._replied(frame.number, encode(Raised.of(error)))
            on_reply(None)
            return
        self._transport.ask(
            frame.key, frame.body, void_at=frame.void_at, urgent=frame.urgent, on_reply=on_reply
        )

    def _keep_children(self) -> None:
        """Keep whom the robot may command: the next process of it may, too."""
        self.kept = msgspec.structs.replace(self.kept, children=tuple(sorted(self._judge.children)))
        self._write_page()

    def _reply(self, frame: pipe.ReplyBack) -> None:
        if (incoming := self._open.get(frame.number)) is not None:
            incoming.reply(frame.body)

    def _end(self, frame: pipe.EndBack) -> None:
        if (incoming := self._open.pop(frame.number, None)) is not None:
            incoming.end(frame.body)

    def _publish(self, frame: pipe.Publish) -> None:
        self._judge.expect_published(frame.key)
        self._transport.publish(frame.key, frame.body)

    def _note_alive(self, frame: pipe.Alive) -> None:
        self.abandoned = tuple(str(each)[:100] for each in frame.abandoned[:20])
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
        if frame.on and self._served is None:
            self._served = await self._transport.serve(frame.key, self._take)

    async def _be_present(self, frame: pipe.Announce) -> None:
        self._judge.expect_own(frame.key)
        self._send(pipe.Did(frame.number, await self._announce(frame.key, frame.unless)))

    async def _withdraw(self, frame: pipe.Withdraw) -> None:
        self._judge.expect_own(frame.key)
        present, self._present = self._present, None
        if present is not None:
            await present.close()

    def _settle_soon(self, frame: pipe.Settle) -> None:
        self._keep(self._settle(frame.number))

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
        if not self._up.done():
            self._for_good = False
            self._up.set_result(reply)

    def _fail(self, frame: pipe.FailedFrame) -> None:
        error = _error_of(frame.body, self.name)
        if not self._up.done():
            self._up.set_exception(error)
        else:
            self.over = str(error)

    def _go(self, _: pipe.GoneFrame) -> None:
        self.over, self._for_good = self.over or DELETED, True

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
        self._soon(pipe.Replied(number, None if body is None else bytes(body)))

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

    def kept(self) -> list[KeptApart]:
        """Return the robots that are kept in this host's folder; what cannot be read is left out."""
        if self._setting.folder is None:
            return []
        found: list[KeptApart] = []
        for path in sorted((self._setting.folder / APART).glob(f"*{_PAGE}")):
            try:
                found.append(_kept.decode(path.read_bytes()))
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
        if self._nursery is None:
            self._nursery = Nursery()
        name = kept.create.name
        robot = RobotApart(kept, permissions, self._setting, self._transport, self._nursery, self._forget)
        self.robots[name] = robot
        try:
            return await robot.begin(fresh=fresh)
        except BaseException:
            self.robots.pop(name, None)
            raise

    def _forget(self, robot: RobotApart) -> None:
        if self.robots.get(robot.name) is robot:
            del self.robots[robot.name]

    async def close(self, *, returns: bool) -> None:
        """End them all, politely if they follow."""
        await asyncio.gather(*(robot.leave(returns=returns) for robot in list(self.robots.values())))
        if self._nursery is not None:
            self._nursery.close()


def _settle(ended: asyncio.Future[int], code: int) -> None:
    if not ended.done():
        ended.set_result(code)


def _error_of(body: bytes, name: str) -> VrError:
    reply = decode_reply(body, key=name)
    return reply.revive() if isinstance(reply, Raised) else VrError(detail=f"{name} cannot be made")


def _how(code: int) -> str:
    """Return how a process has ended, for people."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
