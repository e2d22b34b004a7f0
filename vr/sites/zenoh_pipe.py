"""The pipe over Zenoh: a client of one hub at a time, which it dials for ever.

Scouting and gossip are off: links that they find are not made anew, and a peer next to a router is not
reached, silently. It waits for a hub in a thread of its own, so nothing else waits for the network. All
messages have one priority: a full low one was seen to hold up the others, and the window of the stream
(`stream.py`) keeps the line from filling.

Hubs do not know each other, so sites meet only at the same one. Each site dials the first hub of its list
that answers, and goes back to an earlier one as soon as that answers again: sites that a fault has scattered
meet at the first hub that answers them all.
"""

from __future__ import annotations

import atexit
import base64
import logging
import socket
import ssl
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

import zenoh

from robotree.vr.sites.hub import LEASE, HubAddress, address_of, configured, fingerprint_of
from robotree.vr.sites.invitations import Hub
from robotree.vr.sites.pipe import LinkState, OnArrival

DIAL_WITHIN = 2.0
"""[s] for one try."""

FIRST_PAUSE, LONGEST_PAUSE = 0.2, 5.0
"""[s] between two tries."""

LOOK = 0.2
"""[s] between two looks whether the link is up."""

BACK = 3.0
"""[s] between two looks whether an earlier hub of the list answers again."""

_log = logging.getLogger(__name__)


class ZenohPipe:
    """See the module. It is open when it is made; `close` it."""

    def __init__(self, hubs: Sequence[Hub]) -> None:
        """Begin to dial.

        Args:
            hubs: the first one first; another one while it cannot be reached.
        """
        self._used = 0
        """Number of the hub that is used."""
        self._hubs = [(address_of(hub.address), hub.fingerprint) for hub in hubs]
        self._pinned: dict[HubAddress, str] = {}
        """Certificates of hubs that have shown the one which is known, as PEM."""
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._subscribed: list[tuple[str, OnArrival]] = []
        self._subscribers: list[zenoh.Subscriber] = []
        self._hints: list[Callable[[], None]] = []
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._state = LinkState(False, self._where, "it is being dialed")
        self._thread = threading.Thread(target=self._keep, name="hub", daemon=True)
        atexit.register(self.close)  # an exit without it aborts the process if traffic comes at that moment
        self._thread.start()

    @property
    def _where(self) -> str:
        if self._session is not None:
            return self._hubs[self._used][0].text
        return ", ".join(address.text for address, _ in self._hubs) or "no hub"

    def publish(self, topic: str, body: bytes) -> None:
        with self._lock:
            if self._session is None or self._over.is_set():
                return
            publisher = self._publishers.get(topic)
            if publisher is None:
                publisher = self._publishers[topic] = self._session.declare_publisher(
                    topic, congestion_control=zenoh.CongestionControl.DROP, express=True
                )
        with suppress(zenoh.ZError):  # closed meanwhile
            publisher.put(body)

    def subscribe(self, pattern: str, on_message: OnArrival) -> None:
        with self._lock:
            self._subscribed.append((pattern, on_message))
            if self._session is not None:
                self._declare(self._session, pattern, on_message)

    def hint(self, on_arrival: Callable[[], None]) -> None:
        self._hints.append(on_arrival)

    def state(self) -> LinkState:
        return self._state

    def close(self) -> None:
        atexit.unregister(self.close)
        if self._over.is_set():
            return
        self._over.set()
        self._thread.join(DIAL_WITHIN + 2.0)
        self._hang_up()

    # -- inside: in the own thread ----------------------------------------------------------------

    def _keep(self) -> None:
        """Keep a session with the first hub that answers; its link Zenoh makes anew by itself."""
        while not self._over.is_set():
            self._dial_until_one_answers()
            looked = time.monotonic()
            while self._session is not None and not self._over.wait(LOOK):
                up = bool(self._session.info.routers_zid())
                state = LinkState(up, self._where, "" if up else "no hub answers")
                if state != self._state:
                    self._state = state
                    if up:
                        for on_arrival in self._hints:
                            on_arrival()
                if len(self._hubs) > 1 and not up:
                    self._hang_up()
                elif self._used and time.monotonic() - looked > BACK:
                    looked = time.monotonic()
                    if any(not self._look(number) for number in range(self._used)):
                        self._hang_up()

    def _dial_until_one_answers(self) -> None:
        pause = FIRST_PAUSE
        while not self._over.is_set() and self._session is None:
            reasons = list[str]()
            for number in range(len(self._hubs)):
                reason = self._dial(number)
                if not reason or self._over.is_set():
                    break
                reasons.append(reason)
            if self._session is None:
                none = "the realm has no hub: `robotree realm create NAME --hub ADDRESS`"
                reason = "; ".join(reasons) or none
                if reason != self._state.reason:
                    _log.warning("no hub can be reached: %s", reason)
                self._state = LinkState(False, self._where, reason)
                self._over.wait(pause)
                pause = min(2 * pause, LONGEST_PAUSE)

    def _dial(self, number: int) -> str:
        """Open a session with a hub; returns why there is none, as a clause."""
        address, _ = self._hubs[number]
        if reason := self._look(number):
            return reason
        try:
            session = zenoh.open(configured(self._settings(address)))
        except zenoh.ZError:
            return f"{address.text} does not answer as a hub"
        with self._lock:
            self._session, self._used = session, number
            for pattern, on_message in self._subscribed:
                self._declare(session, pattern, on_message)
        return ""

    def _hang_up(self) -> None:
        """End the session, to dial anew."""
        with self._lock:
            session, self._session = self._session, None
            self._publishers.clear()
            self._subscribers.clear()
        if session is not None:
            session.close()

    def _settings(self, address: HubAddress) -> dict[str, object]:
        retry = "retry_period_init_ms=100;retry_period_max_ms=1000"
        found: dict[str, object] = {
            "mode": "client",
            "connect/endpoints": [f"{address.endpoint}#{retry}"],
            "connect/timeout_ms": int(DIAL_WITHIN * 1000),
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            # a hub that is stopped accepts a connection and says nothing
            "transport/unicast/open_timeout": 1_500,
            "transport/link/tx/lease": int(LEASE * 1000),
            "transport/link/tx/keep_alive": 4,
            "transport/shared_memory/enabled": False,
        }
        if pem := self._pinned.get(address, ""):
            found["transport/link/tls/root_ca_certificate_base64"] = base64.b64encode(pem.encode()).decode()
            found["transport/link/tls/verify_name_on_connect"] = False  # the certificate itself is known
        return found

    def _look(self, number: int) -> str:
        """See whether a hub answers, with the certificate that is known; returns why not, as a clause."""
        address, fingerprint = self._hubs[number]
        where = (address.host.strip("[]"), address.port)
        try:
            if not fingerprint:
                with socket.create_connection(where, timeout=DIAL_WITHIN):
                    return ""
            pem = ssl.get_server_certificate(where, timeout=DIAL_WITHIN)
        except (OSError, ValueError) as error:
            return f"{address.text} does not answer ({getattr(error, 'strerror', None) or error})"
        if fingerprint_of(pem) != fingerprint:
            return f"{address.text} is another hub than the one that was named: its certificate differs"
        self._pinned[address] = pem
        return ""

    def _declare(self, session: zenoh.Session, pattern: str, on_message: OnArrival) -> None:
        """Under the lock."""

        def take(sample: zenoh.Sample) -> None:
            on_message(str(sample.key_expr), sample.payload.to_bytes())

        callback = zenoh.handlers.Callback(take, None, indirect=False)
        self._subscribers.append(session.declare_subscriber(pattern, callback))
