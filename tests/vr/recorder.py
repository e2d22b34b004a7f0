"""What was sent, kept: the socket of a process that hangs brings it later, so a test can bring it again."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any

from robotree.vr.base.transport import Transport


class Recorder:
    """A transport that keeps each request that goes over another one."""

    def __init__(self, transport: Transport) -> None:
        self.transport = transport
        self.sent: list[bytes] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.transport, name)

    def request(
        self, key: str, body: bytes, *, timeout: float, urgent: bool = False, void_at: float = 0.0
    ) -> AsyncIterator[bytes]:
        self.sent.append(body)
        return self.transport.request(key, body, timeout=timeout, urgent=urgent, void_at=void_at)
