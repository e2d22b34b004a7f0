"""A machine plays the wire, the clock and the firmware against a client and a server of goals.

It loses, repeats, delays and reorders whatever it likes, and restarts link and controller; the laws hold all
the same.
"""

from __future__ import annotations

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from robotree.protocol import Frame
from robotree.protocol.messages import Goal, GoalCancel, GoalState, GoalStatus, Message, Reason, Verb
from robotree.protocol.services.fence import Fence, Refusal
from robotree.protocol.services.goal_client import GoalClient, GoalClientEffect, GoalEnded
from robotree.protocol.services.goal_server import Abandon, Begin, GoalId, GoalServer, GoalServerEffect
from robotree.protocol.services.peer import Peer, Send

SENDERS = (255, 254)
KEYS = (1, 2, 3)
goals = st.tuples(st.sampled_from(SENDERS), st.sampled_from(KEYS))
finals = st.sampled_from([GoalState.SUCCEEDED, GoalState.FAILED])


class GoalMachine(RuleBasedStateMachine):
    """Two clients, one controller, and everything that may lie between them."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 0.0
        self.owner: int | None = None
        self.life, self.fence = 1, Fence()
        self.server = self._server_of_this_life()
        self.clients = {sender: GoalClient(1, 1, via="wire") for sender in SENDERS}
        for client in self.clients.values():
            client.life = self.life
        self.asked = 0
        self.asking: dict[tuple[int, int], tuple[int, bool]] = {}
        """By sender and key: the number of the asking, and whether it may be repeated."""
        self.lives_named: dict[int, set[int]] = {}
        self.epochs = dict.fromkeys(SENDERS, 1)
        self.to_server: list[tuple[int, Message]] = []
        self.to_client: list[tuple[int, Message]] = []
        self.begun: dict[GoalId, Goal] = {}
        self.highest = 0
        self.called_off: set[GoalId] = set()
        self.moving: set[GoalId] = set()
        self.told: dict[GoalId, list[GoalState]] = {}
        self.ended: dict[tuple[int, int], list[GoalState]] = {}

    @initialize(epochs=st.tuples(st.integers(1, 3), st.integers(1, 3)))
    def leases(self, epochs: tuple[int, int]) -> None:
        self.epochs = dict(zip(SENDERS, epochs, strict=True))

    def _server_of_this_life(self) -> GoalServer:
        return GoalServer([Verb.GO_TO], lambda _: None, self._guard, fence=self.fence, life=self.life)

    def _guard(self, peer: Peer) -> Refusal | None:
        return None if self.owner in {None, peer.system} else (Reason.NOT_IN_CONTROL, "Another one is.")

    def _client(self, sender: int, effects: list[GoalClientEffect]) -> None:
        for effect in effects:
            if isinstance(effect, Send):
                message = Frame.of(effect.message, system=sender).message
                assert isinstance(message, Message)
                self.to_server.append((sender, message))
                if isinstance(message, Goal) and message.verb != Verb.STATUS:
                    self._judge_the_life(sender, message)
            elif isinstance(effect, GoalEnded):
                self.ended.setdefault((sender, effect.key), []).append(effect.state)

    def _judge_the_life(self, sender: int, goal: Goal) -> None:
        number, repeatable = self.asking[sender, goal.key]
        lives = self.lives_named.setdefault(number, set())
        lives.add(goal.life)
        assert repeatable or len(lives) == 1, "what adds up is asked of one life of the controller only"

    def _server(self, effects: list[GoalServerEffect]) -> None:
        for effect in effects:
            if isinstance(effect, Begin):
                assert effect.id not in self.moving
                self.moving.add(effect.id)
            elif isinstance(effect, Abandon):
                assert effect.id in self.moving, "only what moves is abandoned"
                self.moving.discard(effect.id)
            else:
                status = Frame.of(effect.message).message
                assert isinstance(status, GoalStatus)
                self.to_client.append((status.target_system, status))
                if status.sequence:
                    id_ = GoalId(status.target_system, status.target_component, status.key)
                    self.told.setdefault(id_, []).append(GoalState(status.state))

    @rule(
        goal=goals,
        ttl=st.sampled_from([0.0, 0.5, 3.0]),
        x=st.sampled_from([0.1, 0.2]),
        repeatable=st.booleans(),
    )
    def ask(self, goal: tuple[int, int], ttl: float, x: float, *, repeatable: bool) -> None:
        sender, key = goal
        self.asked += 1
        self.asking[sender, key] = self.asked, repeatable
        effects = self.clients[sender].start(
            key,
            Verb.GO_TO,
            (x,),
            epoch=self.epochs[sender],
            now=self.now,
            ttl=ttl,
            repeatable=repeatable,
        )
        self._client(sender, effects)

    @rule()
    def the_controller_restarts(self) -> None:
        self.life += 1
        self.server = self._server_of_this_life()
        for forgotten in (self.begun, self.called_off, self.moving, self.told):
            forgotten.clear()
        self.to_client.clear()

    @rule(sender=st.sampled_from(SENDERS))
    def a_client_hears_the_mode(self, sender: int) -> None:
        client = self.clients[sender]
        if client.life != self.life:
            self._client(sender, client.restarted(self.life))

    @rule(goal=goals)
    def cancel(self, goal: tuple[int, int]) -> None:
        sender, key = goal
        self._client(sender, self.clients[sender].cancel(key, epoch=self.epochs[sender], now=self.now))

    @rule(sender=st.sampled_from(SENDERS))
    def cancel_whichever(self, sender: int) -> None:
        self._client(sender, self.clients[sender].cancel(0, epoch=self.epochs[sender], now=self.now))

    @rule(sender=st.sampled_from(SENDERS))
    def a_newer_lease(self, sender: int) -> None:
        self.epochs[sender] = max(self.epochs.values()) + 1

    @rule(owner=st.sampled_from([None, *SENDERS]))
    def operator_control(self, owner: int | None) -> None:
        self.owner = owner

    @rule(data=st.data(), keep=st.booleans())
    @precondition(lambda self: bool(self.to_server))
    def deliver_to_the_server(self, data: st.DataObject, *, keep: bool) -> None:
        i = data.draw(st.integers(0, len(self.to_server) - 1))
        sender, message = self.to_server[i] if keep else self.to_server.pop(i)
        self._hear(sender, message)

    def _hear(self, sender: int, message: Message) -> None:
        """Hand a message to the server and hold what it does against the laws."""
        assert isinstance(message, Goal | GoalCancel)
        unfinished, epoch = set(self.server.unfinished), self.server.epoch
        id_ = GoalId(sender, 1, message.key)
        effects = self.server.receive(message, Peer("wire", sender, 1), self.now)
        begins = any(isinstance(each, Begin) for each in effects)
        if self.owner not in {None, sender}:
            assert not begins, "who is not in control begins nothing"
            assert self.server.epoch == epoch, "and fences nobody"
        if isinstance(message, GoalCancel):
            self.called_off.add(id_)
            assert not begins
            assert id_ not in self.server.unfinished
        else:
            assert unfinished <= set(self.server.unfinished), "a goal ends no other"
            if begins:
                self._judge_the_beginning(id_, message)
            elif id_ in self.begun and message.verb != Verb.STATUS:
                self._judge_the_repetition(self.begun[id_], message, effects)
        self.highest = max(self.highest, self.server.epoch)
        self._server(effects)

    def _judge_the_beginning(self, id_: GoalId, goal: Goal) -> None:
        assert goal.verb != Verb.STATUS, "a question begins nothing"
        assert id_ not in self.begun, "no goal begins twice"
        assert id_ not in self.called_off, "nor one that was called off before it came"
        assert goal.epoch >= self.highest, "nor one whose epoch is over"
        assert goal.life == self.life, "nor one that was made for another life"
        self.begun[id_] = goal
        self.highest = goal.epoch

    def _judge_the_repetition(self, first: Goal, again: Goal, effects: list[GoalServerEffect]) -> None:
        (send,) = effects
        assert isinstance(send, Send)
        assert isinstance(send.message, GoalStatus)
        same = repr(first.args) == repr(again.args)  # who asks again has less of the same time left
        assert (send.message.reason == Reason.KEY_REUSED) != same

    @rule(data=st.data(), keep=st.booleans())
    @precondition(lambda self: bool(self.to_client))
    def deliver_to_a_client(self, data: st.DataObject, *, keep: bool) -> None:
        i = data.draw(st.integers(0, len(self.to_client) - 1))
        sender, message = self.to_client[i] if keep else self.to_client.pop(i)
        assert isinstance(message, GoalStatus)
        self._client(sender, self.clients[sender].receive(message, self.now))

    @rule()
    def lose_everything_under_way(self) -> None:
        self.to_server.clear()
        self.to_client.clear()

    @rule(step=st.sampled_from([0.05, 0.3, 1.1, 5.0]))
    def time_passes(self, step: float) -> None:
        self.now += step
        self._server(self.server.tick(self.now))
        for sender, client in self.clients.items():
            self._client(sender, client.tick(self.now))

    @rule(data=st.data(), state=finals, fraction=st.floats(0, 1))
    @precondition(lambda self: bool(self.moving))
    def the_firmware_works(self, data: st.DataObject, state: GoalState, fraction: float) -> None:
        id_ = data.draw(st.sampled_from(sorted(self.moving, key=lambda each: (each.system, each.key))))
        self._server(self.server.activate(id_, self.now))
        self._server(self.server.progress(id_, fraction, self.now))
        if data.draw(st.booleans()):
            self.moving.discard(id_)
            self._server(self.server.finish(id_, state, self.now))

    @rule(goal=goals, state=finals)
    def the_firmware_speaks_of_what_is_over(self, goal: tuple[int, int], state: GoalState) -> None:
        id_ = GoalId(goal[0], 1, goal[1])
        if id_ not in self.moving:
            assert self.server.finish(id_, state, self.now) == []

    @rule()
    def a_safe_stop(self) -> None:
        self._server(self.server.abandon_all(Reason.STOPPED, self.now))

    @invariant()
    def the_epoch_never_falls(self) -> None:
        assert self.server.epoch >= self.highest

    @invariant()
    def what_moves_is_what_the_server_calls_unfinished(self) -> None:
        assert self.moving == set(self.server.unfinished)

    @invariant()
    def a_life_only_goes_forward_and_ends_once(self) -> None:
        for states in self.told.values():
            ends = {state for state in states if state.final}
            assert len(ends) <= 1
            if ends:
                first = next(i for i, state in enumerate(states) if state.final)
                assert all(state.final for state in states[first:]), "nothing follows the end but its replay"

    def teardown(self) -> None:
        """Let the wire heal: every goal that is still pursued is heard the end of."""
        for sender in SENDERS:
            self.a_client_hears_the_mode(sender)
        for _ in range(60):
            self.now += 0.5
            for sender, client in self.clients.items():
                self._client(sender, client.tick(self.now))
            for id_ in list(self.moving):
                self.moving.discard(id_)
                self._server(self.server.finish(id_, GoalState.SUCCEEDED, self.now))
            sent, self.to_server = self.to_server, []
            for sender, message in sent:
                self._hear(sender, message)
            answers, self.to_client = self.to_client, []
            for sender, message in answers:
                assert isinstance(message, GoalStatus)
                self._client(sender, self.clients[sender].receive(message, self.now))
        assert not any(client.pursued for client in self.clients.values()), "every pursuit ends"


GoalMachine.TestCase.settings = settings(max_examples=80, stateful_step_count=40, deadline=None)
TestGoals = GoalMachine.TestCase
