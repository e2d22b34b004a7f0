"""A conversation with one controller: what is said, what is heard, what follows. Pure.

The session composes the wire's services into what a proxy needs. It outlives links: `opened` and `closed`
tell it of each, and goals, twin and stop go on from one to the next. Messages and moments go in, effects come
out; the shell in `connection.py` carries them out.

A robot is *online* while its link is open and its controller was heard within SILENCE.

A stop that was asked for here is kept until it is released here (`will.py`): a controller that restarts
meanwhile, or that somebody else releases, is stopped again as soon as it is heard. A stop that nobody asked
for here (a former proxy did, or somebody on another link) is the controller's own: the session tells that the
robot is *held*, until the controller tells that it is not. A restart is no release: it is then kept as ours.

The session of a proxy claims the controller (`ClaimClient`): only while the controller grants that is the
robot moved from here. A controller that tells no number of its life understands no claims, and is commanded
without one. A view claims nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from robotree.protocol.frame import Frame
from robotree.protocol.messages import (
    AnyMessage,
    ClaimStatus,
    CommandAck,
    GoalStatus,
    Heartbeat,
    MavAutopilot,
    MavCmd,
    MavComponent,
    MavModeFlag,
    MavState,
    MavType,
    Message,
    Mode,
    ModeKind,
    Reason,
)
from robotree.protocol.services.claim_client import ClaimClient, ClaimDenied, ClaimGranted
from robotree.protocol.services.command_client import CommandClient
from robotree.protocol.services.command_client import Effect as CommandEffect
from robotree.protocol.services.goal_client import GoalClient, GoalEnded, GoalProgress, GoalSilent
from robotree.protocol.services.heartbeat import SILENCE, HeartbeatSender
from robotree.protocol.services.peer import Send
from robotree.protocol.services.picture import Picture, PictureReceiver
from robotree.protocol.services.statustext import Listener, Sentence
from robotree.proxy.life import LONGEST_WAY, Word, overtaken, restarted
from robotree.proxy.motion import Request
from robotree.proxy.outcome import reason_in_words
from robotree.proxy.translate import COMPONENTS, READERS, Readers, Target
from robotree.proxy.twin import Twin
from robotree.proxy.will import HOLDING, Answer, ReleaseConfirmed, Will

CONTROLLER = Target(1, MavComponent.AUTOPILOT1)
"""Where a robot's controller is found on its own link, by MAVLink's custom."""
SUPERVISOR_SYSTEM = 255
"""System id of ground stations, by the same custom."""
NOT_YET = "its controller was not heard yet"
"""Why a session is offline that never had a link."""
SETTLED = 2.5
"""[s] after which a new link has brought the first words, if its controller is well: behind a router nobody
is greeted, and the next HEARTBEAT comes within a second; then the claim is answered."""
FORMER_LIVES = 16
"""Lives of a controller that are remembered as over, for `LONGEST_WAY` each."""
DEAD = 2 * SILENCE
"""[s] of silence after which the link itself is given up: its far end may be gone without having said so."""


@dataclass(frozen=True, slots=True)
class OnlineChanged:
    """The controller can be commanded now, or no longer."""

    online: bool


@dataclass(frozen=True, slots=True)
class HeldChanged:
    """The controller takes no goals until it is released, for this reason; or (empty) it takes them again."""

    reason: str


@dataclass(frozen=True, slots=True)
class Redial:
    """Nothing comes over the open link; close it and open another."""

    trouble: str


Claim = ClaimGranted | ClaimDenied
Goal = GoalProgress | GoalEnded | GoalSilent
Event = OnlineChanged | HeldChanged | Answer | Claim | Goal | Picture | Sentence
"""What the session has to tell."""
Effect = Send | Redial | Event
"""What the session has to tell, and what it asks the shell to do."""


class Session:
    """One side of the conversation.

    Args:
        component: which part of the supervisor's system speaks; the controller knows goals by it.
        controller: whom to speak to.
        readers: how the telemetry reads.
        rates: [Hz] at which telemetry is enough, by its kind; the rest comes as the controller sends it.
        claim: by which we command the controller; None: we do not.
    """

    def __init__(
        self,
        *,
        component: int = MavComponent.MISSIONPLANNER,
        controller: Target = CONTROLLER,
        readers: Readers = READERS,
        rates: Mapping[type[Message], float] = MappingProxyType({}),
        claim: ClaimClient | None = None,
    ) -> None:
        self.component = component
        self.controller = controller
        self.twin = Twin(readers)
        self.online = False
        self.trouble = NOT_YET
        """Why it is offline, for people, as one clause."""
        self.heard_at = -math.inf
        """[s] The last sign of life of the controller."""
        self.disbelief = ""
        """Why frames that arrive are not believed, as one clause; empty: no such frame came."""
        self._open = False
        self._opened_at = -math.inf
        self._beats = 0
        """Heartbeats of the controller on this link."""
        self._rates = rates
        self._commands = CommandClient(*controller)
        self._goals = GoalClient(*controller)
        self._heartbeats = HeartbeatSender()
        self._pictures = PictureReceiver()
        self._listener = Listener()
        self._will = Will(controller)
        self._held_told = ""
        self._claim = claim
        self._lives: dict[int, float] = {}
        """Former lives of the controller, and until when [s] a word of one of them was long on its way."""
        self._namesakes: set[int] = set()
        """Components of our system that somebody else speaks as."""

    @property
    def claims(self) -> bool:
        """Whether we command the controller by a claim: it understands them."""
        return self._claim is not None and self._claim.life > 0

    @property
    def denial(self) -> str:
        """Why the controller does not obey us, as a clause; empty: it does, or has not answered yet."""
        denied = None if self._claim is None else self._claim.denied
        return "" if denied is None else denial_in_words(denied)

    def settling(self, now: float) -> bool:
        """Whether it is offline only because the first words on a new link are still under way."""
        if self.online:
            return False
        return now - self._opened_at < SETTLED if self._open else self.trouble == NOT_YET

    @property
    def stopped(self) -> bool:
        """Whether a stop is wanted, confirmed or not."""
        return self._will.stopped

    @property
    def held(self) -> str:
        """Why the robot must not be commanded until it is released, as a clause for people; empty: it may.

        What the controller told last, but for the moment in which its release is on the way: then a goal that
        follows the release is obeyed, and must not be held up here.
        """
        if self._will.releasing:
            return ""
        mode = self.twin.latest(Mode)
        if mode is not None and mode.mode in HOLDING:
            return f"{HOLDING[ModeKind(mode.mode)]}: {reason_in_words(mode.reason)}"
        return "its controller has yet to confirm the stop" if self.stopped else ""

    @property
    def obeyed(self) -> int:
        """The highest epoch that the controller has told of."""
        mode = self.twin.latest(Mode)
        return 0 if mode is None else mode.epoch

    @property
    def pieces(self) -> int:
        """Packets of pictures so far; while they grow, a picture is on its way."""
        return self._pictures.statistics.pieces

    # -- the link ----------------------------------------------------------------------------------

    def opened(self, now: float) -> list[Effect]:
        """A link was opened; the controller has yet to be heard on it."""
        self._open = True
        self._opened_at = now
        self._beats = 0
        self._will.opened()
        if self._claim is not None:
            self._claim.opened()
        self.trouble = self.disbelief or "nothing was heard from its controller yet"
        self._heartbeats.hurry()
        self._goals.hurry()
        return self.tick(now)

    def closed(self, trouble: str) -> list[Effect]:
        """The link ended, or could not be opened; `trouble` says why, in one clause."""
        self._open = False
        self._pictures.link_closed(None)
        return self._turn(online=False, trouble=trouble)

    def hear(self, frame: Frame, now: float) -> list[Effect]:
        """Take one intact frame."""
        if frame.system != self.controller.system:
            self._note_namesake(frame)
            return []
        message = frame.message
        effects: list[Effect] = [*self._pictures.receive(frame, None)]
        effects += self._listener.receive(frame, None, now)
        if frame.component != self.controller.component:
            return effects
        self.heard_at = now
        before, told_at = self.twin.latest(Mode), self.twin.told_at(Mode)
        if isinstance(message, Mode) and before is not None and self._is_over(before, told_at, message, now):
            return effects  # it tells of a stop or a release that is over
        self.twin.hear(message, now)
        if isinstance(message, Heartbeat):
            self._beats += 1
        elif isinstance(message, CommandAck) and frame.is_for(SUPERVISOR_SYSTEM, self.component):
            effects += _said(self._commands.receive(message, now))
        elif isinstance(message, GoalStatus) and self._for_us(message):
            effects += self._goals.receive(message, now)
        elif isinstance(message, ClaimStatus) and self._claim is not None:
            effects += self._claim.receive(message, for_us=self._for_us(message))
            effects += self._keep_claim(now)
        elif isinstance(message, Mode):
            effects += self._compare(message, before, told_at, now)
        if self._open and self._is_introduced() and (turned := self._turn(online=True, trouble="")):
            effects += turned + self._ask_for_rates(now)
        return effects + self._held_news()

    @property
    def simulated(self) -> bool | None:
        """Whether the controller says in its heartbeat that nothing real moves; None: it was never heard."""
        beat = self.twin.latest(Heartbeat)
        return None if beat is None else bool(beat.base_mode & MavModeFlag.HIL_ENABLED)

    def tick(self, now: float) -> list[Effect]:
        """Carry out what is due: heartbeats, repetitions, silence. Call it ten times a second."""
        effects: list[Effect] = [*self._listener.tick(now)]
        if self.online and now - self.heard_at >= SILENCE:
            silent = f"its controller has been silent for {SILENCE:g} s"
            effects += self._turn(online=False, trouble=self.disbelief or silent)
        elif not self.online and self._open and self.disbelief:
            self.trouble = self.disbelief
        effects += [*self._goals.tick(now), *self._will.expire(now)]
        if not self._open:
            effects = [effect for effect in effects if not isinstance(effect, Send)]
            return effects + self._held_news()
        effects += self._keep_claim(now)
        self._heartbeats.keep(math.inf if self._claim and self._claim.granted else self._patience())
        effects += [Send(beat) for beat in self._heartbeats.tick(_heartbeat(), now)]
        effects += _said(self._commands.tick(now))
        if now - max(self._opened_at, self.heard_at) >= DEAD:
            effects.append(Redial(self.disbelief or f"nothing came over the link for {DEAD:g} s"))
        return effects + self._insist(now) + self._held_news()

    # -- what is asked of the controller -----------------------------------------------------------

    def start(
        self,
        key: int,
        request: Request,
        *,
        epoch: int,
        ttl: float,
        now: float,
        repeatable: bool = False,
    ) -> list[Effect]:
        """Ask for a movement.

        Args:
            key: of the goal, 1 to 2^64 - 1.
            request: what to do.
            epoch: of the lease under which it is asked.
            ttl: [s] it may take; 0: until reached.
            now: [s]
            repeatable: carried out twice, it ends the same.
        """
        verb, args = request
        under = self._epoch(epoch)
        claim = self._keep_claim(now)
        goal = self._goals.start(key, verb, args, epoch=under, now=now, ttl=ttl, repeatable=repeatable)
        return [*claim, *goal]

    def cancel(self, key: int, *, epoch: int, now: float) -> list[Effect]:
        """Ask for the end of a movement; repeated until its end is heard."""
        return [*self._goals.cancel(key, epoch=self._epoch(epoch), now=now)]

    def ask_for(self, message: AnyMessage) -> list[Effect]:
        """Say one thing once."""
        return [Send(message)]

    def stop(self, now: float) -> list[Effect]:
        """Protective stop, now, again until it is confirmed, and whenever the controller is not stopped."""
        self._will.stop()
        return self._insist(now) + self._held_news()

    def release(self, epoch: int, now: float) -> list[Effect]:
        """Release the stop; said again until the controller has answered it, for RELEASE_WITHIN at most.

        What is released is the stop that the controller told of last, or our own that it has yet to confirm:
        one that somebody asks for while the release is said again stays in force. Where neither is known of,
        nothing is said, and it is done, also while the controller is away.
        """
        told = self.twin.latest(Mode)
        if told is not None and told.mode not in HOLDING and not self._will.pending:
            return [ReleaseConfirmed()]
        stops, life = (told.stops, told.life) if told else (0, 0)
        self._will.release(self._epoch(epoch), stops, now, life)
        return self._insist(now) + self._held_news()

    def take_back(self, now: float) -> list[Effect]:
        """Nobody waits for the release any more; a controller that obeys it all the same is stopped again."""
        self._will.take_back()
        return self._insist(now) + self._held_news()

    def farewell(self) -> list[Effect]:
        """Give the controller up, so that the next one need not wait until we count as silent."""
        return [*self._claim.release()] if self._claim is not None and self._open else []

    # -- inside ------------------------------------------------------------------------------------

    def _epoch(self, epoch: int) -> int:
        """The epoch under which the controller is told something that is said under a lease's `epoch`.

        Not below the claim's, which is above those of proxies before us.
        """
        if self._claim is None or not self.claims:
            return epoch
        self._claim.raise_to(epoch)
        return self._claim.epoch

    def _is_introduced(self) -> bool:
        """Whether the controller has told on this link who it is, how it is, and whether it obeys us.

        So its life is known before the first goal. One that tells no mode is there with its second heartbeat.
        """
        if self._claim is not None and not self._claim.settled:
            return False
        return self._beats > 1 or (self._beats == 1 and self.twin.told_at(Mode) >= self._opened_at)

    def _keep_claim(self, now: float) -> list[Effect]:
        """Say the claim, if it is due."""
        if self._claim is None or not self._open:
            return []
        mode = self.twin.latest(Mode)
        silence = math.inf if mode is None else mode.silence_ms / 1000
        return [*self._claim.tick(now, silence, moving=bool(self._goals.pursued))]

    def _is_over(self, before: Mode, told_at: float, mode: Mode, now: float) -> bool:
        """Whether a mode was told before the one that was heard last."""
        last, this = Word(before.time_boot_ms, told_at, before.life), Word(mode.time_boot_ms, now, mode.life)
        return now < self._lives.get(mode.life, -math.inf) or overtaken(last, this)

    def _note_namesake(self, frame: Frame) -> None:
        """Somebody else speaks as a component of our system. If it is ours, who holds no claim gives way."""
        if frame.system != SUPERVISOR_SYSTEM:
            return
        self._namesakes.add(frame.component)
        if self._claim is None or frame.component != self.component:
            return
        free = [each for each in COMPONENTS if each not in self._namesakes]
        if free and not self._claim.granted and not self._goals.pursued:
            self.component = free[self._claim.holder % len(free)]

    def _for_us(self, status: GoalStatus | ClaimStatus) -> bool:
        return (status.target_system, status.target_component) == (SUPERVISOR_SYSTEM, self.component)

    def _turn(self, *, online: bool, trouble: str) -> list[Effect]:
        self.trouble = trouble
        if online == self.online:
            return []
        self.online = online
        return [OnlineChanged(online)]

    def _patience(self) -> float:
        """[s] of silence that the controller bears: as much as it tells while it moves for us, else any."""
        mode = self.twin.latest(Mode)
        return mode.silence_ms / 1000 if mode is not None and self._goals.pursued else math.inf

    def _ask_for_rates(self, now: float) -> list[Effect]:
        """Rates belong to one connection of one life of the controller, so they are asked for each time."""
        self._commands = CommandClient(*self.controller)
        effects: list[Effect] = []
        for kind, rate in self._rates.items():
            wish = (kind.codec.definition.id, 1e6 / rate)
            effects += _said(self._commands.send(MavCmd.SET_MESSAGE_INTERVAL, wish, now))
        return effects

    def _compare(self, mode: Mode, before: Mode | None, told_at: float, now: float) -> list[Effect]:
        """The controller has told its mode, and `told_at` [s] the one before: is it what is wished for?"""
        anew = before is not None and restarted(
            Word(before.time_boot_ms, told_at, before.life), Word(mode.time_boot_ms, now, mode.life)
        )
        lost = before is not None and before.mode == ModeKind.SAFE_STOP
        effects: list[Effect] = []
        if anew and before is not None:
            effects += self._goals.restarted(mode.life)
            self._note_former_life(before.life, mode.life, now)
        self._goals.life = mode.life
        if self._claim is not None:
            self._claim.meet(mode.life, mode.epoch)
            effects += self._keep_claim(now)
        effects += [*self._will.hear(mode, anew=anew, lost=lost), *self._insist(now)]
        if anew and self.online and told_at >= self._opened_at:  # so quickly that it was never offline
            effects += self._ask_for_rates(now)
        return effects

    def _note_former_life(self, before: int, life: int, now: float) -> None:
        """Take words of a life that is over for late ones, not for ever: its number may come again."""
        former = {**self._lives, before: now + LONGEST_WAY} if before else self._lives
        self._lives = {each: former[each] for each in list(former)[-FORMER_LIVES:] if each != life}

    def _held_news(self) -> list[Effect]:
        if self.held == self._held_told:
            return []
        self._held_told = self.held
        return [HeldChanged(self._held_told)]

    def _insist(self, now: float) -> list[Effect]:
        return [Send(message) for message in self._will.say(now)] if self._open else []


def _said(effects: Sequence[CommandEffect]) -> list[Effect]:
    """What a command's way asks to be sent. How it ends changes nothing: who knows no rates sends all."""
    return [effect for effect in effects if isinstance(effect, Send)]


def _heartbeat() -> Heartbeat:
    return Heartbeat(MavType.ONBOARD_CONTROLLER, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE)


def denial_in_words(denied: ClaimDenied) -> str:
    """Why a controller does not obey us, and what to do, as a clause."""
    if denied.reason == Reason.BAD_EPOCH:
        why = f"its controller has obeyed epoch {denied.epoch}, and none above it is left"
        return f"{why}; reset it at its machine: robotree sim … --reset-epoch"
    holder = f"{denied.name!r}" if denied.name else "another program"
    return f"{holder} holds its controller; end that program, or start this proxy with --take-over"
