"""One trial of a rule: links to the controller, what was said over them, and where the robot is."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from dataclasses import dataclass
from itertools import count
from typing import TYPE_CHECKING, TypeVar

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.links.security import UNSIGNED
from robotree.protocol.links.url import connect
from robotree.protocol.messages import (
    Claim,
    ClaimStatus,
    ClaimWish,
    Goal,
    GoalCancel,
    GoalState,
    GoalStatus,
    Heartbeat,
    MavAutopilot,
    MavState,
    MavType,
    Message,
    Mode,
    ModeKind,
    Reason,
    SetMode,
)
from robotree.protocol.services.goal_client import padded

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator, Callable

    from robotree.protocol.errors import LinkError
    from robotree.protocol.frame import Frame
    from robotree.protocol.links.link import Link
    from robotree.protocol.links.security import LinkSecurity
    from robotree.protocol.messages import AnyMessage
    from robotree.protocol.tools.conform.motions import Motions, Place

from contextlib import asynccontextmanager

T = TypeVar("T", bound=Message)
Sender = tuple[int, int]
"""System and component."""
FIRST: Sender = (255, 90)
SECOND: Sender = (255, 91)
"""Two senders, with components that MAVLink leaves to its users, as those of proxies."""
WITHIN = 2.0
"""[s] in which a controller answers; in fact it is milliseconds, but a machine may be busy."""
BEAT = Heartbeat(MavType.ONBOARD_CONTROLLER, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE)
MODE_LATE = 1.0
"""[s] It comes twice a second."""
SLOWEST = 0.2
"""[s] of the controller in one of ours, at least."""
TIMES = 10
"""MODEs from which the controller's pace is known: those of five seconds, or fewer where it changes."""
NO_ARGS = padded(())
REFUSALS = {Reason.STOPPED, Reason.STALE_EPOCH, Reason.NOT_IN_CONTROL, Reason.BAD_EPOCH, Reason.OTHER_LIFE}
"""Reasons why a release is not obeyed."""


class RuleBroken(Exception):
    """The controller does not keep a rule: one sentence says what it did instead."""


class NotTried(Exception):
    """A rule could not be tried, or does not apply: one clause says why."""


@dataclass(frozen=True, slots=True)
class Spoken:
    """A message that was sent or received."""

    at: float
    """[s] since the examination began."""
    sent: bool
    system: int
    component: int
    message: AnyMessage


class Line:
    """One link to the controller.

    Args:
        trial: which it belongs to.
    """

    def __init__(self, trial: Trial) -> None:
        self._trial = trial
        self._read = 0
        self._news = asyncio.Event()
        self.received: list[Spoken] = []
        self.ended: LinkError | None = None
        self.link: Link
        self._endpoint: Endpoint

    async def open(self, url: str, security: LinkSecurity) -> Link:
        """Connect; a first heartbeat shows that somebody is here where no connection does."""

        def accept(link: Link) -> Endpoint:
            pair = security.signer_pair(link.controller)
            self._endpoint = Endpoint(
                link, system=FIRST[0], component=FIRST[1], on_frame=self._hear, on_closed=self._close, **pair
            )
            return self._endpoint

        self.link = await connect(url, accept)
        return self.link

    def say(self, message: AnyMessage, sender: Sender = FIRST) -> None:
        """Send a message; what came before it answers no question any more, unless this one asks nothing."""
        if not isinstance(message, Heartbeat):
            self._read = len(self.received)
        self._trial.note(
            Spoken(self._trial.now(), sent=True, system=sender[0], component=sender[1], message=message)
        )
        self._endpoint.send(message, component=sender[1])

    async def until(self, happened: Callable[[], bool], within: float, missing: str) -> None:
        """Wait for something that a received message changes, for `within` seconds of the controller's time.

        Raises:
            RuleBroken: it did not happen in time; `missing` is what is missing, as the subject of a sentence.
        """
        deadline, latest = self._trial.clock() + within, self._trial.now() + within / SLOWEST
        while not happened():
            self._news.clear()
            left = min(deadline - self._trial.clock(), latest - self._trial.now())
            if left <= 0 or self.ended is not None:
                gone = f"; the link has ended: {self.ended}" if self.ended is not None else ""
                raise RuleBroken(f"{missing} did not come within {within:g} s{gone}")
            try:
                async with asyncio.timeout(left):
                    await self._news.wait()
            except TimeoutError:
                continue

    async def expect(
        self,
        kind: type[T],
        such: Callable[[T], bool] = lambda _: True,
        within: float = WITHIN,
        what: str = "",
    ) -> T:
        """The next message of a kind that is such.

        Raises:
            RuleBroken: none came in time.
        """
        found: list[T] = []

        def arrived() -> bool:
            while self._read < len(self.received) and not found:
                message = self.received[self._read].message
                self._read += 1
                if isinstance(message, kind) and such(message):
                    found.append(message)
            return bool(found)

        await self.until(arrived, within, what or kind.codec.definition.name.removeprefix("ROBOTREE_"))
        return found[0]

    def _hear(self, frame: Frame) -> None:
        if (frame.system, frame.component) != self._trial.controller:
            return
        spoken = Spoken(
            self._trial.now(),
            sent=False,
            system=frame.system,
            component=frame.component,
            message=frame.message,
        )
        self.received.append(spoken)
        self._trial.note(spoken)
        self._news.set()

    def _close(self, reason: LinkError) -> None:
        self.ended = reason
        self._news.set()


class Trial:
    """The tools of a rule: a link to the controller, and the frames that came.

    Args:
        url: of the controller.
        controller: its system and component.
        motions: what the robot can be asked to do; None: nothing is known.
        security: signs the links.
    """

    def __init__(
        self,
        url: str,
        *,
        controller: tuple[int, int] = (1, 1),
        motions: Motions | None = None,
        security: LinkSecurity = UNSIGNED,
    ) -> None:
        self.url, self.controller, self.security = url, controller, security
        self.spoken: list[Spoken] = []
        """All that was said and heard since the present rule began."""
        self.epoch = 0
        """The highest epoch that the controller has told."""
        self.life = 0
        self.mode: Mode | None = None
        self.claim: ClaimStatus | None = None
        self.several: bool | None = None
        """Whether it serves several clients; None: not known yet."""
        self._motions = motions
        self._times = deque[tuple[float, float]](maxlen=TIMES)
        """When the latest MODEs came, and the controller's time in each, [s]."""
        self._zero = 0.0
        self._home: Place | None = None
        self._place: Place | None = None
        self._places = 0
        self._keys = count(0x7E57_0000_0000_0001 + 0x1_0000 * (id(self) & 0xFFFF_FFFF))
        self._holders: dict[int, Sender] = {}
        self._began = asyncio.get_running_loop().time()

    def now(self) -> float:
        """[s] since the examination began."""
        return asyncio.get_running_loop().time() - self._began

    def note(self, spoken: Spoken) -> None:
        """Keep a message for the report, and what it tells."""
        self.spoken.append(spoken)
        message = spoken.message
        if spoken.sent:
            return
        if isinstance(message, Mode | ClaimStatus | GoalStatus):
            self.epoch = max(self.epoch, message.epoch)
        if isinstance(message, Mode):
            self.mode, self.life = message, message.life
            if not self._times:
                self._zero = spoken.at - message.time_boot_ms / 1000
            self._times.append((spoken.at, message.time_boot_ms / 1000 + self._zero))
        elif isinstance(message, ClaimStatus):
            self.claim = message
        elif self._motions is not None and isinstance(message, self._motions.telemetry):
            self._place, self._places = self._motions.place(message), self._places + 1

    @property
    def pace(self) -> float:
        """Seconds of the controller in one of ours: the rules use its time, and a simulation may be slow."""
        if len(self._times) < 2:
            return 1.0
        (here, there), (here_now, there_now) = self._times[0], self._times[-1]
        passed = there_now - there
        return min(max(passed / (here_now - here), SLOWEST), 1.0) if passed > 0 and here_now > here else 1.0

    def clock(self) -> float:
        """The controller's time, [s] since about the beginning: it stands still while no MODE comes."""
        if not self._times:
            return self.now()
        at, controller_time = self._times[-1]
        return controller_time + min(self.now() - at, MODE_LATE) * self.pace

    # -- links

    async def start(self) -> None:
        """Open the first link."""
        self.line = Line(self)
        await self.line.open(self.url, self.security)
        self.line.say(BEAT)

    async def restart(self) -> None:
        """End the first link, and open another."""
        self.line.link.close()
        await self.start()

    def close(self) -> None:
        """End the first link."""
        self.line.link.close()

    @asynccontextmanager
    async def second_line(self) -> AsyncGenerator[Line]:
        """A second client, inside the block.

        Raises:
            NotTried: the controller serves one client at a time.
        """
        if self.several is False:
            raise NotTried("it serves one client at a time")
        line = Line(self)
        link = await line.open(self.url, self.security)
        try:
            line.say(BEAT, SECOND)
            try:
                await line.expect(Mode, within=WITHIN)
            except RuleBroken:
                self.several = False
                raise NotTried("it serves one client at a time") from None
            self.several = True
            yield line
        finally:
            link.close()

    # -- where the robot is

    @property
    def motions(self) -> Motions:
        """The motions of the controller's kind.

        Raises:
            NotTried: nothing is known.
        """
        if self._motions is None:
            raise NotTried("no movement of this robot is known; --kind names one")
        return self._motions

    @motions.setter
    def motions(self, motions: Motions | None) -> None:
        self._motions, self._home, self._place, self._places = motions, None, None, 0

    async def place(self) -> Place:
        """Where it is, by a message that comes from now on."""
        before, kind = self._places, self.motions.telemetry
        name = kind.codec.definition.name
        await self.line.until(lambda: self._places > before, WITHIN, name)
        place = self._place or ()
        self._home = self._home or place
        return place

    async def stands(self) -> None:
        """Check that the robot stands.

        Raises:
            RuleBroken: it moves.
        """
        await asyncio.sleep(0.25 / self.pace)  # a real robot needs a moment to stop
        before = await self.place()
        await asyncio.sleep(0.5 / self.pace)
        if (way := math.dist(before, await self.place())) > self.motions.still:
            raise RuleBroken(f"the robot moves on: by {way:.3g} in half a second, after it should stand")

    async def moved(self, since: Place, within: float = WITHIN) -> None:
        """Wait until it is elsewhere."""
        await self.line.until(
            lambda: self._place is not None and math.dist(self._place, since) > 2 * self.motions.still,
            within,
            "a movement",
        )

    async def far(self, *, quick: bool = False) -> tuple[int, Place]:
        """Verb and arguments of a movement to the farther one of two places."""
        motions, here = self.motions, await self.place()
        home = self._home or here
        there = tuple(a + b for a, b in zip(home, motions.offset, strict=True))
        end = max((home, there), key=lambda each: math.dist(each, here))
        silence = 2.0 if self.mode is None else self.mode.silence_ms / 1000
        way = math.dist(here, end) * motions.lever
        slow = max(min(motions.slow, way / (2 * silence + 3.0)), motions.slowest)
        return motions.goal(here, end, motions.quick if quick else slow)

    # -- asking

    def key(self) -> int:
        """A key that was never used."""
        return next(self._keys)

    def goal(
        self,
        verb: int,
        args: Place = NO_ARGS,
        *,
        key: int | None = None,
        epoch: int | None = None,
        ttl: int = 0,
        life: int = 0,
    ) -> Goal:
        """A goal for this controller, under the present epoch unless another one is given."""
        return Goal(
            self.key() if key is None else key,
            self.epoch if epoch is None else epoch,
            ttl,
            args,
            verb,
            *self.controller,
            life,
        )

    async def ask(
        self, message: Goal | GoalCancel, sender: Sender = FIRST, line: Line | None = None
    ) -> GoalStatus:
        """Send a goal or a cancel; the next status of its key."""
        line = line or self.line
        line.say(message, sender)
        return await self.status(message.key, sender, line=line)

    async def status(
        self,
        key: int,
        sender: Sender = FIRST,
        *states: GoalState,
        within: float = WITHIN,
        line: Line | None = None,
    ) -> GoalStatus:
        """The next status of a key; with states the next one that is in one of them."""
        named = " or ".join(state.name for state in states)
        return await (line or self.line).expect(
            GoalStatus,
            lambda it: (
                it.key == key
                and (it.target_system, it.target_component) == sender
                and (not states or it.state in states)
            ),
            within,
            f"a GOAL_STATUS {named}".strip(),
        )

    async def movement(self, **options: int) -> Goal:
        """A goal for a movement that no rule waits for; it is not sent."""
        verb, args = await self.far()
        return self.goal(verb, args, **options)

    async def begin(self, sender: Sender = FIRST, line: Line | None = None, **options: int) -> Goal:
        """Begin a movement that no rule waits for.

        Raises:
            RuleBroken: it does not begin.
        """
        goal = await self.movement(**options)
        status = await self.ask(goal, sender, line)
        expect_status(status, GoalState.ACTIVE, GoalState.ACCEPTED)
        return goal

    def cancel(self, key: int, epoch: int | None = None, life: int = 0) -> GoalCancel:
        """A cancel for this controller."""
        return GoalCancel(key, self.epoch if epoch is None else epoch, *self.controller, life)

    async def set_mode(
        self,
        mode: ModeKind,
        *,
        epoch: int | None = None,
        stops: int = 0,
        life: int = 0,
        sender: Sender = FIRST,
    ) -> Mode:
        """Ask for a mode; the mode that answers: the wished one, or one with a reason why not."""
        wish = SetMode(self.epoch if epoch is None else epoch, *self.controller, mode, stops, life)
        self.line.say(wish, sender)
        return await self.line.expect(
            Mode, lambda it: it.mode == mode or it.reason in {*REFUSALS, Reason.BAD_ARGUMENT}
        )

    async def request(
        self,
        holder: int,
        wish: int = ClaimWish.KEEP,
        *,
        epoch: int | None = None,
        term: int = 9000,
        life: int = 0,
        sender: Sender = FIRST,
        line: Line | None = None,
    ) -> ClaimStatus:
        """Send a claim; its answer."""
        self._holders[holder] = sender
        line = line or self.line
        under = self.epoch + 1 if epoch is None else epoch
        line.say(Claim(holder, under, term, life, *self.controller, wish, f"conform {holder}"), sender)
        return await line.expect(
            ClaimStatus,
            lambda it: (it.target_system, it.target_component) == sender,
            what="a CLAIM_STATUS for its asker",
        )

    def needs_claims(self) -> None:
        """Check that the controller knows claims.

        Raises:
            NotTried: it sends no life, so it needs none.
        """
        if not self.life:
            raise NotTried("it sends no life, so a proxy sends it no claims")

    async def settle(self) -> None:
        """Make the controller ready for the next rule: nothing held, nothing stopped, nothing moving.

        Raises:
            RuleBroken: it does not become ready.
        """
        if self.line.ended is not None:
            await self.start()
        for holder, sender in self._holders.items():
            if self.claim is not None and self.claim.holder == holder:
                await self.request(holder, ClaimWish.RELEASE, epoch=self.epoch, sender=sender)
        self._holders.clear()
        self.line.say(self.cancel(0))
        mode = await self.set_mode(ModeKind.READY)
        if mode.mode != ModeKind.READY:
            refused = Reason(mode.reason).name if mode.reason in {*Reason} else mode.reason
            await self.line.expect(
                Mode, lambda it: it.mode == ModeKind.READY, what=f"MODE READY (but {refused})"
            )


def expect_status(status: GoalStatus, *states: GoalState, reason: Reason | None = None) -> None:
    """Check a status.

    Raises:
        RuleBroken: it is another one.
    """
    right = status.state in states and reason in {None, status.reason}
    if not right:
        wanted = " or ".join(state.name for state in states) + (
            f", {reason.name}" if reason is not None else ""
        )
        raise RuleBroken(f"the status is {named(status)}, and should be {wanted}")


def named(status: GoalStatus) -> str:
    """State and reason of a status, for people."""
    state = GoalState(status.state).name if status.state in {*GoalState} else str(status.state)
    reason = Reason(status.reason).name if status.reason in {*Reason} else str(status.reason)
    return state if status.reason == Reason.NONE else f"{state}, {reason}"


def require(right: object, sentence: str) -> None:
    """Check something.

    Raises:
        RuleBroken: it is not so.
    """
    if not right:
        raise RuleBroken(sentence)
