"""The base of links over sockets: how an address is written, and why it could not be opened."""

from __future__ import annotations

import os
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from robotree.protocol.errors import LinkRefused

if TYPE_CHECKING:
    from collections.abc import Generator


def name(scheme: str, address: tuple[Any, ...]) -> str:
    """The address of a socket as a URL: `tcp:127.0.0.1:5760`, `tcp:[::1]:5760`."""
    host, port = address[:2]
    return f"{scheme}:[{host}]:{port}" if ":" in host else f"{scheme}:{host}:{port}"


def cause(error: OSError) -> str:
    """The system's words for an error."""
    return os.strerror(error.errno) if error.errno is not None and error.errno > 0 else str(error)


@contextmanager
def refusing(address: str, refusal: type[LinkRefused] = LinkRefused) -> Generator[None]:
    """Tell why the socket of an address cannot be had.

    Args:
        address: of the link.
        refusal: what it is if the system refuses it.

    Raises:
        LinkRefused: it cannot be had.
    """
    try:
        yield
    except OSError as error:
        raise refusal(address, cause(error)) from error
    except ValueError as error:  # of the codec of names: an empty part, a long one, a character that none has
        raise LinkRefused(address, "no machine can have that name") from error
