"""Keys that shall have no effect are dropped, and reported together.

A form that is carrying out a command accepts no keys. Hasty keys after the one that sends a form would fill
it in anew and send it again: robots nobody asked for. So while a form carries something out, only the keys
work of which the registry says so (`while_busy`).

A screen that opens by itself takes no key that was meant for the one before. A verb returns after a while and
shows its text, a question closes since another program has answered it: a person who types at that moment
means what they saw last. So what comes unasked is looked at before it is operated, as browsers do it. What a
key opened takes keys at once.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import TYPE_CHECKING, Any

from textual.app import ReturnType
from textual.dom import DOMNode
from textual.errors import NoWidget
from textual.events import Event, Key, MouseDown, MouseUp, Paste
from textual.widgets import Input, TextArea

from robotree.tui.line.action import spell
from robotree.tui.line.actions import ACTIONS, BY_VERB
from robotree.tui.line.page_keys import page_keys
from robotree.tui.screen.keymap import Keymap
from robotree.tui.screen.keys_in_order import STOPPING, KeysInOrder

if TYPE_CHECKING:
    from textual.screen import Screen

SOON = 0.2
"""[s] after the last dropped key until all of them are reported together."""

LISTED = 8
"""Dropped keys that are reported by name."""

LOOK = 0.5
"""[s] that a person takes to see that something else is in front, and to end what they type."""


class Form:
    """Something that a person fills in and has carried out; mixed into a Textual class."""

    carrying: str = ""
    """The command that is being carried out, as a sentence; empty: none."""

    def lets(self, node: DOMNode | None, event: Event) -> bool:
        """Whether a part of the form takes a key or click even while it carries something out."""
        del node, event
        return False


class Apart:
    """A part of a page that belongs to no form around it; mixed into a Textual class."""


def carried_out(node: DOMNode | None, event: Event | None = None) -> str:
    """Return what the form around a widget is carrying out; empty: nothing, or it takes this event."""
    around = [] if node is None else node.ancestors_with_self
    apart = any(isinstance(widget, Apart) for widget in around)
    forms = [] if apart else [widget for widget in around if isinstance(widget, Form)]
    busy = [form for form in forms if form.carrying and not (event and form.lets(node, event))]
    return next((form.carrying for form in busy), "")


class KeyGuard(KeysInOrder[ReturnType]):
    """An app that drops keys for busy forms, and those typed before its screen was seen; never the stop."""

    def __init__(self) -> None:
        """Begin with nothing dropped."""
        super().__init__()
        self.keymap = Keymap()
        """The operator's keys."""
        self._lost: list[str] = []
        """Keys that were dropped and are not reported yet."""
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
            and event.key not in STOPPING
        ):
            self._typed = self._typed or event.key in self.line_keys
            self._seen = max(self._seen, event.time + LOOK)
        await super().on_event(event)

    def drops(self, event: Event) -> str:
        """Drop what is meant for a busy form, or for what was in front before (`KeysInOrder.drops`)."""
        if event.time < self._seen:
            if not isinstance(event, Key) or event.key not in STOPPING:
                return "what is in front now had just come"
            if not self._typed or event.key == BY_VERB["stop"].typing_key:
                return ""
            return "it was a letter for what was in front before"
        if isinstance(event, Key) and event.key in self.keys_while_busy():
            return ""
        return carried_out(self._meant(event), event)

    def keys_while_busy(self) -> set[str]:
        """Return the keys that work while the form in front carries something out."""
        verbs = [action for action in ACTIONS if action.while_busy]
        page = getattr(self.screen, "KEYS_OF", "") if self.screen_stack else ""
        names = [*(verb.verb for verb in verbs), *(key.id for key in page_keys(page) if key.while_busy)]
        return {verb.typing_key for verb in verbs}.union(*map(self.keymap.keys, names))

    def _meant(self, event: Event) -> DOMNode | None:
        if not self.screen_stack:
            return None
        if isinstance(event, MouseDown | MouseUp):
            try:
                return self.get_widget_at(event.x, event.y)[0]
            except NoWidget:
                return None
        return self.focused or self.screen

    def dropped(self, event: Event, why: str) -> None:
        """Tell what was dropped, together with what is dropped right after it."""
        if isinstance(event, MouseUp):
            return  # its button's way down has been told
        self._lost.append(_spelled(event))
        self.set_timer(SOON, partial(self._tell_lost, len(self._lost), why))

    def _tell_lost(self, count: int, why: str) -> None:
        """Report the dropped keys, when no key waits and none was dropped since the timer was set."""
        if count != len(self._lost):
            return
        if self.keys_wait:
            self.set_timer(SOON, partial(self._tell_lost, count, why))
        else:
            self.tell_dropped(_together(self._lost), why)
            self._lost.clear()

    def tell_dropped(self, what: str, why: str) -> None:
        """Tell a person which keys had no effect."""
        raise NotImplementedError


def _spelled(event: Event) -> str:
    match event:
        case Key():
            letter = event.character if event.is_printable and event.key != "space" else None
            return letter or spell(event.key)
        case Paste():
            return "paste"
        case _:
            return "click"


def _together(keys: Iterable[str]) -> str:
    """Return keys as a sentence says them: `the key n`, `5 keys (n e w z ⏎)`."""
    every = list(keys)
    shown = " ".join(every[:LISTED]) + (" …" if len(every) > LISTED else "")
    return f"the key {shown} was dropped" if len(every) == 1 else f"{len(every)} keys ({shown}) were dropped"
