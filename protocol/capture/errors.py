"""What can go wrong with recordings.

Bytes in a recording never raise: they are counted. What raises is a file that cannot be used at all::

    ProtocolError
      BadRecording     a file that cannot be read or written, or has not what is needed of it
        NoFrame        a file without any frame that we know
"""

from __future__ import annotations

from robotree.protocol.errors import ProtocolError


class BadRecording(ProtocolError):
    """A recording cannot be used. `name` is its file."""

    def __init__(self, name: str, problem: str) -> None:
        self.name, self.problem = name, problem
        super().__init__(f"{name}: {problem}")


class NoFrame(BadRecording):
    """A recording holds no frame that we know."""

    def __init__(self, name: str) -> None:
        super().__init__(name, "there is no frame in it that we know; is it a recording, and not compressed?")
