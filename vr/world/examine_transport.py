"""Everything that the contract of a transport promises, as checks for any implementation of it."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from robotree.vr.world import examine_presence, examine_requests
from robotree.vr.world.promises import Join

TRANSPORT_CHECKS: tuple[Callable[[Join], Awaitable[None]], ...] = (
    examine_requests.replies_keep_their_order,
    examine_requests.replies_stream,
    examine_requests.nobody_is_unreachable_at_once,
    examine_requests.a_handler_that_raises_ends_the_reply,
    examine_requests.silence_is_no_answer_in_time,
    examine_requests.requests_run_beside_each_other,
    examine_presence.samples_reach_whoever_subscribed,
    examine_presence.a_subscriber_that_raises_still_hears,
    examine_presence.presence_is_seen_by_early_and_late,
    examine_presence.presence_ends_with_the_last_holder,
    examine_presence.who_is_seen_can_be_asked,
    examine_presence.many_are_present,
    examine_presence.who_is_seen_does_not_hang,
    examine_presence.two_that_announce_at_once_know_of_each_other,
    examine_presence.a_closed_transport_says_so,
    examine_presence.a_handler_may_close_its_transport,
)


async def check_transport(join: Join) -> None:
    """Examine a transport.

    Args:
        join: returns the transport of a new member of one and the same network.

    Raises:
        AssertionError: a promise is broken.
    """
    for check in TRANSPORT_CHECKS:
        await check(join)
