"""How a serial port is opened, and what is wrong when it cannot be, or is there no longer."""

from __future__ import annotations

import contextlib
import errno
import grp
from pathlib import Path

import msgspec
import serial

from robotree.protocol.errors import BadUrl, LinkRefused
from robotree.protocol.links.in_thread import opened
from robotree.protocol.links.sockets import cause

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
