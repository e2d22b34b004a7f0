"""Recordings in which a person has shown something."""

from __future__ import annotations

import io
from collections.abc import Sequence

from robotree.tui.composing.demonstration import Shown
from robotree.tui.recording.tape import TapeWriter
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.base.requests import State
from tests.tui.composing.shown import DESCRIBED, HOME, NOON


def recording(shown: Sequence[Shown], width: float | None = None, caller: str = "anna@pts/1") -> bytes:
    """Return the bytes of a recording in which a person has shown something.

    Args:
        shown: it.
        width: [m] that is read half a second after each command; None: nothing is.
        caller: who asked.
    """
    file = io.BytesIO()
    writer = TapeWriter(file, {"realm": "hall", "began": repr(NOON)})
    writer.description(NOON, DESCRIBED["arm-1"])
    pose = dict(zip(("x", "y", "z", "twist"), HOME, strict=True))
    writer.state(NOON, "arm-1", State(readings=pose))
    for number, one in enumerate(shown):
        key, at = f"k{number}", NOON + 1 + 2 * number
        about = {"robot": one.robot, "key": key, "command": one.command}
        writer.event(
            HistoryEvent(kind="accepted", unix=at, arguments=dict(one.arguments), caller=caller, **about)
        )
        writer.event(HistoryEvent(kind="ended", unix=at + 1, **about))
        if width is not None:
            writer.state(at + 1.5, "arm-1", State(readings={"width": width}))
    writer.close()
    return file.getvalue()
