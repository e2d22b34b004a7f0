"""What links over sockets have in common: how an address is written, and why it could not be had."""

from __future__ import annotations

import os
from typing import Any


def name(scheme: str, address: tuple[Any, ...]) -> str:
    """The address of a socket as a URL: `tcp:127.0.0.1:5760`, `tcp:[::1]:5760`."""
    host, port = address[:2]
    return f"{scheme}:[{host}]:{port}" if ":" in host else f"{scheme}:{host}:{port}"


def cause(error: OSError) -> str:
    """The system's words for an error."""
    return os.strerror(error.errno) if error.errno is not None and error.errno > 0 else str(error)
