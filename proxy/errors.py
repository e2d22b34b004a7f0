"""What goes wrong before a proxy or a view runs.

What goes wrong afterwards is told with the errors of `robotree.vr.errors`, so that every caller knows them.

    VrError
      ProxyError      UnknownKind · BadController
"""

from __future__ import annotations

from robotree.vr.errors import VrError


class ProxyError(VrError):
    """A proxy or a view that cannot be started as asked."""


class UnknownKind(ProxyError):
    """Nobody has written a proxy for this kind of robot."""

    sentence = "{kind!r} is no kind of robot; there is: {known}"


class BadController(ProxyError):
    """The address of the controller means nothing."""

    sentence = "the address of the controller cannot be used: {detail}"
