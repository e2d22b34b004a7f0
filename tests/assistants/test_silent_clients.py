"""Clients that freeze while their connection stays open, send endless lines, or do not read."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
from typing import Any, Self

import anyio
import pytest
from mcp.shared.message import SessionMessage
from mcp_types import jsonrpc_message_adapter

from robotree.assistants import pipes, serving
from robotree.assistants import server as servers
from robotree.assistants.pipes import BoundedLines, PatientTexts
from robotree.assistants.server import AssistantServer
from robotree.assistants.serving import watch_peer
from tests.assistants.hall import Hall
from tests.assistants.test_held import HELLO
from tests.waiting import until


class Wire:
    """A client that says what it is told to, and no more."""

    def __init__(self, server: AssistantServer) -> None:
        self._server = server
        self.heard: list[dict[str, Any]] = []

    async def __aenter__(self) -> Self:
        self._go, come = anyio.create_memory_object_stream[SessionMessage | Exception](100)
        go, self._come = anyio.create_memory_object_stream[SessionMessage](100)
        self._ends = self._go, come, go, self._come
        served = self._server.server.run(come, go, self._server.options())
        self._tasks = [asyncio.create_task(served), asyncio.create_task(self._listen())]
        await self.say("initialize", 1, HELLO)
        await until(lambda: bool(self.heard), "it says hello")
        await self.say("notifications/initialized", None, {})
        return self

    async def __aexit__(self, *_: object) -> None:
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for end in self._ends:
            end.close()

    async def say(self, method: str, number: int | None, params: dict[str, Any]) -> None:
        body = {"jsonrpc": "2.0", "method": method, "params": params}
        body |= {} if number is None else {"id": number}
        await self._go.send(SessionMessage(jsonrpc_message_adapter.validate_json(json.dumps(body))))

    async def _listen(self) -> None:
        async for sent in self._come:
            self.heard.append(sent.message.model_dump(by_alias=True, exclude_unset=True))


def holding(program: str, number: int) -> subprocess.Popen[bytes]:
    """Start a process that is given a descriptor, or the number of a port."""
    words = [sys.executable, "-c", program, str(number)]
    return subprocess.Popen(words, pass_fds=(number,) if number < 1000 else ())


async def test_a_client_that_answers_no_ping_moves_nothing(
    hall: Hall, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(servers, "PINGS", 0.05)
    monkeypatch.setattr(servers, "PONG", 0.2)
    async with Wire(AssistantServer(hall.seat)) as client:
        walk = {"name": "cart-1__walk", "arguments": {"x": 1000.0, "_why": "w"}}
        await client.say("tools/call", 2, walk)
        await until(lambda: hall.cart.at > 0, "it walks")
        await until(lambda: any(one.get("method") == "ping" for one in client.heard), "it is asked")
        await until(lambda: hall.agent.description().busy == "", "it has ended")
    (going,) = hall.seat.going.values()
    assert "gives no sign of life" in str(going.error)


async def test_a_client_that_was_stopped_moves_nothing(hall: Hall, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serving, "LOOKS", 0.02)
    monkeypatch.setattr(serving, "STOPPED", 0.1)
    come, go = os.pipe()
    client = holding("import time; time.sleep(600)", go)
    os.close(go)
    server = AssistantServer(hall.seat)
    watching = asyncio.create_task(watch_peer(pipes.of_descriptor(come), server.hung_up))
    try:
        async with Wire(server) as wire:
            walk = {"name": "cart-1__walk", "arguments": {"x": 1000.0, "_why": "w"}}
            await wire.say("tools/call", 2, walk)
            await until(lambda: hall.cart.at > 0.1, "it walks")
            assert not server.hung_up.is_set()
            client.send_signal(signal.SIGSTOP)
            await until(lambda: hall.agent.description().busy == "", "it has ended")
        client.send_signal(signal.SIGCONT)
        await until(lambda: not server.hung_up.is_set(), "it is back")
    finally:
        watching.cancel()
        client.kill()
        client.wait()
        os.close(come)


CLIENT = "import socket, sys; s = socket.create_connection(('127.0.0.1', int(sys.argv[1]))); s.recv(1)"


async def test_who_is_at_the_other_end_of_a_connection_is_known() -> None:
    with socket.create_server(("127.0.0.1", 0)) as door:
        here = door.getsockname()[1]
        client = holding(CLIENT, here)
        try:
            end, (_, there) = door.accept()
            found = pipes.of_connection(there, here)
            assert not found.stopped()
            client.send_signal(signal.SIGSTOP)
            await until(found.stopped, "it is stopped")
            client.send_signal(signal.SIGCONT)
            await until(lambda: not found.stopped(), "it goes on")
            end.close()
        finally:
            client.kill()
            client.wait()
    assert not pipes.of_connection(1, 1).stopped()


async def test_a_line_without_end_is_not_kept_and_the_next_one_is_read() -> None:
    come, go = os.pipe()
    heard, said = os.pipe()
    lines = BoundedLines(come, 1000, PatientTexts(said))
    found: list[str] = []

    async def read() -> None:
        async for line in lines:
            found.append(line)  # noqa: PERF401 # each when it comes

    reading = asyncio.create_task(read())
    left = b"first\n" + b"x" * 240_000 + b"\nsecond\n" + b"y" * 1500 + b"\nthird\nhalf"
    os.set_blocking(go, False)
    while left:
        with contextlib.suppress(BlockingIOError):
            left = left[os.write(go, left[:4000]) :]
        await asyncio.sleep(0)
    await until(lambda: len(found) == 3, "the others are read")
    os.close(go)
    await reading
    assert found == ["first\n", "second\n", "third\n"]
    assert lines.refused == 2
    answers = os.read(heard, 10_000).decode().splitlines()
    assert [json.loads(each)["error"]["code"] for each in answers] == [-32600, -32600]
    for each in (come, heard, said):
        os.close(each)


async def test_a_client_that_reads_nothing_holds_up_its_own_answers_alone() -> None:
    come, go = os.pipe()
    texts = PatientTexts(go)
    writing = asyncio.create_task(texts.write("x" * 3_000_000))
    await asyncio.sleep(0.01)
    assert not writing.done(), "and yet this runs"
    got = 0
    os.set_blocking(come, False)
    while got < 3_000_000:
        with contextlib.suppress(BlockingIOError):
            got += len(os.read(come, 1 << 20))
        await asyncio.sleep(0)
    await writing
    for each in (come, go):
        os.close(each)
