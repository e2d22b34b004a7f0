"""A Zenoh session as robotree wants it, and surely closed.

What each setting is for, and what was seen without it (Zenoh 1.10.2), is said beside it.
"""

from __future__ import annotations

import atexit
import json
from collections.abc import Sequence

import zenoh

from robotree.vr.base.errors import NetworkUnusable

LEASE = 2.0
"""[s] of silence after which a process counts as gone. With 1 s a busy machine was enough to lose one."""

_SETTINGS: dict[str, object] = {
    "mode": "peer",
    "scouting/multicast/enabled": False,
    "scouting/gossip/enabled": False,  # links that gossip finds are not made anew when they break
    "scouting/delay": 100,  # [ms] that `open` waits for neighbours which are listed but do not answer
    # [ms] for a handshake. A neighbour that is stopped accepts a connection and says nothing; `close` waits
    # for the handshake, so with Zenoh's own 10 s every short-lived process would take as long to end.
    # A handshake that is answered in the very millisecond in which its time is over leaves half a link
    # behind, for ever: it is sent on and never read, and each further one is refused (MAX_LINKS). A
    # process that hung is woken when somebody has given up on it, after 3 s; with a lease of 2 s and 1 s for
    # the handshake that was the same moment, and in 9 of 84 runs on a busy machine the two never met again.
    "transport/unicast/open_timeout": 1_500,
    "transport/unicast/accept_timeout": 1_500,
    "transport/link/tx/lease": int(LEASE * 1000),
    "transport/link/tx/keep_alive": 4,
    "transport/link/tx/queue/congestion_control/block/wait_before_close": 1_000_000,  # [us]; default 5 s
    # 16 MB of /dev/shm for each process: more than a container has, and left behind by a kill
    "transport/shared_memory/enabled": False,
}
_RETRY = "retry_period_init_ms=100;retry_period_max_ms=1000"


class Session:
    """One process's session. Its methods wait: call them in a thread."""

    def __init__(self, listen: Sequence[str], connect: Sequence[str]) -> None:
        """Prepare.

        Args:
            listen: locators at which others may dial, like `tcp/127.0.0.1:7447`.
            connect: locators to dial, again and again until they answer. Of two processes only one may dial
                the other: two that dial each other can end up split for ever (zenoh issue 2806).
        """
        self._listen, self._connect = listen, connect
        self.zenoh: zenoh.Session | None = None
        """The session while it is open."""

    def open(self) -> None:
        """Open it.

        Raises:
            NetworkUnusable: Zenoh cannot listen there.
        """
        config = zenoh.Config()
        for key, value in _SETTINGS.items():
            config.insert_json5(key, json.dumps(value))
        config.insert_json5("listen/endpoints", json.dumps(list(self._listen)))
        config.insert_json5("connect/endpoints", json.dumps([f"{one}#{_RETRY}" for one in self._connect]))
        try:
            self.zenoh = zenoh.open(config)
        except zenoh.ZError as error:
            raise NetworkUnusable(
                where=", ".join((*self._listen, *self._connect)), reason=str(error)
            ) from None
        # an exit without close aborts the process if traffic comes at that moment
        atexit.register(self.close)

    def close(self) -> None:
        """Close it. Twice is once."""
        atexit.unregister(self.close)
        session, self.zenoh = self.zenoh, None
        if session is not None:
            session.close()
