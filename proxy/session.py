"""The session with one controller: what is sent to it, what it reports, and what follows. Pure.

It outlives links: goals, twin and desired mode continue over the next one. Messages and times go in, effects
come out; `connection.py` carries them out.

A robot is *online* while its link is open and its controller was heard within SILENCE. A stop that was
requested here stays wanted until it is released here (`desired_mode.py`). Any other stop is the controller's
own: the robot is reported as *held* until the controller reports that it is not stopped. If the controller
restarts before that, the stop becomes ours: a restart is no release.

The session of a proxy claims the controller (`ClaimClient`), and moves the robot only while that claim is
granted; a controller that sends no number of its life knows no claims. A view claims nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

from robotree.protocol.frame import Frame
from robotree.protocol.messages import (
    AnyMessage,
    CameraPose,
    ClaimStatus,
    CommandAck,
    DataTransmissionHandshake,
    EncapsulatedData,
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
    Statustext,
)
from robotree.protocol.services.claim_client import ClaimClient, ClaimDenied, ClaimGranted
from robotree.protocol.services.command_client import CommandClient, CommandClientEffect
from robotree.protocol.services.goal_client import GoalClient, GoalEnded, GoalProgress, GoalSilent
from robotree.protocol.services.heartbeat import SILENCE, HeartbeatSender
from robotree.protocol.services.peer import Send
from robotree.protocol.services.picture import Picture, PictureReceiver
from robotree.protocol.services.statustext import Sentence, StatustextReceiver
from robotree.proxy.desired_mode import HOLDING_MODES, DesiredMode, ModeAnswer, ReleaseConfirmed
from robotree.proxy.motion import Request
from robotree.proxy.outcome import reason_in_words
from robotree.proxy.restart import LONGEST_DELAY, Report, has_restarted, is_older
from robotree.proxy.translate import COMPONENTS, READERS, MessageReaders, Target
from robotree.proxy.twin import Twin

CONTROLLER = Target(1, MavComponent.AUTOPILOT1)
"""System and component of a robot's controller on its own link, as MAVLink ground stations expect."""
SUPERVISOR_SYSTEM = 255
"""System id of ground stations, by MAVLink's convention."""
NOT_YET = "its controller was not heard yet"
"""Why a session is offline before its first link."""
NOTHING_HEARD = "nothing was heard from its controller yet"
"""Why a session is offline on a link on which no frame of the controller has arrived."""
UNANSWERED = "its controller is heard but answers no CLAIM, as one that sends a life in MODE must"
"""Why a session is offline on a link on which its CLAIM was not answered."""
INCOMPLETE = "its controller is heard but has sent no {} yet"
"""Why a session is offline on a link on which this message of the controller is missing."""
SETTLED = 2.5
"""[s] within which a new link brings the first messages of a healthy controller. Behind a router a new link
is not greeted: the next HEARTBEAT comes within a second, and then the claim is answered."""
FORMER_LIVES = 16
"""Lives of a controller that are remembered as over, for `LONGEST_DELAY` each."""
FROM_ANY_COMPONENT = frozenset({DataTransmissionHandshake, EncapsulatedData, Statustext})
"""Messages that any component of the controller sends: pictures and sentences."""
HEARTBEAT = Heartbeat(MavType.ONBOARD_CONTROLLER, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE)
"""Ours."""
DEAD = 2 * SILENCE
"""[s] of silence after which the link is closed: its far end may be gone without notice."""


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
    """Nothing arrives over the open link; close it and open another."""

    trouble: str


Claim = ClaimGranted | ClaimDenied
Goal = GoalProgress | GoalEnded | GoalSilent
SessionEvent = OnlineChanged | HeldChanged | ModeAnswer | Claim | Goal | Picture | Sentence
"""The reports of the session."""
SessionEffect = Send | Redial | SessionEvent
"""The reports of the session, and its orders to the connection."""


class ControllerSession:
    """Our side of the session with one controller.

    Args:
        component: our component id; the controller recognises our goals by it.
        controller: its system and component.
        readers: how the telemetry reads.
        rates: [Hz] to ask for, by kind of telemetry; the rest comes as the controller sends it.
        claim: with which we command the controller; None: we do not command it.
    """

    def __init__(
        self,
        *,
        component: int = MavComponent.MISSIONPLANNER,
        controller: Target = CONTROLLER,
        readers: MessageReaders = READERS,
        rates: Mapping[type[Message], float] = MappingProxyType({}),
        claim: ClaimClient | None = None,
    ) -> None:
        self.component = component
        self.controller = controller
        self.twin = Twin(readers)
        self.online = False
        self.trouble = NOT_YET
        """Why it is offline, for people, as one clause; empty: it is online."""
        self.heard_at = -math.inf
        """[s] when the controller was heard last."""
        self.rejection = ""
        """Why arriving frames are rejected, as one clause; empty: none was."""
        self._open = False
        self._opened_at = -math.inf
        self._redials = False
        """Whether another link is asked for already: this one may take its time to close."""
        self._beats = 0
        """Heartbeats of the controller on this link."""
        self._rates = rates
        self._commands = CommandClient(*controller)
        self._goals = GoalClient(*controller)
        self._heartbeats = HeartbeatSender()
        self._pictures = PictureReceiver()
        self._camera_poses: dict[int, CameraPose] = {}
        """Of pictures that are on their way, by the component of the camera."""
        self._listener = StatustextReceiver()
        self._desired = DesiredMode(controller)
        self._held_reported = ""
        self._claim = claim
        self._report: Report | None = None
        """Of its latest mode."""
        self._lives: dict[int, float] = {}
        """Former lives of the controller, and until when [s] a report of each counts as late."""
        self._same_system: set[int] = set()
        """Component ids of our system that another program uses."""

    @property
    def claims(self) -> bool:
        """Whether we command the controller by a claim: it understands them."""
        return self._claim is not None and self._claim.life > 0

    @property
    def denial(self) -> str:
        """Why the controller does not obey us, and what to do, as a clause; empty: it does, or is silent."""
        denied = None if self._claim is None else self._claim.denied
        if denied is None:
            return ""
        if denied.reason == Reason.BAD_EPOCH:
            why = f"its controller has obeyed epoch {denied.epoch}, and none above it is left"
            return f"{why}; reset it at its machine: robotree sim … --reset-epoch"
        holder = f"{denied.name!r}" if denied.name else "another program"
        return f"{holder} holds its controller; end that program, or start this proxy with --take-over"

    def settling(self, now: float) -> bool:
        """Whether it is offline only because the first messages on a new link have not arrived yet."""
        if self.online:
            return False
        return now - self._opened_at < SETTLED if self._open else self.trouble == NOT_YET

    @property
    def stopped(self) -> bool:
        """Whether a stop is wanted, confirmed or not."""
        return self._desired.stopped

    @property
    def held(self) -> str:
        """Why the robot must not be commanded until it is released, as a clause for people; empty: it may.

        This is what the controller reported last, except while its release is on its way: a goal that follows
        the release will be obeyed, and must not be blocked here.
        """
        if self._desired.releasing:
            return ""
        mode = self.twin.latest(Mode)
        if mode is not None and mode.mode in HOLDING_MODES:
            return f"{HOLDING_MODES[ModeKind(mode.mode)]}: {reason_in_words(mode.reason)}"
        return "its controller has yet to confirm the stop" if self.stopped else ""

    @property
    def obeyed(self) -> int:
        """The highest epoch that the controller has reported."""
        mode = self.twin.latest(Mode)
        return 0 if mode is None else mode.epoch

    @property
    def witness(self) -> str:
        """By which a later process of ours knows whether the controller can still tell what we asked for.

        The controller knows a goal by our component, in one of its lives; empty: it does not number them.
        """
        mode = self.twin.latest(Mode)
        return f"{self.component}/{mode.life}" if mode is not None and mode.life else ""

    @property
    def pieces(self) -> int:
        """Packets of pictures so far; while they grow, a picture is on its way."""
        return self._pictures.statistics.pieces

    # -- the link ----------------------------------------------------------------------------------

    def opened(self, now: float) -> list[SessionEffect]:
        """A link was opened; the controller has not been heard on it yet."""
        self._open = True
        self._opened_at, self._redials = now, False
        self._beats = 0
        self._desired.opened()
        if self._claim is not None:
            self._claim.opened()
        self.trouble = self.rejection or NOTHING_HEARD
        self._heartbeats.hurry()
        self._goals.opened()
        return self.tick(now)

    def closed(self, trouble: str) -> list[SessionEffect]:
        """The link ended, or could not be opened; `trouble` is the reason, in one clause."""
        self._open = False
        self._pictures.link_closed(None)
        return self._set_online(online=False, trouble=trouble)

    def receive(self, frame: Frame, now: float) -> list[SessionEffect]:
        """Take one intact frame."""
        if frame.system != self.controller.system:
            self._note_same_system(frame)
            return []
        effects: list[SessionEffect] = []
        message = frame.message
        if isinstance(message, CameraPose):
            self._camera_poses[frame.component] = message
        elif type(message) in FROM_ANY_COMPONENT:
            effects += self._pictures.receive(frame, None)
            effects += self._listener.receive(frame, None, now)
        if frame.component != self.controller.component:
            return effects
        self.heard_at = now
        if isinstance(message, Mode):
            last, this = self._report, Report(message.time_boot_ms, now, message.life)
            if now < self._lives.get(this.life, -math.inf) or (last is not None and is_older(last, this)):
                return effects  # an older report, about a stop or a release that is over
            before, self._report = self.twin.latest(Mode), this
            self.twin.update(message, now)
            effects += self._compare_mode(message, before, last, this)
            effects += self._held_change()
        else:
            self.twin.update(message, now)
            effects += self._hear(frame, message, now)
        if not self.online and self._open:
            effects += self._introduction(now)
        return effects

    def _hear(self, frame: Frame, message: AnyMessage, now: float) -> list[SessionEffect]:
        """Take a message of the controller, other than its mode."""
        match message:
            case Heartbeat():
                self._beats += 1
            case ClaimStatus() if self._claim is not None:
                claim = self._claim.receive(message, for_us=self._for_us(message))
                return [*claim, *self._keep_claim(now)]
            case GoalStatus() if self._for_us(message):
                return [*self._goals.receive(message, now)]
            case CommandAck() if frame.is_for(SUPERVISOR_SYSTEM, self.component):
                return _sends(self._commands.receive(message, now))
            case _:
                pass
        return []

    def take_camera_pose(self, component: int) -> CameraPose | None:
        """Return where a camera was in the picture that has just come from it; None: it did not say."""
        return self._camera_poses.pop(component, None)

    @property
    def simulated(self) -> bool | None:
        """Whether the controller says in its heartbeat that nothing real moves; None: it was never heard."""
        beat = self.twin.latest(Heartbeat)
        return None if beat is None else bool(beat.base_mode & MavModeFlag.HIL_ENABLED)

    @property
    def due(self) -> float:
        """When to call `tick` next, [s]; every other call of this object may make it earlier."""
        silent = self.heard_at + SILENCE if self.online else math.inf
        due = min(self._listener.due, self._goals.due, self._desired.due(link_open=self._open), silent)
        if not self._open:
            return due
        claim, moving = self._claim, self._goals.pursuing
        silence = self._silence_reported() if moving else math.inf  # which matters only then
        claimed = math.inf if claim is None else claim.due(silence, moving=moving)
        beat = self._heartbeats.due_for(self._beats_kept_for())
        return min(due, claimed, beat, self._commands.due, self._dead_at())

    def tick(self, now: float) -> list[SessionEffect]:
        """Send what is due (heartbeats, repetitions) and notice silence. Call it when it is `due`."""
        effects: list[SessionEffect] = [*self._listener.tick(now)]
        if self.online and now >= self.heard_at + SILENCE:
            silent = f"its controller has been silent for {SILENCE:g} s"
            effects += self._set_online(online=False, trouble=self.rejection or silent)
        elif not self.online and self._open and self.rejection:
            self.trouble = self.rejection
        goals = [*self._goals.tick(now), *self._desired.expire(now)]
        if not self._open:
            effects = [effect for effect in (*effects, *goals) if not isinstance(effect, Send)]
            return effects + self._held_change()
        self._heartbeats.keep(self._beats_kept_for())
        beats = [Send(beat) for beat in self._heartbeats.tick(HEARTBEAT, now)]
        # the claim first: on a new link goals are refused before it
        effects += [*self._keep_claim(now, beats=bool(beats)), *beats, *goals]
        effects += _sends(self._commands.tick(now))
        if now >= self._dead_at():
            self._redials = True
            effects.append(Redial(self.rejection or f"nothing came over the link for {DEAD:g} s"))
        return effects + self._repeat_mode(now) + self._held_change()

    def _dead_at(self) -> float:
        """When the link counts as dead, [s]."""
        return math.inf if self._redials else max(self._opened_at, self.heard_at) + DEAD

    # -- requests to the controller ----------------------------------------------------------------

    def start(
        self,
        key: int,
        request: Request,
        *,
        epoch: int,
        ttl: float,
        now: float,
        repeatable: bool = False,
        life: int | None = None,
    ) -> list[SessionEffect]:
        """Ask for a movement under the `epoch` of a lease; the rest is as for `GoalClient.start`."""
        verb, args = request
        under = self._epoch(epoch)
        claim = self._keep_claim(now)
        goal = self._goals.start(
            key, verb, args, epoch=under, now=now, ttl=ttl, repeatable=repeatable, life=life
        )
        return [*claim, *goal]

    def cancel(self, key: int, *, epoch: int, now: float) -> list[SessionEffect]:
        """Ask for the end of a movement; repeated until the controller confirms it."""
        return [*self._goals.cancel(key, epoch=self._epoch(epoch), now=now)]

    def stop(self, now: float) -> list[SessionEffect]:
        """Protective stop, now, again until it is confirmed, and whenever the controller is not stopped."""
        self._desired.stop()
        return self._repeat_mode(now) + self._held_change()

    def release(self, epoch: int, now: float) -> list[SessionEffect]:
        """Release the stop; sent again until the controller has answered, for RELEASE_TIMEOUT at most.

        This releases the stop that the controller reported last, or our own unconfirmed one; a stop that
        somebody requests later stays in force. If no stop is known, nothing is sent and the release counts as
        done, also while the controller is offline.
        """
        mode = self.twin.latest(Mode)
        if mode is not None and mode.mode not in HOLDING_MODES and not self._desired.pending:
            return [ReleaseConfirmed()]
        stops, life = (mode.stops, mode.life) if mode else (0, 0)
        self._desired.release(self._epoch(epoch), stops, now, life)
        return self._repeat_mode(now) + self._held_change()

    def withdraw(self, now: float) -> list[SessionEffect]:
        """Drop the release, because its caller no longer waits; if it was sent, a stop follows it."""
        self._desired.withdraw()
        return self._repeat_mode(now) + self._held_change()

    def release_claim(self) -> list[SessionEffect]:
        """Release our claim, so that the next proxy does not have to wait until we count as silent."""
        return [*self._claim.release()] if self._claim is not None and self._open else []

    # -- inside ------------------------------------------------------------------------------------

    def _epoch(self, epoch: int) -> int:
        """The epoch to send for a request under a lease's `epoch`: at least that of our claim."""
        if self._claim is None or not self.claims:
            return epoch
        self._claim.raise_to(epoch)
        return self._claim.epoch

    def _introduction(self, now: float) -> list[SessionEffect]:
        """Go online once this link has brought the heartbeat, the mode, and the answer to our claim.

        So the controller's life is known before the first goal. One that sends no mode counts from its second
        heartbeat. Until then `trouble` says what is missing.
        """
        has_report = self._report is not None and self._report.heard_at >= self._opened_at
        if self._claim is not None and not self._claim.settled:
            missing = UNANSWERED
        elif self._beats > 1 or (self._beats == 1 and has_report):
            self._goals.meet()
            return self._set_online(online=True, trouble="") + self._ask_for_rates(now)
        else:
            missing = INCOMPLETE.format("MODE" if self._beats else "HEARTBEAT")
        self.trouble = self.rejection or missing
        return []

    def _keep_claim(self, now: float, *, beats: bool = False) -> list[SessionEffect]:
        """Send the claim, if it is due or a heartbeat goes out."""
        if self._claim is None or not self._open:
            return []
        silence, moving = self._silence_reported(), self._goals.pursuing
        return [*self._claim.tick(now, silence, moving=moving, beats=beats)]

    def _silence_reported(self) -> float:
        """[s] of silence that the controller allows while something moves, as reported."""
        mode = self.twin.latest(Mode)
        return math.inf if mode is None else mode.silence_ms / 1000

    def _note_same_system(self, frame: Frame) -> None:
        """Note that another program uses a component of our system.

        If it is our own component, we take another one, unless we hold the claim.
        """
        if frame.system != SUPERVISOR_SYSTEM:
            return
        self._same_system.add(frame.component)
        if self._claim is None or frame.component != self.component:
            return
        free = [each for each in COMPONENTS if each not in self._same_system]
        if free and not self._claim.granted and not self._goals.pursuing:
            self.component = free[self._claim.holder % len(free)]

    def _for_us(self, status: GoalStatus | ClaimStatus) -> bool:
        return (status.target_system, status.target_component) == (SUPERVISOR_SYSTEM, self.component)

    def _set_online(self, *, online: bool, trouble: str) -> list[SessionEffect]:
        self.trouble = trouble
        if online == self.online:
            return []
        self.online = online
        return [OnlineChanged(online)]

    def _beats_kept_for(self) -> float:
        """[s] of silence that our heartbeats must not reach; it matters while it moves without a claim."""
        claimed = self._claim is not None and self._claim.granted
        return self._silence_reported() if self._goals.pursuing and not claimed else math.inf

    def _ask_for_rates(self, now: float) -> list[SessionEffect]:
        """Ask for our rates; the controller keeps them for one link and one life."""
        self._commands = CommandClient(*self.controller)
        effects: list[SessionEffect] = []
        for kind, rate in self._rates.items():
            wish = (kind.codec.definition.id, 1e6 / rate)
            effects += _sends(self._commands.send(MavCmd.SET_MESSAGE_INTERVAL, wish, now))
        return effects

    def _compare_mode(
        self, mode: Mode, before: Mode | None, last: Report | None, this: Report
    ) -> list[SessionEffect]:
        """The controller has reported a mode, in `this` report; before, it was another one in the `last`."""
        now, was_stopped = this.heard_at, before is not None and before.mode == ModeKind.SAFE_STOP
        former = last if last is not None and has_restarted(last, this) else None
        effects: list[SessionEffect] = []
        if former is not None:
            effects += self._goals.restarted(mode.life)
            self._note_former_life(former.life, mode.life, now)
        self._goals.life = mode.life
        self._goals.meet()
        if self._claim is not None:
            self._claim.meet(mode.life, mode.epoch)
            effects += self._keep_claim(now)
        effects += [
            *self._desired.receive(mode, restarted=former is not None, was_stopped=was_stopped),
            *self._repeat_mode(now),
        ]
        if former is not None and self.online and former.heard_at >= self._opened_at:
            # it was so quick that it was never offline
            effects += self._ask_for_rates(now)
        return effects

    def _note_former_life(self, before: int, life: int, now: float) -> None:
        """Treat reports of an ended life as late ones, for a limited time: its number may come again."""
        former = {**self._lives, before: now + LONGEST_DELAY} if before else self._lives
        self._lives = {each: former[each] for each in list(former)[-FORMER_LIVES:] if each != life}

    def _held_change(self) -> list[SessionEffect]:
        if (held := self.held) == self._held_reported:
            return []
        self._held_reported = held
        return [HeldChanged(held)]

    def _repeat_mode(self, now: float) -> list[SessionEffect]:
        return [Send(message) for message in self._desired.messages_due(now)] if self._open else []


def _sends(effects: Sequence[CommandClientEffect]) -> list[SessionEffect]:
    """The messages to send for a command. Its result does not matter: without rates everything is sent."""
    return [effect for effect in effects if isinstance(effect, Send)]
