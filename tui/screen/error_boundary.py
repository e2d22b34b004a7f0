"""The last fence of the full screen: an error in one handler is told, and the supervisor goes on.

Textual ends the program at the first exception in a handler. An operator's program must not end while
robots move, so everything of ours that handles messages stands behind this fence. What gets past it (an
error while a screen is drawn) ends the screen, and `supervise` opens it anew.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

from textual import getters
from textual.message import Message
from textual.message_pump import MessagePump

if TYPE_CHECKING:
    from robotree.tui.screen.app import Supervisor

log = logging.getLogger(__name__)


class Fenced(MessagePump):
    """Mixed into the app, its screens and its widgets, before their Textual class."""

    if TYPE_CHECKING:
        app = getters.app(Supervisor)

    def fenced(self, draw: Callable[[], None]) -> Callable[[], None]:
        """Return a timer's callback behind the fence: timers do not come as messages."""

        def safely() -> None:
            try:
                draw()
            except Exception as error:  # the last fence of the supervisor
                log.exception("while %s drew itself", type(self).__name__)
                self.app.mend(error)

        return safely

    async def _dispatch_message(self, message: Message) -> None:
        """Handle a message; an error in the handler is told to the app."""
        try:
            await super()._dispatch_message(message)
        except Exception as error:  # the last fence of the supervisor
            log.exception("while %s handled %s", type(self).__name__, type(message).__name__)
            self.app.mend(error)
