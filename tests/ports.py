"""Ports for processes that a test starts twice at the same place: nobody takes them meanwhile."""

from __future__ import annotations

import os
import socket

LOWEST, HIGHEST = 20_000, 32_000
"""Below those that Linux gives to whoever asks for any port (ip_local_port_range, from 32768 on)."""


def free_port() -> int:
    """Return a TCP port at which nobody listens, and which no test of another worker is given soon."""
    while True:
        port = LOWEST + int.from_bytes(os.urandom(4)) % (HIGHEST - LOWEST)
        with socket.socket() as it:
            try:
                it.bind(("127.0.0.1", port))
            except OSError:
                continue
        return port
