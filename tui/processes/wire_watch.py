"""What a proxy's controller says on the wire, read by `robotree wire monitor` in a process of its own.

The proxy is not asked and does nothing for it: the monitor listens at the same controller, with the proxy's
key. A serial line, which one program has, cannot be watched like that.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from robotree.tui.processes.programs import KEY_VARIABLE, Program, programs

EVERY = "500ms"
"""Between two looks."""
LARGEST = 4_000_000
"""[bytes] of one look."""
LAST_WORDS = 300
"""Characters of what the monitor complains of."""


class WireMessage(msgspec.Struct, frozen=True):
    """One kind of message, as `wire monitor --json` prints it."""

    sysid: int
    compid: int
    name: str
    count: int
    rate: float | None
    """[1/s]; None: one has come."""
    age: float
    """[s]"""
    fields: dict[str, Any]
    """Of the last one."""

    @property
    def id(self) -> tuple[int, int, str]:
        """The sender and the kind."""
        return self.sysid, self.compid, self.name

    def numbers(self) -> Mapping[str, float]:
        """Return the fields that can be drawn over time, those of arrays by their number."""
        found: dict[str, float] = {}
        for name, value in self.fields.items():
            if isinstance(value, list):
                found |= _numbers_of(name, value)  # pyright: ignore[reportUnknownArgumentType] # any list
            elif isinstance(value, int | float) and not isinstance(value, bool):
                found[name] = float(value)
        return found


def _numbers_of(name: str, parts: list[Any]) -> dict[str, float]:
    return {f"{name}[{at}]": float(part) for at, part in enumerate(parts) if isinstance(part, int | float)}


class _Link(msgspec.Struct, frozen=True):
    messages: tuple[WireMessage, ...]
    loss: float = 0.0
    bytes_per_second: float | None = None


class _Look(msgspec.Struct, frozen=True):
    links: tuple[_Link, ...]


_looks = msgspec.json.Decoder(_Look)

Heard = Callable[[Sequence[WireMessage]], None]


class WireWatch:
    """Watches the wire of one proxy until it is ended."""

    def __init__(self, realm: str, robot: str, heard: Heard) -> None:
        """Begin; `heard` takes the messages of each look."""
        self.robot, self._heard = robot, heard
        self.messages: tuple[WireMessage, ...] = ()
        self.note = "its proxy is looked for …"
        """Why nothing is shown, as a sentence; empty: something is."""
        self._task = asyncio.create_task(self._watch(realm), name=f"wire of {robot}")

    async def close(self) -> None:
        """End."""
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    async def _watch(self, realm: str) -> None:
        found = await asyncio.to_thread(programs, realm)
        program = next((one for address, one in found.items() if address.name == self.robot), None)
        words = _monitor_words(program)
        if program is None or not words:
            self.note = f"{self.robot} has no proxy on this machine: only that has a wire to look at"
            return
        key = {KEY_VARIABLE: program.key} if program.key else {}
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            *("-m", "robotree.tui", *words, "--realm", realm),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
            cwd=program.folder,
            env={**os.environ, **key},
            limit=LARGEST,
        )
        self.note = "its controller is listened to …"
        try:
            await self._read(process)
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.terminate()
            await process.wait()

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        if process.stdout is None or process.stderr is None:
            return
        while line := await process.stdout.readline():
            with contextlib.suppress(msgspec.MsgspecError):
                self.messages = tuple(one for link in _looks.decode(line).links for one in link.messages)
                self.note = "" if self.messages else "nothing has come yet"
                self._heard(self.messages)
        said = (await process.stderr.read()).decode(errors="replace").strip()
        self.note = f"the wire can be watched no longer: {said[-LAST_WORDS:] or 'the monitor has ended'}"


def _monitor_words(program: Program | None) -> list[str]:
    """Return the line of the monitor for a proxy; none: it is no proxy."""
    if program is None or program.words[:1] != ("proxy",):
        return []
    options = {"--connect": "", "--key": ""}
    for name in options:
        for at, word in enumerate(program.words):
            if word == name and at + 1 < len(program.words):
                options[name] = program.words[at + 1]
            elif word.startswith(f"{name}="):
                options[name] = word.partition("=")[2]
    if not options["--connect"]:
        return []
    key = ["--key", options["--key"]] if options["--key"] else []
    return ["wire", "monitor", "--connect", options["--connect"], *key, "--every", EVERY, "--json"]
