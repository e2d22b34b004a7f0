"""A slow line: what it carries, and when."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from typing import NamedTuple

import pytest

from robotree.tui.sites.slow_line import SlowLine

LONGEST = 30.0
"""[s] for anything here."""


@pytest.fixture
async def echo() -> AsyncIterator[int]:
    """The port of a server that says again what it hears."""

    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while chunk := await reader.read(1 << 16):
            writer.write(chunk)
        writer.close()

    server = await asyncio.start_server(answer, "127.0.0.1", 0)
    yield int(server.sockets[0].getsockname()[1])
    server.close()


class Dialed(NamedTuple):
    """One end of a line."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter

    async def trip(self, body: bytes) -> float:
        """Say something and hear it again; returns how long it took [s]."""
        begin = asyncio.get_running_loop().time()
        self.writer.write(body)
        async with asyncio.timeout(LONGEST):
            assert await self.reader.readexactly(len(body)) == body
        return asyncio.get_running_loop().time() - begin


async def dial(line: SlowLine) -> Dialed:
    return Dialed(*await asyncio.open_connection("127.0.0.1", await line.open()))


async def test_all_bytes_come_in_their_order_and_not_before_the_delay(echo: int) -> None:
    line = SlowLine("127.0.0.1", echo, delay=0.05)
    end = await dial(line)
    body = bytes(range(256)) * 400
    assert await end.trip(body) >= 0.1
    assert line.carried == 2 * len(body)
    end.writer.close()
    await line.close()


async def test_a_rate_is_not_exceeded_and_a_lost_segment_comes_a_time_out_later(echo: int) -> None:
    line = SlowLine("127.0.0.1", echo, rate=64_000)
    end = await dial(line)
    assert await end.trip(bytes(4000)) >= 0.5
    line.rate, line.loss = 0, 1.0
    assert await end.trip(b"x") >= 0.4
    end.writer.close()
    await line.close()


async def test_what_is_under_way_in_a_cut_comes_after_it_and_a_hang_up_is_seen(echo: int) -> None:
    line = SlowLine("127.0.0.1", echo)
    end = await dial(line)
    await end.trip(b"x")
    line.cut()
    waiting = asyncio.ensure_future(end.trip(b"y"))
    await asyncio.sleep(0.2)
    assert not waiting.done()
    line.mend()
    assert await waiting >= 0.2
    line.hang_up()
    async with asyncio.timeout(LONGEST):
        with pytest.raises((ConnectionError, asyncio.IncompleteReadError)):
            await end.reader.readexactly(1)
    end.writer.close()
    await line.close()
    await line.close()
