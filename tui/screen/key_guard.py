"""Keys in the order in which they came, each with all that follows from it; some shall have no effect.

Textual gives a letter to the focused widget at once, but a bound key goes up through the queues of all its
ancestors to the app before its action runs; the next letters, typed meanwhile, are applied before it. Where
keys come faster than they are handled (a busy machine, ssh, a burst), `0.3`, backspace, `4` became `0.3`.

So the app takes one key at a time (`KeysInOrder`). After each, a passage goes the way that the key went:
through the queue of the widget that had it and of each ancestor, up to the app. What arrives there is behind
the key, and behind whatever the key made these widgets say. When nothing has moved the focus for `PASSAGES`
passages, the next key is taken.

The driver asks for each key whether it may come (`admits`), for keys that wait take memory, and time at the
end. When `MOST` wait, those after them are dropped until all have been dealt with: a line of which a part is
missing must not get its Enter. Keys that stop robots are counted apart, so a flood does not take their place.

Keys that shall have no effect are dropped, and reported together (`KeyGuard`). A form that is carrying out a
command accepts no keys. Hasty keys after the one that sends a form would fill it in anew and send it again:
robots nobody asked for. So while a form carries something out, only the keys work of which the registry says
so (`while_busy`).

A screen that opens by itself takes no key that was meant for the one before. A verb returns after a while and
shows its text, a question closes since another program has answered it: a person who types at that moment
means what they saw last. So what comes unasked is looked at before it is operated, as browsers do it. What a
key opened takes keys at once.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from textual.app import App, ReturnType
from textual.dom import DOMNode
from textual.errors import NoWidget
from textual.events import Event, InputEvent, Key, MouseDown, MouseUp, Paste
from textual.message import Message
from textual.widgets import Input, TextArea

from robotree.tui.line.action import spell
from robotree.tui.line.actions import ACTIONS, BY_VERB
from robotree.tui.line.page_keys import page_keys
from robotree.tui.screen.keymap import Keymap

if TYPE_CHECKING:
    from textual.screen import Screen

PASSAGES = 3
"""Passages with the focus at rest: for the key, for what its action says, for what is made of that."""

LIMIT = 2.0
"""[s] after which the next key is taken anyway: a widget may vanish and its queue with it."""

STOPPING = frozenset({BY_VERB["stop"].key, BY_VERB["stop"].typing_key})
"""Keys that stop robots."""

MOST = 500
"""Keys, clicks and moves of the mouse that may wait; of each key that stops, as many again."""

log = logging.getLogger(__name__)


@dataclass(slots=True, eq=False)
class _UnderWay:
    """A key that is being dealt with."""

    event: Event
    origin: DOMNode | None
    """The widget that had the keys when it came."""
    place: DOMNode | None = None
    """The widget that had them at the last passage."""
    left: int = PASSAGES
    limit: asyncio.TimerHandle | None = None


class KeysInOrder(App[ReturnType]):
    """An app that takes a key when the one before it has been dealt with everywhere."""

    def __init__(self) -> None:
        """Begin without keys."""
        super().__init__()
        self._under_way: _UnderWay | None = None
        self._held: deque[Event] = deque()
        self._admitted: set[int] = set()
        """`id` of each, for events have no hash."""
        self._stops: dict[str, set[int]] = {key: set() for key in STOPPING}
        self._flooded = False

    @property
    def keys_wait(self) -> bool:
        """Whether a key is being handled, or waits for its turn."""
        return self._under_way is not None or bool(self._held)

    def overtakes(self, key: Key, before: list[Event]) -> bool:
        """Whether a key shall be taken at once, whatever is still to be dealt with before it."""
        del key, before
        return False

    def drops(self, event: Event) -> str:
        """Return why a key or click shall have no effect, now that its turn has come; empty: it shall."""
        del event
        return ""

    def dropped(self, event: Event, why: str) -> None:
        """Take note that a key or click had no effect."""

    def admits(self, message: Message) -> bool:
        """Return whether what a person does may come; called in the thread that reads the terminal."""
        if not isinstance(message, InputEvent | Paste):
            return True
        if isinstance(message, Key) and message.key in STOPPING:
            same = self._stops[message.key]
            if room := len(same) < MOST:
                same.add(id(message))
            return room
        if not self._admitted:
            self._flooded = False
        elif not self._flooded and len(self._admitted) >= MOST:
            self._flooded = True
            log.warning("%d keys wait: those that come now are dropped until all have been dealt with", MOST)
        if not self._flooded:
            self._admitted.add(id(message))
        return not self._flooded

    def _forget(self, event: Event) -> None:
        self._admitted.discard(id(event))
        if isinstance(event, Key) and event.key in STOPPING:
            self._stops[event.key].discard(id(event))

    async def on_event(self, event: Event) -> None:
        """Take what a person does, or hold it back until its turn comes; everything else is as it was.

        Buttons of the mouse wait as well: a click on the button that runs a form must not come before the
        last digit in it.
        """
        if not isinstance(event, Key | Paste | MouseDown | MouseUp) or event.is_forwarded:
            self._forget(event)
            await super().on_event(event)
        elif self._under_way is None:
            await self._take(event)
        elif isinstance(event, Key) and self.overtakes(event, [self._under_way.event, *self._held]):
            await self._hand_over(event)
        else:
            self._held.append(event)

    async def _take(self, event: Event) -> None:
        taken = self._under_way = _UnderWay(event, self._keys_are_at)
        try:
            await self._hand_over(event)
        finally:
            taken.limit = asyncio.get_running_loop().call_later(LIMIT, self._give_up, taken)
            self._send(taken)

    async def _hand_over(self, event: Event) -> None:
        self._forget(event)
        if why := self.drops(event):
            self.dropped(event, why)
        else:
            await super().on_event(event)

    @property
    def _keys_are_at(self) -> DOMNode | None:
        if not self.screen_stack:
            return None
        return self.focused or self.screen

    def _send(self, taken: _UnderWay) -> None:
        """Send a passage from where the key went, and from where the next one would go."""
        place = self._keys_are_at
        if place is not taken.place:
            taken.place, taken.left = place, PASSAGES
        taken.left -= 1
        ways = [[] if one is None else one.ancestors_with_self for one in {taken.origin, place}]
        self._pass(taken, deque([*(node for way in ways for node in way if node is not self), self]))

    def _pass(self, taken: _UnderWay, way: deque[DOMNode]) -> None:
        """Go on to the next queue that is still open; the last one is the app's."""
        while way:
            node = way.popleft()
            if node is self:
                self.call_later(self._arrived, taken)
            elif node.call_later(self._pass, taken, way):
                return

    async def _arrived(self, taken: _UnderWay) -> None:
        if taken is not self._under_way:
            return
        if taken.left > 0 or self._keys_are_at is not taken.place:
            self._send(taken)
        else:
            await self._next(taken)

    def _give_up(self, taken: _UnderWay) -> None:
        if not self._exit:  # what ends takes its time, and nobody waits for its keys
            what = f"the key {taken.event.key}" if isinstance(taken.event, Key) else "a click or a paste"
            log.warning("%s has not been dealt with for %g s; the keys after it are taken", what, LIMIT)
        self.call_later(self._next, taken)

    async def _next(self, taken: _UnderWay) -> None:
        if taken is not self._under_way:
            return
        if taken.limit is not None:
            taken.limit.cancel()
        self._under_way = None
        if self._held:
            await self._take(self._held.popleft())
        else:
            self._admitted.clear()  # one whose way ended early must not be waited for


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


class KeyGuard:
    """The part of an app that drops keys for busy forms, and those typed before its screen was seen.

    It never drops the stop.
    """

    def __init__(
        self, app: KeysInOrder[Any], keymap: Keymap, now: Callable[[], float], tell: Callable[[str], None]
    ) -> None:
        """Begin with nothing dropped.

        Args:
            app: whose keys they are.
            keymap: the operator's keys.
            now: returns [s] on the clock of events.
            tell: says to the operator which keys had no effect, and why.
        """
        self._app, self._keymap, self._now, self._tell = app, keymap, now, tell
        self._lost: list[str] = []
        """Keys that were dropped and are not reported yet."""
        self.seen = float("-inf")
        """[s] on the clock of events: from then on keys are meant for what is in front."""
        self._typed = False
        """A field had the focus when it opened: a space was a letter."""

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
        self.seen = max(self.seen, self._now() + LOOK)

    @property
    def line_keys(self) -> set[str]:
        """Keys of the main page after which one types."""
        return {*self._keymap.keys("prompt"), *self._keymap.keys("filter")}

    @property
    def typing(self) -> bool:
        """Whether keys are letters now."""
        front = self._app.focused if self._app.screen_stack else None
        return isinstance(front, Input | TextArea) and not carried_out(front)

    def notice(self, event: Event) -> None:
        """Notice who types on and has not looked yet, as soon as an event comes."""
        if (
            isinstance(event, Key)
            and event.time < self.seen
            and event.is_printable
            and event.key not in STOPPING
        ):
            self._typed = self._typed or event.key in self.line_keys
            self.seen = max(self.seen, event.time + LOOK)

    def drops(self, event: Event) -> str:
        """Drop what is meant for a busy form, or for what was in front before (`KeysInOrder.drops`)."""
        if event.time < self.seen:
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
        page = getattr(self._app.screen, "KEYS_OF", "") if self._app.screen_stack else ""
        names = [*(verb.verb for verb in verbs), *(key.id for key in page_keys(page) if key.while_busy)]
        return {verb.typing_key for verb in verbs}.union(*map(self._keymap.keys, names))

    def _meant(self, event: Event) -> DOMNode | None:
        if not self._app.screen_stack:
            return None
        if isinstance(event, MouseDown | MouseUp):
            try:
                return self._app.get_widget_at(event.x, event.y)[0]
            except NoWidget:
                return None
        return self._app.focused or self._app.screen

    def dropped(self, event: Event, why: str) -> None:
        """Tell what was dropped, together with what is dropped right after it."""
        if isinstance(event, MouseUp):
            return  # its button's way down has been told
        self._lost.append(_spelled(event))
        self._app.set_timer(SOON, partial(self._tell_lost, len(self._lost), why))

    def _tell_lost(self, count: int, why: str) -> None:
        """Report the dropped keys, when no key waits and none was dropped since the timer was set."""
        if count != len(self._lost):
            return
        if self._app.keys_wait:
            self._app.set_timer(SOON, partial(self._tell_lost, count, why))
        else:
            self._tell(f"{_together(self._lost)}: {why}")
            self._lost.clear()


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
