"""A command that goes on after its process was started again: its page takes again the steps that it took.

The page is carried out again from its beginning, with what its steps gave before: nothing is done twice, and
nobody sees anything of it. When a frame of the command asks for a step that was not kept, it goes on with new
ones. A step that is another one than before ends the command. Pure.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from robotree.vr.base.description import FieldSpec
from robotree.vr.base.errors import Diverged
from robotree.vr.base.literal import write
from robotree.vr.base.readable import in_words, rounded
from robotree.vr.core import events as on

_STEP = re.compile(r"(\d+\.)?\d+")
"""Path of a step of the command itself."""


class Intent(NamedTuple):
    """To whom the call of a step is given, kept before it is."""

    child: str
    """Key of the child."""
    witness: str
    """The memory of it beyond the child's process: see `Call.witness`."""
    attempt: int
    """How often before it was found that it had not been carried out."""


class Replay:
    """The steps that one frame of a command took before its process was started again."""

    active: bool = True
    """Whether the frame takes them again; else it takes new ones."""
    used_up: bool = False
    """Whether the frame has asked for a step that was not taken before."""
    _last: int = -1
    """Number of the last step that the frame took before; -1: nobody has asked for it."""

    def __init__(self, kept: dict[str, on.StepResult], own: str, robot: str, command: str) -> None:
        """Begin with the first step.

        Args:
            kept: the steps that the whole command took, by path; those that are taken again are removed.
            own: what the paths of this frame's steps begin with.
            robot: its name, and its command's, for messages.
            command: see `robot`.
        """
        self._kept, self._own, self._robot, self._command = kept, own, robot, command
        self.rewritten: dict[str, Any] = {}
        """Fields that its page has set since the last step that it took again: they may have been lost."""
        self.waiting: list[Callable[[], None]] = []
        """Have the parts of this frame look again that have taken all their steps before it has."""

    def take(self, path: str, kind: str, content: Any, number: int) -> on.StepResult | None:
        """Return what a step gave before; None: it is taken for the first time.

        Args:
            path: of the step, below the key of the call.
            kind: see `events.StepResult`.
            content: what tells it from another step.
            number: of the step in this frame.

        Raises:
            Diverged: the page takes another step than before.
        """
        step = self._kept.pop(path, None)
        if step is None:  # a call may have been under way while later steps were taken
            self.used_up = kind != "call" or number >= self._last_number()
            return None
        if step.kind != kind or (content is not None and step.content != content):
            raise self._diverged(path, step, words_of_step(kind, content))
        self.rewritten = {}
        return step

    def has(self, path: str, kind: str, content: Any) -> bool:
        """Whether exactly this step was taken before."""
        step = self._kept.get(path)
        return step is not None and (step.kind, step.content) == (kind, content)

    def intent(self, path: str) -> Intent | None:
        """Return to whom the call of a step was given that had not ended; None: to nobody."""
        step = self._kept.pop(f"{path}{on.BEGUN}", None)
        return None if step is None else Intent(*step.value)

    def ended_at(self, path: str, number: int) -> bool:
        """Whether the command's end, kept under a path, was raised before so many steps were taken."""
        mark = self._kept.get(path)
        return mark is not None and number >= mark.value

    def left_out(self, now: str = "its end") -> Diverged | None:
        """Return the error for a page that has left out a step that it took before; None: it has not.

        Args:
            now: what it has come to: its end, else a checkpoint, before which only its own lap matters.
        """
        whole = now == "its end"
        for path, step in self._kept.items():
            if _STEP.fullmatch(path) if whole else path.removeprefix(self._own).isdigit():
                return self._diverged(path, step, now)
        return None

    def begin_lap(self, own: str) -> None:
        """Take the steps of the next lap again; `own` is what their paths begin with."""
        self._own, self._last, self.rewritten = own, -1, {}

    def strayed(self, place: str) -> Diverged:
        """Return the error for a page that takes a new step before it comes to a checkpoint."""
        words = on.StepResult("checkpoint", f"at {place}")
        return self._diverged(f"{self._own}checkpoint", words, "another step")

    def _last_number(self) -> int:
        if self._last < 0:
            own = (path.removeprefix(self._own) for path in self._kept if path.startswith(self._own))
            self._last = max((int(number) for number in own if number.isdigit()), default=0)
        return self._last

    def _diverged(self, path: str, step: on.StepResult, now: str) -> Diverged:
        before = words_of_step(step.kind, step.content)
        return Diverged(robot=self._robot, command=self._command, step=path, before=before, now=now)


def words_of_step(kind: str, content: Any, fields: Iterable[FieldSpec] | None = None) -> str:
    """Return a step in words: `arm.go_to(x=0.3, twist=45deg)`.

    Args:
        kind: of the step.
        content: of the step.
        fields: the parameters of the child's command, for people; None: all digits, in the declared units.
    """
    if kind in {"call", "tell"}:  # see `call_child`
        slot, command, arguments = content
        shown = arguments if fields is None else in_words(fields, arguments)
        return f"{slot}.{command}({', '.join(f'{name}={write(value)}' for name, value in shown.items())})"
    shown = content if fields is None else rounded(content)
    return kind if content is None else f"{kind} {shown}"
