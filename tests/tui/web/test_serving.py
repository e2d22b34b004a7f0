"""The port for browsers with real screens behind it, asked by programs that know no manners."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import json
import os
import signal
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Origin

from robotree.tui.web import serving as place_for_browsers
from robotree.tui.web import session
from robotree.tui.web.door import Door
from robotree.tui.web.serving import Reception, Strangers, serving
from tests.terminal import children, living
from tests.waiting import until

pytestmark = pytest.mark.usefixtures("place")

TOKEN, WATCH = "a-token-that-is-for-this-test-alone", "one-to-watch"
TOP = b"realm tabs"
"""What stands on top of each screen."""
HELP = b"On every page, but not"
"""What the page of keys says."""


class Port:
    """A place for browsers, and a program that asks there."""

    def __init__(self, reception: Reception, number: int) -> None:
        self.reception, self.number = reception, number
        self.origin = f"http://127.0.0.1:{number}"

    async def raw(self, head: str) -> str:
        reader, writer = await asyncio.open_connection("127.0.0.1", self.number)
        writer.write(head.replace("\n", "\r\n").encode())
        async with asyncio.timeout(60):
            got = await reader.read()
        writer.close()
        return got.decode(errors="replace")

    def connect(self, origin: str | None = None) -> Any:
        return connect(
            f"ws://127.0.0.1:{self.number}/screen",
            origin=Origin(origin or self.origin),
            max_size=None,
            compression=None,
        )

    async def hello(self, socket: ClientConnection, **more: object) -> None:
        await socket.send(json.dumps({"token": TOKEN, "size": [80, 24], **more}))

    async def waiting(self) -> int:
        """Return the process of the only screen, which waits for a tab."""
        await until(lambda: len(self.screens) == 1, "the spare screen")
        return self.screens[0]

    @property
    def screens(self) -> list[int]:
        """Processes of screens that run."""
        return [pid for pid in children(os.getpid()) if b"behind_a_tab" in line_of(pid) and living(pid)]


def line_of(pid: int) -> bytes:
    """Return the command line of a process, as `ps` shows it."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    return b""


def memory_of(pid: int) -> int:
    """Return the most memory that a process has had, in bytes."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) * 1024


def files_with(words: bytes, folder: Path) -> list[Path]:
    """Return the files in which these words are."""
    return [one for one in folder.rglob("*") if one.is_file() and words in one.read_bytes()]


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have a program that loads nothing behind each tab: the real one takes long."""
    monkeypatch.setattr(session, "PROGRAM", ("-IS", str(Path(__file__).with_name("behind_a_tab.py"))))


@pytest.fixture
async def port(quick: None) -> AsyncIterator[Port]:
    """The place, with that program."""
    del quick
    async with opened() as place:
        yield place


@pytest.fixture
async def real_port() -> AsyncIterator[Port]:
    """The place, with the full screen behind each tab."""
    async with opened() as place:
        yield place


@contextlib.asynccontextmanager
async def opened() -> AsyncIterator[Port]:
    reception = Reception(Door(TOKEN, WATCH), ["--realm", "tabs"], 3)
    async with serving(reception, "127.0.0.1", 0) as server:
        yield Port(reception, next(iter(server.sockets)).getsockname()[1])


async def drawn(socket: ClientConnection, *words: bytes, answers: bool = True) -> bytes:
    """Read what is drawn until these words are; answer beats meanwhile, as the page does."""
    seen = b""
    async with asyncio.timeout(60):
        while not all(word in seen for word in words):
            message = await socket.recv()
            if isinstance(message, bytes):
                seen += message
                await socket.send(json.dumps({"taken": len(message)}))
            elif answers and "beat" in message:
                await socket.send(message)
    return seen


async def ended(socket: ClientConnection) -> tuple[int, str]:
    """Return the code and the sentence with which a socket is closed."""
    with contextlib.suppress(ConnectionClosed):
        async with asyncio.timeout(60):
            while True:
                await socket.recv()
    return socket.close_code or 0, socket.close_reason or ""


async def test_who_knows_another_name_comes_from_elsewhere_or_has_no_token_gets_one_sentence(
    port: Port,
) -> None:
    rebound = await port.raw("GET / HTTP/1.1\nHost: evil.example\n\n")
    assert rebound.startswith("HTTP/1.1 421 ")
    assert "this place is not called 'evil.example'" in rebound
    assert "HTTP/1.1 421" in await port.raw("GET / HTTP/1.1\nHost: 127.0.0.1\nHost: evil.example\n\n")
    assert "HTTP/1.1 404" in await port.raw("GET /../etc/passwd HTTP/1.1\nHost: localhost\n\n")
    page = await port.raw("GET / HTTP/1.1\nHost: localhost\n\n")
    assert "default-src 'none'" in page
    assert "frame-ancestors 'none'" in page
    assert "<!doctype html>" in page.lower(), "what comes is packed only for who takes it so"
    assert "Content-Encoding" not in page
    for offered, packed in {"br, gzip": True, "gzip;q=0.5": True, "gzip;q=0": False, "br": False}.items():
        page = await port.raw(f"GET / HTTP/1.1\nHost: localhost\nAccept-Encoding: {offered}\n\n")
        assert ("Content-Encoding: gzip" in page) == packed, offered
    for origin in ("http://evil.example", "null", f"http://127.0.0.1:{port.number + 1}"):
        with pytest.raises(InvalidStatus) as refused:  # also with the token: it is not even asked for
            async with port.connect(origin):
                pass
        assert refused.value.response.status_code == 403
    for hello in ("{}", "nonsense", json.dumps({"token": "wrong"}), json.dumps({"token": [TOKEN]}), b"\xff"):
        async with port.connect() as socket:
            await socket.send(hello)
            assert await ended(socket) == (4401, place_for_browsers.NO_TOKEN)
    assert len(port.screens) == 1, "that one waits; nothing was begun for them"


@pytest.mark.usefixtures("quick")
async def test_fifty_who_say_nothing_hinder_nobody_and_are_put_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(place_for_browsers, "HELLO", 2.0)
    async with opened() as port:
        where = f"ws://127.0.0.1:{port.number}/screen"
        silent = [await asyncio.open_connection("127.0.0.1", port.number) for _ in range(25)]
        mute = [await connect(where, origin=Origin(port.origin)) for _ in range(25)]
        async with port.connect() as socket:
            await port.hello(socket)
            await drawn(socket, TOP)
        for reader, writer in silent:
            async with asyncio.timeout(60):
                await reader.read()
            writer.close()
        assert {(await ended(one))[0] for one in mute} == {4401}


async def test_a_huge_message_ends_its_tab_and_no_other(port: Port) -> None:
    async with port.connect() as small, port.connect() as huge:
        for socket in (small, huge):
            await port.hello(socket)
            await drawn(socket, TOP)
        with contextlib.suppress(ConnectionClosed):
            await huge.send("x" * 100_000)
        assert (await ended(huge))[0] == 1009
        await small.send(json.dumps({"keys": "?"}))
        await drawn(small, HELP)
        await until(lambda: port.reception.tabs == 1)


async def test_two_tabs_are_two_screens_and_each_ends_alone(real_port: Port) -> None:
    async with real_port.connect() as first:
        await real_port.hello(first)
        await drawn(first, TOP)
        before = set(real_port.screens)
        async with real_port.connect() as second:
            await second.send(json.dumps({"token": WATCH, "size": [80, 24]}))
            await drawn(second, TOP, b"read-only")
            assert real_port.reception.tabs == 2
            own = [pid for pid in before if b"--readonly" not in line_of(pid)]  # or one that waits for a tab
        await until(lambda: real_port.reception.tabs == 1)
        await first.send(json.dumps({"keys": "?", "size": [120, 40]}))
        await drawn(first, HELP)
        assert any(map(living, own))
    await until(lambda: real_port.reception.tabs == 0)
    await until(lambda: len(real_port.screens) <= 1)


async def test_one_tab_more_than_allowed_is_told_and_when_all_have_ended_a_screen_waits(
    port: Port,
) -> None:
    async with contextlib.AsyncExitStack() as tabs:
        for _ in range(3):
            socket = await tabs.enter_async_context(port.connect())
            await port.hello(socket)
            await drawn(socket, TOP)
        assert port.reception.tabs == 3
        async with port.connect() as one_more:
            await port.hello(one_more)
            code, sentence = await ended(one_more)
            assert code == 4429
            assert "3 tabs are open" in sentence
    await until(lambda: port.reception.tabs == 0)
    assert await port.waiting(), "a screen waits again"


@pytest.mark.parametrize("how", ["frozen", "cut"])
async def test_a_tab_that_answers_no_more_ends_with_its_screen(
    port: Port, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    async with port.connect() as socket:
        await port.hello(socket)
        await drawn(socket, TOP)
        before = set(port.screens)
        if how == "cut":
            socket.transport.abort()
        else:
            monkeypatch.setattr(session, "SILENCE", 1.0)
            monkeypatch.setattr(session, "BEAT", 0.1)
            code, sentence = await ended(socket)
            assert code == 1001
            assert "silent for 1 s" in sentence
        await until(lambda: port.reception.tabs == 0)
        await until(lambda: sum(living(pid) for pid in before) <= 1, "only the one that waits is left")


@pytest.mark.parametrize("how", ["cut", "goes on"])
async def test_a_tab_whose_keys_nobody_takes_ends_when_it_is_cut_or_sends_too_many(
    port: Port, monkeypatch: pytest.MonkeyPatch, how: str
) -> None:
    monkeypatch.setattr(session, "SILENCE", 600.0)  # only the end of the socket counts
    pid = await port.waiting()
    async with port.connect() as socket:
        await port.hello(socket)
        await drawn(socket, TOP)
        os.kill(pid, signal.SIGSTOP)
        for _ in range(30):
            await socket.send(json.dumps({"keys": "\0" * 4000}))
        if how == "cut":
            socket.transport.abort()
        else:
            with contextlib.suppress(ConnectionClosed):
                while True:
                    await socket.send(json.dumps({"keys": "x" * 60_000}))
            assert "sent more keys than its screen can take" in (await ended(socket))[1]
        await until(lambda: port.reception.tabs == 0)
        await until(lambda: not living(pid), "it is ended, whatever it does")


async def test_a_flood_of_keys_takes_no_memory_and_keys_work_after_it(real_port: Port) -> None:
    pid = await real_port.waiting()
    async with real_port.connect() as socket:
        await real_port.hello(socket)
        await drawn(socket, TOP)
        before = memory_of(pid)
        for _ in range(25):
            await socket.send(json.dumps({"keys": "\0" * 4000}))

        async def ask() -> None:
            while True:  # the first ones are part of the flood
                await socket.send(json.dumps({"keys": "?"}))
                await asyncio.sleep(0.5)

        asking = asyncio.ensure_future(ask())
        await drawn(socket, HELP)
        asking.cancel()
        assert memory_of(pid) < before + 100_000_000, "2 kB for each would be 200 MB"
    await until(lambda: not living(pid))


async def test_cut_tabs_and_strangers_do_not_fill_the_log(
    port: Port, caplog: pytest.LogCaptureFixture, capsys: pytest.CaptureFixture[str]
) -> None:
    async with port.connect() as socket:
        await port.hello(socket)
        await drawn(socket, TOP)
        socket.transport.abort()
    await until(lambda: port.reception.tabs == 0)
    for _ in range(20):
        async with port.connect() as stranger:
            await stranger.send("{}")
            await ended(stranger)
    gc.collect()
    assert "never retrieved" not in caplog.text
    assert capsys.readouterr().err.count("not let in") == 1


def test_strangers_are_counted_and_told_of_once_a_minute() -> None:
    strangers = Strangers()
    assert strangers.told(100.0) == "1 came without the token of this place, and was not let in"
    assert not any(strangers.told(100.0 + second) for second in range(60))
    assert strangers.told(161.0).startswith("61 came")


async def test_who_leaves_the_screen_is_told_and_a_hidden_tab_gets_it_whole_when_it_is_seen(
    real_port: Port,
) -> None:
    async with real_port.connect() as socket:
        await real_port.hello(socket)
        await drawn(socket, TOP)
        await socket.send(json.dumps({"hidden": True}))
        await socket.send(json.dumps({"keys": "?"}))
        await socket.send(json.dumps({"hidden": False}))
        await drawn(socket, HELP, TOP)
        await socket.send(json.dumps({"keys": "\x1b"}))
        await socket.send(json.dumps({"keys": "\x11"}))  # ctrl+q
        assert await ended(socket) == (1001, "The screen has been left.")


async def test_the_token_is_in_no_process_and_in_no_file(port: Port, place: Path) -> None:
    async with port.connect() as socket:
        await port.hello(socket)
        await drawn(socket, TOP)
        for pid in port.screens:
            assert TOKEN.encode() not in line_of(pid)
            assert TOKEN.encode() not in await asyncio.to_thread(Path(f"/proc/{pid}/environ").read_bytes)
        assert not await asyncio.to_thread(files_with, TOKEN.encode(), place.parent)
