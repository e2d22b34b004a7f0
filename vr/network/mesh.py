"""One process among all others of its realm on one machine: presence, requests and samples.

Every process has two Unix stream sockets to every other one, urgent and bulk, and threads that read them all
(`readers.py`). There is no server. The kernel names the user of the far end (SO_PEERCRED), and closes its
connections when its process dies. A process that is stopped or hangs keeps its connections, but its beat in
the realm's folder stops: after `HANGS` seconds it is *silent*, and present again as soon as it goes on.

Every `TICK` seconds one of the threads compares with the folder: it registers again if its own name is
missing, and dials those that it does not know. So what broke works again after one tick, even a removed
folder.

Callbacks are called in the thread that reads, or in the one that made the change, one at a time, and must
only hand on what they are given. `local.py` hands it to an event loop.
"""

from __future__ import annotations

import contextlib
import errno
import itertools
import logging
import math
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, KeysView, Sequence
from concurrent.futures import Future
from functools import partial
from typing import Any, Final

from robotree.vr.base.errors import RealmUnusable, TooManyKeys
from robotree.vr.base.os_files import BOTH_WAYS, ENDED, WRITABLE, OSFiles
from robotree.vr.base.pattern import Handlers, matches
from robotree.vr.base.places import here_of
from robotree.vr.base.presence import Held, Presence
from robotree.vr.base.principal import Credentials
from robotree.vr.base.system import THIS_SYSTEM, Socket, System
from robotree.vr.base.transport import ELSEWHERE, End, Occupied, OnReply, Respond
from robotree.vr.network.door import Door
from robotree.vr.network.link import (
    LONGEST_KEY,
    MOST_KEYS,
    VERSION,
    AskFrame,
    Awake,
    Channel,
    EndFrame,
    Greedy,
    Hello,
    Impostor,
    LinkFrame,
    News,
    NotAFrame,
    Overflow,
    PeerLink,
    ReplyFrame,
    Sample,
    Topic,
    pack,
)
from robotree.vr.network.readers import Readers, Sockets, What
from robotree.vr.network.realms import TAG, asleep, process_of, remedy
from robotree.vr.network.refusals import Refusals
from robotree.vr.network.rendezvous import Beat, Rendezvous

TICK: Final = 0.25
"""[s] between two beats, and between two looks into the folder."""

LATE: Final = 0.7
"""[s] without a beat after which a process is shown as late: it has missed two, and nothing else follows."""

STEADY: Final = 1.0
"""[s] for which a process must beat in time again before it is late no longer: so it does not flicker."""

RECENT: Final = 1.0
"""[s] within which a sign of life is recent: who gave one does not hang."""

SLEPT: Final = 1.5
"""[s] between two ticks of its own after which a process knows that it has slept itself."""

HANGS: Final = 2.0
"""[s] without a beat after which a process counts as silent; 1 s is too little on a busy machine."""

GREETING: Final = 0.3
"""[s] that a new process waits at most for the greeting of processes that hang."""

DIAL_WITHIN: Final = 0.1
"""[s] that a new process waits for each place in the line of those that want to connect to another one."""

LOST: Final = 4
"""Ticks in a row in which a process is found by nobody, after which it knows that nobody can reach it."""

FLUSH: Final = 0.5
"""[s] for which a process that leaves tries to send what waits."""

REMEMBERED: Final = 4096
"""Keys for which it is remembered who wants their samples."""

REPLACE: Final = "process {} runs another version of robotree; start it again with this one"
"""The remedy for a process that is not understood."""

MOST_MEMBERS: Final = 64
"""Members of a realm that one process may be."""

LIAR: Final = "process {} says that it is another one, or speaks for the robots of others; end it"
"""The remedy for a process that is not believed."""

GREEDY: Final = "process {} announces too many keys; end it, and start its robots in several hosts"
"""The remedy for a process that announces more than `MOST_KEYS`."""

LOST_FILES: Final = (
    "its files in the realm's folder are gone or damaged, so that nobody who comes now knows its robots"
)
"""Why it is not known which robots a running process holds."""

TakeFrame = Callable[[bytes, Credentials, bool, Respond, End], None]
"""Takes a request: its body, the process that has sent it, whether it is urgent, how to reply (any number of
times), and how to end the replies, with one more or with None."""
OnSample = Callable[[str, bytes], None]

_log = logging.getLogger(__name__)


class _Exchange:
    """A request that another process has yet to answer."""

    __slots__ = ("ask", "on_reply", "urgent", "void_at")

    def __init__(self, ask: AskFrame, on_reply: OnReply, void_at: float, *, urgent: bool) -> None:
        self.ask, self.on_reply, self.urgent = ask, on_reply, urgent
        self.void_at = void_at
        """[s] until when the other process may begin with it if it hangs and wakes; 0: it has answered."""


class _Peer:
    """Another process."""

    def __init__(self, tag: str, now: float) -> None:
        self.tag = tag
        self.links: dict[Channel, PeerLink] = {}
        self.refused: list[PeerLink] = []
        """Connections that it has dialed and is going to close, one a channel: see `_settle_who_dialed`."""
        self.greeted: set[Channel] = set()
        """The channels on which its greeting has come."""
        self.known: dict[Topic, set[str]] = {topic: set() for topic in Topic}
        self.ranks: dict[str, int] = {}
        """Of the keys that it serves, where that is not 0."""
        self.beat: Beat | None = None
        self.since = self.last_sign = now
        """[s] Since when it is known, and the last sign of life."""
        self.user = -1
        """Number of its user."""
        self.awake = False
        """Whether its greeting has come and it does not hang: only then it is present."""
        self.late_until = 0.0
        """[s] until when it counts as late."""
        self.exchanges: dict[int, _Exchange] = {}
        """Requests that it has yet to answer."""

    @property
    def met(self) -> bool:
        """Whether both sides know who the other is, on both channels."""
        return len(self.greeted) == len(Channel)


class _Outside:
    """Processes that are not met, and refusals.

    It is apart because CPython finds the attributes of an object with more than 30 of them more slowly.
    """

    def __init__(self, system: System) -> None:
        self.strangers: dict[str, str] = {}
        """Processes in the folder that are refused, and what a person can do about each."""
        self.undialed: dict[str, float] = {}
        """Processes in the folder to which no connection could be made yet, and since when [s]."""
        self.announced = Counter[int]()
        """How many keys each other process announces."""
        self.refusals = Refusals(_log, system=system)
        self.lost_ticks = 0
        """For how many ticks no other process could reach this one."""


class Mesh:
    """See the module. `open` it, then use it from any thread, then `close` it."""

    def __init__(self, place: Rendezvous) -> None:
        """Prepare to enter at this place."""
        self.place = place
        self._system = system = place.system
        self.closed = False
        self._entering = False
        self._lock = system.rlock()
        self._peers: dict[str, _Peer] = {}
        self._known: dict[Topic, Counter[str]] = {topic: Counter() for topic in Topic}
        """The announcements of this process to the others."""
        self._servers: dict[str, TakeFrame] = {}
        self._ranks: dict[str, int] = {}
        """Of the keys that this process serves, where that is not 0."""
        self._subscribers = Handlers[OnSample]()
        self._watchers_of_itself: dict[int, Callable[[str], None]] = {}
        self._cut_off = False
        """Whether no other process can reach this one."""
        self.presence = Presence(held=self.held, unheard=self.unheard, late=self.late, lock=system.rlock())
        self._where: dict[str, _Peer] = {}
        """The other process that serves a key."""
        self._listeners: dict[str, list[_Peer]] = {}
        """The other processes that want the samples of a key, as far as somebody asked."""
        self._outside = _Outside(system)
        self._numbers = itertools.count(1)
        self._to_settle: list[Callable[[], None]] = []
        self._settling = False
        self._sockets = Sockets(system)
        self._door: Door | None = None
        with system.opening:
            self._nudge, self._nudged = system.socketpair()
            system.owns(self)
        self._to_flush: deque[PeerLink] = deque()
        self._readers = Readers(
            self._sockets,
            serve=self._serve_socket,
            tick=self._take_time,
            period=TICK,
            system=system,
            wake=self._wake,
            release=self._release,
        )
        self.after_reading = self._readers.after_reading
        self._complete = system.event()
        self._takers: dict[type[LinkFrame], Callable[[PeerLink, Any], None]] = {
            Hello: self._take_greeting,
            News: self._take_news,
            AskFrame: self._take_request,
            ReplyFrame: self._take_reply,
            EndFrame: self._take_end,
            Sample: self._take_sample,
            Awake: self._take_awake,
        }
        self._ended_all: Future[None] = Future()
        self._ticked = 0.0
        """[s] When the last tick was."""
        self.sees: Callable[[int, str, bytes], bool] | None = None
        """Whether a user may have a sample; None: nobody else is in the realm."""

    # -- coming and leaving

    def open(self, greeting: float = GREETING) -> None:
        """Enter; returns when the greetings of all others have come, or after a time limit.

        Args:
            greeting: [s] to wait at most for those that show no sign of life; 0: wait for nobody. One that
                does is only busy, and is waited for longer: who saw nobody there would say so.

        It may be closed meanwhile by another thread; then it is left again.

        Raises:
            RealmUnusable: the realm's folder cannot be used.
        """
        with self._lock:
            if self.closed:
                return
            self._entering = True
        try:
            self._enter()
        except BaseException:
            with self._lock:
                self._entering = False
            if self.closed:
                self._release()
            raise
        self._readers.start()
        if self.closed:
            self.place.leave()
        self._check_complete()
        self._await_greetings(greeting)

    def _await_greetings(self, patience: float) -> None:
        """Wait for the greetings of all others; `HANGS` at most, for those with a sign of life."""
        latest = self._system.now() + HANGS
        while not self._complete.wait(patience) and patience and self._system.now() < latest:
            with self._lock:
                unmet = [*self._outside.undialed, *(tag for tag, peer in self._peers.items() if not peer.met)]
            if not any(self._beats(tag) for tag in unmet):
                return

    def _beats(self, tag: str) -> bool:
        """Whether a process that has sent no greeting yet is only busy: its last sign of life is new."""
        return not asleep(process_of(tag), self._system) and self._system.now() - self._sign_of(tag) < RECENT

    def _sign_of(self, tag: str) -> float:
        """Return the last sign of life of a process [s, CLOCK_MONOTONIC]; long ago if it has none."""
        beat = self.place.beat_of(tag)
        if beat is None:
            return 0.0
        try:
            return beat.read()
        finally:
            beat.close()

    def _enter(self) -> None:
        for end in (self._nudge, self._nudged):
            end.setblocking(False)
        self._sockets.add(self._nudged, self._take_nudges)
        self._ticked = self._system.now()
        self._readers.due = self._ticked + TICK
        self._register()
        self._dial_all(DIAL_WITHIN)

    def in_child(self) -> Iterable[int]:
        """See `forks.Owner`: a child is nobody here, and leaves what is its parent's."""
        self.closed, self._lock = True, self._system.rlock()
        self.place.forsake()
        return [self._nudge.fileno(), self._nudged.fileno(), *self._sockets.descriptors()]

    def close(self) -> Future[None]:
        """Leave: others see it at once. Twice is once.

        Returns:
            Done when all is closed.
        """
        with self._lock:
            first, self.closed = not self.closed, True
            opened = self._entering
        if first:
            self.place.leave()
            if not opened:
                self._release()
            self._readers.close()
        return self._ended_all

    # -- what others can ask and see

    def serve(self, key: str, answer: TakeFrame, *, rank: int = 0) -> None:
        """Take the requests to a key; `rank` as in `Transport.serve`.

        Raises:
            ValueError: this process serves it already.
            TooManyKeys: it announces as many keys as others take.
        """
        with self._lock:
            if key in self._servers:
                raise ValueError(f"{key} is served already")
            self._check_room(Topic.SERVES, key)
            self._servers[key] = answer
            if rank:
                self._ranks[key] = rank
            self._announce_change(Topic.SERVES, key, there=True)

    def end_serving(self, key: str) -> None:
        """Take no more requests to a key."""
        with self._lock:
            if self._servers.pop(key, None) is not None:
                self._ranks.pop(key, None)
                self._announce_change(Topic.SERVES, key, there=False)

    def announce(self, key: str, *, unless: Sequence[str] = ()) -> None:
        """Be present under a key; as often as `withdraw` is called later.

        Raises:
            Occupied: somebody else of this machine is present under one of the patterns `unless`.
            TooManyKeys: this process announces as many keys as others take.
        """
        with self._lock:
            self._check_room(Topic.HOLDS, key)
        self.place.hold(key)  # first: a process that cannot be seen must be known of
        with self._lock:
            found = (other for pattern in unless for other in self.presence.keys(pattern))
            others = [other for other in found if other != key]
            others = others and here_of(self.presence, others)
            if not others:
                self._announce_change(Topic.HOLDS, key, there=True)
                return
        self.place.drop(key)
        raise Occupied(others)

    def withdraw(self, key: str) -> None:
        """Be present under a key no longer."""
        with self._lock:
            self._announce_change(Topic.HOLDS, key, there=False)
        self.place.drop(key)

    def settle(self, on_settled: Callable[[], None]) -> None:
        """Call back once all others that are awake know what was announced here, and theirs is known here.

        Announcements and urgent requests share one connection, which keeps their order. So a process that has
        answered an urgent request, here to no key, knows what was announced here, and what it announced
        without knowing that has come before its answer. Many that come together share their requests.
        """
        with self._lock:
            self._to_settle.append(on_settled)
            if self._settling:
                return
            self._settling = True
        self._settle_all()

    def _settle_all(self) -> None:
        """Ask all others once for those that wait now; those that come meanwhile wait for the next round."""
        with self._lock:
            waiting, self._to_settle = self._to_settle, []
            self._settling = bool(waiting)
            peers = [peer for peer in self._peers.values() if peer.awake] if waiting else []
        left = itertools.count(len(peers), -1)  # its next is atomic

        def on_reply(reply: bytes | None) -> None:
            if reply is None and next(left) == 0:
                for on_settled in waiting:
                    on_settled()
                self._settle_all()

        if waiting:
            for peer in peers:
                self._ask_peer(peer, "", b"", void_at=0.0, urgent=True, on_reply=on_reply)
            on_reply(None)  # of this process

    def subscribe(self, pattern: str, on_sample: OnSample) -> int:
        """Take the samples under a pattern; returns a number for `unsubscribe`.

        Raises:
            TooManyKeys: this process announces as many keys as others take.
        """
        with self._lock:
            self._check_room(Topic.SUBSCRIBES, pattern)
            number = next(self._numbers)
            self._subscribers.add(number, pattern, on_sample)
            self._announce_change(Topic.SUBSCRIBES, pattern, there=True)
            return number

    def unsubscribe(self, number: int) -> None:
        """Take them no longer."""
        with self._lock:
            if (pattern := self._subscribers.remove(number)) is not None:
                self._announce_change(Topic.SUBSCRIBES, pattern, there=False)

    def held_elsewhere(self, keys: Collection[str]) -> set[str]:
        """Return those of these keys under which another process is present and awake."""
        with self._lock:
            held = [peer.known[Topic.HOLDS] for peer in self._peers.values() if peer.awake]
            few = keys if isinstance(keys, KeysView) else set(keys)
            return {key for one in held for key in (one & few if len(one) < len(few) else few & one)}

    def rank_elsewhere(self, key: str) -> int:
        """Return the highest rank by which another process serves a key; 0: none does."""
        with self._lock:
            return max((_rank(peer, key) for peer in self._peers.values() if peer.awake), default=0)

    def wanted(self) -> set[str]:
        """Return the patterns to which the other processes subscribe."""
        with self._lock:
            return {pattern for peer in self._peers.values() for pattern in peer.known[Topic.SUBSCRIBES]}

    # -- what one can ask and see

    def watch_itself(self, on_cut_off: Callable[[str], None]) -> int:
        """Learn why no other process can reach this one any more, and "" when one can; see `unwatch`."""
        with self._lock:
            number = next(self._numbers)
            self._watchers_of_itself[number] = on_cut_off
            return number

    def unwatch(self, number: int) -> None:
        """Learn of that no longer."""
        with self._lock:
            self._watchers_of_itself.pop(number, None)

    def unheard(self, pattern: str) -> list[tuple[Held, bool]]:
        """Return what is held by processes without a sign of life, and if it is certain that they hang."""
        now = self._system.now()
        with self._lock:
            doubts = {tag: self._certain(peer, now) for tag, peer in self._peers.items()}
            doubts |= dict.fromkeys(self._outside.strangers, True)
            doubts |= {tag: self._unmet_for(tag, since, now) for tag, since in self._outside.undialed.items()}
            return [
                (one, certain)
                for tag, certain in sorted(doubts.items())
                if certain is not None
                for one in self._held_by(tag, pattern)
                if one.key
            ]

    def late(self, pattern: str) -> list[Held]:
        """Return what is held under a pattern by processes that beat late, whether they hang or not.

        A process becomes late when its last beat is older than `LATE`, and is late no longer when none was
        older for `STEADY`. While this process has not ticked for so long itself, it judges nobody anew.
        """
        now = self._system.now()
        with self._lock:
            if now - self._ticked < LATE:
                for peer in self._peers.values():
                    if peer.beat is None:
                        peer.beat = self.place.beat_of(peer.tag)
                    if now - max(peer.last_sign, peer.beat.read() if peer.beat else 0.0) > LATE:
                        peer.late_until = now + STEADY
            late = [tag for tag, peer in self._peers.items() if peer.met and now < peer.late_until]
            return [one for tag in sorted(late) for one in self._held_by(tag, pattern) if one.key]

    def _certain(self, peer: _Peer, now: float) -> bool | None:
        """Return if it is certain that a process hangs; None: it is heard, or has ended. Under the lock.

        Who comes, wakes or ends shows it within `HANGS`. One that is stopped and shows no sign does not.
        """
        if peer.awake:
            heard = peer.beat is None or now - max(peer.last_sign, peer.beat.read()) < RECENT
            return None if heard else asleep(process_of(peer.tag), self._system)
        return self._unmet_for(peer.tag, now if peer.met else peer.since, now)

    def _unmet_for(self, tag: str, since: float, now: float) -> bool | None:
        """As `_certain`, of a process that is not present here; tried to meet it `since` [s]."""
        process = process_of(tag)
        if not self._system.lives(process):
            return None  # it has just ended, and holds nothing any more
        return now - since > HANGS or now - self._sign_of(tag) > HANGS or asleep(process, self._system)

    def held(self, pattern: str) -> list[Held]:
        """Return what is held present by all processes that live, this one included; see `Presence.held`.

        Each process is looked at once, and what it holds is known, or it is returned without a key: whatever
        becomes of its files meanwhile, none is left out. One whose name has just come into the folder is met
        at once, without a wait for the next tick.
        """
        with self._lock:
            own = [key for key in self._known[Topic.HOLDS] if matches(pattern, key)]
            living = self.place.living()
            unknown = living - self._peers.keys() - self._outside.strangers.keys()
            peers = {
                tag for tag, one in self._peers.items() if one.awake or self._system.lives(process_of(tag))
            }
            others = sorted(living | peers)  # of one that hung and has just ended nothing is left
            found = held_by(self._system.pid(), own, self._system)
            found += [one for tag in others for one in self._held_by(tag, pattern)]
        if unknown:
            self._readers.due = 0.0
            self._wake()
        return found

    def _held_by(self, tag: str, pattern: str) -> list[Held]:
        """Return what another process holds; without a key: nobody here knows what. Under the lock."""
        process, peer = process_of(tag), self._peers.get(tag)
        said = peer.known[Topic.HOLDS] if peer is not None and peer.met else None
        written = self.place.keys_of(tag)  # also what it was about to say
        if said is None and written is None:
            advice = remedy(process, f"`kill {process}` ends it", self._system)
            return [Held("", f"process {process}", advice, LOST_FILES, asleep(process, self._system))]
        keys = [key for key in (said or set()).union(written or ()) if matches(pattern, key)]
        if tag not in self._outside.strangers:
            return held_by(process, keys, self._system)
        advice = self._outside.strangers[tag]
        return [Held(key, f"process {process}", advice, "which is not understood") for key in sorted(keys)]

    def ask(self, key: str, body: bytes, *, void_at: float = 0.0, urgent: bool, on_reply: OnReply) -> None:
        """Ask the process that serves a key.

        Args:
            key: as served; a pattern, with `void_at` infinite, for the processes of which nobody can read
                what they serve.
            body: the request.
            void_at: [s, CLOCK_MONOTONIC] after which the other process does not begin with it any more: if it
                hangs it is waited for until then. Infinite: it is not waited for, and reads it when it wakes.
            urgent: ahead of everything else.
            on_reply: takes the replies, and None at the end: at once if nobody serves the key, and when the
                process that does dies or hangs.
        """
        with self._lock:
            peer = None if self.closed else self._where.get(key)
        if peer is not None:
            waits = 0.0 if void_at == math.inf else void_at
            self._ask_peer(peer, key, body, void_at=waits, urgent=urgent, on_reply=on_reply)
            return
        if void_at == math.inf:
            self._leave(key, body)
        on_reply(None)

    def _leave(self, key: str, body: bytes) -> None:
        """Leave a request in the socket of a process that hangs, or has not sent its greeting yet.

        It stays there if this process ends first: so a process that missed a stop stops when it wakes.
        """
        packed = pack(AskFrame(next(self._numbers), key, body))
        with self._lock:
            asleep = [peer for peer in self._peers.values() if not peer.awake]
            links = [peer.links.get(Channel.URGENT) for peer in asleep if self._may_serve(peer, key)]
        for link in links:
            if link is not None:  # a newcomer may have said hello on the other channel only
                with contextlib.suppress(Overflow):
                    link.send(packed)

    def _may_serve(self, peer: _Peer, key: str) -> bool:
        """Whether a process has announced a key, or else has it in its file, or nobody can read that."""
        keys = peer.known[Topic.SERVES] if peer.met else self.place.keys_of(peer.tag)
        return keys is None or key in keys

    def _ask_peer(
        self, peer: _Peer, key: str, body: bytes, *, void_at: float, urgent: bool, on_reply: OnReply
    ) -> None:
        number = next(self._numbers)
        asked = AskFrame(number, key, body)
        packed = pack(asked)
        with self._lock:
            lives = self._peers.get(peer.tag) is peer
            if lives:
                peer.exchanges[number] = _Exchange(asked, on_reply, void_at, urgent=urgent)
        if not lives:
            on_reply(None)
            return
        try:
            peer.links[Channel.URGENT if urgent else Channel.BULK].send(packed)
        except Overflow:
            self._end_exchange(peer, number)

    def publish(self, key: str, body: bytes) -> None:
        """Tell all who want the samples of a key; one that is too slow misses older ones."""
        with self._lock:
            peers, own = self._listening(key), self._subscribers.of(key)
        if self.sees is not None:
            peers = [peer for peer in peers if self.sees(peer.user, key, body)]
        if peers:
            packed = pack(Sample(key, body))
            for peer in peers:
                peer.links[Channel.BULK].publish(key, packed)
        for hear in own:
            hear(key, body)

    def listeners(self, key: str) -> int:
        """Return how many processes want the samples of a key, this one included."""
        with self._lock:
            return len(self._listening(key)) + bool(self._subscribers.of(key))

    def _listening(self, key: str) -> list[_Peer]:
        """Return the other processes that want the samples of a key. Under the lock."""
        peers = self._listeners.get(key)
        if peers is None:
            if len(self._listeners) >= REMEMBERED:
                self._listeners.clear()
            peers = self._listeners[key] = [
                peer
                for peer in self._peers.values()
                if peer.awake and any(matches(pattern, key) for pattern in peer.known[Topic.SUBSCRIBES])
            ]
        return peers

    # -- meeting

    def _register(self) -> None:
        if not self.place.listed:
            return
        with self._system.opening:
            listening = self.place.register()
            if self._door is not None:
                self._door.accept_all()
                self._door.close()
            self._door = Door(
                listening,
                self._sockets,
                wrap=partial(PeerLink, wants_to_write=self._later, system=self._system),
                close=self._ended,
                refusals=self._outside.refusals,
                admits=None if self.place.shared is None else self.place.admits,
                system=self._system,
            )

    def _dial_all(self, patience: float = 0.0) -> None:
        """Dial those in the folder that this process does not know.

        Args:
            patience: [s] to wait for each of them in which too many others wait already.
        """
        now = self._system.now()
        others = self.place.others()
        with self._lock:
            for tag in self._outside.undialed.keys() - (set(others) - self._peers.keys()):
                del self._outside.undialed[tag]
        for tag in self._outside.strangers.keys() - set(others):
            del self._outside.strangers[tag]
        for tag in others:
            if tag in self._peers or tag in self._outside.strangers:
                continue
            with self._lock, self._system.opening:
                self._dial(tag, now, patience)

    def _dial(self, tag: str, now: float, patience: float) -> None:
        """Connect to another process, if it can be. Under the lock."""
        lines: list[Socket] = []
        try:
            for _ in Channel:
                lines.append(self.place.dial(tag, patience))  # noqa: PERF401 # the first one is to be closed
        except OSError as error:
            for line in lines:
                line.close()
            if error.errno in {errno.EMFILE, errno.ENFILE} and not self.place.listed:
                reason = f"{error.strerror}".lower()
                raise RealmUnusable(realm=self.place.realm, reason=reason) from None
            if isinstance(error, ConnectionRefusedError):
                self.place.forget(tag)  # it listened before it could be seen, so it is dead
                self._outside.undialed.pop(tag, None)
            else:
                self._outside.undialed.setdefault(tag, now)
            return
        links = [
            PeerLink(line, channel=channel, member=tag, wants_to_write=self._later, system=self._system)
            for channel, line in zip(Channel, lines, strict=True)
        ]
        if not all(self.place.leads_to(line, tag) for line in lines):
            for link in links:
                link.close()
            far = links[0].far_end
            text = f"process {far.process} of user {far.user} listens as if it were process {process_of(tag)}"
            self._outside.refusals.note("identity", f"{text}; it is not connected to")
            return
        self._outside.undialed.pop(tag, None)
        peer = self._peers[tag] = _Peer(tag, now)
        for link in links:
            self._add_link(peer, link)

    def _add_link(self, peer: _Peer, link: PeerLink) -> None:
        """Send the greeting: which process this is, and all that it announces. Under the lock."""
        if link.channel is None:
            return
        peer.links[link.channel], peer.user = link, link.far_end.user
        if link.dialed:
            self._sockets.add(link.socket, link)
        urgent = link.channel is Channel.URGENT
        known = {topic: list(keys.elements()) for topic, keys in self._known.items()} if urgent else {}
        ranks = self._ranks if urgent else {}
        link.send(pack(Hello(VERSION, self.place.tag, link.channel, known, ranks)))

    def _take_greeting(self, link: PeerLink, hello: Hello) -> None:
        """The greeting of a process has come."""
        with self._lock:
            self._identify(link, hello)
            if not link.dialed:
                link.channel = hello.channel
                if (peer := self._settle_who_dialed(link)) is None:
                    return
                self._add_link(peer, link)
            peer = self._peers.get(link.member)
            if peer is None or peer.links.get(hello.channel) is not link:
                return
            peer.greeted.add(hello.channel)
            if hello.channel is Channel.URGENT:
                known = {topic: set(hello.known.get(topic, ())) for topic in Topic}
                self._check_greed(peer, sum(len(known[topic]) - len(peer.known[topic]) for topic in Topic))
                for topic, said in known.items():
                    for key in peer.known[topic] - said:
                        self._learn(peer, News(topic, key, there=False))
                    for key in said:
                        self._learn(peer, News(topic, key, there=True, rank=hello.ranks.get(key, 0)))
            if peer.met:
                self._show(peer)
            self._check_complete()

    def _identify(self, link: PeerLink, hello: Hello) -> None:
        """Check that a process is the one that it says it is, and speaks as this one does. Under the lock.

        Raises:
            NotAFrame: it is another one, or of another version, or says it a second time.
        """
        process = link.far_end.process
        named = process_of(hello.member) if TAG.fullmatch(hello.member) else 0
        if named != process or link.member not in {"", hello.member}:
            raise Impostor(f"it says that it is {hello.member!r}")
        if link.introduced:
            raise NotAFrame("it says a second time who it is")
        link.member = hello.member
        if hello.version != VERSION:
            raise NotAFrame(f"version {hello.version} of the frames; this process has {VERSION}")
        members = {tag for tag in self._peers if process_of(tag) == process}
        if len(members | {hello.member}) > MOST_MEMBERS:
            raise NotAFrame(f"it is in the realm more than {MOST_MEMBERS} times")
        link.introduce()
        if self._door is not None:
            self._door.introduced(link)

    def _check_greed(self, peer: _Peer, more: int) -> None:
        """Check that a process announces no more keys than are taken of one. Under the lock.

        Raises:
            Greedy: it would, with so many `more`.
        """
        if self._outside.announced[process_of(peer.tag)] + more > MOST_KEYS:
            raise Greedy(f"it announces more than {MOST_KEYS} keys")

    def _check_owner(self, user: int, topic: Topic, key: str) -> None:
        """Check that an agent which a process announces, or of which it publishes, is of its user.

        Raises:
            Impostor: it is another user's.
        """
        shared = self.place.shared
        if shared is not None and topic is not Topic.SUBSCRIBES and not shared.may_announce(user, key):
            raise Impostor(f"it speaks for {key}, and user {user} has no such agent")

    def _settle_who_dialed(self, link: PeerLink) -> _Peer | None:
        """Return the process that has dialed; None: this one has dialed it, too, and that counts.

        Of two that have dialed each other the one with the smaller tag keeps its own. It does not close
        those of the other: closed before its own greeting is read there, they would look like its end.
        """
        peer = self._peers.get(link.member)
        mine = peer.links.get(link.channel) if peer is not None and link.channel is not None else None
        if peer is not None and mine is not None:
            if mine.dialed and self.place.tag < link.member:
                link.refused = True
                for before in [one for one in peer.refused if one.channel is link.channel]:
                    peer.refused.remove(before)
                    self._close_link(before)
                peer.refused.append(link)
                return None
            if not mine.dialed:  # it has lost this connection, and comes again
                self._lose(peer)
                peer = None
            else:
                self._close_link(mine)
                peer.greeted.discard(mine.channel)
        if peer is None:
            peer = self._peers[link.member] = _Peer(link.member, self._system.now())
            self._outside.undialed.pop(link.member, None)
        return peer

    def _check_complete(self) -> None:
        with self._lock:
            if not self._outside.undialed and all(peer.met for peer in self._peers.values()):
                self._complete.set()

    # -- who is there

    def _show(self, peer: _Peer) -> None:
        """A process is there and awake. Under the lock."""
        peer.last_sign = self._system.now()
        if not peer.awake:
            peer.awake = True
            self._listeners.clear()
            for key in peer.known[Topic.SERVES]:
                other = self._where.get(key)  # what another one serves meanwhile is that one's
                if other is None or _rank(peer, key) > _rank(other, key):
                    self._where[key] = peer
            for key in sorted(peer.known[Topic.HOLDS]):
                self.presence.count(key, there=True)

    def _hide(self, peer: _Peer) -> None:
        """A process has died or hangs: what was asked of it ends. Under the lock.

        What it may still begin with when it wakes ends later: see `_give_up`.
        """
        if peer.awake:
            peer.awake = False
            self._listeners.clear()
            for key in [key for key, server in self._where.items() if server is peer]:
                self._find_server(key)
            for key in sorted(peer.known[Topic.HOLDS]):
                self.presence.count(key, there=False)
        self._give_up(peer, self._system.now())

    def _give_up(self, peer: _Peer, now: float) -> None:
        """End what was asked of a process that has died or hangs, if it cannot begin with it any more.

        This is the one place that knows of a process that hangs. For one that beats and does not answer each
        request says itself how long it waits.
        """
        for number, exchange in list(peer.exchanges.items()):
            if peer.tag not in self._peers or exchange.void_at <= now:
                self._end_exchange(peer, number)
            else:
                self._readers.due = min(self._readers.due, exchange.void_at)

    def _lose(self, peer: _Peer) -> None:
        """A connection to a process has ended, and with it all. Under the lock."""
        self._peers.pop(peer.tag, None)
        for link in (*peer.links.values(), *peer.refused):
            self._close_link(link)
        self._count_keys(peer, -sum(map(len, peer.known.values())))
        if peer.beat is not None:
            peer.beat.close()
            peer.beat = None
        self._hide(peer)
        self._check_complete()

    def _learn(self, peer: _Peer, news: News) -> None:
        """Note what a process lets others know. Under the lock."""
        keys = peer.known[news.topic]
        if (news.key in keys) == news.there:
            return
        if news.there:
            self._check_owner(peer.user, news.topic, news.key)
            self._check_greed(peer, 1)
        self._note_rank(peer, news)
        (keys.add if news.there else keys.discard)(news.key)
        self._count_keys(peer, 1 if news.there else -1)
        if news.topic is Topic.SUBSCRIBES:
            self._listeners.clear()
        elif not peer.awake:
            pass
        elif news.topic is Topic.HOLDS:
            self.presence.count(news.key, there=news.there, left=not news.there)
        elif news.there:
            other = self._where.get(news.key)
            if other is None or _rank(peer, news.key) >= _rank(other, news.key):
                self._where[news.key] = peer
        elif self._where.get(news.key) is peer:
            self._find_server(news.key)

    @staticmethod
    def _note_rank(peer: _Peer, news: News) -> None:
        if news.topic is Topic.SERVES:
            peer.ranks.pop(news.key, None)
            if news.rank and news.there:
                peer.ranks[news.key] = news.rank

    def _find_server(self, key: str) -> None:
        """Ask another process for a key from now on, if one serves it. Under the lock."""
        self._where.pop(key, None)
        for peer in self._peers.values():
            if peer.awake and key in peer.known[Topic.SERVES]:
                other = self._where.get(key)
                if other is None or _rank(peer, key) >= _rank(other, key):
                    self._where[key] = peer

    def _count_keys(self, peer: _Peer, more: int) -> None:
        """Count how many keys a process announces. Under the lock."""
        process = process_of(peer.tag)
        self._outside.announced[process] += more
        if not self._outside.announced[process]:
            del self._outside.announced[process]

    def _check_room(self, topic: Topic, key: str) -> None:
        """Check that the others take one more key of this process. Under the lock.

        Raises:
            TooManyKeys: they do not, for it announces too many.
            RealmUnusable: they do not, for it names nobody's agent, or another user's.
        """
        if len(key.encode()) > LONGEST_KEY or (
            key not in self._known[topic] and sum(map(len, self._known.values())) >= MOST_KEYS
        ):
            raise TooManyKeys(key=key, most=MOST_KEYS, longest=LONGEST_KEY)
        try:
            self._check_owner(self._system.user(), topic, key)
        except Impostor:  # the others would throw this process out
            reason = f"{key} is of a time when nobody shared it; delete the robot, and make it anew"
            raise RealmUnusable(realm=self.place.realm, reason=reason) from None

    def _announce_change(self, topic: Topic, key: str, *, there: bool) -> None:
        """Change what this process announces, and send the change to the others. Under the lock."""
        keys = self._known[topic]
        before = keys[key]
        keys[key] += 1 if there else -1
        if keys[key] <= 0:
            del keys[key]
        if bool(before) == (key in keys):
            return
        self._say_to_all(News(topic, key, there, self._ranks.get(key, 0) if topic is Topic.SERVES else 0))
        if topic is Topic.HOLDS:
            self.presence.count(key, there=there, left=not there)

    # -- what has come

    def _serve_socket(self, what: What, events: int) -> bool:
        """Do what a socket is ready for; returns whether more may have come."""
        if not isinstance(what, PeerLink):
            what()
            return False
        if events & WRITABLE:
            self._flush(what)
        if not events & ~WRITABLE:
            return False
        return self._read(what, ended=bool(events & ENDED))

    def _take_nudges(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while self._nudged.recv(4096):
                pass
        while self._to_flush:
            self._flush(self._to_flush.popleft())

    def _take_time(self) -> None:
        try:
            self._tick(self._system.now())
        except (OSError, RealmUnusable) as error:
            _log.warning("realm %s: %s", self.place.realm, error)

    def _read(self, link: PeerLink, *, ended: bool) -> bool:
        """Read once; returns whether more may have come: of a far end that has `ended`, at least its end."""
        if link.closed:
            return False
        try:
            for frame in link.receive():
                self._take(link, frame)
                if link.closed:
                    return False
        except BlockingIOError:
            return False
        except EOFError:
            self._ended(link)
        except NotAFrame as error:
            self._refuse(link, error)
        else:
            if not link.introduced and self._door is not None:
                self._door.came(link)
        return not link.closed and (link.full or ended)

    def _refuse(self, link: PeerLink, why: NotAFrame) -> None:
        """Disconnect from a process that is not understood, or not believed, or announces too much."""
        process = link.far_end.process
        self._outside.refusals.note(why.kind, f"process {process} is refused: {why}")
        if link.member:
            liar = LIAR if isinstance(why, Impostor) else REPLACE
            advice = GREEDY if isinstance(why, Greedy) else liar
            self._outside.strangers[link.member] = advice.format(process)
        self._ended(link)

    def _ended(self, link: PeerLink) -> None:
        """The far end has closed. Its earlier messages on the other channel still count."""
        with self._lock:
            peer = self._peers.get(link.member)
            if peer is None or link.channel is None or peer.links.get(link.channel) is not link:
                self._close_link(link)
                return
            others = [other for other in peer.links.values() if other is not link and not other.closed]
        for other in others:
            with contextlib.suppress(BlockingIOError, EOFError, NotAFrame):
                while not other.closed:
                    for frame in other.receive():
                        self._take(other, frame)
        with self._lock:
            if self._peers.get(link.member) is peer:
                self._lose(peer)

    def _take(self, link: PeerLink, frame: LinkFrame) -> None:
        if not (link.introduced or isinstance(frame, Hello)):
            raise NotAFrame("it did not say who it is")
        if link.refused:  # it says all of it again on the connection that stays
            return
        self._takers[type(frame)](link, frame)

    def _take_reply(self, link: PeerLink, reply: ReplyFrame) -> None:
        peer = self._peers.get(link.member)
        if peer is not None and (exchange := peer.exchanges.get(reply.number)) is not None:
            exchange.void_at = 0.0
            exchange.on_reply(reply.body)

    def _take_end(self, link: PeerLink, end: EndFrame) -> None:
        if (peer := self._peers.get(link.member)) is None:
            return
        if end.elsewhere:
            self._ask_elsewhere(peer, end.number)
        else:
            self._end_exchange(peer, end.number, end.last)

    def _ask_elsewhere(self, peer: _Peer, number: int) -> None:
        """Ask who serves a key now that another process serves no longer; nobody may."""
        exchange = peer.exchanges.pop(number, None)
        if exchange is None:
            return
        ask, urgent, on_reply = exchange.ask, exchange.urgent, exchange.on_reply
        with self._lock:
            own, other = self._servers.get(ask.key), self._where.get(ask.key)
        if own is not None:

            def end(last: bytes | None) -> None:
                if last is not None and last is not ELSEWHERE:
                    on_reply(last)
                on_reply(None)

            me = Credentials(self._system.pid(), self._system.user())
            own(ask.body, me, urgent, on_reply, end)
        elif other is not None and other is not peer:
            void_at = exchange.void_at
            self._ask_peer(other, ask.key, ask.body, void_at=void_at, urgent=urgent, on_reply=on_reply)
        else:
            on_reply(None)

    def _take_sample(self, link: PeerLink, sample: Sample) -> None:
        if self.place.shared is not None:
            self._check_owner(link.far_end.user, Topic.HOLDS, sample.key)
        with self._lock:
            hearers = self._subscribers.of(sample.key)
        for hear in hearers:
            hear(sample.key, sample.body)

    def _take_news(self, link: PeerLink, news: News) -> None:
        with self._lock:
            if (peer := self._peers.get(link.member)) is not None:
                self._learn(peer, news)

    def _take_awake(self, link: PeerLink, _: Awake) -> None:
        with self._lock:
            if (peer := self._peers.get(link.member)) is not None and peer.met:
                self._show(peer)

    def _take_request(self, link: PeerLink, ask: AskFrame) -> None:
        if "*" in ask.key:  # of somebody who cannot read what is served here, and waits for no answer
            with self._lock:
                meant = [key for key in self._servers if matches(ask.key, key)]
            for key in meant:
                self._take_request(link, AskFrame(ask.number, key, ask.body))
            return
        answer = self._servers.get(ask.key)
        number = ask.number

        def respond(body: bytes) -> None:
            self._say(link, pack(ReplyFrame(number, body)))

        def end(last: bytes | None) -> None:
            elsewhere = last is ELSEWHERE
            self._say(link, pack(EndFrame(number, None if elsewhere else last, elsewhere)))

        if answer is None:  # another process may serve it: it has left this one in the meantime
            end(ELSEWHERE)
        else:
            try:
                answer(ask.body, link.far_end, link.channel is Channel.URGENT, respond, end)
            except Exception:  # noqa: BLE001 # the asker must not wait for an answer that never comes
                _log.exception("the handler of %s raised", ask.key)
                end(None)

    def _say_to_all(self, frame: LinkFrame) -> None:
        packed = pack(frame)
        for peer in list(self._peers.values()):
            if (link := peer.links.get(Channel.URGENT)) is not None:
                self._say(link, packed)

    def _say(self, link: PeerLink, packed: bytes) -> None:
        """Send what must not be lost; if it would be, disconnect: all is sent again on the next link."""
        try:
            link.send(packed)
        except Overflow:
            process = link.far_end.process
            self._outside.refusals.note(
                "deaf", f"process {process} does not read what is sent to it; it is disconnected"
            )
            with contextlib.suppress(OSError):
                link.socket.shutdown(BOTH_WAYS)

    def _end_exchange(self, peer: _Peer, number: int, last: bytes | None = None) -> None:
        if (exchange := peer.exchanges.pop(number, None)) is not None:
            if last is not None:
                exchange.on_reply(last)
            exchange.on_reply(None)

    def _tick(self, now: float) -> None:
        """Give a sign of life, judge the others' signs, and mend what is broken."""
        slept, self._ticked = now - self._ticked > SLEPT, now
        self.place.beat(now)
        if slept:  # nobody else is to blame
            self._say_to_all(Awake())
        else:
            for peer in list(self._peers.values()):
                self._judge(peer, now)
        trouble = ""
        if not self.place.registered():
            try:
                self._register()
            except RealmUnusable as error:
                trouble = str(error)
        self._dial_all()
        if self._door is not None:
            self._door.tick()
        self._outside.refusals.write()
        self._judge_itself(trouble)

    def _judge_itself(self, trouble: str) -> None:
        """Check whether any other process can reach this one, and report each change.

        Args:
            trouble: why nobody who comes now can find this process; empty: it can be found.
        """
        with self._lock:
            alone = not any(peer.awake for peer in self._peers.values())
            watchers = list(self._watchers_of_itself.values())
        self._outside.lost_ticks = self._outside.lost_ticks + 1 if trouble and alone else 0
        cut_off = self._outside.lost_ticks >= LOST
        if cut_off == self._cut_off:
            return
        self._cut_off = cut_off
        if cut_off:
            _log.warning("no other process can reach this one: %s", trouble)
        for watcher in watchers:
            watcher(f"no other process can reach it: {trouble}" if cut_off else "")

    def _judge(self, peer: _Peer, now: float) -> None:
        with self._lock:
            if self._peers.get(peer.tag) is not peer:
                return
            if peer.beat is not None:
                peer.last_sign = max(peer.last_sign, peer.beat.read())
            if now - peer.last_sign > RECENT:  # it may have made its file anew
                if peer.beat is not None:
                    peer.beat.close()
                peer.beat = self.place.beat_of(peer.tag)
                if peer.beat is not None:
                    peer.last_sign = max(peer.last_sign, peer.beat.read())
            if now - peer.last_sign > HANGS:
                self._hide(peer)
            elif peer.met and not peer.awake and now - peer.last_sign < RECENT:
                self._show(peer)

    # -- sockets

    def _later(self, link: PeerLink) -> None:
        """Something waits on a link: have the thread send it on."""
        self._to_flush.append(link)
        self._wake()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):  # full: it is awake anyway; closed: it has ended
            self._nudge.send(b"!")

    def _flush(self, link: PeerLink) -> None:
        waits = link.flush()
        if not link.closed:
            self._sockets.change(link.socket, writes=waits)

    def _close_link(self, link: PeerLink) -> None:
        if not link.closed:
            self._sockets.remove(link.socket)
            link.close()
            if self._door is not None:
                self._door.closed(link)

    def _release(self) -> None:
        """Send what waits, as far as it can be, and close all that is open."""
        links = [what for what in self._sockets.all() if isinstance(what, PeerLink)]
        latest = self._system.now() + FLUSH
        while any([link.flush() for link in links]) and self._system.now() < latest:  # noqa: C419 # all of them
            self._system.sleep(0.005)
        with self._lock:
            for peer in self._peers.values():
                if peer.beat is not None:
                    peer.beat.close()
                for number in list(peer.exchanges):
                    self._end_exchange(peer, number)
            self._peers.clear()
        for link in links:
            link.close()
        if self._door is not None:
            self._door.close()
        for end in (self._nudge, self._nudged):
            end.close()
        self._sockets.close()
        self._ended_all.set_result(None)


def _rank(peer: _Peer, key: str) -> int:
    return peer.ranks.get(key, 0)


def held_by(process: int, keys: Iterable[str], system: OSFiles = THIS_SYSTEM) -> list[Held]:
    """Return what a process holds, and what a person can do if it does not answer."""
    sleeps = asleep(process, system)
    how = "which hangs" if sleeps else "which runs and could not be reached from here"
    end = f"try again from another terminal; if that fails too, `kill {process}` ends it"
    advice = remedy(process, end, system)
    return [Held(key, f"process {process}", advice, how, sleeps) for key in sorted(keys)]
