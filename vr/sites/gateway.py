"""The gateway: the one process of a machine that joins it to the other sites of a realm.

For the processes of its machine it is one more member of the local network, which is present in the name of
all agents of the other sites. What is asked of these, it passes on, sealed, to their gateway, which asks
there and answers for who asked (`Voucher`). Nobody else here knows of other machines, and what is local never
passes it: if it dies, the machine goes on alone.

Everything happens on the event loop. Callbacks of the local network and of the pipe only hand over.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import os
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from functools import partial
from typing import Final

from robotree.vr.base.address import Address
from robotree.vr.base.chance import token
from robotree.vr.base.envelope import Received
from robotree.vr.base.errors import NoAnswer, NoSuchPermit, NotAMember, SiteSilent, VrError
from robotree.vr.base.permit import Permit, on_clock, travelling
from robotree.vr.base.places import CALLER, OWN
from robotree.vr.base.principal import Credentials, Voucher, user_name
from robotree.vr.base.requests import (
    Accepted,
    DescribeGateway,
    GatewayDescribed,
    Raised,
    Reply,
    SafeStop,
    encode,
)
from robotree.vr.base.transport import ELSEWHERE, End, Respond, Transport
from robotree.vr.exchange.authority import Here
from robotree.vr.exchange.dispatcher import Dispatcher, SendReply, not_for
from robotree.vr.network.on_loop import LoopTurns
from robotree.vr.network.permit_file import permits_beside
from robotree.vr.sites.certificates import Certificate
from robotree.vr.sites.frames import (
    AboutSite,
    Admitted,
    AgainStates,
    AllNews,
    Announced,
    Hung,
    OneNews,
    Revoked,
    SiteAsk,
    SiteEnd,
    SiteFrame,
    SitePolicy,
    SiteReply,
    SiteSample,
    SiteState,
    SiteStopped,
    StillSo,
    StopSite,
    arrived,
    decode_frame,
    encode_frame,
    leaving,
    sender_of,
)
from robotree.vr.sites.handshake import Handshakes
from robotree.vr.sites.keys import RealmKeys
from robotree.vr.sites.networks import GRANTED, Ground, Pipe, Topics
from robotree.vr.sites.sealing import ID_SIZE, Lane, Verdict
from robotree.vr.sites.showing import Showing, Standing
from robotree.vr.sites.site import ARRIVAL, GONE, RememberedSite, Site, SiteExchange, seen
from robotree.vr.sites.stopping import SiteStops, StopHere
from robotree.vr.sites.stream import PIECE, Full, SiteStream
from robotree.vr.sites.summary import Mirrors, Summaries, is_state

TICK: Final = 0.1
"""[s] between two looks at all sites."""

GREET, GREET_SELDOM = 0.5, 5.0
"""[s] between two greetings of a site that does not answer: at first, and later."""

LOOK: Final = 2.0
"""[s] between two looks into the folder for revoked certificates."""

HERE: Final = 2.0
"""[s] between two hints that this gateway is there."""

MOST_STRANGERS: Final = 64
"""Names of sites that only a hint has told of."""

PAUSE: Final = 0.05
"""[s] at least between two answers of the authority: it writes files, and who gets none asks again."""

SLEPT: Final = 1.0
"""[s] between two ticks after which this process knows that it was late itself; as long it judges nobody."""

KEYS_AT_ONCE: Final = 200
"""Keys in one frame."""

STILL: Final = "still"
"""Under which a sentence about unchanged states waits: a newer one takes its place."""

HOSTS: Final = "host/"
"""Begin of the keys of hosts."""

GREETING, SEALED, REVOKED = b"g", b"s", b"r"
"""First byte of a message between gateways."""

_log = logging.getLogger(__name__)


class Gateway:
    """See the module. `open` it, `close` it."""

    def __init__(
        self,
        transport: Transport,
        pipe: Pipe,
        keys: RealmKeys,
        *,
        ground: Ground,
        stop_here: StopHere,
        wall: Callable[[], float] = time.time,
        chance: Callable[[int], bytes] = os.urandom,
        version: str = "",
    ) -> None:
        """Prepare.

        Args:
            transport: the local network.
            pipe: the network between machines.
            keys: of the realm.
            ground: the local network without an event loop: the mesh of `transport`.
            stop_here: stops the robots of this machine.
            wall: [s since 1970], for certificates.
            chance: draws so many bytes that nobody can guess.
            version: of robotree, for people.

        Raises:
            NotAMember: the own certificate is not good any more.
        """
        self.transport, self._mesh, self._pipe, self._keys = transport, ground, pipe, keys
        self._wall, self._loop = wall, asyncio.get_running_loop()
        self._turns = LoopTurns()
        self._handshakes = Handshakes(keys.own, keys.trust, chance=chance)
        self._topics = Topics(keys.realm)
        self.address = Address("gateway", keys.name, token())
        self.sites: dict[str, Site] = {site.name: Site(site.name) for site in keys.sites()}
        self._sessions: dict[bytes, Site] = {}
        self._standing = Standing(ground, lambda key: partial(self._take, key))
        self._wanted = set[str]()
        self._astray: list[tuple[float, Site, SiteExchange]] = []
        """Requests to agents that have left a site, and since when [s]: news of them may be on the way."""
        self._hung: list[tuple[str, str, str]] = []
        """The agents of this machine that hang, as the other sites were told."""
        self._numbers = itertools.count(1)
        self._own, self._version, self._out = keys.certificate(wall()), version, ""
        self._stops = SiteStops(self, keys, stop_here)
        self._showing = Showing(self, transport)
        self._admitted: dict[bytes, bytes] = {}
        """Certificates that were given of late, by request."""
        self.refused = Counter[str]()
        """What was refused, by reason."""
        self._known: dict[str, RememberedSite] = {}
        """The sites that the machine was told of."""
        self._looked = self._hinted = self._answered = 0.0
        self._ticked = self._woke = self.now()
        self._ticking: asyncio.Task[None] | None = None
        self._leaving = False

    async def open(self) -> None:
        """Begin: join both networks."""
        dispatcher = Dispatcher(
            f"gateway {self._keys.name}", self._answer, now=self.now, here=Here("gateway", self._keys.name)
        )
        self._tell_of_sites()
        await self.transport.serve(self.address.key, dispatcher.take)
        await self.transport.announce(self.address.key)
        self.transport.presence.watch("**", self._changed)
        self._pipe.subscribe(self._topics.to(self._keys.name), self._on_pipe)
        self._pipe.subscribe(self._topics.here, self._on_pipe)
        if self._keys.is_authority:
            self._pipe.subscribe(self._topics.authority("*", "*"), self._on_pipe)
        self._pipe.hint(self._hint)
        self._ticking = asyncio.create_task(self._tick_for_ever(), name="gateway")

    async def close(self) -> None:
        """Leave both. Twice is once."""
        ticking, self._ticking = self._ticking, None
        if ticking is not None:
            ticking.cancel()
            await asyncio.gather(ticking, return_exceptions=True)
            for site in self.sites.values():
                self._end_session(site, "this gateway ends")
            await self._loop.run_in_executor(None, self._pipe.close)

    # -- for the processes of this machine ---------------------------------------------------------

    def _answer(self, received: Received, send: SendReply) -> Reply | Awaitable[Reply]:
        match received.request:
            case SafeStop() as stop:
                send(Accepted(key=stop.order))
                return self._stops.stop_sites(stop)
            case DescribeGateway():
                return self.describe()
            case _:
                raise not_for("gateway", received.request)

    def describe(self) -> GatewayDescribed:
        """Return how the other sites are."""
        now, state = self.now(), self._pipe.state()
        trouble = self.reason()
        remedy = f"look at the hub and at the way to {state.where}; it is dialed for ever"
        refused = [name for name, site in self.sites.items() if site.refused]
        known = {name: RememberedSite(name) for name in refused} | self._known
        clause = (
            (self._out, "`robotree realm renew`, or ask the authority") if self._out else (trouble, remedy)
        )
        return GatewayDescribed(
            site=self._keys.name,
            realm=self._keys.realm,
            hub=state.where,
            trouble=trouble,
            version=self._version,
            ends=self._own.ends,
            out=self._out,
            sites=tuple(
                seen(one, self.sites.get(one.name), now, clause if clause[0] else ("", ""))
                for one in sorted(known.values())
            ),
            refused=dict(self.refused.most_common(8)),
        )

    # -- for the stop -----------------------------------------------------------------------------

    def send(self, site: Site, frame: SiteFrame, lane: Lane, *, until: float = float("inf")) -> bool:
        """Send a frame to a site; returns whether there is a session with it."""
        stream = site.stream
        if stream is None:
            return False
        try:
            stream.put(lane, encode_frame(frame), until=until)
        except Full:
            self._end_session(site, "it reads nothing")
            return False
        self._flush_soon()
        return True

    def is_local(self, key: str) -> bool:
        """Whether a key is of this machine, also if its process hangs."""
        return key in self._standing.local or key not in self._standing.where

    @property
    def local(self) -> set[str]:
        """The keys that are present here and of this machine."""
        return self._standing.local

    def rank(self, key: str) -> int:
        """Return how often an agent of this machine has moved."""
        return self._mesh.rank_elsewhere(key)

    def now(self) -> float:
        """[s] on this machine's monotonic clock."""
        return self._loop.time()

    def reason(self) -> str:
        """Return why no site can be reached, as a clause; empty: the hub answers."""
        state = self._pipe.state()
        return "" if state.up else f"the hub {state.where} is not reached: {state.reason}"

    # -- the local side ---------------------------------------------------------------------------

    def _changed(self, key: str, there: bool) -> None:  # noqa: FBT001 # a PresenceHandler
        del there  # what is so now counts: this may be the gateway's own word
        if not key.startswith(OWN) and self._standing.look(key) is not None:
            self._tell(key)

    def _tell(self, key: str) -> None:
        """Tell all sites whether an agent of this machine is there."""
        there = key in self._standing.local
        for site in self.sites.values():
            if not there:
                site.summaries.forget(key)
            self._showing.tell(site, key, there=there)

    def _see_who_came(self) -> None:
        """Tell all sites of agents that were at one of them and are here now."""
        for key in self._standing.come_here():
            self._tell(key)

    def _see_wanted(self) -> None:
        wanted = self._mesh.wanted()
        for pattern in sorted(wanted ^ self._wanted):
            for site in self.sites.values():
                self.send(site, OneNews(Announced.WANTED, pattern, pattern in wanted), Lane.URGENT)
        self._wanted = wanted

    def _take(  # an `TakeFrame`
        self,
        key: str,
        body: bytes,
        sender: Credentials,
        urgent: bool,  # noqa: FBT001
        respond: Respond,
        end: End,
    ) -> None:
        action = partial(self._pass_on, key, body, sender, urgent=urgent, respond=respond, end=end)
        if not self._turns.put(action, urgent=urgent):
            end(None)

    def _pass_on(
        self, key: str, body: bytes, sender: Credentials, *, urgent: bool, respond: Respond, end: End
    ) -> None:
        """Pass a request on to the site of its key."""
        site, now, found = self._standing.where.get(key), self.now(), leaving(body, self.now())
        if site is None and key in self._standing.local:
            end(ELSEWHERE)
            return
        if site is None or site.stream is None or found is None or found.vouched:
            end(None)  # who asks from another site, by this gateway, is to ask there itself
            return
        if found.void_at and not site.linked(now):
            reason = self.reason() or "its gateway is not heard"
            error = SiteSilent(site=site.name, seconds=site.silence(now), reason=reason)
            end(encode(Raised.of(error)))
            return
        self._showing.introduce(site, sender_of(body))
        number = next(self._numbers)
        again = partial(self._pass_on, key, body, sender, urgent=urgent, respond=respond, end=end)
        site.exchanges[number] = SiteExchange(key, respond, end, found.void_at, again)
        permit = self._permit(found.permit) if found.permit else None
        user = user_name(sender.user)
        ask = SiteAsk(number, key, body, urgent, now, found.age, user, sender.process, permit)
        lane = Lane.URGENT if urgent else Lane.NORMAL
        self.send(site, ask, lane, until=found.void_at or float("inf"))

    def _permit(self, permit: str) -> Permit | None:
        """Return a permit of this site for a robot of another one; None: there is none."""
        with suppress(NoSuchPermit):
            return travelling(permits_beside(self.transport.gate).find(permit))
        return None

    def _hear(self, site: Site, key: str, body: bytes) -> None:
        if site.stream is None or _agent(key) not in self._standing.local:
            return
        if (shown := self._showing.shown(site, key, body)) is None:
            return
        if not is_state(key):
            site.stream.publish(key, encode_frame(SiteSample(key, shown)))
        elif (state := site.summaries.take(key, shown, self.now())) is not None:
            site.stream.publish(key, encode_frame(state))
        self._flush_soon()

    # -- the other sites --------------------------------------------------------------------------

    def _on_pipe(self, topic: str, body: bytes) -> None:
        """In a thread of the pipe."""
        self._turns.put(partial(self._take_message, topic, body), urgent=True)

    def _hint(self) -> None:
        """In a thread of the pipe: somebody may have arrived."""
        self._turns.put(self._greet_all, urgent=True)

    def _take_message(self, topic: str, body: bytes) -> None:
        try:
            if topic == self._topics.here:
                self._take_hint(body)
            elif topic != self._topics.to(self._keys.name):
                self._answer_as_authority(topic, body)
            elif body[:1] == SEALED:
                self._take_sealed(body[1:])
            elif body[:1] == GREETING:
                self._take_greeting(body[1:])
            elif body[:1] == REVOKED and self._keys.take_revocations(body[1:]):
                self._spread()
        except VrError as error:
            self._note_refusal(error)
            self._refuse(str(error))

    def _refuse(self, reason: str) -> None:
        """Count what is refused, and tell of it seldom."""
        text = reason if len(self.refused) < MOST_STRANGERS else "others"
        self.refused[text] += 1
        if self.refused[text] in {1, 10} or self.refused[text] % 1000 == 0:
            _log.warning("refused %d times: %s", self.refused[text], reason)

    def _note_refusal(self, error: VrError) -> None:
        """Remember why a site is not linked; one whose certificate was revoked gets the list that says so."""
        if not isinstance(error, NotAMember):
            return
        kind, _, name = str(error.data["who"]).partition(" ")
        site = self.sites.get(name)
        if site is None or site.stream is not None or kind not in {"site", "person"}:
            return
        site.refused = f"it shows that it is {kind} {name}, and {error.data['reason']}"
        now = self.now()
        if self._keys.trust.packed and now - site.answered > GREET_SELDOM:
            site.answered = now
            self._pipe.publish(self._topics.to(name), REVOKED + self._keys.trust.packed)

    def _take_sealed(self, packet: bytes) -> None:
        site = self._sessions.get(packet[:ID_SIZE])
        if site is None or site.stream is None:
            return
        silent, forged = not site.linked(self.now()), site.stream.counts[Verdict.FORGED]
        body = site.stream.receive(packet, self.now())
        if site.stream.counts[Verdict.FORGED] > forged:
            self._refuse(f"what came as from site {site.name} was made or changed without its keys")
        if silent and site.linked(self.now()):
            _log.info("site %s is heard again", site.name)
        if body is not None and (frame := decode_frame(body)) is not None:
            self._take_frame(site, frame)
        self._flush_soon()

    def _take_frame(self, site: Site, frame: SiteFrame) -> None:
        match frame:
            case AllNews() | OneNews():
                self._take_news(site, frame)
            case SiteAsk():
                self._take_ask(site, frame)
            case SiteReply() | SiteEnd():
                self._take_answer(site, frame)
            case SiteSample():
                self._publish(site, frame.key, frame.body)
            case Revoked():
                if self._keys.take_revocations(frame.packed):
                    self._spread()
            case StopSite():
                self._stops.carry_out(site, frame)
            case SiteStopped():
                self._stops.take_answer(site, frame)
            case _:
                self._take_what_is_said(site, frame)

    def _take_what_is_said(self, site: Site, frame: SiteFrame) -> None:
        """Take what a site says of its robots, of itself and of other sites."""
        match frame:
            case SiteState() | StillSo() | AgainStates():
                self._take_states(site, frame)
            case AboutSite():
                way = 0.0 if site.stream is None else site.stream.way / 2
                site.version, site.clock = frame.version[:40], frame.wall + way - self._wall()
            case Admitted():
                self._take_admitted(frame)
            case Hung():
                site.hung = [one for one in frame.agents if one[0] in site.keys or Address.parse(one[0])]
            case SitePolicy():
                self._showing.take_policy(frame.data)
            case _:
                pass

    def _publish(self, site: Site, key: str, body: bytes) -> None:
        if self._standing.where.get(_agent(key)) is site:
            self._mesh.publish(key, body)

    def _take_states(self, site: Site, frame: SiteState | StillSo | AgainStates) -> None:
        if site.stream is None:
            return
        match frame:
            case SiteState():
                if _agent(frame.key) in site.keys and is_state(frame.key):
                    site.mirrors.take(frame)
                    self._publish(site, frame.key, frame.body)
            case StillSo():
                same, lost = site.mirrors.still(frame)
                for key, body in same:
                    self._publish(site, key, body)
                if lost:
                    self.send(site, AgainStates(list(lost)), Lane.NORMAL)
            case AgainStates():
                for state in site.summaries.again(frame.numbers):
                    site.stream.publish(state.key, encode_frame(state))
                self._flush_soon()

    def _take_admitted(self, admitted: Admitted) -> None:
        """Remember sites that the authority has admitted: a stop names them though they were never heard."""
        for packed in admitted.certificates:
            with suppress(NotAMember):
                certificate = self._keys.trust.certificate(packed, self._wall())
                if certificate.kind == "site" and certificate.name != self._keys.name:
                    self._keys.remember(certificate)
        self._tell_of_sites()

    def _take_news(self, site: Site, news: AllNews | OneNews) -> None:
        if isinstance(news, AllNews):
            self._take_all(site, news)
        elif news.topic is Announced.PRESENT:
            if news.there:
                self._learn(site, news.key, news.rank)
            else:
                self._forget(site, news.key)
        else:
            (self._want if news.there else self._unwant)(site, news.key)

    def _take_answer(self, site: Site, answer: SiteReply | SiteEnd) -> None:
        exchange = site.exchanges.get(answer.number)
        if exchange is None:
            return
        if isinstance(answer, SiteReply):
            exchange.void_at = 0.0
            exchange.respond(answer.body)
        else:
            del site.exchanges[answer.number]
            if answer.elsewhere:
                self._astray.append((self.now(), site, exchange))
                self._see_astray()
            else:
                exchange.end(None)

    def _see_astray(self) -> None:
        """Ask where the agents are now that have left a site; one of which nobody knows is not asked."""
        now, astray, self._astray = self.now(), self._astray, []
        for since, left, exchange in astray:
            where = self._standing.where.get(exchange.key)
            if (where is None and exchange.key in self._standing.local) or where not in (None, left):
                exchange.again()
            elif now - since > ARRIVAL:
                exchange.end(None)
            else:
                self._astray.append((since, left, exchange))

    def _take_all(self, site: Site, news: AllNews) -> None:
        site.fresh.update(news.keys)
        for key in news.keys:
            self._learn(site, key, news.ranks.get(key, 0))
        for pattern in news.patterns:
            self._want(site, pattern)
        if not news.more:
            for key in sorted(site.keys - site.fresh):
                self._forget(site, key)
            site.fresh.clear()

    def _learn(self, site: Site, key: str, rank: int) -> None:
        if not self._standing.claim(site, key, rank):
            return
        if self._astray:
            self._see_astray()
        for since, ask in list(site.early):
            if sender_of(ask.body) == key:
                site.early.remove((since, ask))
                self._ask_here(site, ask, known=True)

    def _forget(self, site: Site, key: str) -> None:
        self._standing.drop(site, key)
        site.mirrors.forget(key)

    def _want(self, site: Site, pattern: str) -> None:
        if pattern not in site.patterns:
            hand_over = partial(self._hear, site)

            def on_sample(key: str, body: bytes) -> None:
                self._turns.put(partial(hand_over, key, body))

            number = self._mesh.subscribe(pattern, on_sample)
            site.patterns[pattern] = partial(self._mesh.unsubscribe, number)

    def _unwant(self, site: Site, pattern: str) -> None:
        if (end := site.patterns.pop(pattern, None)) is not None:
            end()

    # -- requests from other sites ----------------------------------------------------------------

    def _take_ask(self, site: Site, ask: SiteAsk) -> None:
        sender = sender_of(ask.body)
        if sender and sender not in site.keys:
            site.early.append((self.now(), ask))  # the news of its presence may be on the way
        else:
            self._ask_here(site, ask, known=bool(sender))

    def _ask_here(self, site: Site, ask: SiteAsk, *, known: bool) -> None:
        """Ask an agent of this machine, in the name of who asked on another one."""
        assert site.stream is not None  # noqa: S101 # it came by it
        assert site.member is not None  # noqa: S101 # it has proved who it is
        stream, member, now = site.stream, site.member, self.now()
        age = ask.age + stream.delay(ask.sent, now)
        person = member.kind == "person"
        user = member.name if person else ask.user
        voucher = Voucher(member.name, user, ask.process, person, member.may)
        permit = None if ask.permit is None else on_clock(ask.permit, site.clock)
        found = arrived(ask.body, age, voucher, now, known=known, permit=permit)
        large = answered = False

        def reply(body: bytes | None) -> None:
            nonlocal large, answered
            if site.stream is not stream:
                return  # who asked has been told that nothing comes any more
            large = large or (body is not None and len(body) > PIECE)
            lane = Lane.BULK if large else Lane.URGENT if ask.urgent else Lane.NORMAL
            frame = SiteReply(ask.number, body) if body is not None else SiteEnd(ask.number, elsewhere=left())
            answered = True
            self.send(site, frame, lane)

        def left() -> bool:
            return not answered and (ask.key in self._standing.where or ask.key not in self._standing.local)

        if found is None or ask.key not in self._standing.local:
            reply(None)
        elif found.expired:
            reply(encode(Raised.of(NoAnswer(key=ask.key, seconds=age))))
            reply(None)
        else:

            def on_loop(body: bytes | None) -> None:
                if ask.key.startswith(HOSTS):  # it may have taken a robot, which is known before it says so
                    self._see_who_came()
                reply(body)

            def on_reply(body: bytes | None) -> None:
                self._turns.put(partial(on_loop, body), urgent=ask.urgent)

            self._mesh.ask(ask.key, found.body, void_at=found.void_at, urgent=ask.urgent, on_reply=on_reply)

    # -- who is there -----------------------------------------------------------------------------

    def _take_hint(self, body: bytes) -> None:
        """Somebody says that a gateway is there; nobody vouches for it."""
        name = body[:64].decode(errors="replace")
        if name == self._keys.name or Address.parse(f"gateway/{name}/x") is None:
            return
        site = self.sites.get(name)
        if site is None and sum(one.member is None for one in self.sites.values()) < MOST_STRANGERS:
            site = self.sites[name] = Site(name)
        if site is not None and site.stream is None and self.now() - site.tried > GREET:
            site.tries = 0
            self._greet(site)

    def _greet_all(self) -> None:
        self._pipe.publish(self._topics.here, self._keys.name.encode(), to_all=True)
        for site in self.sites.values():
            site.tries = 0
            self._greet(site)

    def _greet(self, site: Site) -> None:
        """Begin a handshake, if it is on this side to begin."""
        if self._keys.name < site.name:
            site.tried, site.tries = self.now(), site.tries + 1
            session = b"" if site.stream is None else site.stream.session
            self._say(site.name, self._handshakes.greet(site.name, self.now(), session))

    def _take_greeting(self, packed: bytes) -> None:
        step = self._handshakes.take(packed, now=self.now(), wall=self._wall(), knows=self._knows)
        established = step.established
        if step.answer:
            self._say(step.to, step.answer)
        if established is not None and established.member.name != self._keys.name:
            self._begin(established.member, SiteStream(established.sealing, self.now()))

    def _knows(self, name: str, session: bytes) -> bool:
        site = self._sessions.get(session)
        return site is not None and site.name == name and site.stream is not None

    def _say(self, name: str, packed: bytes) -> None:
        self._pipe.publish(self._topics.to(name), GREETING + packed)

    def _begin(self, member: Certificate, stream: SiteStream) -> None:
        """A member has proved who it is: tell it all."""
        site = self.sites.setdefault(member.name, Site(member.name))
        if site.stream is not None:
            self._end_session(site, "its gateway was started again", hide=False)
        site.member, site.stream, site.tries, site.refused = member, stream, 0, ""
        site.summaries, site.mirrors = Summaries(self.now()), Mirrors()
        site.fresh.clear()
        self._sessions[stream.session] = site
        self._keys.remember(member)
        _log.warning("site %s is linked", site.name)
        self.send(site, AboutSite(self._version, self._wall()), Lane.URGENT)
        local, patterns = self._showing.begin(site), sorted(self._wanted)
        for begin in range(0, max(len(local), 1), KEYS_AT_ONCE):
            keys, rest = local[begin : begin + KEYS_AT_ONCE], patterns if not begin else []
            ranks = {key: rank for key in keys if (rank := self._mesh.rank_elsewhere(key))}
            self.send(site, AllNews(keys, rest, begin + KEYS_AT_ONCE < len(local), ranks), Lane.URGENT)
        if self._keys.trust.packed:
            self.send(site, Revoked(self._keys.trust.packed), Lane.URGENT)
        if self._keys.is_authority:
            self.send(site, Admitted(list(self._keys.admitted())), Lane.NORMAL)
        if self._hung:
            self.send(site, Hung(self._hung), Lane.NORMAL)
        self._showing.send_policy(site)
        self._tell_of_sites()

    def _end_session(self, site: Site, why: str, *, hide: bool = True) -> None:
        stream, site.stream = site.stream, None
        if stream is None:
            return
        site.was_heard, site.hung = stream.heard, []
        _log.warning("site %s: %s", site.name, why)
        self._sessions.pop(stream.session, None)
        exchanges, site.exchanges = site.exchanges, {}
        now = self.now()
        for exchange in exchanges.values():
            if exchange.void_at > now:  # it may be begun there until then
                self._loop.call_later(exchange.void_at + stream.round_trip - now, exchange.end, None)
            else:
                exchange.end(None)
        site.early.clear()
        for pattern in list(site.patterns):
            self._unwant(site, pattern)
        if hide:
            for key in sorted(site.keys):
                self._forget(site, key)
        self._stops.lost(site)

    # -- the authority ----------------------------------------------------------------------------

    def _answer_as_authority(self, topic: str, body: bytes) -> None:
        *_, about, number = topic.split("/")
        if self.now() - self._answered < PAUSE:
            return
        self._answered = self.now()
        try:
            if about == "join":
                answer = GRANTED + self._granted(number, body)
            else:
                answer = GRANTED + self._keys.renew(body, self._wall())
        except VrError as error:
            answer = encode(Raised.of(error))
            self.refused[str(error)[:200]] += 1
        self._pipe.publish(self._topics.answer(about, number), answer)

    def _granted(self, number: str, body: bytes) -> bytes:
        """Admit a member once; who asks again because the answer was lost gets the same."""
        known = self._admitted.get(body)
        if known is None:
            known = self._keys.admit(body, self._wall())
            while len(self._admitted) >= MOST_STRANGERS:
                del self._admitted[next(iter(self._admitted))]
            self._admitted[body] = known
            self._tell_of_sites()
            for site in self.sites.values():
                self.send(site, Admitted(list(self._keys.admitted())), Lane.NORMAL)
            _log.warning("a member has joined with invitation %s", number)
        return known

    # -- time -------------------------------------------------------------------------------------

    def _flush_soon(self) -> None:
        """Have what waits sent after what is done now."""
        if not self._leaving:
            self._leaving = True
            self._loop.call_soon(self._flush)

    def _flush(self) -> None:
        self._leaving, now = False, self.now()
        for site in self.sites.values():
            if site.stream is not None:
                topic = self._topics.to(site.name)
                for packet in site.stream.take(now):
                    self._pipe.publish(topic, SEALED + packet)

    async def _tick_for_ever(self) -> None:
        while True:
            try:
                self._tick()
            except Exception:  # noqa: BLE001 # one site's fault is not the others'
                _log.exception("a look at the sites failed")
            await asyncio.sleep(TICK)

    def _tick(self) -> None:
        now = self.now()
        if now - self._ticked > SLEPT:
            self._woke = now
        self._ticked = now
        self._check_itself()
        self._see_wanted()
        self._see_who_came()
        self._see_astray()
        self._mark_silent(now)
        for site in list(self.sites.values()):
            self._look_at(site, now)
        if now - self._hinted > HERE:
            self._hinted = now
            self._pipe.publish(self._topics.here, self._keys.name.encode(), to_all=True)
        if now - self._looked > LOOK:
            self._looked = now
            self._showing.look()
            self._see_hung()
            self._tell_of_sites()
            with suppress(NotAMember):
                before = self._keys.trust.revocations.number
                if self._keys.take_revocations() or self._keys.trust.revocations.number > before:
                    self._spread()
        self._flush()

    def _tell_of_sites(self) -> None:
        """Let the machine know which sites belong to the realm, and which are not heard."""
        known = {site.name: RememberedSite(site.name, site.kind, site.ends) for site in self._keys.sites()}
        for name in sorted(self._known.keys() - known.keys()):
            self._standing.forget(name)
        self._known = known
        self._mark_silent(self.now())

    def _mark_silent(self, now: float) -> None:
        for name in self._known:
            site = self.sites.get(name)
            self._standing.tell_of(name, silent=site is None or not site.linked(now))

    def _see_hung(self) -> None:
        """Tell the other sites which agents hang here, and what helps: there they are only absent."""
        held = (one for one in self._mesh.presence.hangs("*/*/*") if self.is_local(one.key))
        hung = [(one.key, one.where, one.remedy) for one in held if not one.key.startswith(OWN)][
            :KEYS_AT_ONCE
        ]
        if hung != self._hung:
            self._hung = hung
            for site in self.sites.values():
                self.send(site, Hung(hung), Lane.NORMAL)

    def _check_itself(self) -> None:
        """End all sessions when the own certificate is not good any more; say so once."""
        try:
            self._keys.trust.check(self._own, self._wall())
            self._out = ""
        except NotAMember as error:
            self._out = str(error)
            if any(site.stream is not None for site in self.sites.values()):
                _log.warning("this machine is out of the realm: %s", error)
            for site in self.sites.values():
                self._end_session(site, "this machine is out of the realm")

    def _look_at(self, site: Site, now: float) -> None:
        if site.stream is not None and site.linked(now):
            for frame in site.summaries.due(now, site.stream.rate):
                key = frame.key if isinstance(frame, SiteState) else STILL
                site.stream.publish(key, encode_frame(frame))
        while site.early and now - site.early[0][0] > ARRIVAL:
            self._ask_here(site, site.early.popleft()[1], known=False)
        if site.stream is not None and site.stream.silence(now) > GONE and now - self._woke > SLEPT:
            self._end_session(site, f"it was silent for {GONE:g} s")
        if site.member is not None and site.stream is not None:
            try:
                self._keys.trust.check(site.member, self._wall())
            except NotAMember as error:
                self._end_session(site, str(error))
        if not site.linked(now) and now - site.tried > min(GREET * 2 ** min(site.tries, 8), GREET_SELDOM):
            self._greet(site)

    def _spread(self) -> None:
        """A newer list of revoked certificates is believed: hand it on, and end what it ends."""
        for site in self.sites.values():
            self.send(site, Revoked(self._keys.trust.packed), Lane.URGENT)
        self._flush()
        for site in self.sites.values():
            if site.member is not None and site.member.serial in self._keys.trust.revocations.serials:
                self._end_session(site, "its certificate was revoked")


def _agent(key: str) -> str:
    """Return the key of the agent, or of the person's program, that publishes under a key."""
    parts = 2 if key.startswith(CALLER) else 3
    return "/".join(key.split("/", parts)[:parts])
