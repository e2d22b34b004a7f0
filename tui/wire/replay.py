"""`robotree wire replay FILE --connect|--listen URL`: send a recording again, in its own time or faster.

Who is dialled may be a robot's controller, which would obey what was recorded as if it were said anew: goals,
modes, parameters, with their old epochs. So what commands is left out there. Who comes by itself to listen is
a view, a proxy or a ground station, and hears everything.
"""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Iterable
from itertools import chain

from robotree.protocol.errors import LinkError
from robotree.protocol.frame import encode
from robotree.protocol.links.link import Link, Listener, Pausable
from robotree.protocol.links.security import UNSIGNED, LinkSecurity
from robotree.protocol.links.url import connect, listen
from robotree.protocol.parser import Parser
from robotree.protocol.signing import Signer
from robotree.protocol.tools.capture.files import Recording
from robotree.protocol.tools.capture.records import BadRecording, NoFrame
from robotree.protocol.tools.capture.replay import RecordFilter, schedule
from robotree.tui.errors import ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.terminal import answer, note, put
from robotree.tui.wire.lasting import Lasting, lasting
from robotree.tui.wire.security import securing

BREATH = 0.005
"""[s] between two looks whether a far end has read."""
LAST_WORDS = 2.0
"""[s] in which what waits may still leave after the last frame."""
DATAGRAMS = 2000.0
"""[1/s] Frames at most where a far end cannot make us wait: what is beyond its buffer, some 200, is lost."""


class Listeners:
    """Everyone who hears the replay."""

    def __init__(self, here: Lasting, security: LinkSecurity = UNSIGNED) -> None:
        """Nobody yet."""
        self._here, self._security = here, security
        self.links: dict[Link, Signer | None] = {}
        self.somebody, self.nobody = asyncio.Event(), asyncio.Event()
        self.nobody.set()

    def accept(self, link: Link) -> _Deaf:
        """Somebody has come."""
        self.links[link] = self._security.signer_pair(link.controller)["signer"]
        self.somebody.set()
        self.nobody.clear()
        return _Deaf(self, link)

    def gone(self, link: Link, reason: LinkError) -> None:
        """Somebody has left; with the last one the replay ends."""
        self.links.pop(link, None)
        if not self.links:
            self.nobody.set()
            self._here.end(reason)

    def send(self, data: bytes) -> None:
        """Say a frame again; with a key it is signed anew, for its old signature is one that was heard."""
        for link, signer in self.links.items():
            link.send(data if signer is None else _signed(data, signer))

    @property
    def congested(self) -> bool:
        """Whether somebody has not read what was sent."""
        return any(link.congested for link in self.links)

    @property
    def defenceless(self) -> bool:
        """Whether somebody cannot make us wait, and loses what comes too fast."""
        return any(not isinstance(link, Pausable) for link in self.links)


def _signed(data: bytes, signer: Signer) -> bytes:
    """The same messages from the same speakers; what is no frame of the dialect stays as it is."""
    frames = Parser().feed(data)
    again = [
        encode(
            frame.message,
            sequence=frame.sequence,
            system=frame.system,
            component=frame.component,
            signer=signer,
        )
        for frame in frames
    ]
    return b"".join(again) or data


class _Deaf:
    """A handler: a recording does not answer."""

    def __init__(self, crowd: Listeners, link: Link) -> None:
        self._crowd, self._link = crowd, link

    def received(self, data: bytes) -> None:
        pass

    def closed(self, reason: LinkError) -> None:
        self._crowd.gone(self._link, reason)


def replay(line: Line, _realm: str) -> int:
    """Replay the file once."""
    recording = Recording(line.text("FILE"))
    if recording.form == "raw":
        raise BadRecording(recording.name, "has no times; replay a .tlog, an .mcap or a candump log")
    filter_ = RecordFilter(passive=bool(line.text("--connect")) and not line.flag("--commands"))
    moments = schedule(filter_.filter(recording.captured()), speed(line.text("--speed")))
    first = next(moments, None)
    if first is None and filter_.commands:
        raise BadRecording(recording.name, "has nothing but what commands; --commands sends that")
    if first is None:
        raise NoFrame(recording.name)
    return asyncio.run(_replay(line, chain([first], moments), filter_))


def speed(text: str) -> float:
    """Read `2`, `0.5`, or `max`: as fast as it goes.

    Raises:
        ValueRefused: it is no speed.
    """
    if text == "max":
        return math.inf
    try:
        number = float(text or "1")
    except ValueError:
        number = 0.0
    if not (number > 0 and math.isfinite(number)):
        raise ValueRefused("SPEED", f"{text!r} is no speed; write a factor above 0, or max")
    return number


async def _replay(line: Line, moments: Iterable[tuple[float, bytes]], filter_: RecordFilter) -> int:
    listener: Listener | None = None
    async with lasting(line) as here, securing(line) as security:
        crowd = Listeners(here, security)
        if line.text("--connect"):
            await connect(line.text("--connect"), crowd.accept)
        else:
            listener = await listen(line.text("--listen"), crowd.accept)
            address = listener.address
            answer(f"ready {address}", lambda: {"ready": address})
            note("the replay begins when somebody connects")
            await here.until(crowd.somebody.wait())
        sent = await _send(moments, crowd, here)
        here.end()
        for link in [*crowd.links]:
            link.close()
        await crowd.nobody.wait()  # until the last frame was read, or the link waits no longer for that
        if listener is not None:
            await listener.close()
    withheld = f"; {filter_.withheld} with keys were left out" if filter_.withheld else ""
    names = ", ".join(f"{number} {name}" for name, number in filter_.commands.most_common())
    count = filter_.commands.total()
    commands = f"; {count} that command were left out: {names} (--commands sends them)" if count else ""
    counts = {"frames": sent, "withheld": filter_.withheld, "commands": dict(filter_.commands)}
    put(json.dumps(counts) if line.flag("--json") else f"{sent} frames were sent{withheld}{commands}")
    return here.exit_code()


async def _send(moments: Iterable[tuple[float, bytes]], crowd: Listeners, here: Lasting) -> int:
    """Send everything when it is due, but not faster than it is read; return how many frames it was."""
    loop = asyncio.get_running_loop()
    began, sent = loop.time(), 0
    free = began  # when the next frame would be on its way if all came evenly, at DATAGRAMS
    for due, data in moments:
        await here.wait(max(began + due - loop.time(), 0))
        if crowd.defenceless:
            free = max(free, loop.time()) + 1 / DATAGRAMS
            if (early := free - loop.time()) > BREATH:
                await here.wait(early)
        while crowd.congested and not here.over:
            await here.wait(BREATH)
        if here.over:
            break
        crowd.send(data)
        sent += 1
    left = loop.time() + LAST_WORDS
    while crowd.congested and loop.time() < left:
        await here.wait(BREATH)
    return sent
