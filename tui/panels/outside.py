"""The screen's side of a panel that is a program: starts its process, judges what it says, ends it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import sys
import tempfile
from collections.abc import Coroutine, Mapping
from typing import Any, Protocol

import msgspec

from robotree.tui.panels import frames
from robotree.tui.panels.judge import PanelJudge
from robotree.vr.base.errors import VrError
from robotree.vr.base.permissions import Permissions
from robotree.vr.isolation.confine import environment
from robotree.vr.isolation.judge import Misbehaved
from robotree.vr.isolation.pipe import HEAD

START = 30.0
"""[s] for a panel to be there."""
SILENT = 10.0
"""[s] without a sign of life after which a panel is ended: it hangs."""
LARGEST_PICTURE = 1280
"""[px] of a side."""
BACKLOG = 1024 * 1024
"""[bytes] that a panel has not read yet after which it is ended."""
_INSIDE = "robotree.tui.panels.inside"


class PanelHands(Protocol):
    """What the screen does for a panel."""

    async def carry_out(self, command: str, arguments: Mapping[str, Any]) -> Any:
        """Carry out a command of its robot; raises `VrError`."""

    async def look(self, view: str, camera: str, width: int, height: int) -> bytes:
        """Return the picture of a camera as JPEG; raises `VrError`."""
        ...

    def draw_lines(self, lines: Mapping[int, list[frames.Span]]) -> None:
        """Show lines that look otherwise now."""

    def be_up(self, frame: frames.PanelUp) -> None:
        """Take note that the panel is there."""

    def be_over(self, reason: str) -> None:
        """Take note that there is none any more, with the reason as a clause; not after `close`."""


class PanelProcess:
    """One panel, from its start to its end. On one event loop."""

    def __init__(
        self,
        begin: frames.BeginPanel,
        permissions: Permissions | None,
        hands: PanelHands,
    ) -> None:
        """Begin without a process.

        Args:
            begin: what the panel is made of.
            permissions: of its page; None: it is not limited.
            hands: what the screen does for it.
        """
        self._begin, self._hands = begin, hands
        self._loop = asyncio.get_running_loop()
        self.judge = PanelJudge(begin.robot, permissions, self._loop.time())
        self.pid = 0
        """Number of its process; 0: there is none."""
        self._writer: asyncio.StreamWriter | None = None
        self._deadline = self._loop.time() + START
        self._limit: asyncio.Timeout | None = None
        self._up = False
        self._why = ""
        """Why it is ended from here."""
        self._tasks: set[asyncio.Task[None]] = set()
        self._closed = False
        self._keep(self._live())

    def send(self, frame: frames.PanelFrame) -> None:
        """Tell the panel something; one that does not read is ended."""
        if isinstance(frame, frames.PressKey) or (
            isinstance(frame, frames.UseMouse) and frame.what == "down"
        ):
            self.judge.touched(self._loop.time())
        if self._writer is None or self._writer.is_closing():
            return
        self._writer.write(frames.packed(frame))
        if self._writer.transport.get_write_buffer_size() > BACKLOG:
            self._end("it does not read what it is told")

    def close(self) -> None:
        """End the panel. Twice is once."""
        self._closed = True
        self._end("")

    def _end(self, why: str) -> None:
        self._why = self._why or why
        if self.pid:  # 0 would be our own group
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.pid, signal.SIGKILL)

    async def _live(self) -> None:
        why = ""
        try:
            why = await self._one_process()
        except Misbehaved as fault:
            why = f"it was ended: {fault}"
        except OSError as error:
            why = f"no process can be made for it: {error.strerror or error}"
        finally:
            self._end("")
            for task in self._tasks - {asyncio.current_task()}:
                task.cancel()
            if not self._closed:
                self._closed = True
                self._hands.be_over(why or "its process has ended")

    async def _one_process(self) -> str:
        """Have a process be the panel until it ends; returns why it did.

        Raises:
            Misbehaved: it did what no panel does.
            OSError: no process can be made.
        """
        with contextlib.ExitStack() as stack:
            room = []
            if self._begin.files:  # modules need a place for their files
                room = [stack.enter_context(tempfile.TemporaryDirectory(prefix="robotree-panel-"))]
            return await self._in_room(room)

    async def _in_room(self, room: list[str]) -> str:
        own, other = socket.socketpair()
        try:
            process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-m", _INSIDE, str(other.fileno()), *room),
                pass_fds=[other.fileno()],
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.DEVNULL,
                stderr=asyncio.subprocess.DEVNULL,
                start_new_session=True,
                env=environment(),
            )
        except BaseException:
            own.close()
            raise
        finally:
            other.close()
        self.pid = process.pid
        reader, self._writer = await asyncio.open_connection(sock=own, limit=2**20)
        self.send(self._begin)
        failed = ""
        try:
            if not self._closed:
                async with asyncio.timeout_at(self._deadline) as self._limit:
                    failed = await self._read(reader)
        except TimeoutError:
            failed = f"it hung for {SILENT:.0f} s" if self._up else f"it was not there within {START:.0f} s"
        finally:
            self._end("")
            self._writer.close()
            await process.wait()
            self.pid = 0
        return failed or self._why

    async def _read(self, reader: asyncio.StreamReader) -> str:
        """Take what the panel says until it ends; returns why, as far as it says so itself.

        Raises:
            Misbehaved: it said what no panel says.
        """
        while True:
            try:
                (size,) = HEAD.unpack(await reader.readexactly(HEAD.size))
                self.judge.expect_size(size)
                body = await reader.readexactly(size)
            except (asyncio.IncompleteReadError, OSError):
                return ""
            now = self._loop.time()
            self.judge.expect_pace(size, now)
            try:
                frame = frames.from_panel.decode(body)
            except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
                raise Misbehaved("it sent what cannot be read") from None
            refusal = self.judge.refusal(frame, now)
            if isinstance(frame, frames.PanelFailed):
                return frame.reason
            if (self._up or isinstance(frame, frames.PanelUp)) and self._limit is not None:
                self._limit.reschedule(now + SILENT)
            self._take(frame, refusal)

    def _take(self, frame: frames.FromPanel, refusal: str) -> None:
        match frame:
            case frames.DrawnLines(lines=lines):
                self._hands.draw_lines(lines)
            case frames.PanelUp():
                self._up = True
                self._hands.be_up(frame)
            case frames.AskCommand(number=number) if refusal:
                self.send(frames.CallDone(number, None, refusal))
            case frames.AskCommand():
                self._keep(self._carry_out(frame))
            case frames.AskPicture(number=number) if refusal:
                self.send(frames.PictureSeen(number, b"", refusal))
            case frames.AskPicture():
                self._keep(self._look(frame))
            case _:
                pass

    async def _look(self, frame: frames.AskPicture) -> None:
        jpeg, refusal = b"", ""
        try:
            size = (min(max(side, 1), LARGEST_PICTURE) for side in (frame.width, frame.height))
            jpeg = await self._hands.look(frame.view, frame.camera, *size)
        except VrError as error:
            refusal = str(error)
        finally:
            self.judge.open.discard(frame.number)
        self.send(frames.PictureSeen(frame.number, jpeg, refusal))

    async def _carry_out(self, frame: frames.AskCommand) -> None:
        value, refusal = None, ""
        try:
            value = msgspec.to_builtins(await self._hands.carry_out(frame.command, frame.arguments))
        except VrError as error:
            refusal = str(error)
        finally:
            self.judge.open.discard(frame.number)
        self.send(frames.CallDone(frame.number, value, refusal))

    def _keep(self, work: Coroutine[Any, Any, None]) -> None:
        task = self._loop.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
