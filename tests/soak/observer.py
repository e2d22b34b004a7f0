"""What a controller really does, seen over a separate link: the truth that all reports are compared with."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import math
import time
from collections import deque
from dataclasses import dataclass
from typing import Self

from robotree.protocol import Endpoint, Frame
from robotree.protocol.errors import LinkError
from robotree.protocol.links.link import Link
from robotree.protocol.links.url import connect
from robotree.protocol.messages import (
    CommandLong,
    Heartbeat,
    LocalPositionNed,
    MavAutopilot,
    MavCmd,
    MavState,
    MavType,
    Mode,
    ModeKind,
    Tool,
)

BEAT = Heartbeat(MavType.GCS, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE)
OFTEN = 5000.0
"""[us] between two places: 200 a second."""
STANDS = 0.01
"""[m/s] A robot that is slower than this stands."""
KEPT = 20_000
"""Places that are remembered: more than a minute."""
REDIAL = 0.1
"""[s]"""
SPAN = 0.05
"""[s] over which a speed is taken."""


@dataclass(frozen=True, slots=True)
class Seen:
    """Where a robot was."""

    heard: float
    """[s] on our clock."""
    at: float
    """[s] on the controller's, since it started."""
    place: tuple[float, float, float]
    """(3,) [m]"""


class Observer:
    """Watches one controller and commands nothing. It connects again whenever its link ends.

    Args:
        address: of the controller.
        system: MAVLink system id, other than those of proxies and ground stations.
    """

    def __init__(self, address: str, system: int = 77) -> None:
        self.address, self._system = address, system
        self.seen: deque[Seen] = deque(maxlen=KEPT)
        self.modes: deque[tuple[float, Mode]] = deque(maxlen=KEPT)
        self._link: Link | None = None
        self._work: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._work = asyncio.create_task(self._keep())
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._work is not None:
            self._work.cancel()
            await asyncio.gather(self._work, return_exceptions=True)
        if self._link is not None:
            self._link.close()

    async def _keep(self) -> None:
        while True:
            over = asyncio.Event()
            with contextlib.suppress(LinkError, OSError):
                await self._dial(over)
                await over.wait()
            await asyncio.sleep(REDIAL)

    async def _dial(self, over: asyncio.Event) -> None:
        ends: list[Endpoint] = []

        def accept(link: Link) -> Endpoint:
            ends.append(
                Endpoint(
                    link,
                    system=self._system,
                    component=1,
                    on_frame=self._hear,
                    on_closed=lambda _reason: over.set(),
                )
            )
            return ends[0]

        self._link = await connect(self.address, accept)
        ends[0].send(BEAT)
        for kind in (Tool, LocalPositionNed):
            wish = (float(kind.codec.definition.id), OFTEN, 0.0, 0.0, 0.0, 0.0, 0.0)
            ends[0].send(CommandLong(1, 1, MavCmd.SET_MESSAGE_INTERVAL, 0, *wish))

    def _hear(self, frame: Frame) -> None:
        now, message = time.monotonic(), frame.message
        if isinstance(message, Tool | LocalPositionNed):
            place = (message.x, message.y, message.z)
            self.seen.append(Seen(now, message.time_boot_ms / 1000, place))
        elif isinstance(message, Mode):
            self.modes.append((now, message))

    # -- what is seen ------------------------------------------------------------------------------

    @property
    def place(self) -> tuple[float, float, float]:
        """(3,) [m] where it was last."""
        return self.seen[-1].place if self.seen else (math.nan,) * 3

    @property
    def mode(self) -> int:
        """What it does as a whole, a `ModeKind`; -1: nothing was heard yet."""
        return self.modes[-1][1].mode if self.modes else -1

    @property
    def stopped(self) -> bool:
        """Whether it is in safe stop."""
        return self.mode == ModeKind.SAFE_STOP

    @property
    def fresh(self) -> bool:
        """Whether it was heard within the last 0.3 s."""
        return bool(self.seen) and time.monotonic() - self.seen[-1].heard < 0.3

    def speed(self) -> float:
        """[m/s] over the last moment."""
        if not self.seen:
            return 0.0
        last = self.seen[-1]
        for one in reversed(self.seen):
            if one.at > last.at:
                return 0.0  # it has started anew
            if last.at - one.at >= SPAN:
                return math.dist(one.place, last.place) / (last.at - one.at)
        return 0.0

    def mark(self) -> tuple[float, float]:
        """This moment: on our clock, and on the controller's as last heard."""
        return time.monotonic(), self.seen[-1].at if self.seen else 0.0

    def after(self, mark: tuple[float, float]) -> list[Seen]:
        """Return what was seen from a moment on, in one life of the controller."""
        return [one for one in self.seen if one.heard >= mark[0] and one.at >= mark[1]]

    def stood_after(self, mark: tuple[float, float]) -> float:
        """[s] on the controller's clock from a moment until it moved no more; 0: it never did."""
        moving = [
            now.at
            for then, now in itertools.pairwise(self.after(mark))
            if now.at > then.at and math.dist(then.place, now.place) / (now.at - then.at) >= STANDS
        ]
        return moving[-1] - mark[1] if moving else 0.0

    def stood_at(self, mark: tuple[float, float]) -> float:
        """[s] on our clock: when it was last heard to move since a moment; else that moment.

        On a busy machine it is heard late, so it stood somewhat earlier.
        """
        moved = [
            now.heard
            for then, now in itertools.pairwise(self.after(mark))
            if now.at > then.at and math.dist(then.place, now.place) / (now.at - then.at) >= STANDS
        ]
        return moved[-1] if moved else mark[0]

    def way_since(self, mark: tuple[float, float]) -> float:
        """[m] that it has gone since a moment, along its path; noise below a millimetre is left out."""
        way, last = 0.0, None
        for one in self.seen:
            if one.heard < mark[0]:
                continue
            if last is None or math.dist(last, one.place) >= 0.001:
                way += 0.0 if last is None else math.dist(last, one.place)
                last = one.place
        return way

    async def moves(self, within: float = 10.0, faster: float = 0.03) -> bool:
        """Wait until it moves."""
        return await holds(lambda: self.speed() > faster, within)

    async def stands(self, within: float = 10.0) -> bool:
        """Wait until it stands, and has for a moment."""
        return await holds(lambda: self.fresh and self.speed() < STANDS, within)


async def holds(what: object, within: float) -> bool:
    """Wait until a condition holds; whether it came to that."""
    assert callable(what)
    until = time.monotonic() + within
    while not what():
        if time.monotonic() > until:
            return False
        await asyncio.sleep(0.01)
    return True
