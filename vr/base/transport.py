"""The interface of a network for agents, and nothing more.

Four verbs: ask (`request`), answer (`serve`), publish (`publish`, `subscribe`), and be present (`announce`).
Who else is present the table `presence` says. `network/` has one for the processes of a machine and one for
several machines, `world/` one within a process, in virtual time. `testing.py` examines any implementation
(`check_transport`).

All callbacks are called on the event loop of the transport, except those of `ask` and `serve`. Bodies are
bytes; `requests.py` gives them meaning. A key is a chunk path like `robot/arm-1/6f2c`; a pattern may have `*`
for one chunk, `**` for many.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Sequence
from typing import Final, Protocol

from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.presence import Presence
from robotree.vr.base.principal import Credentials

Respond = Callable[[bytes], None]
"""Send one reply; may be called any number of times until the handler returns."""

RequestHandler = Callable[[bytes, Respond], Awaitable[None] | None]
"""Answers one request on the event loop: at once (None), or when what it returns has been awaited, in a task.
An exception in it is logged and ends the reply."""

End = Callable[[bytes | None], None]
"""Ends the replies to a request, with one more or with None."""


ELSEWHERE: Final = bytes([0xC1])  # a byte that MessagePack never uses: no reply begins with it
"""Instead of a last reply: somebody else serves the key from now on, and the transport asks there again."""


class Incoming:
    """One request that has come. Everything in it may be used in any thread."""

    __slots__ = ("_on_loop", "body", "credentials", "end", "reply")

    def __init__(
        self,
        body: bytes,
        credentials: Credentials,
        reply: Respond,
        end: End,
        on_loop: Callable[[RequestHandler], None],
    ) -> None:
        """Made by a transport.

        Args:
            body: as it was sent.
            credentials: of the process that has sent it.
            reply: sends one reply.
            end: ends the replies.
            on_loop: has a handler answer it at its turn on the event loop.
        """
        self.body, self.credentials, self.reply, self.end = body, credentials, reply, end
        self._on_loop = on_loop

    def pass_on(self) -> None:
        """Have it asked again of who serves the key now; where nobody does, its replies end without one."""
        self.end(ELSEWHERE)

    def answer_on_loop(self, handler: RequestHandler) -> None:
        """Have it answered on the event loop, after everything there that is more urgent."""
        self._on_loop(handler)


TakeRequest = Callable[[Incoming], None]
"""Takes a request in the thread that reads it. Must not block."""


def on_loop(handler: RequestHandler) -> TakeRequest:
    """Take each request by having it answered on the event loop."""
    return lambda incoming: incoming.answer_on_loop(handler)


OnReply = Callable[[bytes | None], None]
"""Takes one reply, in any thread; None: there are no more. Must not block."""

SampleHandler = Callable[[str, bytes], None]
"""Takes one published sample: its key and its body. Must not block."""

CutOffHandler = Callable[[str], None]
"""Takes why no other process can reach this one, as a clause; empty: one can. Must not block."""


class Occupied(Exception):
    """A key was not announced, because others are present."""

    def __init__(self, keys: Sequence[str]) -> None:
        """Name what they are present under."""
        super().__init__(", ".join(keys))
        self.keys = tuple(keys)


class Registration(Protocol):
    """Something declared on a transport that can be taken back."""

    async def close(self) -> None:
        """Take it back. Twice is once."""
        ...


class Transport(Protocol):
    """The way from agent to agent. Calls within one process may be direct."""

    presence: Presence
    """The agents that are present and those that hang: the one table of this process."""

    identity: Credentials
    """This process, as the others see it named."""

    gate: PolicyGate
    """The policy of the realm."""

    async def serve(self, key: str, take: TakeRequest, *, rank: int = 0) -> Registration:
        """Answer the requests sent to exactly this key. One server per key and process.

        Args:
            key: of the server.
            take: takes each request in the thread that reads it; see `on_loop`.
            rank: of several processes that serve the key, the one with the highest is asked; of equal ones
                the latest. It grows with each move of an agent.
        """
        ...

    def request(
        self, key: str, body: bytes, *, timeout: float, urgent: bool = False, void_at: float = 0.0
    ) -> AsyncIterator[bytes]:
        """Ask the server of a key and iterate over its replies until it has no more.

        Args:
            key: as served.
            body: the request.
            timeout: [s] for the whole exchange, from now to the last reply.
            urgent: ahead of everything else (lease renewals, stops, cancels).
            void_at: [s] on the event loop's clock, after which the server does not begin with it any more. If
                the server's process hangs, the replies do not end before: it may wake and begin. 0: they do.
                Infinite: they do, and the request is left for the process, which reads it when it wakes.

        Raises:
            Unreachable: it ended without a single reply: not served, or its process died or hangs.
            NoAnswer: the time was over (replies that came before were yielded).
            TransportClosed: this transport is closed.
        """
        ...

    def ask(
        self, key: str, body: bytes, *, void_at: float = 0.0, urgent: bool = False, on_reply: OnReply
    ) -> None:
        """Ask the server of a key without waiting. From any thread, without the event loop if possible.

        Args:
            key: as served; or a pattern, for processes of which nobody knows what they serve: they read the
                request when they wake, and nobody waits for a reply.
            body: the request.
            void_at: as in `request`. How long to wait for replies the asker decides.
            urgent: as in `request`.
            on_reply: takes the replies; None without one: nobody serves the key, or its process died or
                hangs.
        """
        ...

    def after_reading(self, job: Callable[[], bool]) -> bool:
        """Have the thread that reads do something which takes long, after what it does now.

        So what a request begins need not be handed to another thread: others read meanwhile.

        Args:
            job: returns whether the thread can read again; must not raise.

        Returns:
            False: this thread does not read, or has something to do already; nothing happens.
        """
        ...

    def publish(self, key: str, body: bytes) -> None:
        """Send a sample to all subscribers; never blocks, a receiver that is too slow misses it."""
        ...

    def listeners(self, key: str) -> int:
        """Return how many processes take what is published under a key, as far as is known here. Quick."""
        ...

    async def subscribe(self, pattern: str, handler: SampleHandler) -> Registration:
        """Take what is published under a pattern from now on."""
        ...

    async def announce(self, key: str, *, unless: Sequence[str] = ()) -> Registration:
        """Be present under a key until the registration closes or this process dies.

        Args:
            key: to be present under.
            unless: patterns; if somebody of this machine is present under one of them, it is not announced.

        Raises:
            Occupied: somebody is.
        """
        ...

    async def settle(self, within: float) -> None:
        """Wait until what this process has announced is known to all others that are awake, and theirs here.

        Of two that announce `unless` the other is there, and then settle, each knows of the other, or one of
        them was refused.

        Args:
            within: [s] to wait at most; where nobody can tell, that long.
        """
        ...

    async def watch_itself(self, handler: CutOffHandler) -> Registration:
        """Learn when no other process of the realm can reach this one any more, and when one can again.

        That is so when no other process is connected and awake, and none that comes later can find this one.
        """
        ...

    async def close(self) -> None:
        """Take everything back and leave. Twice is once."""
        ...
