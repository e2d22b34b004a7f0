"""How a running command asks a space: it waits as for a child, and whatever ends it ends the request, too."""

from __future__ import annotations

import contextlib

from robotree.vr.base.errors import NoSpace, SeveralSpaces, SpaceError, SpaceLost
from robotree.vr.base.requests import AnyRequest, GiveUp, Raised, Reply
from robotree.vr.running.frame import Frame
from robotree.vr.running.robot_runtime import RobotRuntime

_WORDS = {
    "WriteEntry": "the write",
    "FindEntries": "what was asked for",
    "RenewEntry": "the renewal",
    "OpenTransaction": "the begin of a transaction",
    "CloseTransaction": "the commit",
    "AcquireFence": "the request for a fence",
    "RenewFence": "the renewal of a fence",
    "WatchEntries": "the watch",
}
"""What a request is called for people."""


def ask_space(frame: Frame, space: str, request: AnyRequest) -> Reply:
    """Ask a space, as one step of a running command, and wait for its answer.

    Args:
        frame: of the command.
        space: its name; empty: the only one that runs.
        request: the question.

    Raises:
        SpaceError: the refusal of the space; or there is none, or it ended before it answered.
        VrError: the command was asked to end.
    """
    frame.step()
    runtime, replies = frame.runtime, list[Reply | None]()
    key, name = space_of(runtime, space)

    def take(reply: Reply | None) -> None:
        replies.append(reply)
        frame.worker.wake()

    runtime.ask(key, request, take)
    try:
        frame.wait(lambda: bool(replies))
    except BaseException:
        if ask := getattr(request, "ask", ""):
            runtime.ask(key, GiveUp(ask=ask), lambda _: None)
        raise
    reply = replies[0]
    if reply is None:
        raise SpaceLost(space=name, request=_WORDS.get(type(request).__name__, "the request"))
    if isinstance(reply, Raised):
        raise reply.revive()
    return reply


def tell_space(frame: Frame, space: str, request: AnyRequest) -> None:
    """Tell a space something, if it runs, without waiting."""
    with contextlib.suppress(SpaceError):
        key, _ = space_of(frame.runtime, space)
        frame.runtime.ask(key, request, lambda _: None)


def space_of(runtime: RobotRuntime, space: str) -> tuple[str, str]:
    """Return key and name of a space that runs.

    Raises:
        NoSpace: none of this name does.
        SeveralSpaces: several do, and none was named.
    """
    found = {key: key.split("/")[1] for key in runtime.spaces(space)}
    if not found:
        raise NoSpace(name=f"{space!r} " if space else "", example=space or "jobs")
    if len(found) > 1:
        names = sorted(found.values())
        raise SeveralSpaces(known=", ".join(names), example=names[0])
    return next(iter(found.items()))
