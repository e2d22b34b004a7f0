"""Goals, the sender's side: send until it is answered, then listen, poll and cancel.

A goal is repeated with its key until its first status comes. From then on only its status is polled, so that
a controller that has restarted answers UNKNOWN instead of beginning again. After `patience` without an answer
the goal is not repeated any more: a link that comes back much later must not start a movement.

A goal names the life of the controller that it was made for, so that another life does not begin it. If the
controller has restarted, the goal may have begun before: it ends as UNKNOWN with OTHER_LIFE. Only a goal that
was never answered, and whose repetition has the same result, is sent again in the new life.

A goal that is refused because somebody else commands may still begin: the controller does not store such a
refusal, and a repetition may arrive when nobody else commands any more. So the goal is cancelled, and ends as
refused when the controller has confirmed that it does not know it.

A repetition carries the rest of the time to live. A goal whose time is over before it was answered is
cancelled; when the controller then reports that it never had it, it ends as EXPIRED. A cancelled goal without
an answer is polled until LINGER after its time to live: then it moves no more, and polling ends. A goal
without a deadline is polled for ever.
"""

from __future__ import annotations

from math import inf, isinf, nan
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import Goal, GoalCancel, GoalState, GoalStatus, Reason, Verb
from robotree.protocol.services.peer import Send

if TYPE_CHECKING:
    from collections.abc import Hashable, Sequence

RESEND = 0.25
"""[s] between two repetitions of what was not answered."""
POLL = 1.0
"""[s] of silence after which the status is asked for."""
LONGEST_SILENCE = 3.0
"""[s] of silence after which the goal counts as out of sight."""
LINGER = 10.0
"""[s] after its time to live for which a cancelled goal of which nothing is heard is asked about."""
ARGUMENTS = 7
"""Of a goal, and of a command."""
_HALF = 0x8000


def padded(args: Sequence[float]) -> tuple[float, ...]:
    """The (7,) arguments of a goal or a command, from its first ones; the others are NaN: as it is now."""
    return (*args, *(nan,) * (ARGUMENTS - len(args)))


class GoalProgress(msgspec.Struct, frozen=True):
    """The controller told something new about a goal that goes on."""

    key: int
    state: GoalState
    progress: float


class GoalEnded(msgspec.Struct, frozen=True):
    """The last word on a goal.

    UNKNOWN: the controller does not know it (any more); with OTHER_LIFE, it may have begun before a restart.
    EXPIRED: it ran out of time, on the controller or on its way there.
    """

    key: int
    state: GoalState
    reason: int
    text: str


class GoalSilent(msgspec.Struct, frozen=True):
    """Nothing was heard of a goal for `patience`: it may move or not. It is still asked for.

    After a cancel its end is reported if the controller sends one; if it is given up, nothing is.
    """

    key: int
    acknowledged: bool
    """Whether the controller ever answered."""


GoalClientEffect = Send | GoalProgress | GoalEnded | GoalSilent


class _Pursuit(msgspec.Struct):
    goal: Goal
    deadline: float
    """[s] When its time to live is over; infinite: never."""
    heard: float
    asked: float
    """[s] The last time; -inf: it is to be asked about at once."""
    repeatable: bool = False
    acknowledged: bool = False
    silent: bool = False
    cancelled: bool = False
    sequence: int = -1
    again: bool = False
    """Whether an earlier process of ours may have asked for it: that it is not known is an answer at once."""
    refusal: GoalStatus | None = None
    """Because somebody else commands; a repetition of the goal that is on its way must not begin after it."""


class GoalClient:
    """All goals that we have sent to one controller.

    Args:
        system: the controller's.
        component: the controller's.
        via: the link to it; may be set anew when the link was.
        patience: the silence after which a goal counts as out of sight, [s].
    """

    def __init__(
        self,
        system: int,
        component: int,
        *,
        via: Hashable = None,
        patience: float = LONGEST_SILENCE,
    ) -> None:
        self.system, self.component, self.via = system, component, via
        self._patience = patience
        self.life = 0
        """Of the controller, as reported; 0: not reported."""
        self._pursuits: dict[int, _Pursuit] = {}
        self._met = True
        """Whether the controller has told on this link how it is, so that a restart would be known."""

    @property
    def pursued(self) -> list[int]:
        """Keys of the goals whose end was not heard yet."""
        return list(self._pursuits)

    @property
    def pursuing(self) -> bool:
        """Whether there is any goal whose end was not heard yet."""
        return bool(self._pursuits)

    def start(
        self,
        key: int,
        verb: int,
        args: Sequence[float],
        *,
        epoch: int,
        now: float,
        ttl: float = 0.0,
        repeatable: bool = False,
        life: int | None = None,
    ) -> list[GoalClientEffect]:
        """Ask for a movement. With a key that is being pursued, the same request is sent once more.

        Args:
            key: unique for us, 1 to 2^64 - 1.
            verb: what to do, a `Verb` or a number of your own.
            args: up to 7; the others are NaN, as it is now.
            epoch: of the lease.
            now: [s]
            ttl: time to live, [s]; 0: until reached.
            repeatable: carried out twice, it ends the same.
            life: of the controller, when an earlier process of ours may have asked for it; None: none has.
        """
        lives = ttl or inf
        target = (self.system, self.component)
        made_for = self.life if life is None else life
        goal = Goal(key, epoch, _milliseconds(lives), padded(args), verb, *target, life=made_for)
        self._pursuits[key] = _Pursuit(
            goal, now + lives, heard=now, asked=now, repeatable=repeatable, again=life is not None
        )
        return [Send(goal, self.via)]

    def cancel(self, key: int, *, epoch: int, now: float) -> list[GoalClientEffect]:
        """Ask for the end of a goal; repeated until the end is heard."""
        if (pursuit := self._pursuits.get(key)) is not None:
            pursuit.cancelled, pursuit.asked = True, now
            pursuit.goal = msgspec.structs.replace(pursuit.goal, epoch=epoch)
        return [Send(GoalCancel(key, epoch, self.system, self.component, self.life), self.via)]

    def restarted(self, life: int) -> list[GoalClientEffect]:
        """The controller has begun another life, of this number; 0: not reported."""
        self.life = life
        effects: list[GoalClientEffect] = []
        for key, pursuit in list(self._pursuits.items()):
            if pursuit.cancelled and not life:
                continue  # the goal itself may still be under way, and this controller would begin it
            if pursuit.repeatable and not (pursuit.acknowledged or pursuit.cancelled):
                pursuit.goal, pursuit.asked = msgspec.structs.replace(pursuit.goal, life=life), -inf
            else:
                self.forget(key)
                effects.append(GoalEnded(key, GoalState.UNKNOWN, Reason.OTHER_LIFE, ""))
        return effects

    def opened(self) -> None:
        """There is a new link. Ask about every goal at the next tick: the controller must hear who wants it.

        A goal that names no life and was not answered waits until the controller is met: if it has begun it,
        and has restarted meanwhile, it would begin it again.
        """
        self._met = False
        self._hurry()

    def meet(self) -> None:
        """The controller has told on this link how it is; a restart was reported before."""
        if not self._met:
            self._met = True
            self._hurry()

    def _hurry(self) -> None:
        for pursuit in self._pursuits.values():
            pursuit.asked = -inf

    def forget(self, key: int) -> None:
        """Ask no more about a goal."""
        self._pursuits.pop(key, None)

    def receive(self, status: GoalStatus, now: float) -> list[GoalClientEffect]:
        """Take a status that came from the controller and is addressed to us."""
        pursuit = self._pursuits.get(status.key)
        if pursuit is None:
            return []
        try:
            state = GoalState(status.state)
        except ValueError:
            return []
        if state == GoalState.UNKNOWN and _says_nothing(status, pursuit):
            return []
        if state == GoalState.REFUSED and status.reason == Reason.NOT_IN_CONTROL:
            return self._make_sure(status, pursuit, now)
        if state == GoalState.UNKNOWN and pursuit.refusal is not None:
            state, status = GoalState.REFUSED, pursuit.refusal
        elif state == GoalState.UNKNOWN and _overdue(pursuit, now):
            state = GoalState.EXPIRED
        pursuit.heard, pursuit.acknowledged, pursuit.silent = now, True, False
        if state.final or state == GoalState.UNKNOWN:
            del self._pursuits[status.key]
            return [GoalEnded(status.key, state, status.reason, status.text)]
        news = pursuit.sequence < 0 or 0 < (status.sequence - pursuit.sequence) & 0xFFFF < _HALF
        pursuit.sequence = status.sequence if news else pursuit.sequence
        return [GoalProgress(status.key, state, status.progress)] if news else []

    def _make_sure(self, refusal: GoalStatus, pursuit: _Pursuit, now: float) -> list[GoalClientEffect]:
        """The controller keeps no such refusal: call the goal off, so that none of its repetitions begins."""
        pursuit.heard, pursuit.silent, pursuit.refusal = now, False, refusal
        if pursuit.cancelled:
            return []
        return self.cancel(refusal.key, epoch=pursuit.goal.epoch, now=now)

    @property
    def due(self) -> float:
        """When to call `tick` next, [s]."""
        return min(map(self._due, self._pursuits.values())) if self._pursuits else inf

    def tick(self, now: float) -> list[GoalClientEffect]:
        """Repeat and ask what is due."""
        effects: list[GoalClientEffect] = []
        for key, pursuit in list(self._pursuits.items()):
            if not pursuit.silent and now >= pursuit.heard + self._patience:
                pursuit.silent = True
                effects.append(GoalSilent(key, pursuit.acknowledged))
            if pursuit.silent and pursuit.cancelled and now >= pursuit.deadline + LINGER:
                self.forget(key)
            else:
                effects += self._remind(pursuit, now)
        return effects

    def _remind(self, pursuit: _Pursuit, now: float) -> list[GoalClientEffect]:
        if _overdue(pursuit, now):
            pursuit.cancelled = True  # one that is still under way must not begin any more
        if now < self._reminder(pursuit):
            return []
        pursuit.asked = now
        goal = pursuit.goal
        if pursuit.cancelled:
            cancel = GoalCancel(goal.key, goal.epoch, self.system, self.component, goal.life)
            return [Send(cancel, self.via)]
        if pursuit.acknowledged or pursuit.silent:
            goal = msgspec.structs.replace(goal, verb=Verb.STATUS)
        elif not (self._met or goal.life or pursuit.repeatable):
            return []
        else:
            goal = msgspec.structs.replace(goal, ttl_ms=_milliseconds(pursuit.deadline - now))
        return [Send(goal, self.via)]

    def _due(self, pursuit: _Pursuit) -> float:
        due = self._reminder(pursuit)
        if not pursuit.silent:
            due = min(due, pursuit.heard + self._patience)
        elif pursuit.cancelled:
            due = min(due, pursuit.deadline + LINGER)
        return due if pursuit.acknowledged or pursuit.cancelled else min(due, pursuit.deadline)

    def _reminder(self, pursuit: _Pursuit) -> float:
        """When a goal is repeated, or asked about, [s]."""
        unanswered = pursuit.cancelled or not pursuit.acknowledged
        if unanswered:
            return pursuit.asked + (POLL if pursuit.silent else RESEND)
        return max(pursuit.asked, pursuit.heard) + POLL if pursuit.asked > -inf else -inf


def _says_nothing(unknown: GoalStatus, pursuit: _Pursuit) -> bool:
    """Whether it does not matter that the controller does not know a goal.

    After a restart its MODE reports the new life, and then the goal is decided. A goal that
    was never answered is still on its way: it is an answer to an older question.
    """
    if pursuit.again:
        return False
    if unknown.reason == Reason.OTHER_LIFE:
        return True
    return not (pursuit.acknowledged or pursuit.cancelled or pursuit.silent)


def _overdue(pursuit: _Pursuit, now: float) -> bool:
    """Whether the time to live was over before the controller answered."""
    return not pursuit.acknowledged and now >= pursuit.deadline


def _milliseconds(time_to_live: float) -> int:
    """A time to live as the wire has it; 0 is for ever there, so the shortest is 1."""
    return 0 if isinf(time_to_live) else max(1, round(time_to_live * 1000))
