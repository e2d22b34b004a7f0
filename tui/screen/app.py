"""The full screen: puts pages in front of the store, and verbs behind the keys."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from rich.segment import Segment
from textual import work
from textual.app import SystemCommand
from textual.binding import Binding, BindingType
from textual.color import Color
from textual.driver import Driver
from textual.events import Event, Key
from textual.filter import LineFilter
from textual.screen import Screen

from robotree.tui.errors import SupervisorError, UnknownVerb
from robotree.tui.line import grammar
from robotree.tui.line.action import Scope, Where, spell
from robotree.tui.line.actions import ACTIONS, BY_VERB, shapes
from robotree.tui.line.grammar import Line
from robotree.tui.screen import asking, looks
from robotree.tui.screen.driver import outliving
from robotree.tui.screen.jog import bounds
from robotree.tui.screen.operator_app import OperatorApp
from robotree.tui.screen.pages.dialogs import AttendDialog, Reading
from robotree.tui.screen.pages.main import FIRST, MainPage, main_page
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.seen import wording
from robotree.tui.seen.rows import natural
from robotree.tui.seen.selection import NOWHERE, Place
from robotree.tui.terminal import STEERING
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.exchange.attendance import Attendance

log = logging.getLogger(__name__)


SHOWN_EVERY = 0.5
"""[s] between two looks whether the other operators are to be told of another page."""
QUITS = frozenset({"q", "q!", "exit"})
"""Lines that leave other programs, taken as `quit`."""


class ControlFilter(LineFilter):
    """Takes away what steers a terminal instead of being seen, from every line of every widget.

    Rich and Textual take a few control characters out of a text and let escapes pass. What steers has no
    width, so it is taken away without moving anything.
    """

    def apply(self, segments: list[Segment], background: Color) -> list[Segment]:  # noqa: ARG002 # Textual's contract
        """Return the segments of one line with harmless texts; see `LineFilter.apply`."""
        if not any(STEERING.search(segment.text) for segment in segments):
            return segments
        return [Segment(STEERING.sub("", text), style) for text, style, _ in segments]


CONTROL_FILTER = ControlFilter()


def words_of(screen: Screen[object]) -> str:
    """Return which page is in front, in words for other operators."""
    robot = getattr(getattr(screen, "robot", None), "name", "")
    if isinstance(screen, MainPage) and screen.pane != FIRST:
        return f"the {screen.pane}"
    name = {"MainPage": "the list", "PanelPage": "panel", "TeleopPage": "tele-operation"}.get(
        type(screen).__name__, type(screen).__name__.removesuffix("Page").removesuffix("Dialog").lower()
    )
    return f"{name} of {robot}" if robot else name


def program_keys(*verbs: str) -> Iterable[Binding]:
    """Make the keys of the whole program from the registry: all of them, or those of these verbs."""
    for action in ACTIONS:
        if action.scope is not Scope.PROGRAM or (verbs and action.verb not in verbs):
            continue
        first, asked = (
            bool(action.typing_key or action.while_busy),
            f"verb('{action.verb}')",
        )  # also over a question
        yield Binding(
            action.key,
            f"quiet_{asked}",
            action.label,
            show=bool(action.label),
            priority=first,
            id=action.verb,
        )
        if action.typing_key:
            yield Binding(action.typing_key, asked, show=False, priority=True)


def _short(words: Sequence[str]) -> Sequence[str]:
    """Take `view NAME` for the use of a saved filter: what else begins with that word is for a shell."""
    if len(words) == 2 and words[0] == "view" and f"view {words[1]}" not in BY_VERB:
        return "view", "use", words[1]
    return words


class Supervisor(OperatorApp):
    """One operator, one realm."""

    TITLE = "robotree"
    CSS_PATH = Path(__file__).with_name("supervisor.tcss")  # beside this file, also for a subclass elsewhere
    ENABLE_COMMAND_PALETTE = True
    BINDINGS: ClassVar[list[BindingType]] = [*program_keys()]

    fatal: Exception | None = None
    """The error that ended the screen, if one did."""

    def get_driver_class(self) -> type[Driver]:
        """Return what draws on the terminal, and goes on when that has gone."""
        return outliving(super().get_driver_class())

    def on_load(self) -> None:
        """Let tasks begin when the loop comes to them, on every Python alike.

        From 3.12 on Textual (8.2.8, `App.run_async`) has every task of the loop begin inside `create_task`;
        the realm was joined on this loop before, and nothing of ours is written for that.
        """
        asyncio.get_running_loop().set_task_factory(None)

    async def on_mount(self) -> None:
        """Show the first page and begin to listen."""
        first = self.first_page()
        await self.push_screen(first)
        self.looks.order_letters()
        await self.feed.open()
        self.watching.hear_streams()
        self.store.me = self.realm_client.operators.person
        self.realm_client.operators.on_said.append(self._hear)
        await self.realm_client.operators.open()
        self.set_interval(SHOWN_EVERY, self.guarded(self._show_where))
        first.draw()
        self.opened()

    def opened(self) -> None:
        """Begin what a screen does beside that.

        It is no `on_mount` of a subclass: Textual calls those of all classes, so `super` would open it twice.
        """

    def _hear(self, person: str, text: str) -> None:
        """Show what another operator says."""
        self.tell(f"{person} says: {text}", "good")

    def _show_where(self) -> None:
        """Say to the other operators which page is in front."""
        if self.screen_stack:  # else the screen is about to end
            self.realm_client.operators.show(words_of(self.screen), self.selection.name)

    def first_page(self) -> Page:
        """Return the page to begin with."""
        return MainPage()

    async def on_unmount(self) -> None:
        """Stop to listen."""
        await self.watching.close()
        self.looks.order_letters(ends=True)
        await self.feed.close()

    def _handle_exception(self, error: Exception) -> None:
        """Remember what ends this screen, so that `supervise` can say it and open another one."""
        self.fatal = error
        log.error("the screen ended", exc_info=error)
        super()._handle_exception(error)

    # -- the selection -----------------------------------------------------------------------------

    def choose(self, name: str) -> None:
        """A person selects a robot."""
        self.selection = self.selection.choose(name)
        self.main.follow()

    # -- verbs -------------------------------------------------------------------------------------

    @work(exit_on_error=False, group="verbs")
    async def perform(self, line: Line) -> None:
        """Carry out a verb beside everything else; a longer text is shown in a dialog of its own."""
        try:
            text, refusal = await self._carry_out(line)
        except Exception as error:  # the last fence of this task
            log.exception("while doing %s", line.verb)
            self.report_error(error)
            return
        if refusal:
            return
        if "\n" in text:
            typed, reading = self.guard.typing, Reading(grammar.form(line, shapes(Where.PROMPT)), text)
            self.push_screen(reading)
            self.guard.opened_by_itself(reading, typed=typed)
        elif text:
            self.tell(text, "good")

    def ask_for(self, verb: str, place: Place = NOWHERE) -> None:
        """Do what a key asks for: open a page, ask what is missing, ask back where it is dangerous."""
        if absent := self.keyboard.elsewhere(verb.split()):
            self.tell(str(absent), "warning")
        else:
            asking.ask_for(self, verb, place)

    def run_typed(self, text: str) -> None:
        """Do what was typed at the prompt."""
        try:
            words = _short(grammar.split("quit" if text.strip() in QUITS else text))
            line = self.prompt.parse(words) if words else None
        except UnknownVerb as error:
            near = f"did you mean {' or '.join(error.near)}?" if error.near else ""
            hint = near or f"{self.keymap.spelled('help')} shows all keys and verbs"
            self.tell(f"no verb {error.verb!r}; {hint}", "error")
            return
        except (SupervisorError, VrError) as error:
            self.tell(str(error), "error")
            return
        if line is None:
            return
        if line.verb == "log" and (line.flag("--follow") or not line.text("NAME")):
            line = Line("log")  # what robots say comes there by itself
        if line.verb in looks.VERBS:
            self.looks.change(line.verb, line.text("NAME") or line.text("LANGUAGE"))
        elif not BY_VERB[line.verb].run or line == Line("log"):
            asking.ask_for(self, line.verb, Place(line.text("NAME")))  # some of these have no key
        elif BY_VERB[line.verb].danger:
            self._confirm(line)
        else:
            self.perform(line)

    def _confirm(self, line: Line) -> None:
        """Ask back, unless what the line names is not there."""
        name = line.text("NAME") or line.text("PARENT.SLOT").partition(".")[0]
        if not name or self.realm_client.directory.present("robot", name):
            asking.confirm_line(self, line)
        else:
            self._confirm_absent(line, name)

    @work(exit_on_error=False, group="verbs")
    async def _confirm_absent(self, line: Line, name: str) -> None:
        """Say who is not there, or hangs; ask back if it has come just now."""
        try:
            await self.realm_client.directory.resolve(name)
        except VrError as error:
            self.tell(str(error), "error")
        else:
            asking.confirm_line(self, line)

    @property
    def main(self) -> MainPage:
        """The main page."""
        return main_page(self)

    # -- keys of the whole program -----------------------------------------------------------------

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Give letters and the space to the field in which the operator types."""
        if action == "quiet_verb" and self.guard.typing:
            return False
        if action == "quiet_verb" and not self.keyboard.has(BY_VERB[str(parameters[0])]):
            return False
        return super().check_action(action, parameters)

    def overtakes(self, key: Key, before: list[Event]) -> bool:
        """Let the stop wait for no other key, unless it is a space to be typed (`KeysInOrder.overtakes`)."""
        stop = BY_VERB["stop"]
        if key.key != stop.key:
            return key.key == stop.typing_key
        typed_next = any(isinstance(one, Key) and one.key in self.guard.line_keys for one in before)
        return not self.guard.typing and not typed_next

    def action_quiet_verb(self, verb: str) -> None:
        """Do what a key asks for that works wherever nobody types."""
        self.ask_for(verb)

    def action_verb(self, verb: str) -> None:
        """Do what a key asks for that works anywhere."""
        self.ask_for(verb)

    async def action_quit(self) -> None:
        """Leave, after asking back if something ends with this screen."""
        self.ask_for("quit")

    def action_help_quit(self) -> None:
        """Say at ctrl+c what leaves, in the line for such words; Textual's own would cover what one reads."""
        self.tell(f"ctrl+q leaves; {spell(BY_VERB['stop'].typing_key)} stops every robot")

    def hold_key(self, robot: str, command: str, attendance: Attendance) -> Callable[[], None]:
        """Put in front where a key is held for a command that wants that; returns how to take it away."""
        dialog = AttendDialog(robot, command, attendance)
        typed = self.guard.typing
        self.push_screen(dialog)
        self.guard.opened_by_itself(dialog, typed=typed)
        return dialog.over

    def open_teleoperation(self, robot: RobotDescription) -> None:
        """Open the tele-operation of a robot, if it can be tele-operated."""
        found = bounds(robot)
        if self.withheld("call"):
            return
        if found is None:
            self.tell(
                f"{robot.name} cannot be tele-operated: it needs go_to with x, y, z, twist and get_info",
                "warning",
            )
        else:
            self.push_screen(TeleopPage(robot, found))

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return what every line of every widget goes through: Textual's filters, and ours."""
        return [*super().get_line_filters(), CONTROL_FILTER]

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Offer the registry in the palette, beside what Textual offers."""
        for group, actions in self.keyboard.groups.items():
            for action in actions:
                if action.verb == "stop" and self.OWN_KEYS:  # its key does something else on this screen
                    continue
                title = f"{group}: {action.verb}" + (
                    f"  ({self.keymap.spelled(action.verb)})" if action.key else ""
                )
                yield SystemCommand(title, action.help, lambda verb=action.verb: self._from_palette(verb))
        for name in sorted(self.store.known, key=natural):
            about = wording.summary(robot.doc) if (robot := self.store.described(name)) else ""
            yield SystemCommand(f"Robot: {name}", about or "Select it.", lambda name=name: self._go_to(name))
        yield from super().get_system_commands(screen)  # pyright: ignore[reportUnknownMemberType] # Textual leaves it open

    def _go_to(self, name: str) -> None:
        """Show a robot in the list, selected, whatever page is in front."""
        while self.screen is not self.main:
            self.pop_screen()
        self.main.reveal()
        self.choose(name)

    def _from_palette(self, verb: str) -> None:
        if BY_VERB[verb].scope is Scope.PROGRAM:
            self.ask_for(verb)
        else:
            self.main.action_verb(verb)


class Composer(Supervisor):
    """The full screen that begins with the composer."""

    def opened(self) -> None:
        """Open the composer over the main page."""
        self.ask_for("compose")
