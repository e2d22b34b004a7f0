"""A machine plays the wire, the clock and the restarts of a controller against those who claim it.

It loses, repeats, delays and reorders what is said; holders vanish and come back, a person has one take over.
"""

from __future__ import annotations

from typing import Any

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from robotree.protocol import Frame
from robotree.protocol.messages import Claim, ClaimStatus, ClaimWish
from robotree.protocol.services.claim_client import ClaimClient
from robotree.protocol.services.claim_server import RESERVED, ClaimChanged, ClaimServer, Holder
from robotree.protocol.services.fence import LAST_EPOCH, Fence
from robotree.protocol.services.peer import Peer, Send

NAMES = ("a", "b", "c")
names = st.sampled_from(NAMES)


class ClaimMachine(RuleBasedStateMachine):
    """Three programs with the same ids, two of them behind one link, and one controller."""

    def __init__(self) -> None:
        super().__init__()
        self.now, self.life, self.highest = 0.0, 1, 0
        self.kept = (0, 0, "")
        self.server = self._started()
        self.holders = 0
        self.names: dict[int, str] = {}
        self.clients: dict[str, ClaimClient] = {name: self._born(name) for name in NAMES}
        self.to_server: list[tuple[str, Claim]] = []
        self.to_client: list[tuple[str, ClaimStatus]] = []
        self.granted: dict[int, int] = {}
        """By epoch: the holder that got it."""

    def _started(self) -> ClaimServer:
        fence = Fence(*self.kept, keep=self._keep)
        return ClaimServer(fence, self.life, self.now)

    def _keep(self, fence: Fence) -> None:
        self.kept = fence.epoch, fence.holder, fence.name

    def _born(self, name: str, *, take_over: bool = False) -> ClaimClient:
        self.holders += 1
        self.names[self.holders] = name
        client = ClaimClient(1, 1, holder=self.holders, name=name, take_over=take_over)
        client.meet(self.life, self.kept[0])
        return client

    def _peer(self, name: str) -> Peer:
        return Peer("router" if name in {"a", "b"} else "own link", 255, 30)

    def _sent(self, name: str, effects: list[Any]) -> None:
        for effect in effects:
            if isinstance(effect, Send):
                message = Frame.of(effect.message).message
                assert isinstance(message, Claim)
                self.to_server.append((name, message))

    @rule(step=st.sampled_from([0.1, 0.3, 1.0, 2.5, 12.0]))
    def time_passes(self, step: float) -> None:
        self.now += step
        self.server.tick(self.now)
        for name, client in self.clients.items():
            self._sent(name, client.tick(self.now, 2.0, moving=True))

    @rule(data=st.data(), keep=st.booleans())
    @precondition(lambda self: bool(self.to_server))
    def deliver_a_claim(self, data: st.DataObject, *, keep: bool) -> None:
        i = data.draw(st.integers(0, len(self.to_server) - 1))
        self._hear(*(self.to_server[i] if keep else self.to_server.pop(i)))

    def _hear(self, name: str, claim: Claim) -> None:
        self.server.tick(self.now)
        before, epoch = self.server.holding, self.server.fence.epoch
        effects = self.server.receive(claim, self._peer(name), self.now)
        after = self.server.holding
        if before is not None and before.holder != claim.holder and claim.wish != ClaimWish.TAKE_OVER:
            assert after == before, "who is heard from is not moved by the claim of another one"
        if after is not None and after != before:
            assert (after.holder, after.peer) == (claim.holder, self._peer(name))
            assert self.granted.setdefault(self.server.fence.epoch, after.holder) == after.holder
        assert self.server.fence.epoch >= epoch
        for effect in effects:
            if isinstance(effect, Send):
                status = Frame.of(effect.message).message
                assert isinstance(status, ClaimStatus)
                self.to_client.append((name, status))
            elif isinstance(effect, ClaimChanged):
                assert effect.before != effect.after

    @rule(data=st.data(), keep=st.booleans())
    @precondition(lambda self: bool(self.to_client))
    def deliver_an_answer(self, data: st.DataObject, *, keep: bool) -> None:
        i = data.draw(st.integers(0, len(self.to_client) - 1))
        name, status = self.to_client[i] if keep else self.to_client.pop(i)
        self.clients[name].receive(status, for_us=True)

    @rule()
    def all_hear_who_holds_it(self) -> None:
        for client in self.clients.values():
            client.meet(self.life, self.kept[0])
            client.receive(self.server.status(), for_us=False)

    @rule()
    def lose_everything_under_way(self) -> None:
        self.to_server.clear()
        self.to_client.clear()

    @rule(name=names, lease=st.integers(1, 2000) | st.sampled_from([2**31, LAST_EPOCH, 2**32 - 1]))
    def a_lease_begins(self, name: str, lease: int) -> None:
        self.clients[name].raise_to(lease)

    @rule(name=names)
    def a_link_ends(self, name: str) -> None:
        self.server.link_closed(self._peer(name).via, self.now)
        self.clients[name].opened()

    @rule(name=names, take_over=st.booleans())
    def a_program_dies_and_is_started_again(self, name: str, *, take_over: bool) -> None:
        self.clients[name] = self._born(name, take_over=take_over)

    @rule(name=names)
    def a_program_ends_in_order_and_is_started_again(self, name: str) -> None:
        client = self.clients[name]
        self._sent(name, client.release())
        assert client.tick(self.now + 60, 2.0, moving=True) == [], "who has given it up asks for it no more"
        self.clients[name] = self._born(name)

    @rule()
    def the_controller_restarts(self) -> None:
        self.life += 1
        self.server = self._started()
        held = self.server.holding
        assert (held.holder if held else 0) == self.kept[1], "its last holder is waited for"
        assert held is None or (held.peer, held.until) == (None, self.now + RESERVED)

    @invariant()
    def the_epoch_never_falls_and_leaves_room(self) -> None:
        assert self.highest <= self.server.fence.epoch <= LAST_EPOCH
        self.highest = self.server.fence.epoch

    @invariant()
    def one_peer_may_and_its_voice_is_the_holders(self) -> None:
        held = self.server.holding
        for name in NAMES:
            peer = self._peer(name)
            may = self.server.guard(peer) is None
            assert may == (held is None or held.peer == peer)
            voice = self.server.voice(peer)
            assert voice == (Holder(held.holder) if held is not None and held.peer == peer else peer)

    def teardown(self) -> None:
        """Let the wire heal: one of them holds the controller, knows it, and the others know who it is."""
        self.to_server.clear()
        self.to_client.clear()
        for _ in range(60):
            self.now += 0.3
            self.server.tick(self.now)
            for name, client in self.clients.items():
                client.meet(self.life, self.kept[0])
                client.receive(self.server.status(), for_us=False)
                self._sent(name, client.tick(self.now, 2.0, moving=True))
            sent, self.to_server = self.to_server, []
            for name, claim in sent:
                self._hear(name, claim)
            answers, self.to_client = self.to_client, []
            for name, status in answers:
                self.clients[name].receive(status, for_us=True)
        granted = [name for name, client in self.clients.items() if client.granted]
        if self.server.fence.epoch == LAST_EPOCH and not granted:
            return  # nothing is left above it: a person has to reset it
        assert len(granted) == 1
        (holder,) = granted
        assert self.server.holding is not None
        assert self.server.holding.holder == self.clients[holder].holder
        others = [client for name, client in self.clients.items() if name != holder]
        assert all(client.denied is not None and client.denied.name == holder for client in others)


ClaimMachine.TestCase.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)
TestClaims = ClaimMachine.TestCase
