"""Errors before a proxy or a view runs.

What goes wrong afterwards is raised as the errors of `robotree.vr.base.errors`, which every caller knows.

    VrError
      ProxyError      UnknownKind · NoKind · SeveralKinds · BadController

A kind's file that cannot be read or run raises the same errors as a virtual robot's: NoSuchFile,
BrokenSource.
"""

from __future__ import annotations

from robotree.vr.base.errors import VrError


class ProxyError(VrError):
    """A proxy or a view that cannot be started as asked."""


class UnknownKind(ProxyError):
    """There is no proxy for this kind of robot."""

    sentence = "{kind!r} is no kind of robot; there is: {known}, or a file with one of your own, as {kind}.py"


class NoKind(ProxyError):
    """The file defines no (such) kind of robot."""

    sentence = "{path} defines no kind of robot{wanted}; it needs a class that derives from RobotProxy"


class SeveralKinds(ProxyError):
    """The file defines several kinds of robots and none was named."""

    sentence = "{path} defines several kinds of robots ({known}); name one: {path}:CLASS"


class BadController(ProxyError):
    """The address of the controller means nothing."""

    sentence = "the address of the controller cannot be used: {detail}"
