"""The pipe over Zenoh: a client of each hub of the list, which are dialed for ever.

Hubs do not know each other: linked routers lose routes silently when they form a circle. Instead a gateway is
a client of all of them at once, by sessions that know nothing of each other either. A message goes by the
first hub of the list at which the other gateway is heard, which that hub tells (Zenoh's matching status). So
two sites meet wherever both reach any hub; when a hub dies, what follows goes by the next one without a dial;
and when it is back, nothing is cut to return to it.

Scouting and gossip are off: links that they find are not made anew, and a peer next to a router is not
reached, silently. It waits for each hub in a thread of its own, so nothing else waits for the network. All
messages have one priority: a full low one was seen to hold up the others, and the window of the stream
(`stream.py`) keeps the line from filling.
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
from robotree.vr.sites.networks import LinkState, OnArrival

DIAL_WITHIN = 2.0
"""[s] for one try."""

FIRST_PAUSE, LONGEST_PAUSE = 0.2, 2.0
"""[s] between two tries."""

LOOK = 0.2
"""[s] between two looks whether the link is up."""

ANEW = 5.0
"""[s] without a link after which a session is made anew: until then Zenoh makes the link anew by itself."""

_log = logging.getLogger(__name__)


class _Way:
    """The session with one hub. It is open when it is made; `close` it."""

    def __init__(self, hub: Hub, on_up: Callable[[], None]) -> None:
        self.address, self._fingerprint = address_of(hub.address), hub.fingerprint
        self.up = False
        """Whether it can be used now."""
        self.reason: str = "it is being dialed"
        """Why it cannot, as a clause."""
        self._on_up = on_up
        self._pinned: dict[HubAddress, str] = {}
        """Certificates that have shown to be the one which is known, as PEM."""
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._subscribed: list[tuple[str, OnArrival]] = []
        self._subscribers: list[zenoh.Subscriber] = []
        self._lock = threading.Lock()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._keep, name=f"hub {self.address.text}", daemon=True)
        self._thread.start()

    def publish(self, topic: str, body: bytes, *, unheard: bool) -> bool:
        """Send to who subscribes to a topic at this hub; returns whether it knows of anybody who does.

        Args:
            topic: where.
            body: what.
            unheard: whether to send it also if not.
        """
        with self._lock:
            if self._session is None or not self.up or self._over.is_set():
                return False
            publisher = self._publishers.get(topic)
            if publisher is None:
                publisher = self._publishers[topic] = self._session.declare_publisher(
                    topic, congestion_control=zenoh.CongestionControl.DROP, express=True
                )
        with suppress(zenoh.ZError):  # closed meanwhile
            heard = publisher.matching_status.matching
            if heard or unheard:
                publisher.put(body)
            return heard
        return False

    def subscribe(self, pattern: str, on_message: OnArrival) -> None:
        """See `Pipe`."""
        with self._lock:
            self._subscribed.append((pattern, on_message))
            if self._session is not None:
                self._declare(self._session, pattern, on_message)

    def let_go(self) -> None:
        """Begin to end: its thread ends at the next look."""
        self._over.set()

    def close(self) -> None:
        """Leave."""
        self.let_go()
        self._thread.join(DIAL_WITHIN + 2.0)
        self._hang_up()

    # -- inside: in the own thread ----------------------------------------------------------------

    def _keep(self) -> None:
        """Keep a session. Its link Zenoh makes anew by itself; if it does not, the session is made anew."""
        pause = FIRST_PAUSE
        while not self._over.is_set():
            reason = self._dial()
            if reason:
                if reason != self.reason:
                    _log.warning("a hub cannot be reached: %s", reason)
                self.up, self.reason = False, reason
                self._over.wait(pause)
                pause = min(2 * pause, LONGEST_PAUSE)
                continue
            pause, was_up = FIRST_PAUSE, time.monotonic()
            while not self._over.wait(LOOK) and time.monotonic() - was_up < ANEW:
                if self._see():
                    was_up = time.monotonic()
            if not self._over.is_set():
                self._hang_up()

    def _see(self) -> bool:
        """Look whether the link is up."""
        session = self._session
        up = session is not None and bool(session.info.routers_zid())
        came, self.up = up and not self.up, up
        self.reason = "" if up else f"{self.address.text} does not answer"
        if came:
            self._on_up()
        return up

    def _dial(self) -> str:
        """Open a session; returns why there is none, as a clause."""
        if reason := self._look():
            return reason
        try:
            session = zenoh.open(configured(self._settings()))
        except zenoh.ZError:
            return f"{self.address.text} does not answer as a hub"
        with self._lock:
            self._session = session
            for pattern, on_message in self._subscribed:
                self._declare(session, pattern, on_message)
        self._see()
        return ""

    def _hang_up(self) -> None:
        with self._lock:
            session, self._session = self._session, None
            self.up = False
            self._publishers.clear()
            self._subscribers.clear()
        if session is not None:
            session.close()

    def _settings(self) -> dict[str, object]:
        retry = "retry_period_init_ms=100;retry_period_max_ms=1000"
        found: dict[str, object] = {
            "mode": "client",
            "connect/endpoints": [f"{self.address.endpoint}#{retry}"],
            "connect/timeout_ms": int(DIAL_WITHIN * 1000),
            "scouting/multicast/enabled": False,
            "scouting/gossip/enabled": False,
            # a hub that is stopped accepts a connection and says nothing
            "transport/unicast/open_timeout": 1_500,
            "transport/link/tx/lease": int(LEASE * 1000),
            "transport/link/tx/keep_alive": 4,
            "transport/shared_memory/enabled": False,
        }
        if pem := self._pinned.get(self.address, ""):
            found["transport/link/tls/root_ca_certificate_base64"] = base64.b64encode(pem.encode()).decode()
            found["transport/link/tls/verify_name_on_connect"] = False  # the certificate itself is known
        return found

    def _look(self) -> str:
        """See whether the hub answers, with the certificate that is known; returns why not, as a clause."""
        address = self.address
        where = (address.host.strip("[]"), address.port)
        try:
            if not self._fingerprint:
                with socket.create_connection(where, timeout=DIAL_WITHIN):
                    return ""
            pem = ssl.get_server_certificate(where, timeout=DIAL_WITHIN)
        except (OSError, ValueError) as error:
            return f"{address.text} does not answer ({getattr(error, 'strerror', None) or error})"
        if fingerprint_of(pem) != self._fingerprint:
            return f"{address.text} is another hub than the one that was named: its certificate differs"
        self._pinned[address] = pem
        return ""

    def _declare(self, session: zenoh.Session, pattern: str, on_message: OnArrival) -> None:
        """Under the lock."""

        def take(sample: zenoh.Sample) -> None:
            on_message(str(sample.key_expr), sample.payload.to_bytes())

        callback = zenoh.handlers.Callback(take, None, indirect=False)
        self._subscribers.append(session.declare_subscriber(pattern, callback))


class ZenohPipe:
    """See the module. It is open when it is made; `close` it."""

    def __init__(self, hubs: Sequence[Hub]) -> None:
        """Begin to dial.

        Args:
            hubs: the first one first; another one where that one does not know of the other side.
        """
        self._hints: list[Callable[[], None]] = []
        self._ways = [_Way(hub, self._came_up) for hub in hubs]
        atexit.register(self.close)  # an exit without it aborts the process if traffic comes at that moment

    def publish(self, topic: str, body: bytes, *, to_all: bool = False) -> None:
        """See `Pipe`."""
        if to_all:
            for way in self._ways:
                way.publish(topic, body, unheard=True)
        elif not any(way.publish(topic, body, unheard=False) for way in self._ways):
            for way in self._ways:  # what a hub knows of its clients may be on the way
                way.publish(topic, body, unheard=True)

    def subscribe(self, pattern: str, on_message: OnArrival) -> None:
        """See `Pipe`."""
        for way in self._ways:
            way.subscribe(pattern, on_message)

    def hint(self, on_arrival: Callable[[], None]) -> None:
        """See `Pipe`."""
        self._hints.append(on_arrival)

    def state(self) -> LinkState:
        """See `Pipe`; the hub is the first one that is reached."""
        for way in self._ways:
            if way.up:
                return LinkState(True, way.address.text)
        where = ", ".join(way.address.text for way in self._ways) or "no hub"
        none = "the realm has no hub: `robotree realm create NAME --hub ADDRESS`"
        return LinkState(False, where, "; ".join(way.reason for way in self._ways) or none)

    def close(self) -> None:
        """See `Pipe`."""
        atexit.unregister(self.close)
        ways, self._ways = self._ways, []
        for way in ways:
            way.let_go()
        for way in ways:
            way.close()

    def _came_up(self) -> None:
        for on_arrival in self._hints:
            on_arrival()
