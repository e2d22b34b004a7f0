"""How a running command asks a space: it waits as for a child, and whatever ends it ends the request, too."""

from __future__ import annotations

import contextlib
from typing import Any

import msgspec

from robotree.vr.base.errors import NoSpace, SeveralSpaces, SpaceError, SpaceLost
from robotree.vr.base.requests import AnyRequest, GiveUp, Raised, Reply, WriteEntry, decode_reply, encode
from robotree.vr.core import events as on
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
"""The name of a request for people."""


def ask_space(frame: Frame, space: str, request: AnyRequest) -> Reply:
    """Ask a space, as one step of a running command, and wait for its answer.

    What it answers is kept with the step, so a command that goes on in another process asks once. A request
    that was under way then is asked again under its key, and the space answers as it did before.

    Args:
        frame: of the command.
        space: its name; empty: the only one that runs.
        request: the question.

    Raises:
        SpaceError: the refusal of the space; or there is none, or it ended before it answered.
        VrError: the command was asked to end.
    """
    path = frame.step()
    content = [type(request).__name__, _about(request)]
    step = frame.recalled(path, "space", content)
    if step is None:
        frame.hold(path, "space", content)
        if hasattr(request, "ask"):
            request = msgspec.structs.replace(request, ask=path)
        reply = _wait_for(frame, space, request)
        frame.keep_step(path, on.StepResult("space", content, encode(reply)))
    else:
        reply = decode_reply(step.value, key=space or "the space")
    if isinstance(reply, Raised):
        raise reply.revive()
    return reply


def _wait_for(frame: Frame, space: str, request: AnyRequest) -> Reply:
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
    return reply


def _about(request: AnyRequest) -> Any:
    """Return what tells a request from another one, whatever its times and keys are."""
    if isinstance(request, WriteEntry):
        return [request.entry.kind, request.entry.fields]
    return [getattr(request, name, "") for name in ("kind", "fields", "name")]


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
    found = {key: key.split("/")[1] for key in runtime.present("space", space)}
    if not found:
        raise NoSpace(name=f"{space!r} " if space else "", example=space or "jobs")
    if len(found) > 1:
        names = sorted(found.values())
        raise SeveralSpaces(known=", ".join(names), example=names[0])
    return next(iter(found.items()))
