"""The port at which browsers get the full screen: `robotree web`.

What a browser loads is our page, and the terminal for browsers xterm.js (MIT); nothing comes from elsewhere.
xterm.js comes in a bundle with the package textual-serve. The end of that bundle is a client for
textual-serve's own server, whose page loads a font from another host, which has no token and cannot be closed
to others; it is cut off, and what it is made of is handed to our page instead (decision 0130).
"""

from __future__ import annotations

import asyncio
import contextlib
import gzip
import http
import logging
import math
import secrets
import ssl
from collections.abc import AsyncGenerator, Iterable
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import textual_serve
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from robotree.tui import exit_codes
from robotree.tui.errors import NotInstalled, ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.processes.realm import only_looking
from robotree.tui.terminal import answer, note
from robotree.tui.web.door import LOOPBACK, Door, origin_of
from robotree.tui.web.session import Screen, Session, message_of, size_of

# -- what a browser loads --------------------------------------------------------------------------

BEGINS, TERMINAL, FIT, WIDTHS = (
    "class w{constructor(e,t){this.element=e",
    "v.Terminal",
    "g.FitAddon",
    "C.Unicode11Addon",
)
"""How the client in the bundle of textual-serve 1.1.3 begins, and what it is made of."""

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; connect-src 'self';"
    " img-src 'self' data:; manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""What the page may load (CSP 3). xterm.js writes the colours of cells into a style sheet of its own."""


class Asset(NamedTuple):
    """One file, as it is sent."""

    kind: str
    packed: bytes
    """By gzip."""


def assets() -> dict[str, Asset]:
    """Return what is served, by path.

    Raises:
        NotInstalled: the bundle is not the one that is known.
    """
    ours, theirs = files("robotree.tui.web").joinpath("page"), files(textual_serve).joinpath("static")
    page = Asset("text/html", _packed(ours.joinpath("index.html").read_bytes()))
    return {
        "/": page,
        "/user": page,
        "/page.css": Asset("text/css", _packed(ours.joinpath("page.css").read_bytes())),
        "/page.js": Asset("text/javascript", _packed(ours.joinpath("page.js").read_bytes())),
        "/xterm.css": Asset("text/css", _packed(theirs.joinpath("css", "xterm.css").read_bytes())),
        "/xterm.js": Asset(
            "text/javascript",
            _packed(handed_over(theirs.joinpath("js", "textual.js").read_text("utf-8")).encode()),
        ),
    }


def handed_over(bundle: str) -> str:
    """Return the bundle without the client at its end, which hands its parts over as `window.xterm`.

    Raises:
        NotInstalled: the bundle is another one.
    """
    whole, found, client = bundle.rpartition(BEGINS)
    if not found or not all(part in client for part in (TERMINAL, FIT, WIDTHS)):
        raise NotInstalled("web", "textual-serve 1.1.3", "pip install 'textual-serve==1.1.3'")
    parts = f"window.xterm={{Terminal:{TERMINAL},FitAddon:{FIT},Unicode11Addon:{WIDTHS}}}"
    return f"{whole}{parts}}})()}})();"


def _packed(content: bytes) -> bytes:
    return gzip.compress(content, mtime=0)


PORT = "7334"
HELLO = 5.0
"""[s] in which whoever connects says what he wants, and shows the token."""
MESSAGE = 65_536
"""Bytes of a message that is taken."""
TABS = "8"
NO_TOKEN = "without the token nothing is shown: open the address that `robotree web` printed"  # noqa: S105 # it is none
GOING_AWAY, REFUSED, CROWDED = 1001, 4401, 4429
"""Why a socket is closed: RFC 6455, section 7.4; and our own."""

PAUSE = 60.0
"""[s] between two lines about strangers."""

log = logging.getLogger(__name__)


class Strangers:
    """Counts those who come without a token: they could fill the log."""

    def __init__(self) -> None:
        """Nobody has come."""
        self._count, self._next = 0, -math.inf

    def told(self, now: float) -> str:
        """Take note of one more; return what is to be said, empty: nothing yet."""
        self._count += 1
        if now < self._next:
            return ""
        count, self._count, self._next = self._count, 0, now + PAUSE
        return (
            f"{count} came without the token of this place, and {'was' if count == 1 else 'were'} not let in"
        )


class Reception:
    """Lets browsers in and gives each tab a screen."""

    def __init__(self, door: Door, words: list[str], most: int) -> None:
        """Be ready for tabs.

        Args:
            door: what is let in.
            words: the command line before what a tab wants: the realm.
            most: tabs at the same time.
        """
        self._door, self._words, self._most = door, words, most
        self._assets = assets()
        self._spare: Screen | None = None
        self._getting_ready = asyncio.Lock()
        self._over = False
        self._strangers = Strangers()
        self.tabs = 0
        """How many are served now."""

    # -- pages -------------------------------------------------------------------------------------

    def answer(self, connection: ServerConnection, request: Request) -> Response | None:
        """Answer what is no WebSocket; None: it is one that may go on."""
        hosts = request.headers.get_all("Host")
        host = hosts[0] if len(hosts) == 1 else ""
        if reason := self._door.stranger(host):
            return connection.respond(http.HTTPStatus.MISDIRECTED_REQUEST, f"{reason}\n")
        path = request.path.partition("?")[0]
        if path == "/screen":
            if reason := self._door.foreign(request.headers.get("Origin", ""), host):
                return connection.respond(http.HTTPStatus.FORBIDDEN, f"{reason}\n")
            return None
        found = self._assets.get(path)
        if found is None:
            return connection.respond(http.HTTPStatus.NOT_FOUND, "there is no such page; open /\n")
        return self._page(found, packed=_takes_gzip(request.headers.get_all("Accept-Encoding")))

    @staticmethod
    def _page(asset: Asset, *, packed: bool) -> Response:
        body = asset.packed if packed else gzip.decompress(asset.packed)
        headers = Headers({
            "Content-Type": f"{asset.kind}; charset=utf-8",
            **({"Content-Encoding": "gzip"} if packed else {}),
            "Content-Length": str(len(body)),
            "Vary": "Accept-Encoding",
            "Content-Security-Policy": POLICY,
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-cache",
            "Connection": "close",
        })  # fmt: skip
        return Response(http.HTTPStatus.OK, "OK", headers, body)

    # -- tabs --------------------------------------------------------------------------------------

    async def meet(self, tab: ServerConnection) -> None:
        """Serve one tab for as long as it is there."""
        with contextlib.suppress(ConnectionClosed):
            try:
                async with asyncio.timeout(HELLO):
                    hello = message_of(await tab.recv())
            except TimeoutError:
                await tab.close(REFUSED, NO_TOKEN)
                return
            token = hello.get("token")
            right = self._door.right(token) if isinstance(token, str) else ""
            if not right:
                if said := self._strangers.told(asyncio.get_running_loop().time()):
                    note(said)
                await tab.close(REFUSED, NO_TOKEN)
            elif self.tabs >= self._most:
                await tab.close(
                    CROWDED, f"{self._most} tabs are open, and that is as many as there may be; close one"
                )
            else:
                self.tabs += 1
                try:
                    await self._serve(tab, hello, right)
                finally:
                    self.tabs -= 1
                    await self.prepare()

    async def _serve(self, tab: ServerConnection, hello: dict[str, object], right: str) -> None:
        screen = await self._screen()
        try:
            size = size_of(hello.get("size")) or (80, 24)
            screen.resize(*size)
            readonly = ["--readonly"] if right == "watch" else []
            screen.begin([*self._words, *readonly, "user" if hello.get("page") == "user" else "supervise"])
            getting_ready = asyncio.ensure_future(self.prepare())
            reason = await Session(tab, screen, size).last()
        finally:
            await asyncio.shield(screen.close())
        await getting_ready
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(HELLO):
                await tab.close(GOING_AWAY, reason)

    async def _screen(self) -> Screen:
        """Return the screen that has been got ready; or a new one."""
        found, self._spare = self._spare, None
        if found is not None and found.waits():
            return found
        if found is not None:
            await found.close()
        made = Screen()
        await made.open()
        return made

    async def prepare(self) -> None:
        """Get a screen ready for the next tab: it is there at once then."""
        async with self._getting_ready:
            if self._spare is None and self.tabs < self._most and not self._over:
                made = Screen()
                await made.open()
                self._spare = made

    async def close(self) -> None:
        """End what nobody wanted."""
        self._over = True
        async with self._getting_ready:
            if self._spare is not None:
                await self._spare.close()


def door_of(line: Line) -> tuple[Door, str, int, ssl.SSLContext | None]:
    """Return who is let in, and where: host, port, and what seals the connection.

    Raises:
        ValueRefused: the line does not say it properly.
    """
    given = line.text("--listen", f"127.0.0.1:{PORT}")
    host, _, port = (given if ":" in given else f"127.0.0.1:{given}").rpartition(":")
    if not (port.isdecimal() and int(port) < 65536 and host):
        raise ValueRefused("ADDRESS", f"{given!r} is none; write a port, such as {PORT}, or HOST:PORT")
    cert, origin = line.text("--cert"), line.text("--origin")
    if host not in LOOPBACK and not cert:
        raise ValueRefused(
            "ADDRESS",
            f"what goes to {host} could be read on the way; give --cert FILE, or leave the port on this"
            " machine and reach it by `ssh -L`",
        )
    sealed = _sealed(cert) if cert else None
    door = Door(
        command=secrets.token_urlsafe(32),
        watch=secrets.token_urlsafe(32),
        origins=frozenset({origin_of(origin)} if origin else ()),
        scheme="https" if sealed else "http",
        hosts=LOOPBACK | {host.lower()},
    )
    return door, host.strip("[]"), int(port), sealed


def _sealed(given: str) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        context.load_cert_chain(Path(given).expanduser())
    except (OSError, ssl.SSLError) as error:
        raise ValueRefused(
            "--cert", f"{given} is no certificate with its key: {error.strerror or error}"
        ) from None
    return context


@contextlib.asynccontextmanager
async def serving(
    reception: Reception, host: str, port: int, sealed: ssl.SSLContext | None = None
) -> AsyncGenerator[Server]:
    """Serve at a port for the time of a block; its tabs end with it."""
    quiet = logging.getLogger("robotree.tui.web.socket")
    quiet.setLevel(logging.CRITICAL)  # strangers could fill the log
    async with serve(
        reception.meet,
        host,
        port,
        ssl=sealed,
        process_request=reception.answer,
        open_timeout=HELLO,
        ping_interval=None,  # the beats of a session are answered by the page, those of the browser by itself
        close_timeout=2.0,
        max_size=MESSAGE,
        max_queue=16,
        server_header=None,
        compression=None,
        logger=quiet,
    ) as server:
        try:
            await reception.prepare()
            yield server
        finally:
            await reception.close()


async def web(line: Line, realm: str) -> int:
    """Serve the full screen to browsers until this is interrupted."""
    readonly = only_looking(given=line.flag("--readonly"))
    most = line.text("--tabs", TABS)
    if not (most.isdecimal() and 1 <= int(most) <= 64):
        raise ValueRefused("--tabs", f"{most!r} is no number from 1 to 64")
    door, host, port, sealed = door_of(line)
    words = ["--realm", realm, *(["--readonly"] if readonly else [])]
    reception = Reception(door, words, int(most))
    async with serving(reception, host, port, sealed) as server:
        found = next(iter(server.sockets)).getsockname()[1]
        name = f"[{host}]" if ":" in host else host
        shown = next(iter(door.origins), f"{door.scheme}://{name}:{found}")
        _tell(shown, door, realm, readonly=readonly)
        await asyncio.get_running_loop().create_future()
    return exit_codes.DONE


def _takes_gzip(headers: Iterable[str]) -> bool:
    """Return whether `Accept-Encoding` offers gzip: RFC 9110, section 12.5.3; a weight of 0 refuses it."""
    for each in ",".join(headers).split(","):
        name, _, weight = (part.strip().lower() for part in each.partition(";"))
        if name == "gzip":
            return weight.removeprefix("q=").strip("0.") != "" or not weight
    return False


def _tell(shown: str, door: Door, realm: str, *, readonly: bool) -> None:
    addresses = {"watch": f"{shown}/#{door.watch}"}
    if not readonly:
        addresses = {"command": f"{shown}/#{door.command}", **addresses}
    note(
        f"whoever has an address acts in realm {realm} as you do; with /user before its # it shows that page"
    )
    answer("\n".join(f"ready to {what}: {where}" for what, where in addresses.items()), lambda: addresses)
