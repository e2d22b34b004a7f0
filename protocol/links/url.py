"""Addresses of links: `SCHEME:WHERE?OPTION=VALUE&…`, and the registry of schemes.

>>> parse("tcp:127.0.0.1:5760").host_and_port()
('127.0.0.1', 5760)
>>> parse("tcp:5760").host_and_port()
('127.0.0.1', 5760)
"""

from __future__ import annotations

import ipaddress
from importlib import import_module
from typing import TYPE_CHECKING, Protocol, cast
from urllib.parse import parse_qsl

import msgspec

from robotree.protocol.errors import BadUrl

if TYPE_CHECKING:
    from robotree.protocol.links.link import Accept, Handler, Link, Listener

LOOPBACK = "127.0.0.1"
CONTROLLER = "controller"
"""The option that every address may have: the name by which the controller's key is found."""
SCHEMES = {
    "can": "robotree.protocol.links.can",
    "serial": "robotree.protocol.links.serial",
    "tcp": "robotree.protocol.links.tcp",
    "udp": "robotree.protocol.links.udp",
}
"""The module of each scheme, imported when first used. It has the functions of `Scheme`."""


class Scheme(Protocol):
    """The functions that the module of a scheme offers."""

    async def connect_url(self, url: Url, accept: Accept) -> Link:
        """Open the link that the address names."""
        ...

    async def listen_url(self, url: Url, accept: Accept, *, exposed: bool) -> Listener:
        """Wait for links at the address."""
        ...


class Url(msgspec.Struct, frozen=True):
    """A taken-apart address."""

    text: str
    scheme: str
    where: str
    options: dict[str, str]
    controller: str = ""
    """Name of the controller at the end where one listens, see `Link.controller`; empty: its address."""

    def host_and_port(self) -> tuple[str, int]:
        """Of an address `HOST:PORT`, `[HOST]:PORT` or `PORT` (on this machine).

        Raises:
            BadUrl: it is none.
        """
        host, _, port = self.where.rpartition(":")
        host = host.removeprefix("[").removesuffix("]") if host.startswith("[") else host
        if not port.isascii() or not port.isdigit() or int(port) > 0xFFFF:
            problem = f"{port!r} is no port; write {self.scheme}:HOST:PORT with a port up to 65535"
            raise BadUrl(self.text, problem)
        if ":" in host and "[" not in self.where:
            raise BadUrl(self.text, "write an IPv6 address in brackets")
        return host or LOOPBACK, int(port)

    def only(self, *known: str) -> dict[str, str]:
        """The options, all of which must be known.

        Raises:
            BadUrl: one is not.
        """
        for name in self.options:
            if name not in known:
                raise BadUrl(self.text, f"option {name!r} is unknown; there is {', '.join(known) or 'none'}")
        return self.options


def parse(text: str) -> Url:
    """Take an address apart.

    Raises:
        BadUrl: it has no scheme, or one that we do not know.
    """
    scheme, colon, rest = text.partition(":")
    if not colon or scheme not in SCHEMES:
        raise BadUrl(text, f"begin it with {' or '.join(f'{name}:' for name in sorted(SCHEMES))}")
    where, _, query = rest.partition("?")
    try:
        options = dict(parse_qsl(query, keep_blank_values=True, strict_parsing=True)) if query else {}
    except ValueError as error:
        raise BadUrl(text, "write options as ?name=value&name=value") from error
    controller = options.pop(CONTROLLER, "")
    if not controller.isascii() or any(each.isspace() or not each.isprintable() for each in controller):
        raise BadUrl(text, f"{CONTROLLER}={controller!r} is no name; write letters and digits without spaces")
    return Url(text, scheme, where, options, controller)


def require_loopback(address: str, host: str, *, exposed: bool) -> None:
    """Refuse to listen where other machines can reach us, unless somebody asked for it.

    Raises:
        BadUrl: `host` is not loopback and `exposed` is not set.
    """
    if not exposed and not _is_loopback(host):
        reached = f"{host or 'every address'} can be reached from outside"
        raise BadUrl(address, f"{reached}; listen on {LOOPBACK}, and let a tunnel such as ssh lead there")


def instead(address: str) -> str:
    """Return the advice for an address that is in use when we want to listen there.

    Args:
        address: any; one that means nothing gets the most general advice.
    """
    match address.partition(":")[0]:
        case "tcp" | "udp":
            return "choose another port (0: any free one) or end its owner"
        case "can":
            return "choose another number with ?node=N, or end who has this one"
        case "serial":
            return "name the device of a port that is there, or end its owner"
        case _:
            return "choose another address"


def is_private(address: str) -> bool:
    """Whether a link leads to a program of this machine, and no other program can read along.

    TCP and UDP from loopback, and the link of tests. A serial line leads anywhere, and what is said on a bus,
    also on one between processes, is heard by everybody on it.

    Args:
        address: of the open link, with the far end's host.
    """
    scheme, _, where = address.partition(":")
    if scheme in ("tcp", "udp"):
        try:
            return _is_loopback(Url(address, scheme, where, {}).host_and_port()[0])
        except BadUrl:
            return False
    return scheme == "loop"


def _is_loopback(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def _module(url: Url) -> Scheme:
    return cast("Scheme", import_module(SCHEMES[url.scheme]))


def _naming(url: Url, accept: Accept) -> Accept:
    """Let the address name the controller of each link that opens, if it does."""

    def name_and_accept(link: Link) -> Handler:
        link.controller = url.controller
        return accept(link)

    return name_and_accept if url.controller else accept


async def connect(url: str | Url, accept: Accept) -> Link:
    """Open the link that an address names.

    Raises:
        BadUrl: the address means nothing.
        LinkRefused: it cannot be opened.
    """
    taken = parse(url) if isinstance(url, str) else url
    return await _module(taken).connect_url(taken, _naming(taken, accept))


async def listen(url: str | Url, accept: Accept, *, exposed: bool = False) -> Listener:
    """Wait for links at an address.

    Raises:
        BadUrl: the address means nothing, or is not loopback and `exposed` is not set.
        LinkRefused: it is taken.
    """
    taken = parse(url) if isinstance(url, str) else url
    return await _module(taken).listen_url(taken, _naming(taken, accept), exposed=exposed)
