"""A Zenoh session as robotree wants it: opened at the rendezvous, and surely closed.

What each setting is for, and what was seen without it (Zenoh 1.10.2), is said beside it.
"""

from __future__ import annotations

import atexit
import json
from pathlib import Path

import zenoh

from robotree.vr.errors import RealmUnusable
from robotree.vr.network.rendezvous import Rendezvous

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
    # behind, for ever: it is sent on and never read, and each further one is refused (MAX_LINKS). Whoever
    # hung is woken when somebody has given up on it, after 3 s; with a lease of 2 s and 1 s for the handshake
    # that was the same moment, and in 9 of 84 runs on a busy machine the two never met again.
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
    """One process's session in a realm. Its methods wait: call them in a thread."""

    def __init__(self, place: Rendezvous) -> None:
        """Prepare to enter at this place."""
        self._place = place
        self.zenoh: zenoh.Session | None = None
        """The session while it is open."""

    @property
    def realm(self) -> str:
        """The realm's name."""
        return self._place.realm

    @property
    def socket(self) -> Path:
        """The socket on which this process listens."""
        return self._place.socket

    def open(self) -> None:
        """Enter: dial all who are there, and be there for those who come.

        Raises:
            RealmUnusable: the door stays locked, or Zenoh cannot listen there.
        """
        with self._place.door() as neighbours:
            config = zenoh.Config()
            for key, value in _SETTINGS.items():
                config.insert_json5(key, json.dumps(value))
            config.insert_json5("listen/endpoints", json.dumps([self._place.locator]))
            dialed = [f"{locator}#{_RETRY}" for locator in neighbours]
            config.insert_json5("connect/endpoints", json.dumps(dialed))
            try:
                self.zenoh = zenoh.open(config)
            except zenoh.ZError as error:
                raise RealmUnusable(realm=self.realm, reason=str(error)) from None
            # an exit without close aborts the process if traffic comes at that moment
            atexit.register(self.close)
            self._place.enter()

    def announce(self, key: str) -> zenoh.LivelinessToken:
        """Be present under a key, for the network and at the rendezvous.

        Raises:
            zenoh.ZError: the session has closed meanwhile.
        """
        session = self.zenoh
        if session is None:
            raise zenoh.ZError(f"the session is closed: {key}")
        self._place.hold(key)  # first: who cannot be seen must be known of
        try:
            return session.liveliness().declare_token(key)
        except zenoh.ZError:
            self._place.let_go(key)
            raise

    def take_back(self, key: str, token: zenoh.LivelinessToken) -> None:
        """Be present no longer under a key."""
        token.undeclare()
        self._place.let_go(key)

    def held(self) -> dict[str, int]:
        """Return what the living processes of the realm hold present: process ids by key."""
        return self._place.held()

    def close(self) -> None:
        """Leave. Twice is once."""
        atexit.unregister(self.close)
        session, self.zenoh = self.zenoh, None
        if session is not None:
            session.close()
        self._place.leave()
