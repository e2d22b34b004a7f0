"""The serving side of every agent: each request is opened, authorised, and handed to what answers it.

What must not wait for an event loop, such as calls, is answered in the thread that reads it (`at_once`);
everything else on the loop. An error that is raised anywhere on the way goes to the asker.
"""

from __future__ import annotations

import inspect
import logging
from collections.abc import Awaitable, Callable, Mapping
from functools import partial

from robotree.vr.base.envelope import Received, opened
from robotree.vr.base.errors import Garbled, VrError
from robotree.vr.base.principal import Principal
from robotree.vr.base.requests import AnyRequest, Raised, Reply, encode
from robotree.vr.base.transport import Incoming, Respond
from robotree.vr.exchange.authority import ANYWHERE, Here, authorise, expect_permitted, shown

SendReply = Callable[[Reply], None]
"""Sends one reply; may be called any number of times until the request is answered."""

AnswerRequest = Callable[[Received, SendReply], Reply | Awaitable[Reply | None] | None]
"""Answers a request on the event loop: with the reply that it returns, at once or when it was awaited, after
any number of others. A `VrError` that it raises travels to the asker."""

AnswerAtOnce = Callable[[Received, Incoming], None]
"""Answers a request in the thread that reads it, or later in any other. Must not block."""

Authorise = Callable[[Principal, AnyRequest], None]
"""Refuses a request that its principal may not make."""

_log = logging.getLogger(__name__)


class Dispatcher:
    """Takes all requests for one agent."""

    def __init__(
        self,
        who: str,
        answer: AnswerRequest,
        *,
        now: Callable[[], float],
        at_once: Mapping[type[AnyRequest], AnswerAtOnce] | None = None,
        allow: Authorise | None = None,
        here: Here = ANYWHERE,
    ) -> None:
        """Begin.

        Args:
            who: is asked, for people.
            answer: answers what `at_once` does not.
            now: [s] on the machine's monotonic clock.
            at_once: what answers requests of some classes in the thread that reads them.
            allow: see `authority.authorise`; None: the agent has no state that matters to it.
            here: the agent, and the policy to which it keeps.
        """
        self._who, self._answer, self._now = who, answer, now
        self._at_once = at_once or {}
        self._allow = allow or partial(authorise, state=None, here=here)
        self._here, self._gate = here, here.gate

    def take(self, incoming: Incoming) -> None:
        """Take a request: see `Transport.serve`."""
        try:
            now = self._now()
            if now >= self._gate.due:
                self._gate.refresh(now)
            received = opened(incoming.body, incoming.credentials, self._who, now, self._gate.owner)
            self._allow(received.principal, received.request)
            if received.may is not None:
                asker = received.principal.agent.split("/")[1:2]
                expect_permitted("".join(asker), received.may, received.request, self._here.kinds())
            answer = self._at_once.get(type(received.request))
            if answer is not None:
                answer(received, incoming)
                return
        except Exception as error:  # noqa: BLE001 # the error boundary: the asker gets an answer
            incoming.end(encode(refusal(error, self._who)))
            return
        incoming.answer_on_loop(partial(self._answer_on_loop, received))

    def _answer_on_loop(self, received: Received, _: bytes, respond: Respond) -> Awaitable[None] | None:
        def send(reply: Reply) -> None:
            respond(encode(reply))

        try:
            received.expect_in_time(self._who, self._now())  # it may have waited for its turn
            reply = self._answer(received, send)
            if inspect.isawaitable(reply):
                return self._finish(received.principal, reply, send)
            if reply is not None:
                send(shown(reply, received.principal, self._here))
        except Exception as error:  # noqa: BLE001 # as above
            send(refusal(error, self._who))
        return None

    async def _finish(self, principal: Principal, answer: Awaitable[Reply | None], send: SendReply) -> None:
        try:
            reply = await answer
            if reply is not None:
                send(shown(reply, principal, self._here))
        except Exception as error:  # noqa: BLE001 # as above
            send(refusal(error, self._who))


def refusal(error: Exception, who: str) -> Raised:
    """Return the reply for an error; what is no `VrError` is a fault of the agent, and logged."""
    if isinstance(error, VrError):
        return Raised.of(error)
    _log.error("%s: an answer failed", who, exc_info=error)
    return Raised.of(VrError(detail=f"{who}: internal error: {error!r}"))


def not_for(role: str, request: AnyRequest) -> Garbled:
    """Return the error for a request that an agent of this role does not answer."""
    return Garbled(key="a caller", detail=f"a {role} does not answer {type(request).__name__}")
