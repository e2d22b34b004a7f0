"""Textual's driver, for terminals that vanish: what is drawn then is drawn nowhere.

Textual writes in a thread and hands texts over in a bounded queue. An error in that thread, such as that of a
terminal that was closed, ends it; then the queue fills up, and the event loop waits at it for ever, deaf to
every signal (Textual 8.2.8, `textual/drivers/_writer_thread.py`).
"""

from __future__ import annotations

from typing import IO, Any, cast

from textual.driver import Driver
from textual.drivers import linux_driver
from textual.drivers.linux_driver import LinuxDriver
from textual.message import Message

from robotree.tui.screen.bounded_paste import BoundedPaste
from robotree.tui.screen.keys_in_order import KeysInOrder
from robotree.tui.terminal import forget_the_reader


class Outliving:
    """A standard stream whose writing never fails."""

    def __init__(self, stream: IO[str]) -> None:
        """Write to `stream` as long as somebody can read it."""
        self._stream = stream

    def write(self, text: str) -> None:
        """Write, or do not."""
        try:
            self._stream.write(text)
        except OSError:
            forget_the_reader(self._stream)

    def flush(self) -> None:
        """Have it written, or not."""
        try:
            self._stream.flush()
        except OSError:
            forget_the_reader(self._stream)

    def fileno(self) -> int:
        """Return the stream's file descriptor."""
        return self._stream.fileno()


LEAVE = "\x1b[?1049l"
"""What leaves the alternate screen (xterm), so that the shell shows again."""


class OutlivingDriver(LinuxDriver):
    """Goes on when its terminal has gone. What ends the program then is `processes.ending`."""

    stays = False
    """Whether the alternate screen is not left at the end, because another program is drawn over this one."""

    def run_input_thread(self) -> None:
        """Read the terminal, with pastes that have a largest size."""
        setattr(linux_driver, "XTermParser", BoundedPaste)  # noqa: B010 # Textual makes the one of its module
        super().run_input_thread()

    def send_message(self, message: Message) -> None:
        """Send what came from the terminal, unless too much waits (`KeysInOrder.admits`)."""
        if not isinstance(self._app, KeysInOrder) or self._app.admits(message):
            super().send_message(message)

    def write(self, data: str) -> None:
        """Write to the terminal."""
        if not (self.stays and data == LEAVE):
            super().write(data)

    def __init__(self, *given: Any, **named: Any) -> None:
        """Take what Textual gives."""
        super().__init__(*given, **named)  # pyright: ignore[reportUnknownMemberType] # Textual leaves it open
        self._file = cast("Any", Outliving(cast("IO[str]", self._file)))


def outliving(chosen: type[Driver]) -> type[Driver]:
    """Return the driver to be used where Textual has chosen this one."""
    return OutlivingDriver if chosen is LinuxDriver else chosen
