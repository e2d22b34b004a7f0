"""Keys in the order in which they came, each with all that follows from it.

Textual gives a letter to the focused widget at once, but a bound key goes up through the queues of all its
ancestors to the app before its action runs; the next letters, typed meanwhile, are applied before it. Where
keys come faster than they are handled (a busy machine, ssh, a burst), `0.3`, backspace, `4` became `0.3`.

So the app takes one key at a time. After each, a passage goes the way that the key went: through the queue
of the widget that had it and of each ancestor, up to the app. What arrives there is behind the key, and
behind whatever the key made these widgets say. When nothing has moved the focus for `PASSAGES` passages, the
next key is taken.

The driver asks for each key whether it may come (`admits`), for keys that wait take memory, and time at the
end. When `MOST` wait, those after them are dropped until all have been dealt with: a line of which a part is
missing must not get its Enter. Keys that stop robots are counted apart, so a flood does not take their place.
"""

from __future__ import annotations

import asyncio
import logging
from collections import deque
from dataclasses import dataclass

from textual.app import App, ReturnType
from textual.dom import DOMNode
from textual.events import Event, InputEvent, Key, MouseDown, MouseUp, Paste
from textual.message import Message

from robotree.tui.line.actions import BY_VERB

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
