"""The protective stop that a command line sends before it loads anything else.

On a busy machine nearly all the time of `robotree stop` is the start of Python and its imports. So this
module sends the stop to each robot that the processes of a realm have written down, in plain Python, and
loads no library; `typing` alone takes a tenth as long as the start of Python. A process whose list is damaged
is asked for all its robots that are meant. Then the full order (`supervision/stop.py`) follows under the same
order id: a robot that gets an order twice has been stopped once. The full order also finds robots that are
not written down, waits for all answers and reports.

It writes no file, needs two descriptors at a time, and waits for nobody: a process that hangs reads the stop
when it wakes. What is written in the folder is not trusted: the kernel says who is at the other end.

The frames are those of `link.py` and `envelope.py`; a test compares the bytes.
"""

from __future__ import annotations

import contextlib
import os
import re
import struct
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from robotree.vr.base.os_files import OS_FILES, OSFiles
from robotree.vr.network.realms import (
    DEFAULT_REALM,
    REALM_VARIABLE,
    all_realms,
    dial,
    leads_to,
    members,
    places,
    realm_folder,
    to_be_asked,
)

REASON = "the operator's protective stop"
"""For those whose commands it ends."""

WITHIN = 2.4
"""[s] in which the answer of a robot must leave, were it awaited: as in the full order."""

DIAL_WITHIN = 0.1
"""[s] to wait for a process whose socket takes no more."""

SCRIPT = "script"
"""Begin of the sender's key, as in `envelope.py`."""

VERSION, URGENT = 3, 0
"""Version and lane of its frames, as in `link.py`."""

_HELLO, _ASK = 0, 2
"""Tags of the frames."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_FLAGS = {"--json", "--readonly", "--calm"}
"""Options that change nothing of what is stopped."""

_Packable = str | bytes | float | None | Sequence["_Packable"] | Mapping[str, "_Packable"]


class StopLine:
    """A line that asks for a stop."""

    __slots__ = ("everywhere", "name", "realm")

    def __init__(self, name: str = "", realm: str = "", *, everywhere: bool = False) -> None:
        """Note what it asks for.

        Args:
            name: of the robot; empty: all.
            realm: empty: that of the environment.
            everywhere: whether all realms of this user are meant.
        """
        self.name, self.realm, self.everywhere = name, realm, everywhere

    def folders(self) -> list[Path]:
        """Return the folders of the realms that are meant."""
        if self.everywhere:
            realms = all_realms()
        else:
            realms = [realm_folder(self.realm or os.environ.get(REALM_VARIABLE) or DEFAULT_REALM)]
        return [place for realm in realms for place in places(realm)]


def understood(words: Sequence[str]) -> StopLine | None:
    """Understand the plain forms of the line `stop`; None: it is another line, or the full parser decides.

    Args:
        words: of the line, without the program's name.
    """
    plain: list[str] = []
    realm, everywhere, rest = "", False, iter(words)
    for word in rest:
        if word == "--everywhere":
            everywhere = True
        elif word.partition("=")[0] == "--realm":
            again, realm = bool(realm), word[8:] if "=" in word else next(rest, "")
            if again or not _NAME.fullmatch(realm):
                return None
        elif word.startswith("-"):
            if word not in _FLAGS:
                return None
        else:
            plain.append(word)
    if plain[:1] != ["stop"] or len(plain) > 2 or not all(map(_NAME.fullmatch, plain)):
        return None
    if not _NAME.fullmatch(realm or os.environ.get(REALM_VARIABLE) or DEFAULT_REALM):
        return None
    return StopLine("".join(plain[1:]), realm, everywhere=everywhere)


def send_first(words: Sequence[str], system: OSFiles = OS_FILES) -> str:
    """Send the stop that a line asks for.

    Args:
        words: of the line, without the program's name.
        system: on which the realms lie.

    Returns:
        The id of the order, for the full order that follows; empty: the line asks for something else, or is
        left to the full parser.
    """
    line = understood(words)
    if line is None:
        return ""
    order = system.chance(8).hex()
    for folder in line.folders():
        for tag in members(folder, system):
            if meant := to_be_asked(folder, tag, line.name, system):
                with contextlib.suppress(OSError):  # the full order says who was not reached
                    _tell(folder, tag, meant, order, system)
    return order


def _tell(folder: Path, tag: str, keys: Iterable[str], order: str, system: OSFiles) -> None:
    with dial(folder, tag, DIAL_WITHIN, system) as line:
        if leads_to(line, folder, tag, system):
            line.sendall(frames(keys, order, system.now(), system))


# -- frames ----------------------------------------------------------------------------------------


def frames(keys: Iterable[str], order: str, now: float, system: OSFiles = OS_FILES) -> bytes:
    """Return what is sent to one process: who speaks, and one request for each robot.

    Args:
        keys: of the robots.
        order: id of the order.
        now: [s, CLOCK_MONOTONIC].
        system: of this process.
    """
    stop: dict[str, _Packable] = {"type": "SafeStop", "reason": REASON, "within": WITHIN, "order": order}
    envelope = _packed([stop, "", now, float("inf"), _clock(), b"", _terminal(), None])
    member = f"{system.pid()}-{system.chance(4).hex()}"
    hello = _framed([_HELLO, VERSION, member, URGENT, {}, {}])
    asked = (_framed([_ASK, number, key, envelope]) for number, key in enumerate(keys, 1))
    return b"".join([hello, *asked])


def _framed(frame: Sequence[_Packable]) -> bytes:
    body = _packed(frame)
    return len(body).to_bytes(4, "little") + body


def _packed(value: _Packable) -> bytes:
    """Return a value as MessagePack, in the forms that msgspec chooses."""
    match value:
        case None:
            packed = b"\xc0"
        case str():
            packed = _headed(len(value.encode()), 0xA0, 32, 0xD9) + value.encode()
        case bytes():
            packed = _headed(len(value), 0, 0, 0xC4) + value
        case float():
            packed = b"\xcb" + struct.pack(">d", value)
        case int():
            packed = _headed(value, 0, 128, 0xCC)
        case Mapping():
            parts = [part for item in value.items() for part in item]
            packed = bytes([0x80 + len(value), *b"".join(map(_packed, parts))])
        case _:
            packed = bytes([0x90 + len(value), *b"".join(map(_packed, value))])
    return packed


def _headed(number: int, small: int, below: int, first: int) -> bytes:
    """Return a header with a number in it, in one byte or behind one.

    Args:
        number: from 0 on.
        small: the header of 0, where the number is in the header itself.
        below: which the number must be for that.
        first: the header of a number in one byte; those of two and of four bytes follow it.
    """
    if number < below:
        return bytes([small + number])
    size = 1 if number < 1 << 8 else 2 if number < 1 << 16 else 4
    return bytes([first + size.bit_length() - 1]) + number.to_bytes(size, "big")


def _terminal() -> str:
    """Return the terminal of this process; see `envelope.this_terminal`."""
    for stream in range(3):
        with contextlib.suppress(OSError):
            return os.ttyname(stream).removeprefix("/dev/")
    return SCRIPT


def _clock() -> str:
    """Return the name of this machine's clock; see `envelope.this_clock`."""
    try:
        with Path("/proc/sys/kernel/random/boot_id").open(encoding="ascii") as boot:
            name = boot.read().strip()
    except OSError:
        return ""
    try:
        return f"{name[:13]}{Path('/proc/self/ns/time').readlink()}"
    except OSError:
        return name[:13]
