"""MAVLink over a serial line: `serial:/dev/ttyUSB0?baud=57600`, 8 data bits, no parity, one stop bit.

A serial line has no connections: there is a link while the port exists. Both ends do the same, but a listener
opens the port again when an unplugged adapter is back.

A line is slow and its driver buffers much, so frames are handed to the driver only while its buffer is nearly
empty: frames wait here, where newer telemetry replaces older.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import grp
import logging
import os
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import serial

from robotree.files import forks
from robotree.protocol.errors import BadUrl, LinkBroken, LinkClosed, LinkError, LinkRefused
from robotree.protocol.frame import LARGEST_FRAME
from robotree.protocol.links.in_thread import opened
from robotree.protocol.links.link import handler_of
from robotree.protocol.links.outbox import Outbox
from robotree.protocol.links.sockets import cause

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable

    from serial import Serial

    from robotree.protocol.links.link import Accept, Handler, Link, LinkStatistics, Listener, Unsent
    from robotree.protocol.links.url import Url

BAUD = 57600
"""[bit/s] what telemetry radios and most autopilots are set to."""
BAUDS = range(50, 4_000_001)
"""[bit/s] what termios knows."""

NO_PORT = "it is no serial port; name the device of one"


class Setting(msgspec.Struct, frozen=True):
    """Which port, and how both ends are set. 8 data bits, no parity, one stop bit."""

    device: str
    """Such as `/dev/ttyUSB0`."""
    baud: int = BAUD
    """[bit/s]"""
    rtscts: bool = False
    """Whether the line has hardware flow control."""

    def __str__(self) -> str:
        return f"serial:{self.device}?baud={self.baud}{'&rtscts=1' if self.rtscts else ''}"


async def open_port(setting: Setting) -> serial.Serial:
    """Open a port for us alone; reading and writing never wait.

    Raises:
        LinkRefused: it cannot be had.
        BadUrl: it has no such speed.
    """

    def open_it() -> serial.Serial:  # some adapters take their time
        return serial.Serial(
            setting.device,
            setting.baud,
            timeout=0,
            write_timeout=0,
            rtscts=setting.rtscts,
            exclusive=True,
        )

    try:
        return await opened(open_it, lambda port: port.close())
    except OSError as error:
        raise LinkRefused(str(setting), _refused(error, setting.device)) from error
    except ValueError as error:
        problem = f"the port has no speed of {setting.baud} bit/s; choose another baud="
        raise BadUrl(str(setting), problem) from error


def ended(error: OSError) -> str:
    """Why a port is of no more use; EIO is what most drivers say of an adapter that was pulled out."""
    return "it was unplugged" if error.errno in {errno.EIO, errno.ENXIO, errno.ENODEV} else cause(error)


def _refused(error: OSError, device: str) -> str:
    """Why a port could not be opened, and what to do about it."""
    match error.errno:
        case errno.ENOENT | errno.ENXIO | errno.ENODEV:
            return "there is no such device; plug it in, or look for its name in /dev/serial/by-id"
        case errno.EACCES | errno.EPERM:
            return f"permission denied; join the group {_group(device)} and log in again"
        case errno.EBUSY | errno.EAGAIN:
            return "another program uses it; end that program"
        case errno.EISDIR:
            return NO_PORT
        case None if "configure" in str(error):  # pyserial hands on what termios says as text alone
            return NO_PORT
        case _:
            return cause(error)


def _group(device: str) -> str:
    """The group whose members may use a device: dialout on Debian, uucp on Arch."""
    with contextlib.suppress(OSError, KeyError):
        return grp.getgrgid(Path(device).stat().st_gid).gr_name
    return "dialout"


_log = logging.getLogger(__name__)

FRESH = 0.05
"""[s] of transmission that the driver may keep; telemetry grows so old at most before it leaves."""
SMALLEST_RESERVE = LARGEST_FRAME
"""[bytes] that the driver may keep however slow the line is: one frame."""
LOOK = 0.01
"""[s] between two looks whether the driver has sent what it keeps."""
AGAIN = 1.0
"""[s] between two attempts of a listener to open a port that is gone."""
_PIECE = 4096
_BITS_PER_BYTE = 10
"""A start bit, 8 data bits, a stop bit."""


class SerialLink:
    """One open port. Made by `connect` and `listen`.

    Args:
        port: open, and ours alone.
        setting: what it was opened as.
        on_end: told when the link has ended, before its handler.
    """

    def __init__(
        self,
        port: Serial,
        setting: Setting,
        on_end: Callable[[], None] = lambda: None,
    ) -> None:
        self.address = self.controller = str(setting)
        self._port, self._descriptor, self._on_end = port, port.fileno(), on_end
        self._reserve = max(SMALLEST_RESERVE, round(FRESH * setting.baud / _BITS_PER_BYTE))
        self._loop = asyncio.get_running_loop()
        self._outbox = Outbox()
        self._rest = b""
        """The end of a frame whose beginning the driver has."""
        self._full = False
        self._timer: asyncio.TimerHandle | None = None
        self._reason: LinkError | None = None
        self._handler: Handler | None = None
        forks.owns(self)

    def in_child(self) -> Iterable[int]:
        return (self._descriptor,) if self._reason is None else ()

    def begin(self, accept: Accept) -> None:
        """Let somebody hear the link; who closes it at once is told of the end at once, too."""
        self._handler = handler_of(self, accept)
        if self._reason is not None:
            self._handler.closed(self._reason)
        else:
            self._loop.add_reader(self._descriptor, self._readable)

    @property
    def congested(self) -> bool:
        """Whether frames wait for the line."""
        return bool(self._rest) or self._outbox.waiting > 0 or not self._has_room()

    @property
    def statistics(self) -> LinkStatistics:
        """The gauges now."""
        return self._outbox.statistics(len(self._rest))

    def send(self, frame: bytes | Unsent, topic: Hashable | None = None) -> None:
        """Send one whole frame, or queue it."""
        if self._reason is not None:
            self._outbox.dropped += 1
            return
        self._outbox.put(frame, topic)
        self._pump()
        if (overrun := self._outbox.overrun(self.address)) is not None:
            self._end(overrun)

    def close(self) -> None:
        """End the link; the far end is not told."""
        self._end(LinkClosed(self.address, by_us=True))

    # -- out ---------------------------------------------------------------------------------------

    def _has_room(self) -> bool:
        """Whether the driver has so little that a frame would leave soon."""
        if self._reason is not None or self._full:
            return False
        try:
            return self._port.out_waiting <= self._reserve
        except OSError:  # the reader will be told why
            return False

    def _pump(self) -> None:
        """Hand over what waits, as far as it leaves soon."""
        while self._reason is None and not self._full:
            if not self._rest:
                if not self._outbox.waiting:
                    return
                if not self._has_room():
                    self._look_again()
                    return
                self._rest = self._outbox.pop() or b""
            self._write()

    def _write(self) -> None:
        # Not through Serial.write, which spins while a port that shall not block has no room.
        try:
            count = os.write(self._descriptor, self._rest)
        except BlockingIOError:
            self._full = True
            self._loop.add_writer(self._descriptor, self._writable)
        except OSError as error:
            self._end(LinkBroken(self.address, ended(error)))
        else:
            self._rest = self._rest[count:]

    def _writable(self) -> None:
        self._full = False
        self._loop.remove_writer(self._descriptor)
        self._pump()

    def _look_again(self) -> None:
        """No event reports that a driver has sent its buffer."""
        if self._timer is None:
            self._timer = self._loop.call_later(LOOK, self._looked)

    def _looked(self) -> None:
        self._timer = None
        self._pump()

    # -- in ----------------------------------------------------------------------------------------

    def _readable(self) -> None:
        try:
            data = os.read(self._descriptor, _PIECE)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(LinkBroken(self.address, ended(error)))
            return
        if data and self._handler is not None:
            self._outbox.received += len(data)
            self._handler.received(data)
        else:  # what a port says, again and again, whose adapter is gone
            self._end(LinkBroken(self.address, "it was unplugged"))

    # -- the end -----------------------------------------------------------------------------------

    def _end(self, reason: LinkError) -> None:
        if self._reason is not None:
            return
        self._reason = reason
        self._loop.remove_reader(self._descriptor)
        self._loop.remove_writer(self._descriptor)
        if self._timer is not None:
            self._timer.cancel()
        with contextlib.suppress(OSError):  # the port may be gone already
            self._port.close()
        self._on_end()
        if self._handler is not None:
            self._handler.closed(reason)


class SerialListener:
    """Has a link while its port is there. Made by `listen`."""

    def __init__(self, setting: Setting, accept: Accept, again: float) -> None:
        self.address = str(setting)
        """Of our end of the cable; who connects names the other end."""
        self._setting, self._accept, self._pause = setting, accept, again
        self._link: SerialLink | None = None
        self._again: asyncio.Task[None] | None = None
        self._closing = False

    @property
    def links(self) -> frozenset[Link]:
        """The link, while there is one."""
        return frozenset() if self._link is None else frozenset({self._link})

    async def open(self) -> None:
        """Open the port.

        Raises:
            LinkRefused: it cannot be had.
            BadUrl: it has no such speed.
        """
        port = await open_port(self._setting)
        if self._closing:
            port.close()
            return
        self._link = link = SerialLink(port, self._setting, self._ended)
        link.begin(self._accept)

    async def close(self) -> None:
        """Leave the port and end its link."""
        self._closing = True
        if self._again is not None:
            self._again.cancel()
            await asyncio.gather(self._again, return_exceptions=True)
        if self._link is not None:
            self._link.close()

    def _ended(self) -> None:
        self._link = None
        if not self._closing:
            self._again = asyncio.get_running_loop().create_task(self._open_again())

    async def _open_again(self) -> None:
        last_problem = ""
        while True:
            await asyncio.sleep(self._pause)
            try:
                return await self.open()
            except LinkError as error:  # also BadUrl: the adapter that was plugged in may not have the speed
                if last_problem != str(error):
                    _log.warning("%s; tried again every %g s", error, self._pause)
                last_problem = str(error)


async def connect(setting: Setting, accept: Accept) -> Link:
    """Open the port.

    Raises:
        LinkRefused: it cannot be had.
        BadUrl: it has no such speed.
    """
    link = SerialLink(await open_port(setting), setting)
    link.begin(accept)
    return link


async def listen(setting: Setting, accept: Accept, again: float = AGAIN) -> Listener:
    """Have a link whenever the port is there, beginning now.

    Args:
        setting: the port.
        accept: hears of every link.
        again: [s] between two attempts to open the port when it is gone.

    Raises:
        LinkRefused: it cannot be had now.
        BadUrl: it has no such speed.
    """
    listener = SerialListener(setting, accept, again)
    await listener.open()
    return listener


def read(url: Url) -> Setting:
    """Take an address apart.

    Raises:
        BadUrl: it means nothing.
    """
    options = url.only("baud", "rtscts")
    if not url.where:
        raise BadUrl(url.text, "write serial:DEVICE, as in serial:/dev/ttyUSB0?baud=57600")
    baud, rtscts = options.get("baud", str(BAUD)), options.get("rtscts", "0")
    if not (baud.isascii() and baud.isdigit() and int(baud) in BAUDS):
        raise BadUrl(url.text, f"baud={baud} is no speed from {BAUDS.start} to {BAUDS.stop - 1}")
    if rtscts not in {"0", "1"}:
        raise BadUrl(url.text, f"rtscts={rtscts} is neither 0 nor 1")
    return Setting(url.where, int(baud), rtscts == "1")


async def connect_url(url: Url, accept: Accept) -> Link:
    """`serial:DEVICE?baud=…`."""
    return await connect(read(url), accept)


async def listen_url(url: Url, accept: Accept, *, exposed: bool) -> Listener:  # noqa: ARG001  a cable leads to one
    """`serial:DEVICE?baud=…`."""
    return await listen(read(url), accept)
