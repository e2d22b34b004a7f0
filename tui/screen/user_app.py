"""The program for people who do not operate robots: one list of what can be done, in plain words.

It knows what the supervisor knows, and shows less of it. Where nobody is in the realm it shows what was taken
along: orders are left in that memory, and go to the directories as soon as one is there.
"""

from __future__ import annotations

from typing import Any, ClassVar

from textual.binding import Binding, BindingType

from robotree.tui.line.action import spell
from robotree.tui.line.actions import BY_VERB
from robotree.tui.screen import asking
from robotree.tui.screen.app import Supervisor, program_keys
from robotree.tui.screen.pages.dialogs import Confirm, Reading
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.pages.user import UserPage
from robotree.tui.screen.user_desk import UserDesk
from robotree.tui.seen.selection import NOWHERE, Place

SHOWN = frozenset({"stop", "resume", "role"})
"""What this program asks for as operators do, beside what it does in its own way."""
HELP = """\
What can be done stands in the list. Choose it with the arrows and ⏎.

A question of a robot or a script comes first: choose it to answer.
What is under way shows how far it is; choose it to end it.
Results wait until you have looked at them.

What cannot begin now may be left as an order: it is carried out once, when its robot is there and free, and \
its result waits here, also if you leave.

{stop} stops every robot, on every page. {quit} leaves."""


class UserApp(Supervisor, inherit_bindings=False):
    """One person, one realm."""

    ENABLE_COMMAND_PALETTE = False
    BINDINGS: ClassVar[list[BindingType]] = [
        *program_keys("stop", "help"),
        Binding("ctrl+q", "quit", show=False, priority=True),
        Binding("ctrl+c", "help_quit", show=False, system=True),
    ]

    def __init__(self, *given: Any, **named: Any) -> None:
        """Take what `Supervisor` takes."""
        super().__init__(*given, **named)
        self.desk = UserDesk(self)

    def first_page(self) -> Page:
        """Return the list."""
        return UserPage(self.desk)

    def choose(self, name: str) -> None:
        """Select nothing: there is no list of robots."""

    def ask_for(self, verb: str, place: Place = NOWHERE) -> None:
        """Do what a key asks for."""
        if verb == "help":
            quits, stops = spell(BY_VERB["quit"].key), spell(BY_VERB["stop"].key)
            self.push_screen(Reading("help", HELP.format(stop=stops, quit=quits)))
        elif verb == "quit":
            self._leave()
        elif verb in SHOWN:
            asking.ask_for(self, verb, place)

    def _leave(self) -> None:
        if running := ", ".join(each.title for each in self.desk.errands if each.runs):
            question = Confirm("Leave?", f"This ends with it: {running}", "Leave")
            self.ask(question, lambda _yes: self.exit(0))
        else:
            self.exit(0)
