"""A controller to talk to: the wire's own goal server, heartbeats and modes, moved by the test's hand."""

from __future__ import annotations

import asyncio
from collections.abc import Callable

import pytest

from robotree.protocol.endpoint import Endpoint
from robotree.protocol.errors import LinkError
from robotree.protocol.frame import Frame
from robotree.protocol.links.link import Link
from robotree.protocol.links.loopback import Faults, Loopback
from robotree.protocol.messages import (
    AnyMessage,
    Claim,
    Goal,
    GoalCancel,
    GoalState,
    Heartbeat,
    LocalPositionNed,
    Mode,
    ModeKind,
    PictureRequest,
    Reason,
    SetMode,
    Tool,
    Verb,
)
from robotree.protocol.services.claim_server import ClaimServer
from robotree.protocol.services.fence import Fence, Refusal
from robotree.protocol.services.goal_client import GoalEnded
from robotree.protocol.services.goal_server import Abandon, Begin, GoalServer, GoalServerEffect
from robotree.protocol.services.heartbeat import HeartbeatSender
from robotree.protocol.services.peer import Peer, Send
from robotree.protocol.services.picture import split
from robotree.proxy.motion import Request
from robotree.proxy.session import (
    SUPERVISOR_SYSTEM,
    ControllerSession,
    HeldChanged,
    OnlineChanged,
    Redial,
    SessionEffect,
)

LONG_AGO = float("-inf")
GRIP = Request(Verb.GRIP, (0.02,))


class Controller:
    """A robot's controller without a robot."""

    def __init__(self, life: int = 0) -> None:
        self.life = life
        """0: it tells none, and understands no claims."""
        self.fence = Fence()
        self.claims = ClaimServer(self.fence, life)
        self.goals = self._goals_of_this_life()
        self.refusal: Refusal | None = None
        self.begun: list[Begin] = []
        self.abandoned: list[Abandon] = []
        self.heard: list[AnyMessage] = []
        self.mode, self.stops = ModeKind.READY, 1
        self.objection = Reason.NONE
        """Why it does not obey a release."""
        self.mute = False
        self.answers_claims = self.beats = self.modes = True
        """Whether it sends CLAIM_STATUS, HEARTBEAT and MODE."""
        self.place: tuple[float, float] | None = None
        self.jpeg = b""
        self.holes = 0
        """How many of the next pictures lose a packet on their way."""
        self.now = 0.0
        self._began = 0.0
        self._heartbeats = HeartbeatSender()
        self.x = 0.1
        """[m] Where its tool is."""
        self._mode_told = LONG_AGO
        self._endpoint: Endpoint | None = None

    def accept(self, link: Link) -> Endpoint:
        self._endpoint = Endpoint(link, system=1, component=1, on_frame=self._hear, on_closed=self._closed)
        self._heartbeats.hurry()
        self._mode_told = LONG_AGO
        return self._endpoint

    def say(self, message: AnyMessage) -> None:
        if self._endpoint is not None and not self.mute:
            self._endpoint.send(message)

    def tell_tool(self) -> None:
        self.say(Tool(5, self.x, 0.2, 0.3, 1.0, 2.0, 3.0, 0.4, 0.5, 0.6, (0, 0, 32767, 0), 0))

    def tell_place(self) -> None:
        if self.place is not None:
            self.say(LocalPositionNed(5, self.place[0], -self.place[1], 0.0, 0.0, 0.0, 0.0))

    def tick(self, now: float) -> None:
        self.now = now
        for beat in self._heartbeats.tick(Heartbeat(0, 0, 0, 0, 4), now):
            if self.beats:
                self.say(beat)
        if now - self._mode_told >= 0.5:
            self._tell_mode()
            if self.life and self.answers_claims:
                self.say(self.claims.status())
        self._carry_out(self.goals.tick(now))

    async def live(self, each: Callable[[], None] = lambda: None) -> None:
        """Let the loop's time pass for it, and have it do something now and then, until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            self.tick(loop.time())
            each()
            await asyncio.sleep(0.02)

    def progress(self, fraction: float) -> None:
        self._carry_out(self.goals.activate(self.begun[-1].id, self.now))
        self._carry_out(self.goals.progress(self.begun[-1].id, fraction, self.now))

    def finish(self, state: GoalState, reason: Reason = Reason.NONE, text: str = "") -> None:
        self._carry_out(self.goals.finish(self.begun[-1].id, state, self.now, reason, text))

    def _goals_of_this_life(self) -> GoalServer:
        guard = self.claims.guard if self.life else lambda _: None
        return GoalServer(set(Verb), self._check, guard, fence=self.fence, life=self.life)

    def restart(self) -> None:
        """Forget everything, the time too, as a power cycle does; but who tells lives keeps its fence."""
        self.life += bool(self.life)
        self.fence = self.fence if self.life else Fence()
        self.claims = ClaimServer(self.fence, self.life, self.now)
        self.goals, self._began = self._goals_of_this_life(), self.now
        self.mode, self.stops = ModeKind.READY, 1

    def stop(self) -> None:
        """Somebody on another link stops it."""
        self._carry_out(self.goals.abandon_all(Reason.STOPPED, self.now))
        self.stops += self.mode != ModeKind.SAFE_STOP
        self._enter(ModeKind.SAFE_STOP)

    def release(self) -> None:
        """Somebody on another link releases it."""
        self._enter(ModeKind.READY)

    def _check(self, _: Goal) -> Refusal | None:
        return (Reason.STOPPED, "") if self.mode == ModeKind.SAFE_STOP else self.refusal

    def _hear(self, frame: Frame) -> None:
        message = frame.message
        self.heard.append(message)
        if isinstance(message, (Goal, GoalCancel)):
            peer = Peer(None, frame.system, frame.component)
            self._carry_out(self.goals.receive(message, peer, self.now))
        elif isinstance(message, SetMode):
            self._set_mode(message)
        elif isinstance(message, Claim) and self.life and self.answers_claims:
            peer = Peer(None, frame.system, frame.component)
            for effect in self.claims.receive(message, peer, self.now):
                if isinstance(effect, Send):
                    self.say(effect.message)
        elif isinstance(message, PictureRequest) and self.jpeg:
            self.draw(self.jpeg, message)

    def draw(self, jpeg: bytes, request: PictureRequest) -> None:
        """Send a picture."""
        assert self._endpoint is not None
        pieces = split(jpeg, width=request.width, height=request.height, quality=request.quality)
        if self.holes:
            self.holes -= 1
            pieces.pop(1)
        for piece in pieces:
            self._endpoint.send(piece, component=request.target_component)

    def _set_mode(self, message: SetMode) -> None:
        if message.mode == ModeKind.SAFE_STOP:
            self.stop()
        elif self.objection != Reason.NONE:
            self._tell_mode(self.objection)
        elif self.mode == ModeKind.SAFE_STOP and message.stops not in {0, self.stops}:
            self._tell_mode(Reason.STOPPED)
        elif message.life not in {0, self.life}:
            self._tell_mode(Reason.OTHER_LIFE)
        elif self.goals.fence(message.epoch):
            self.release()
        else:
            self._tell_mode()

    def _enter(self, mode: ModeKind) -> None:
        self.mode = mode
        self._tell_mode()

    def _tell_mode(self, answer: Reason | None = None) -> None:
        self._mode_told = self.now
        standing = Reason.OPERATOR if self.mode == ModeKind.SAFE_STOP else Reason.NONE
        reason = standing if answer is None else answer
        now = round(1000 * (self.now - self._began))
        if self.modes:
            self.say(Mode(now, self.goals.epoch, 1000, self.mode, reason, self.stops, self.life))

    def _carry_out(self, effects: list[GoalServerEffect]) -> None:
        for effect in effects:
            match effect:
                case Send(message=message):
                    self.say(message)
                case Begin():
                    self.begun.append(effect)
                case Abandon():
                    self.abandoned.append(effect)

    def _closed(self, _: LinkError) -> None:
        self._endpoint = None


class Talk:
    """A session and a controller on a loopback link, in time that passes by hand."""

    def __init__(
        self, faults: Faults | None = None, session: ControllerSession | None = None, life: int = 0
    ) -> None:
        self.session = session or ControllerSession()
        self.controller = Controller(life)
        self.events: list[SessionEffect] = []
        self.redials: list[Redial] = []
        self.now = 0.0
        self._accidents = faults
        self._loopback: Loopback | None = None
        self._endpoint: Endpoint | None = None
        self.connect()

    @property
    def turns(self) -> list[bool]:
        return [event.online for event in self.events if isinstance(event, OnlineChanged)]

    @property
    def holds(self) -> list[bool]:
        return [bool(event.reason) for event in self.events if isinstance(event, HeldChanged)]

    @property
    def ends(self) -> list[GoalState]:
        return [event.state for event in self.events if isinstance(event, GoalEnded)]

    def start(self, key: int = 7, epoch: int = 5, ttl: float = 0.0, *, repeatable: bool = False) -> None:
        """Have it close the gripper."""
        goal = self.session.start(key, GRIP, epoch=epoch, ttl=ttl, now=self.now, repeatable=repeatable)
        self.perform(goal)

    def connect(self) -> None:
        self._loopback = Loopback(self._accept, self.controller.accept, self._accidents, self.now)
        self.perform(self.session.opened(self.now))

    def cut(self) -> None:
        assert self._loopback is not None
        self._loopback.cut()
        self._loopback.advance()

    def perform(self, effects: list[SessionEffect]) -> None:
        for effect in effects:
            match effect:
                case Send(message=message):
                    if self._endpoint is not None:
                        self._endpoint.send(message)
                case Redial():
                    self.redials.append(effect)
                case _:
                    self.events.append(effect)

    def wait(self, seconds: float, each: Callable[[], None] = lambda: None) -> None:
        """Let time pass, in steps of 50 ms."""
        assert self._loopback is not None
        for _ in range(round(seconds / 0.05)):
            self.now = round(self.now + 0.05, 6)
            self.controller.tick(self.now)
            self.perform(self.session.tick(self.now))
            self._loopback.advance(self.now)
            each()

    def _accept(self, link: Link) -> Endpoint:
        self._endpoint = Endpoint(
            link,
            system=SUPERVISOR_SYSTEM,
            component=self.session.component,
            on_frame=lambda frame: self.perform(self.session.receive(frame, self.now)),
            on_closed=self._closed,
        )
        return self._endpoint

    def _closed(self, reason: LinkError) -> None:
        self._endpoint = None
        self.perform(self.session.closed(str(reason)))


@pytest.fixture
def talk() -> Talk:
    return Talk()


@pytest.fixture
def make_talk() -> type[Talk]:
    return Talk


@pytest.fixture
def make_controller() -> type[Controller]:
    return Controller
