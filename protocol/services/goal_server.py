"""Goals, the controller's side: one movement for each key, whatever the wire repeats, delays or reorders.

A goal is known by its sender and key. The same key with the same content is answered with the stored status;
with other content it is refused. A goal from an epoch older than the highest obeyed one is refused (fencing).
A goal that is not reached within its time to live ends as EXPIRED. Epoch, life and addresses do not belong to
the content: a sender may ask for its goal again under a newer lease.

A goal names the life of the controller that it was made for. After a restart its key is unknown, and it may
have begun before: it is answered with UNKNOWN and OTHER_LIFE, and does not begin.

Stops and questions are accepted from all senders. Only senders that `guard` admits may begin a goal, raise
the epoch, or become the receiver of a goal's status.

The server decides; the firmware moves. The server returns `Begin` and `Abandon`; the firmware calls
`activate`, `progress` and `finish`. Every call returns what to do next.
"""

from __future__ import annotations

from math import inf, isinf
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.messages import Goal, GoalCancel, GoalState, GoalStatus, Reason, Verb
from robotree.protocol.services.fence import Fence, Refusal
from robotree.protocol.services.peer import Peer, Send

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable

CAPACITY = 256
"""Goals whose status is kept; the oldest finished one makes room."""
FORGOTTEN = 4096
"""Keys that are still known as used after their status was dropped; the sender with most loses first."""
PROGRESS_PERIOD = 0.1
"""[s] between two statuses that tell nothing but progress."""
LONGEST_TEXT = 80
OTHER_LIFE = "This controller has restarted since; it may have begun before."


class GoalId(msgspec.Struct, frozen=True):
    """Names a goal on this controller. Its sender may come back on another link."""

    system: int
    component: int
    key: int


class Begin(msgspec.Struct, frozen=True):
    """Please move: a new goal was accepted."""

    id: GoalId
    verb: int
    args: tuple[float, ...]


class Abandon(msgspec.Struct, frozen=True):
    """Please hold: this goal has ended without being reached."""

    id: GoalId
    reason: Reason


GoalServerEffect = Send | Begin | Abandon
_Speaker = tuple[int, int]
"""System and component."""


class _Record(msgspec.Struct):
    peer: Peer
    content: bytes
    deadline: float
    """[s] When its time to live is over; infinite: never."""
    state: GoalState = GoalState.ACCEPTED
    reason: Reason = Reason.NONE
    text: str = ""
    progress: float = 0.0
    sequence: int = 0
    told: float = float("-inf")
    """[s] The last status that was sent unasked."""


def misfit(verb: int, args: Iterable[float], verbs: Collection[Verb]) -> Refusal | None:
    """Why no robot of these verbs can do that, whatever it looks like; None: it may be that it can."""
    if verb not in verbs:
        known = ", ".join(sorted(each.name for each in verbs))
        return Reason.UNKNOWN_VERB, f"Verb {verb} is unknown here; known are {known}."
    if any(map(isinf, args)):
        return Reason.BAD_ARGUMENT, "An argument is infinite."
    return None


class GoalServer:
    """All goals of one controller.

    Args:
        verbs: the verbs that this controller knows.
        check: why a goal cannot be begun now; None: it can.
        guard: why a peer may not command; None: it may. Who may not has no goal begun (its key stays
            unused), raises no epoch, and does not become the one who is told of a goal.
        fence: the epochs that it obeys.
        life: of this controller; goals made for another one are not begun. 0: whatever they are made for.
    """

    def __init__(
        self,
        verbs: Collection[Verb],
        check: Callable[[Goal], Refusal | None],
        guard: Callable[[Peer], Refusal | None] = lambda _: None,
        *,
        fence: Fence | None = None,
        life: int = 0,
    ) -> None:
        self._verbs, self._check, self._guard = frozenset(verbs), check, guard
        self._fence, self._life = fence or Fence(), life
        self._records: dict[GoalId, _Record] = {}
        self._forgotten: dict[_Speaker, dict[GoalId, None]] = {}

    @property
    def epoch(self) -> int:
        """The highest epoch obeyed."""
        return self._fence.epoch

    @property
    def unfinished(self) -> list[GoalId]:
        """The goals that are accepted or active, oldest first."""
        return [id_ for id_, record in self._records.items() if not record.state.final]

    def asker(self, id_: GoalId) -> Peer:
        """The peer that asked last for a kept goal (for itself, its status or its end) and may command.

        It is told of the goal.

        Raises:
            KeyError: its status is not kept (any more).
        """
        return self._records[id_].peer

    def fence(self, epoch: int) -> bool:
        """Obey an epoch from now on; False: it is older than one already obeyed, or not honest."""
        return self._fence.admit(epoch) is None

    def receive(self, message: Goal | GoalCancel, peer: Peer, now: float) -> list[GoalServerEffect]:
        """Take a message that is addressed to this controller."""
        id_ = GoalId(peer.system, peer.component, message.key)
        denial = self._guard(peer)
        may = denial is None
        if isinstance(message, GoalCancel):
            cancel = self._cancel if message.key else self._cancel_whichever
            return cancel(message, id_, peer, now, may=may)
        known = id_ in self._records or self._is_forgotten(id_)
        if not known and self._is_of_another_life(message):
            return [self._refusal(id_, peer, Reason.OTHER_LIFE, OTHER_LIFE, GoalState.UNKNOWN)]
        if message.verb == Verb.STATUS:
            return self._answer(id_, peer, may=may)
        if (record := self._records.get(id_)) is None:
            return self._new(message, id_, peer, denial, now)
        if record.content != _content(message):
            text = "The key was used before with other content; take a new one."
            return [self._refusal(id_, peer, Reason.KEY_REUSED, text)]
        if may and message.epoch > self.epoch:
            self.fence(message.epoch)
        return self._answer(id_, peer, may=may)

    def activate(self, id_: GoalId, now: float) -> list[GoalServerEffect]:
        """The movement has begun."""
        record = self._open(id_)
        if record is None or record.state == GoalState.ACTIVE:
            return []
        record.state = GoalState.ACTIVE
        return [self._changed(id_, record, now)]

    def progress(self, id_: GoalId, fraction: float, now: float) -> list[GoalServerEffect]:
        """Progress, 0 to 1. Sent at most every `PROGRESS_PERIOD`."""
        if (record := self._open(id_)) is None:
            return []
        record.progress = min(max(0.0, fraction), 1.0)
        return [self._changed(id_, record, now)] if now - record.told >= PROGRESS_PERIOD else []

    def finish(
        self, id_: GoalId, state: GoalState, now: float, reason: Reason = Reason.NONE, text: str = ""
    ) -> list[GoalServerEffect]:
        """The movement has ended. Ignored when the goal has ended before.

        Raises:
            ValueError: the state is not a final one.
        """
        if not state.final:
            raise ValueError(f"{state.name} does not end a goal; finish it with a final state")
        if (record := self._open(id_)) is None:
            return []
        record.state, record.reason, record.text, record.deadline = state, reason, text, inf
        record.progress = 1.0 if state == GoalState.SUCCEEDED else record.progress
        return [self._changed(id_, record, now)]

    def abandon_all(self, reason: Reason, now: float, text: str = "") -> list[GoalServerEffect]:
        """End every unfinished goal, because of a stop, a hold or silence."""
        state = GoalState.CANCELLED
        return [effect for id_ in self.unfinished for effect in self._abandon(id_, state, reason, text, now)]

    def tick(self, now: float) -> list[GoalServerEffect]:
        """End the goals whose time to live is over."""
        late = [id_ for id_, record in self._records.items() if now >= record.deadline]
        text = "Its time to live was over before it was reached."
        return [
            effect for id_ in late for effect in self._abandon(id_, GoalState.EXPIRED, Reason.NONE, text, now)
        ]

    def _new(
        self, goal: Goal, id_: GoalId, peer: Peer, denial: Refusal | None, now: float
    ) -> list[GoalServerEffect]:
        if self._is_forgotten(id_):
            return [self._unknown(id_, peer)]
        if (denial := self._denial(goal, denial)) is not None:
            return [self._refusal(id_, peer, *denial)]
        if not self._make_room():
            return [
                self._refusal(id_, peer, Reason.FAULT, f"{CAPACITY} goals are unfinished; end one first.")
            ]
        deadline = now + goal.ttl_ms / 1000 if goal.ttl_ms else inf
        record = self._records[id_] = _Record(peer, _content(goal), deadline)
        if (refusal := self._objection(goal)) is not None:
            return self.finish(id_, GoalState.REFUSED, now, *refusal)
        return [self._changed(id_, record, now), Begin(id_, goal.verb, goal.args)]

    def _denial(self, goal: Goal, denial: Refusal | None) -> Refusal | None:
        """Why nothing is even noted of a goal; `denial`: what the guard says."""
        if not goal.key:
            return Reason.BAD_ARGUMENT, "The key of a goal must not be 0."
        if denial is not None:
            return denial
        return self._fence.admit(goal.epoch)

    def _objection(self, goal: Goal) -> Refusal | None:
        return misfit(goal.verb, goal.args, self._verbs) or self._check(goal)

    def _cancel_whichever(
        self, cancel: GoalCancel, id_: GoalId, peer: Peer, now: float, *, may: bool
    ) -> list[GoalServerEffect]:
        if self._is_of_another_life(cancel):
            return [self._refusal(id_, peer, Reason.OTHER_LIFE, OTHER_LIFE)]
        refusal = self._fence.admit(cancel.epoch) if may else self._fence.objection(cancel.epoch)
        if refusal is not None:
            return [self._refusal(id_, peer, *refusal)]
        return self.abandon_all(Reason.OPERATOR, now)

    def _is_of_another_life(self, message: Goal | GoalCancel) -> bool:
        return bool(self._life) and message.life not in {0, self._life}

    def _cancel(
        self, cancel: GoalCancel, id_: GoalId, peer: Peer, now: float, *, may: bool
    ) -> list[GoalServerEffect]:
        if id_ not in self._records and not self._is_forgotten(id_):
            self._forget(id_)  # the goal itself may still be under way: it must not begin
        if id_ not in self._records and self._is_of_another_life(cancel):
            return [self._refusal(id_, peer, Reason.OTHER_LIFE, OTHER_LIFE, GoalState.UNKNOWN)]
        record = self._open(id_)
        if record is None:
            return self._answer(id_, peer, may=may)
        record.peer = peer if may else record.peer
        effects = self._abandon(id_, GoalState.CANCELLED, Reason.OPERATOR, "", now)
        return effects if record.peer == peer else [*effects, self._status(id_, record, peer)]

    def _abandon(
        self, id_: GoalId, state: GoalState, reason: Reason, text: str, now: float
    ) -> list[GoalServerEffect]:
        return [Abandon(id_, reason), *self.finish(id_, state, now, reason, text)]

    def _open(self, id_: GoalId) -> _Record | None:
        record = self._records.get(id_)
        return None if record is None or record.state.final else record

    def _make_room(self) -> bool:
        if len(self._records) < CAPACITY:
            return True
        oldest = next((id_ for id_, record in self._records.items() if record.state.final), None)
        if oldest is None:
            return False
        del self._records[oldest]
        self._forget(oldest)
        return True

    def _forget(self, id_: GoalId) -> None:
        """Keep a key alone; no flood of one speaker's makes the few of another forgotten."""
        self._forgotten.setdefault((id_.system, id_.component), {})[id_] = None
        if sum(map(len, self._forgotten.values())) > FORGOTTEN:
            speaker, keys = max(self._forgotten.items(), key=lambda each: len(each[1]))
            del keys[next(iter(keys))]
            if not keys:
                del self._forgotten[speaker]

    def _is_forgotten(self, id_: GoalId) -> bool:
        return id_ in self._forgotten.get((id_.system, id_.component), ())

    def _answer(self, id_: GoalId, peer: Peer, *, may: bool) -> list[GoalServerEffect]:
        if (record := self._records.get(id_)) is None:
            return [self._unknown(id_, peer)]
        record.peer = peer if may else record.peer
        return [self._status(id_, record, peer)]

    def _changed(self, id_: GoalId, record: _Record, now: float) -> Send:
        record.sequence = record.sequence + 1 & 0xFFFF
        record.told = now
        return self._status(id_, record, record.peer)

    def _status(self, id_: GoalId, record: _Record, peer: Peer) -> Send:
        return self._send(
            peer, id_, record.state, record.reason, record.text, record.progress, record.sequence
        )

    def _unknown(self, id_: GoalId, peer: Peer) -> Send:
        return self._refusal(id_, peer, Reason.NONE, "", GoalState.UNKNOWN)

    def _refusal(
        self, id_: GoalId, peer: Peer, reason: Reason, text: str, state: GoalState = GoalState.REFUSED
    ) -> Send:
        return self._send(peer, id_, state, reason, text, 0.0, 0)

    def _send(
        self,
        peer: Peer,
        id_: GoalId,
        state: GoalState,
        reason: Reason,
        text: str,
        progress: float,
        sequence: int,
    ) -> Send:
        status = GoalStatus(
            key=id_.key,
            epoch=self.epoch,
            progress=progress,
            sequence=sequence,
            reason=reason,
            target_system=id_.system,
            target_component=id_.component,
            state=state,
            text=text.encode()[:LONGEST_TEXT].decode(errors="ignore"),
        )
        return Send(status, peer.via)


def _content(goal: Goal) -> bytes:
    """The bytes in which two equal goals agree; NaN equals NaN here.

    The time to live is not among it: who asks again, later, has less of the same time left.
    """
    asked = msgspec.structs.replace(
        goal, key=0, epoch=0, ttl_ms=0, target_system=0, target_component=0, life=0
    )
    return Goal.codec.content(asked)
