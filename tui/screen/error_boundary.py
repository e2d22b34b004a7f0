"""The error boundary of the full screen: an error in one handler is shown, and the supervisor goes on.

Textual ends the program at the first exception in a handler. An operator's program must not end while
robots move, so all our classes that handle messages derive from `ErrorBoundary`. What it does not catch (an
error while a screen is drawn) ends the screen, and `supervise` opens a new one.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import Protocol, cast

from textual.message import Message
from textual.message_pump import MessagePump

log = logging.getLogger(__name__)


class Reports(Protocol):
    """An app that shows errors of its own program."""

    def report_error(self, error: Exception) -> None:
        """Go on after an error, and show it."""
        ...


class ErrorBoundary(MessagePump):
    """Mixed into the app, its screens and its widgets, before their Textual class."""

    def _report(self, error: Exception) -> None:
        cast("Reports", self.app).report_error(error)  # pyright: ignore[reportUnknownMemberType] # Textual leaves open which app it is

    def guarded(self, draw: Callable[[], None]) -> Callable[[], None]:
        """Return a timer's callback that reports its errors: timers do not come as messages."""

        def safely() -> None:
            try:
                draw()
            except Exception as error:  # the supervisor goes on
                log.exception("while %s drew itself", type(self).__name__)
                self._report(error)

        return safely

    async def _dispatch_message(self, message: Message) -> None:
        """Handle a message; an error in the handler is reported to the app."""
        try:
            await super()._dispatch_message(message)
        except Exception as error:  # the supervisor goes on
            log.exception("while %s handled %s", type(self).__name__, type(message).__name__)
            self._report(error)
