"""`can:INTERFACE/CHANNEL?option=value&…`, taken apart. Pure.

Options: `node`, the controller's number; `host`, the host's own (by chance if left out); `fd`; `bitrate`
and `data_bitrate`; `silence`, see `SilenceTimer`; `telemetry`, see `Telemetry`; and `bus.NAME=VALUE` for
whatever else the interface of python-can understands.
"""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.errors import BadUrl
from robotree.protocol.links.can.identifiers import CONTROLLERS, HOSTS
from robotree.protocol.links.url import Url

if TYPE_CHECKING:
    from collections.abc import Iterable

_OWN = ("node", "host", "fd", "bitrate", "data_bitrate", "silence", "telemetry")
_PASSED_ON = "bus."


class Telemetry(StrEnum):
    """Which hosts get a controller's telemetry that fits one frame."""

    AUTO = "auto"
    """To all while one host is linked, who then hears it like any listener; to each if there are several,
    for each has its own rates, sequence numbers and signature."""
    BROADCAST = "broadcast"
    """To all, always: for a controller that gives all its links the same bytes. They go out once."""
    ADDRESSED = "addressed"
    """To each host by itself."""


class CanAddress(msgspec.Struct, frozen=True, kw_only=True):
    """Where a bus is, and who we are on it."""

    interface: str
    channel: str
    node: int = 1
    """The controller's number."""
    host: int | None = None
    """The host's number; None: any that is free."""
    fd: bool = True
    bitrate: int | None = None
    """[bit/s]"""
    data_bitrate: int | None = None
    """[bit/s] of the data field of CAN FD frames."""
    silence: float | None = None
    """[s] after which a partner has gone; None: the usual."""
    telemetry: Telemetry = Telemetry.AUTO
    passed_on: dict[str, str] = {}
    """For the interface."""

    def __str__(self) -> str:
        fd = "" if self.fd else "&fd=0"
        host = "" if self.host is None else f"&host={self.host}"
        return f"can:{self.interface}/{self.channel}?node={self.node}{host}{fd}"

    @property
    def bus_options(self) -> dict[str, int | bool | str]:
        """The arguments of `can.Bus` besides interface and channel."""
        options: dict[str, int | bool | str] = {"fd": self.fd, **self.passed_on}
        if self.bitrate is not None:
            options["bitrate"] = self.bitrate
        if self.data_bitrate is not None:
            options["data_bitrate"] = self.data_bitrate
        return options


def read(url: Url) -> CanAddress:
    """Take an address apart.

    Raises:
        BadUrl: it means nothing.
    """
    interface, _, channel = url.where.partition("/")
    if not interface or not channel:
        raise BadUrl(url.text, "write can:INTERFACE/CHANNEL, as in can:robotree/cell or can:socketcan/can0")
    passed_on = {name.removeprefix(_PASSED_ON): value for name, value in _split(url, passed_on=True)}
    own = dict(_split(url, passed_on=False))
    Url(url.text, url.scheme, url.where, own).only(*_OWN)
    telemetry = own.get("telemetry", Telemetry.AUTO)
    if telemetry not in set(Telemetry):
        raise BadUrl(url.text, f"telemetry={telemetry} is none of {', '.join(Telemetry)}")
    return CanAddress(
        interface=interface,
        channel=channel,
        node=_number(url, own, "node", CONTROLLERS) or 1,
        host=_number(url, own, "host", HOSTS),
        fd=bool(_number(url, {"fd": "1", **own}, "fd", range(2))),
        bitrate=_number(url, own, "bitrate", range(1, 10**9)),
        data_bitrate=_number(url, own, "data_bitrate", range(1, 10**9)),
        silence=_seconds(url, own, "silence"),
        telemetry=Telemetry(telemetry),
        passed_on=passed_on,
    )


def _split(url: Url, *, passed_on: bool) -> Iterable[tuple[str, str]]:
    return [each for each in url.options.items() if each[0].startswith(_PASSED_ON) is passed_on]


def _number(url: Url, options: dict[str, str], name: str, allowed: range) -> int | None:
    text = options.get(name)
    if text is None:
        return None
    if not (text.isascii() and text.isdigit()) or int(text) not in allowed:
        problem = f"{name}={text} is no whole number from {allowed.start} to {allowed.stop - 1}"
        raise BadUrl(url.text, problem)
    return int(text)


def _seconds(url: Url, options: dict[str, str], name: str) -> float | None:
    text = options.get(name)
    if text is None:
        return None
    try:
        seconds = float(text)
    except ValueError:
        seconds = 0.0
    if not 0.01 <= seconds <= 3600:
        raise BadUrl(url.text, f"{name}={text} is no time from 0.01 to 3600 s")
    return seconds
