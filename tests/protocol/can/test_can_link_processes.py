"""Links over CAN between real processes: what is sent arrives, and an end that dies is missed."""

from __future__ import annotations

from collections.abc import Callable
from subprocess import Popen

import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.errors import LinkBroken, LinkClosed
from robotree.protocol.links.can import link as can_link
from robotree.protocol.links.link import Link
from robotree.protocol.links.url import connect
from robotree.protocol.messages import Statustext
from robotree.protocol.testing import RecordingHandler, until

Spawn = Callable[..., "Popen[str]"]
LONG = 60.0
"""[s] that no test takes, however slow the machine is."""
CONTROLLER = """
import asyncio, sys
from robotree.protocol import Endpoint
from robotree.protocol.links.can import link
from robotree.protocol.links.url import listen

link.TRANSFER_TIMEOUT = float(sys.argv[2])

def echo(link):
    endpoint = Endpoint(link, system=1, component=1, on_frame=lambda frame: endpoint.send(frame.message))
    return endpoint

async def main():
    listener = await listen(sys.argv[1], echo)
    print("here", flush=True)
    await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline)
    await listener.close()

asyncio.run(main())
"""


def controller(spawn: Spawn, url: str) -> Popen[str]:
    """A process that sends every message back."""
    process = spawn("-c", CONTROLLER, url, str(LONG))
    assert process.stdout
    assert process.stdout.readline() == "here\n"
    return process


class Ear(RecordingHandler):
    """Keeps the messages too."""

    def __init__(self, link: Link) -> None:
        super().__init__(link)
        self.parser = Parser()
        self.texts: list[str] = []

    def received(self, data: bytes) -> None:
        super().received(data)
        for frame in self.parser.feed(data):
            assert isinstance(frame.message, Statustext)
            self.texts.append(frame.message.text)


async def opened(url: str) -> tuple[Link, Ear]:
    ears: list[Ear] = []

    def accept(link: Link) -> Ear:
        ears.append(Ear(link))
        return ears[0]

    return await connect(url, accept), ears[0]


def words(count: int) -> list[str]:
    """Texts short and long, so that some fit one frame of CAN FD and some do not."""
    return [f"{index} " + "x" * (index % 2 * 45) for index in range(count)]


@pytest.mark.parametrize("fd", [0, 1])
async def test_a_burst_comes_back_whole_and_in_order(
    spawn: Spawn, channel: str, fd: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(can_link, "TRANSFER_TIMEOUT", LONG)
    url = f"can:robotree/{channel}?fd={fd}&silence={LONG:g}"
    process = controller(spawn, url)
    link, ear = await opened(url)
    texts = words(500)
    for index, text in enumerate(texts):
        link.send(encode(Statustext(severity=6, text=text), sequence=index, system=255, component=1))
    await until(lambda: len(ear.texts) == len(texts) or ear.reasons, LONG)
    assert ear.texts == texts
    statistics = ear.parser.statistics
    assert (statistics.lost, statistics.late, statistics.bad_crc, statistics.skipped) == (0, 0, 0, 0)
    link.close()
    await until(lambda: bool(ear.reasons))
    process.communicate("end\n", timeout=LONG)
    assert process.returncode == 0


async def test_a_controller_that_ends_says_so(spawn: Spawn, channel: str) -> None:
    url = f"can:robotree/{channel}?silence={LONG:g}"
    process = controller(spawn, url)
    _, ear = await opened(url)
    process.communicate("end\n", timeout=LONG)
    await until(lambda: bool(ear.reasons))
    assert [type(each) for each in ear.reasons] == [LinkClosed]


async def test_a_killed_controller_is_missed_and_its_successor_found(spawn: Spawn, channel: str) -> None:
    url = f"can:robotree/{channel}?silence=0.6"
    process = controller(spawn, url)
    _, ear = await opened(url)
    process.kill()
    await until(lambda: bool(ear.reasons))
    assert [type(each) for each in ear.reasons] == [LinkBroken]
    assert "nothing came for 0.6 s" in str(ear.reasons[0])
    url = f"can:robotree/{channel}?silence={LONG:g}"
    controller(spawn, url)
    link, second = await opened(url)
    link.send(encode(Statustext(severity=6, text="hello"), sequence=0, system=255, component=1))
    await until(lambda: second.texts == ["hello"])
    link.close()
    await until(lambda: bool(second.reasons))


async def test_a_session_does_not_survive_its_controller(spawn: Spawn, channel: str) -> None:
    """The successor is up before the silence is noticed, knows no such session, and says so."""
    url = f"can:robotree/{channel}?silence={LONG:g}"
    process = controller(spawn, url)
    _, ear = await opened(url)
    process.kill()
    process.wait()
    controller(spawn, url)
    await until(lambda: bool(ear.reasons))
    assert [type(each) for each in ear.reasons] == [LinkClosed]
