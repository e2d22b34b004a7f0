"""`robotree wire monitor --connect URL`: a live table of what links say and how well they do."""

from __future__ import annotations

import asyncio
import shutil
import sys
from enum import IntEnum
from pathlib import Path

import msgspec

from robotree.protocol.dialect.extension import extend
from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkError
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.security import UNSIGNED, LinkSecurity
from robotree.protocol.links.url import connect
from robotree.protocol.messages import ClaimStatus, MavState, MavType
from robotree.protocol.tools.capture.gauges import LinkGauge, LinkReading, MessageReading, PeerReading
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.seen.wording import columns
from robotree.tui.terminal import clear, put
from robotree.tui.wire.identity import COMPONENT, SYSTEM
from robotree.tui.wire.lasting import Lasting, lasting
from robotree.tui.wire.record import fields
from robotree.tui.wire.security import securing

PERIOD = 1.0
"""[s] between two pictures of the table."""
CLAIM_STATUS = ClaimStatus.codec.definition.name
LATE = 3.0
"""[s] A CLAIM_STATUS comes every second; an older one says so."""
WIDTH = 150
"""Columns of the table where there is no terminal that has a number of its own."""


class Watched:
    """A handler that watches its link; the delay is learnt by asking for the far clock."""

    def __init__(self, link: Link, here: Lasting, security: LinkSecurity = UNSIGNED) -> None:
        """Watch until `here` is over; with a key, ask signed and show only what is signed."""
        self._here = here
        self._clock = asyncio.get_running_loop().time
        signer_pair = security.signer_pair(link.controller)
        self.gauge = LinkGauge(link.address, signer_pair["verifier"])
        signer = signer_pair["signer"]
        self._mouth = Endpoint(link, system=SYSTEM, component=COMPONENT, on_frame=_unheard, signer=signer)

    def received(self, data: bytes) -> None:
        """Count what came."""
        self.gauge.receive(data, self._clock())

    def ask(self) -> None:
        """Send the message that measures the delay."""
        for question in self.gauge.questions(self._clock()):
            self._mouth.send(question, telemetry=True)

    def closed(self, reason: LinkError) -> None:
        """Nothing more will come."""
        self._here.end(reason)


def _unheard(_frame: Frame) -> None:
    """Frames are counted by the gauge."""


def monitor(line: Line, _realm: str) -> int:
    """Watch until the end."""
    if line.text("--xml"):
        extend(Path(line.text("--xml")))
    return asyncio.run(_watch(line))


async def _watch(line: Line) -> int:
    period = values.duration(line.text("--every")) if line.text("--every") else PERIOD
    urls = [line.text("--connect"), *line.many("URL")]
    async with lasting(line) as here, securing(line) as security:
        watched: list[Watched] = []

        def accept(link: Link) -> Watched:
            watched.append(Watched(link, here, security))
            return watched[-1]

        links = [await connect(url, accept) for url in urls]
        while not here.over:
            for each in watched:
                each.ask()
            await here.wait(period)
            now = asyncio.get_running_loop().time()
            show([each.gauge.reading(now) for each in watched], as_json=line.flag("--json"))
        for link in links:
            link.close()
    return here.exit_code()


def show(readings: list[LinkReading], *, as_json: bool) -> None:
    """Draw the table anew: over the old one on a terminal, below it elsewhere."""
    if as_json:
        text = msgspec.json.encode({"links": readings}).decode()
    else:
        text = "\n\n".join(map(table, readings)) + "\n"
        if sys.stdout.isatty():
            clear()
    put(text)


def table(link: LinkReading) -> str:
    """One link for people."""
    delay = "unknown" if link.delay is None else f"{link.delay * 1e3:.2f} ms"
    head = (
        f"{link.address}   {_rate(link.frames_per_second)} frames/s   "
        f"{_rate(link.bytes_per_second, 0)} bytes/s   loss {link.loss:.1%}   delay {delay}   "
        f"bad checksum {link.bad_crc}   unknown {link.unknown}   refused {link.refused}"
    )
    doubt = [f"{link.address}: {link.rejection}"] if link.rejection else []
    rows: list[tuple[str, ...]] = [("FROM", "MESSAGE", "RATE/S", "AGE/S", "COUNT", "LAST")]
    rows += [
        (
            f"{message.sysid}/{message.compid}",
            message.name,
            _rate(message.rate),
            f"{message.age:.2f}",
            str(message.count),
            fields(message.fields),
        )
        for message in link.messages
    ]
    about = [*_present(link.peers), *_claims(link.messages)]
    return "\n".join([head, *doubt, *about, *(_cut(row) for row in columns(rows).splitlines())])


def _rate(rate: float | None, digits: int = 1) -> str:
    """A rate, or that it is not known yet."""
    return "-" if rate is None else f"{rate:.{digits}f}"


def _present(peers: list[PeerReading]) -> list[str]:
    """A line with the peers that are and were present, unless there was none."""
    words = [
        f"{each.sysid}/{each.compid} {_named(MavType, each.type)} {_named(MavState, each.state)}"
        if each.there
        else f"{each.sysid}/{each.compid} gone for {each.age:.0f} s"
        for each in peers
    ]
    return [_cut(f"there: {', '.join(words)}")] if words else []


def _claims(messages: list[MessageReading]) -> list[str]:
    """A line with the holder of the claim, for each controller that tells it."""
    lines: list[str] = []
    for each in messages:
        if each.name != CLAIM_STATUS:
            continue
        status = each.fields
        name, system, component = status["name"] or "?", status["holder_system"], status["holder_component"]
        holder = f"held by {name} ({system}/{component})" if status["holder"] else "free"
        late = f", {each.age:.0f} s ago" if each.age > LATE else ""
        lines.append(_cut(f"claim on {each.sysid}/{each.compid}: {holder}, epoch {status['epoch']}{late}"))
    return lines


def _named(kind: type[IntEnum], number: int) -> str:
    """The name of a number in an enumeration, or the number."""
    return kind(number).name if number in {each.value for each in kind} else str(number)


def _cut(row: str) -> str:
    width, _ = shutil.get_terminal_size((WIDTH, 24))
    return row if len(row) <= width else f"{row[: width - 1]}…"
