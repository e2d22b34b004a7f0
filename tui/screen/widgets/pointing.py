"""What a plan and a picture share in which one points: the keys, and what they say of the cursor."""

from __future__ import annotations

from textual.message import Message
from textual.widget import Widget

from robotree.tui.screen.part import Part, refusal


class Pointing(Part, Widget, can_focus=True):
    """A widget with a cursor."""

    KEYS_OF = "plan"

    class News(Message):
        """Something was done with the cursor. Textual runs the handlers of a base, too: this one has none."""

        def __init__(self, where: Pointing) -> None:
            """Say in which widget."""
            super().__init__()
            self.where = where

    class Pointed(News):
        """The cursor was moved."""

    class Chosen(News):
        """The point under the cursor was chosen."""

    class Turned(News):
        """Another robot is wanted."""

        def __init__(self, where: Pointing, by: int) -> None:
            """Say how many further."""
            super().__init__(where)
            self.by = by

    @property
    def has_cursor(self) -> bool:
        """Whether somebody has moved the cursor here."""
        raise NotImplementedError

    def action_cursor(self, across: int, down: int) -> None:
        """Move the cursor by so many cells; the first time it comes to the middle."""
        raise NotImplementedError

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Take no key of what is absent since one may only look."""
        if refusal(self, self.app.keyboard, action, parameters):
            return False
        return super().check_action(action, parameters)

    def action_choose(self) -> None:
        """Choose the point under the cursor."""
        if self.has_cursor:
            self.post_message(self.Chosen(self))
        else:
            self.action_cursor(0, 0)

    def action_robot(self, by: int) -> None:
        """Select another robot that moves here."""
        self.post_message(self.Turned(self, by))
