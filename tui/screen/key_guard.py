"""A screen that opens by itself takes no key that was meant for the one before.

A verb returns after a while and shows its text, a question closes since another program has answered it: a
person who types at that moment means what they saw last. So what comes unasked is looked at before it is
operated, as browsers do it. What a key opened takes keys at once.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from textual.app import ReturnType
from textual.events import Event, Key
from textual.widgets import Input, TextArea

from robotree.tui.line.actions import BY_VERB
from robotree.tui.screen.busy import BusyForms, carried_out

if TYPE_CHECKING:
    from textual.screen import Screen

LOOK = 0.5
"""[s] that a person takes to see that something else is in front, and to end what they type."""

_STOPS = {BY_VERB["stop"].key, BY_VERB["stop"].typing_key}


class KeyGuard(BusyForms[ReturnType]):
    """An app that drops what was typed before its screen could be seen; never the stop."""

    def __init__(self) -> None:
        """Begin with what was asked for."""
        super().__init__()
        self._seen = float("-inf")
        """[s] on the clock of events: from then on keys are meant for what is in front."""
        self._typed = False
        """A field had the focus when it opened: a space was a letter."""

    @staticmethod
    def now() -> float:
        """[s] on the clock of events."""
        raise NotImplementedError

    def opened_by_itself(self, front: Screen[Any], *, typed: bool) -> None:
        """Note that a screen has come to the front by itself.

        Args:
            front: the screen.
            typed: whether what was in front before was a field that one types in.
        """
        self._typed = typed
        self._wait_for_a_look()
        front.call_after_refresh(self._wait_for_a_look)  # on a busy machine it is drawn later

    def _wait_for_a_look(self) -> None:
        self._seen = max(self._seen, self.now() + LOOK)

    @property
    def line_keys(self) -> set[str]:
        """Keys of the main page after which one types."""
        return {*self.keymap.keys("prompt"), *self.keymap.keys("filter")}

    @property
    def typing(self) -> bool:
        """Whether keys are letters now."""
        front = self.focused if self.screen_stack else None
        return isinstance(front, Input | TextArea) and not carried_out(front)

    async def on_event(self, event: Event) -> None:
        """Notice who types on and has not looked yet; stops overtake the letters before them."""
        if (
            isinstance(event, Key)
            and event.time < self._seen
            and event.is_printable
            and event.key not in _STOPS
        ):
            self._typed = self._typed or event.key in self.line_keys
            self._seen = max(self._seen, event.time + LOOK)
        await super().on_event(event)

    def drops(self, event: Event) -> str:
        """Drop what was meant for what was in front before (`KeysInOrder.drops`)."""
        if event.time >= self._seen:
            return super().drops(event)
        if not isinstance(event, Key) or event.key not in _STOPS:
            return "what is in front now had just come"
        if not self._typed or event.key == BY_VERB["stop"].typing_key:
            return ""
        return "it was a letter for what was in front before"
