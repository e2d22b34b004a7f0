"""The errors of the wire.

Bytes that arrive never raise: they are counted, in the `statistics` of parsers, verifiers, links and buses.
Errors are our own mistakes, and links or files that cannot be opened. `dialect/errors.py` and
`tools/capture/records.py` have further ones::

    ProtocolError
      DialectError          an XML file that does not compile
      LocalProtocolError    our own mistake when sending
        InvalidMessage      a message with a value that its field cannot hold
        UnknownMessage      a message that the dialect does not have
        UnfitClass          a class with other fields than its message
        PayloadSize         a payload that ISO-TP cannot carry
        TransferUnderWay    an ISO-TP transfer before the last one has ended
      KeyRefused            a signing key that came over the wire, and is not taken
      KeyFileError          a file with signing keys that cannot be used
        UnmatchedLink       it has keys, but none for a link that is wanted
      LinkError
        BadUrl              an address that cannot be understood
        LinkRefused         the port is taken, or the device cannot be had
          LinkUnanswered    nobody listens there, or answers
        LinkClosed          ended in order: by us, or by the far end
        LinkBroken          the transport broke
        LinkOverrun         cut by us: the far end did not read
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path


class ProtocolError(Exception):
    """The root of all errors of this package."""


class DialectError(ProtocolError):
    """A dialect does not compile. `detail` is the generator's message."""

    def __init__(self, path: str, detail: str) -> None:
        self.path, self.detail = path, detail
        super().__init__(f"{path} does not compile; correct the XML: {detail}")


class LocalProtocolError(ProtocolError):
    """We were about to send something wrong; nothing was sent."""


class InvalidMessage(LocalProtocolError):
    """A field cannot hold its value."""

    def __init__(self, message: str, field: str, problem: str) -> None:
        self.message, self.field, self.problem = message, field, problem
        super().__init__(f"{message}.{field} {problem}; correct the value before sending")


class UnknownMessage(LocalProtocolError):
    """The dialect has no such message."""

    def __init__(
        self, what: int | str, remedy: str = "add it to robotree.xml and regenerate the table"
    ) -> None:
        self.what = what
        super().__init__(f"the dialect has no message {what!r}; {remedy}")


class UnfitClass(LocalProtocolError):
    """A class has other fields than the message that it shall be."""

    def __init__(self, cls: str, message: str, fields: tuple[str, ...]) -> None:
        self.message, self.fields = message, fields
        super().__init__(
            f"{cls} is not as {message} is; give it these fields, in this order: {', '.join(fields)}"
        )


class PayloadSize(LocalProtocolError):
    """A payload of this size cannot be sent."""

    def __init__(self, size: int, largest: int) -> None:
        self.size, self.largest = size, largest
        super().__init__(f"a payload of {size} bytes cannot be sent; ISO-TP carries 1 to {largest}")


class TransferUnderWay(LocalProtocolError):
    """The transfer before has not ended."""

    def __init__(self, size: int, position: int) -> None:
        self.size, self.position = size, position
        sentence = f"{position} of {size} bytes are sent; wait until `busy` is false"
        super().__init__(sentence)


class KeyRefused(ProtocolError):
    """A key that came over the wire is not taken. Its sentence is for who sent it, and shows no key."""


class KeyFileError(ProtocolError):
    """A key file cannot be used. Its content is never part of the message."""

    def __init__(self, path: Path, problem: str) -> None:
        self.path, self.problem = path, problem
        super().__init__(f"{path}: {problem}")


class UnmatchedLink(KeyFileError):
    """The file has keys, but none for a link that is wanted."""

    def __init__(self, path: Path, address: str, patterns: Iterable[str]) -> None:
        self.address, self.patterns = address, tuple(patterns)
        problem = f"no pattern matches the links of {address}; there is {', '.join(self.patterns)}"
        super().__init__(path, f"{problem}; add a line for them, or write --key none to do without")


class LinkError(ProtocolError):
    """A link cannot be had, or ended. `address` names it."""

    def __init__(self, address: str, sentence: str) -> None:
        self.address = address
        super().__init__(sentence)


class BadUrl(LinkError):
    """An address that means nothing to us."""

    def __init__(self, address: str, problem: str) -> None:
        self.problem = problem
        super().__init__(address, f"{address!r} is no address of a link: {problem}")


class LinkRefused(LinkError):
    """The link could not be opened. `cause` is the error of the operating system."""

    def __init__(self, address: str, cause: str) -> None:
        self.cause = cause
        super().__init__(address, f"{address} cannot be opened: {cause}")


class LinkUnanswered(LinkRefused):
    """Nobody listens at the far end, or answers."""


class LinkClosed(LinkError):
    """The link ended in order."""

    def __init__(self, address: str, *, by_us: bool) -> None:
        self.by_us = by_us
        super().__init__(address, f"{address} was closed by {'us' if by_us else 'the far end'}")


class LinkBroken(LinkError):
    """The link ended because of the world around it."""

    def __init__(self, address: str, cause: str) -> None:
        self.cause = cause
        super().__init__(address, f"{address} broke: {cause}")


class LinkOverrun(LinkError):
    """The far end did not read, and what must not be dropped outgrew the bound."""

    def __init__(self, address: str, waiting: int) -> None:
        self.waiting = waiting
        super().__init__(
            address, f"{address} was cut: {waiting} bytes wait and the far end does not read them"
        )
