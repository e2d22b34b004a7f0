"""One tab: a process with the full screen at a terminal of its own, and the socket to the browser.

What the browser says is JSON: first `{"token", "size": [columns, lines], "page"}`, then `{"keys": TEXT}`,
`{"size": …}`, `{"taken": BYTES}` for what it has drawn, `{"hidden": true}` when it is not seen, and
`{"beat": N}` in answer to ours. What the terminal draws goes to it as bytes; `{"ended": SENTENCE}` says why
there is no more.

The tab is there for as long as it answers. Closed, killed or gone with its machine: the socket ends, or
nothing is heard for `SILENCE`. A frozen tab answers nothing, whatever its browser does. Then the terminal is
closed, and the screen ends as in a window that is closed: what it has begun on robots ends, too.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import json
import os
import signal
import struct
import sys
import termios
import tty
from collections.abc import Sequence
from typing import Any, cast

from websockets.asyncio.server import ServerConnection

BEAT, SILENCE = 2.0, 10.0
"""[s] between two questions whether the tab is there; and after which one that says nothing is not."""
WINDOW = 1_000_000
"""Bytes that a browser may have to draw; then the screen waits, as at a slow terminal."""
CHUNK = 65_536
"""Bytes read from the terminal at once."""
LAST = 5.0
"""[s] in which a screen whose terminal has closed ends by itself (`processes.ending.CREW_LAST_WORDS`)."""
KEYS = 400_000
"""Bytes of keys that may wait for the screen: a paste of 100 000 letters of any script."""
PROGRAM = ("-m", "robotree.tui.behind_a_tab")
"""What Python runs in the terminal."""
SMALLEST, LARGEST = 2, 500
"""Columns, and lines, of a terminal."""


def size_of(given: object) -> tuple[int, int] | None:
    """Return columns and lines from a message; None: that is no size."""
    if not isinstance(given, list) or len(cast("list[object]", given)) != 2:
        return None
    numbers = [one for one in cast("list[object]", given) if type(one) is int]
    if len(numbers) != 2:
        return None
    columns, lines = (min(max(one, SMALLEST), LARGEST) for one in numbers)
    return columns, lines


def message_of(text: str | bytes) -> dict[str, Any]:
    """Return a message of a browser; empty: it is none."""
    with contextlib.suppress(ValueError, RecursionError):
        if isinstance(found := json.loads(text), dict):
            return cast("dict[str, Any]", found)
    return {}


class Screen:
    """A terminal, and in it the process of the full screen, which waits to be wanted."""

    def __init__(self) -> None:
        """Nothing runs yet."""
        self.master = -1
        self._wish = -1
        self._process: asyncio.subprocess.Process | None = None

    async def open(self) -> None:
        """Open the terminal and start the process."""
        self.master, inside = os.openpty()
        waiting, self._wish = os.pipe()
        os.set_inheritable(waiting, True)
        tty.setraw(inside)
        os.set_blocking(self.master, False)
        environment = {name: text for name, text in os.environ.items() if not name.startswith("TEXTUAL_")}
        environment |= {"TERM": "xterm-256color", "COLORTERM": "truecolor"}
        try:
            self._process = await asyncio.create_subprocess_exec(
                *(sys.executable, *PROGRAM, str(waiting)),
                stdin=inside, stdout=inside, stderr=inside,
                env=environment, start_new_session=True, pass_fds=(waiting,),
            )  # fmt: skip
        finally:
            os.close(inside)
            os.close(waiting)

    @property
    def pid(self) -> int:
        """The process."""
        return self._process.pid if self._process else 0

    def waits(self) -> bool:
        """Whether it can still be wanted."""
        return self._process is not None and self._process.returncode is None and self._wish >= 0

    def begin(self, words: Sequence[str]) -> None:
        """Want it, with these words of the command line."""
        with contextlib.suppress(OSError):  # it has ended: its terminal says why
            os.write(self._wish, f"{json.dumps(list(words))}\n".encode())
        os.close(self._wish)
        self._wish = -1

    def resize(self, columns: int, lines: int) -> None:
        """Give the terminal a size; its process is told by the kernel."""
        if self.master >= 0:
            fcntl.ioctl(self.master, termios.TIOCSWINSZ, struct.pack("HHHH", lines, columns, 0, 0))

    async def read(self) -> bytes:
        """Wait for what is drawn; empty: the process has ended."""
        while self.master >= 0:
            try:
                return os.read(self.master, CHUNK)
            except BlockingIOError:
                await self._ready(write=False)
            except OSError:
                return b""
        return b""

    async def write(self, keys: bytes) -> None:
        """Press keys."""
        rest = keys
        while rest and self.master >= 0:
            try:
                rest = rest[os.write(self.master, rest) :]
            except BlockingIOError:
                await self._ready(write=True)
            except OSError:
                return

    async def _ready(self, *, write: bool) -> None:
        loop = asyncio.get_running_loop()
        add, remove = (
            (loop.add_writer, loop.remove_writer) if write else (loop.add_reader, loop.remove_reader)
        )
        found = loop.create_future()
        add(self.master, lambda: None if found.done() else found.set_result(None))
        try:
            await found
        finally:
            remove(self.master)

    async def close(self) -> None:
        """Close the terminal, and see that the process ends."""
        for descriptor in (self._wish, self.master):
            if descriptor >= 0:
                os.close(descriptor)
        self._wish = self.master = -1
        if self._process is None:
            return
        with contextlib.suppress(ProcessLookupError):
            self._process.send_signal(signal.SIGHUP)
        try:
            async with asyncio.timeout(LAST):
                await self._process.wait()
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
            await self._process.wait()


class Session:
    """What goes between a tab and its screen."""

    def __init__(self, tab: ServerConnection, screen: Screen, size: tuple[int, int]) -> None:
        """Join them; `size` is that of the tab."""
        self._tab, self._screen, self._size = tab, screen, size
        self._open, self._hidden = 0, False
        """Bytes that the tab has not drawn yet."""
        self._room = asyncio.Event()
        self._room.set()
        self._heard = asyncio.get_running_loop().time()
        self._keys = bytearray()
        """What the terminal has not taken yet."""
        self._pressed = asyncio.Event()

    async def last(self) -> str:
        """Carry to and fro until one of both ends; return why, as a sentence."""
        coroutines = (self._draw(), self._listen(), self._press(), self._beat())
        works = [asyncio.ensure_future(one) for one in coroutines]
        try:
            done, _ = await asyncio.wait(works, return_when=asyncio.FIRST_COMPLETED)
            return next((one.result() for one in done if not one.exception()), "The connection has ended.")
        finally:
            for one in works:
                one.cancel()
            await asyncio.gather(*works, return_exceptions=True)

    async def _draw(self) -> str:
        while True:
            await self._room.wait()
            drawn = await self._screen.read()
            if not drawn:
                return "The screen has been left."
            if self._hidden:
                continue  # whoever sees it again gets it whole
            self._open += len(drawn)
            if self._open >= WINDOW:
                self._room.clear()
            await self._tab.send(drawn)

    async def _beat(self) -> str:
        loop, number = asyncio.get_running_loop(), 0
        while (silent := loop.time() - self._heard) < SILENCE:
            number += 1
            sending = asyncio.ensure_future(self._tab.send(json.dumps({"beat": number})))
            sending.add_done_callback(lambda one: one.cancelled() or one.exception())
            try:
                await asyncio.wait([sending], timeout=min(BEAT, SILENCE - silent))
                if sending.done():
                    sending.result()
                    await asyncio.sleep(min(BEAT, SILENCE - silent))
            finally:
                sending.cancel()
        return f"This tab was silent for {SILENCE:g} s, so what it had begun was ended."

    async def _press(self) -> str:
        """Give the terminal its keys, apart from the socket: a screen may take none for a long time."""
        while True:
            await self._pressed.wait()
            self._pressed.clear()
            while self._keys:
                some = bytes(self._keys[:CHUNK])
                del self._keys[:CHUNK]
                await self._screen.write(some)

    async def _listen(self) -> str:
        """Take what the tab says. Nothing is waited for here, for else its end would not be seen."""
        while True:
            message = message_of(await self._tab.recv())
            self._heard = asyncio.get_running_loop().time()
            if isinstance(keys := message.get("keys"), str):
                self._keys += keys.encode(errors="replace")
                if len(self._keys) > KEYS:
                    return "This tab sent more keys than its screen can take, so what it had begun was ended."
                self._pressed.set()
            if size := size_of(message.get("size")):
                self._size = size
                self._screen.resize(*size)
            if type(taken := message.get("taken")) is int and taken > 0:
                self._take(taken)
            if isinstance(hidden := message.get("hidden"), bool):
                self._hide(hidden=hidden)

    def _take(self, taken: int) -> None:
        self._open = max(self._open - taken, 0)
        if self._open < WINDOW:
            self._room.set()

    def _hide(self, *, hidden: bool) -> None:
        """Let a tab that nobody sees draw nothing, for its timers are slow; one that is seen gets all."""
        if hidden == self._hidden:
            return
        self._hidden = hidden
        self._open = 0
        self._room.set()
        if not hidden:
            columns, lines = self._size
            self._screen.resize(columns, max(lines - 1, SMALLEST))
            later = asyncio.get_running_loop().call_later  # two changes at once would be none
            later(0.1, lambda: self._screen.resize(*self._size))
