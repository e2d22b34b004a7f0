"""`robotree wire ping --connect URL`: how long a frame takes to a robot and back."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable, Collection, Hashable
from typing import Protocol

import msgspec

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.rejection import rejection
from robotree.protocol.links.security import UNSIGNED
from robotree.protocol.links.url import connect
from robotree.protocol.messages import AnyMessage, Ping, Timesync
from robotree.protocol.services.peer import Peer
from robotree.protocol.services.ping import Pinger, RoundTrips, summary
from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.terminal import complain, put
from robotree.tui.wire.identity import COMPONENT, SYSTEM
from robotree.tui.wire.lasting import lasting
from robotree.tui.wire.security import securing

EVERY = 0.2
"""[s] between two questions."""
COUNT = 10
LAST_ANSWER_WITHIN = 1.0
"""[s] to wait for the last answers."""


class Asker(Protocol):
    """Asks by one of MAVLink's services."""

    def ask(self, now: float) -> AnyMessage:
        """The next question."""
        ...

    def heard(self, frame: Frame, via: Hashable, now: float) -> tuple[int, float] | None:
        """The number of the question that a frame answers, and what it took [s]; None: it answers none."""
        ...


class ByPing:
    """Asks by PING."""

    def __init__(self) -> None:
        """Nothing was asked yet."""
        self._pinger = Pinger(SYSTEM, COMPONENT)

    def ask(self, now: float) -> AnyMessage:
        """The next question."""
        return self._pinger.ask(now)

    def heard(self, frame: Frame, via: Hashable, now: float) -> tuple[int, float] | None:
        """Take an answer."""
        if not isinstance(frame.message, Ping):
            return None
        echo = self._pinger.receive(frame.message, Peer(via, frame.system, frame.component), now)
        return None if echo is None else (echo.number, echo.round_trip)


class ByTimesync:
    """Asks by TIMESYNC, for robots that do not answer PING."""

    def __init__(self) -> None:
        """Nothing was asked yet."""
        self._asked: dict[int, tuple[int, float]] = {}

    def ask(self, now: float) -> AnyMessage:
        """The next question; its time is its name."""
        question = Timesync(tc1=0, ts1=round(now * 1e9))
        self._asked[question.ts1] = len(self._asked) + 1, now
        return question

    def heard(self, frame: Frame, via: Hashable, now: float) -> tuple[int, float] | None:  # noqa: ARG002  as promised
        """Take an answer."""
        message = frame.message
        if not isinstance(message, Timesync) or not message.tc1 or message.ts1 not in self._asked:
            return None
        number, asked = self._asked[message.ts1]
        return number, now - asked


SERVICES: dict[str, Callable[[], Asker]] = {"ping": ByPing, "timesync": ByTimesync}
"""The services by which a robot may be asked."""


def ping(line: Line, _realm: str) -> int:
    """Send a number of requests, and print the times."""
    by, count = line.text("--by", "ping"), line.text("--count", str(COUNT))
    if by not in SERVICES:
        raise ValueRefused("SERVICE", f"{by!r} is no service; there is {' and '.join(SERVICES)}")
    number = values.whole("COUNT", count, 1, math.inf, "is no count; write a number above 0")
    return asyncio.run(_ping(line, SERVICES[by](), number))


async def _ping(line: Line, asker: Asker, count: int) -> int:
    clock = asyncio.get_running_loop().time
    every = values.duration(line.text("--every")) if line.text("--every") else EVERY
    times: dict[int, float] = {}
    asked = 0
    keyless = 0
    speakers: set[tuple[int, int]] = set()
    async with lasting(line) as here, securing(line) as security:

        def hear(frame: Frame) -> None:
            nonlocal keyless
            keyless += frame.signed and signer_pair["verifier"] is None
            speakers.add((frame.system, frame.component))
            answer = asker.heard(frame, None, clock())
            if answer is None or answer[0] in times:  # several may answer; the first one counts
                return
            times[answer[0]] = answer[1]
            try:
                tell(frame, *answer, as_json=line.flag("--json"))
            except OSError as error:  # it is about standard output; the link must not take it for its own
                here.end(error)
            if len(times) == count:
                here.end()

        mouth: list[Endpoint] = []
        signer_pair = UNSIGNED.signer_pair("")

        def accept(link: Link) -> Endpoint:
            nonlocal signer_pair
            signer_pair = security.signer_pair(link.controller)
            ears = Endpoint(
                link, system=SYSTEM, component=COMPONENT, on_frame=hear, on_closed=here.end, **signer_pair
            )
            mouth.append(ears)
            return ears

        link = await connect(line.text("--connect"), accept)
        while asked < count and not here.over:
            mouth[0].send(asker.ask(clock()))
            asked += 1
            await here.wait(every if asked < count else LAST_ANSWER_WITHIN)
        here.end()
        link.close()
    doubt = rejection(None if mouth[0].statistics.received else signer_pair["verifier"], keyless=keyless)
    missing = f"nobody at {line.text('--connect')} answers: {doubt}" if doubt else _missing(line, speakers)
    return _result(line, summary(asked, list(times.values())), here.exit_code(), missing)


def _missing(line: Line, speakers: Collection[tuple[int, int]]) -> str:
    """Why nothing was answered: nothing is there, or it does not know the service."""
    by = line.text("--by", "ping")
    hint = f"; try --by {next(name for name in SERVICES if name != by)}"
    if not speakers:
        return f"nobody at {line.text('--connect')} answers{hint if by == 'ping' else ''}"
    who = ", ".join(f"{system}/{component}" for system, component in sorted(speakers))
    says = "speaks, but answers" if len(speakers) == 1 else "speak, but answer"
    return f"{who} {says} no {by.upper()}{hint}"


def _result(line: Line, trips: RoundTrips, code: int, missing: str) -> int:
    put(msgspec.json.encode({"statistics": trips}).decode() if line.flag("--json") else text(trips))
    if trips.answered or code:
        return code
    complain(missing)
    return exit_codes.NOBODY


def tell(frame: Frame, number: int, seconds: float, *, as_json: bool) -> None:
    """Print one answer."""
    if as_json:
        data = {"sysid": frame.system, "compid": frame.component, "seq": number, "seconds": seconds}
        put(msgspec.json.encode(data).decode())
    else:
        put(f"{frame.system}/{frame.component}: number {number}, {seconds * 1e3:.3f} ms")


def text(trips: RoundTrips) -> str:
    """Statistics for people."""
    head = f"{trips.asked} asked, {trips.answered} answered, {trips.loss:.0%} lost"
    if trips.shortest is None or trips.median is None or trips.late is None or trips.longest is None:
        return head
    times = (trips.shortest, trips.median, trips.late, trips.longest)
    named = zip(("shortest", "median", "99 of 100 within", "longest"), times, strict=True)
    return f"{head}; {', '.join(f'{name} {seconds * 1e3:.3f} ms' for name, seconds in named)}"
