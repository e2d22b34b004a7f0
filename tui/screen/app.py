"""The full screen: puts pages in front of the store, and verbs behind the keys."""

from __future__ import annotations

import asyncio
import logging
import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from textual import work
from textual.app import SystemCommand
from textual.binding import Binding, BindingType
from textual.driver import Driver
from textual.events import Event, Key
from textual.filter import LineFilter
from textual.screen import Screen

from robotree.tui.errors import SupervisorError
from robotree.tui.line import completion, grammar
from robotree.tui.line.action import Scope, Where
from robotree.tui.line.actions import ACTIONS, BY_VERB, shapes
from robotree.tui.line.carrying import Refusal, carry_out
from robotree.tui.line.grammar import Line
from robotree.tui.line.keys import spell
from robotree.tui.line.surface import Surface
from robotree.tui.line.verbs import CALL_LIMIT, Outcome
from robotree.tui.screen import asking
from robotree.tui.screen.driver import outliving
from robotree.tui.screen.error_boundary import Fenced
from robotree.tui.screen.keymap import Keymap
from robotree.tui.screen.pages.dialogs import Reading
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.screen.place import NOWHERE, Place
from robotree.tui.screen.teleoperable import bounds
from robotree.tui.screen.themes import OURS, REDUCED, chosen
from robotree.tui.screen.unasked import Unasked
from robotree.tui.screen.widgets.harmless import Harmless
from robotree.tui.seen import wording
from robotree.tui.seen.feeding import Feed
from robotree.tui.seen.mood import took
from robotree.tui.seen.selection import Selection
from robotree.tui.seen.store import Store, Weight
from robotree.vr.errors import NotConfirmed, VrError
from robotree.vr.network.rendezvous import DEFAULT_REALM

if TYPE_CHECKING:
    from robotree.vr.description import RobotDescription
    from robotree.vr.supervision.fleet import Fleet

log = logging.getLogger(__name__)


class Hearer(Protocol):
    """Who asked for a command and hears what comes of it; may have gone meanwhile."""

    def began(self) -> None:
        """The command was sent."""
        ...

    def went_on(self, fraction: float, text: str) -> None:
        """It tells how far it is."""
        ...

    def returned(self, value: Any, seconds: float) -> None:
        """It succeeded."""
        ...

    def failed(self, reason: str) -> None:
        """It was refused or failed."""
        ...


def program_keys() -> Iterable[Binding]:
    """Make the keys of the whole program from the registry."""
    for one in ACTIONS:
        if one.scope is not Scope.PROGRAM:
            continue
        first, asked = bool(one.typing_key), f"verb('{one.verb}')"
        yield Binding(one.key, f"quiet_{asked}", one.label, show=bool(one.label), priority=first, id=one.verb)
        if one.typing_key:
            yield Binding(one.typing_key, asked, show=False, priority=True)


class Supervisor(Fenced, Unasked[int]):
    """One operator, one realm."""

    TITLE = "robotree"
    CSS_PATH = "supervisor.tcss"
    ENABLE_COMMAND_PALETTE = True
    BINDINGS: ClassVar[list[BindingType]] = [*program_keys()]

    def __init__(
        self,
        fleet: Fleet,
        *,
        realm: str,
        store: Store | None = None,
        farewell: str = "",
        readonly: bool = False,
        keymap: Keymap | None = None,
        calm: bool = False,
    ) -> None:
        """Supervise a fleet that has been joined.

        Args:
            fleet: the agents of the realm.
            realm: its name, to be shown.
            store: what is known already, when the screen is opened anew.
            farewell: what ends with this screen, as a sentence to ask back with; empty: nothing does.
            readonly: whether all that changes robots is absent.
            keymap: the operator's keys; None: those of the registry.
            calm: whether the line is slow: no pictures, and what changes all the time is drawn seldom.
        """
        super().__init__()
        self.calm = calm
        self.keymap = keymap or Keymap()
        self.set_keymap(dict(self.keymap.changed))
        self.readonly = readonly
        shell = f"robotree --realm {realm}" if realm != DEFAULT_REALM else "robotree"
        self.prompt = Surface(Where.PROMPT, readonly, shell=shell)
        """What can be typed."""
        self.keyboard = Surface(Where.SCREEN, readonly)
        """What has keys."""
        for theme in (*OURS, *REDUCED.values()):
            self.register_theme(theme)
        wanted = os.environ.get("TEXTUAL_THEME", "")
        ours = chosen(wanted, self.console.color_system).name
        self.theme = wanted if wanted in self.available_themes and wanted not in REDUCED else ours
        self.fleet, self.realm, self.farewell = fleet, realm, farewell
        self.store = store or Store()
        self.feed = Feed(fleet, self.store, self.now)
        self.selection = Selection()
        """The robot that keys are about, whatever page is in front."""
        self.marks: frozenset[str] = frozenset()
        """Robots that an action may take together."""
        self._harmless = Harmless()
        self.steps: dict[str, int] = {}
        """The step of tele-operation that was chosen last, by robot: an index of `jog.STEPS`."""
        self.mended: list[Exception] = []
        """Errors that the fence held back."""
        self.fatal: Exception | None = None
        """The error that ended the screen, if one did."""

    def get_driver_class(self) -> type[Driver]:
        """Return what draws on the terminal, and goes on when that has gone."""
        return outliving(super().get_driver_class())

    @staticmethod
    def now() -> float:
        """[s] on the store's clock, which is that of events."""
        return time.monotonic()

    def on_load(self) -> None:
        """Let tasks begin when the loop comes to them, on every Python alike.

        From 3.12 on Textual (8.2.8, `App.run_async`) has every task of the loop begin inside `create_task`;
        the realm was joined on this loop before, and nothing of ours is written for that.
        """
        asyncio.get_running_loop().set_task_factory(None)

    async def on_mount(self) -> None:
        """Show the main page and begin to listen."""
        await self.push_screen(MainPage())
        await self.feed.open()
        self.main.draw()

    async def on_unmount(self) -> None:
        """Stop to listen."""
        await self.feed.close()

    # -- telling -----------------------------------------------------------------------------------

    def tell(self, text: str, weight: Weight = "plain", robot: str = "") -> None:
        """Enter something in the log, of a robot or of none; the flash line shows it."""
        self.store.tell(text, weight, self.now(), robot)

    def mend(self, error: Exception) -> None:
        """Go on after an error that should not have been."""
        self.mended.append(error)
        if any(repr(error) in one.text for one in list(self.store.happenings)[-3:]):
            return  # what goes wrong at every drawing is told once
        self.tell(f"something went wrong in here, not in the robots: {error!r}", "error")

    def _handle_exception(self, error: Exception) -> None:
        """Remember what ends this screen, so that `supervise` can say it and open another one."""
        self.fatal = error
        log.error("the screen ended", exc_info=error)
        super()._handle_exception(error)

    def tell_dropped(self, what: str, why: str) -> None:
        """Tell which keys had no effect (`BusyForms.tell_dropped`)."""
        self.tell(f"{what}: {why}", "warning")

    # -- the selection -----------------------------------------------------------------------------

    def choose(self, name: str) -> None:
        """A person selects a robot."""
        self.selection = self.selection.choose(name)
        self.main.follow()

    @property
    def asked(self) -> float:
        """[s] when the key was pressed that is being dealt with; now, where there is none."""
        return self.now() if self._under_way is None else self._under_way.event.time

    def certain(self) -> bool:
        """Whether a key is meant for the robot that is selected now; else it is told why nothing is done."""
        refusal = self.selection.refusal(self.asked)
        if refusal:
            self.tell(refusal, "warning")
        return not refusal

    # -- verbs -------------------------------------------------------------------------------------

    def progress(self, fraction: float, text: str) -> None:
        """Hear how far a verb is (`verbs.Teller`)."""
        share = "" if math.isnan(fraction) else f"{fraction:.0%} "
        self.tell(f"… {share}{text}".rstrip())

    def warn(self, text: str) -> None:
        """Hear what a person should know before a verb has ended (`verbs.Teller`)."""
        self.tell(text, "warning")

    def outcome(self, outcome: Outcome) -> None:
        """Hear one of many outcomes of a verb (`verbs.Teller`)."""
        self.tell(outcome.text)

    async def attempt(self, line: Line) -> str:
        """Carry out a verb and tell what came of it.

        Returns:
            Why it was refused or failed; empty: it was done.
        """
        text, refusal = await self._carry_out(line)
        if text:
            self.tell(text, "good")
        return refusal

    async def _carry_out(self, line: Line) -> tuple[str, str]:
        if line.verb == "stop":
            self.store.begin_stop(line.text("NAME"), self.now())
        began, robot = self.now(), line.text("ROBOT.COMMAND").partition(".")[0]
        try:
            with self.store.asking(robot):
                outcome = await carry_out(self.fleet, line, self)
        finally:
            self.feed.hint()
        self._note_stop(line, outcome)
        if isinstance(outcome, Refusal):
            self.tell(f"{outcome}{self._took(robot, began)}", "error", robot)
            return "", str(outcome)
        if outcome.doubt:
            self.tell(str(outcome.doubt), "warning")
        if line.verb == "create":
            self.selection = self.selection.go_to(line.text("NAME"), self.now())
        one_line = outcome.text and "\n" not in outcome.text
        return outcome.text + (self._took(robot, began) if one_line else ""), ""

    def _took(self, robot: str, began: float) -> str:
        """Say how long a command took that began at this moment [s]; other verbs take no time."""
        return f" after {took(self.now() - began)}" if robot else ""

    def _note_stop(self, line: Line, outcome: Outcome | Refusal) -> None:
        """Keep who has confirmed a stop and who has not, until it is resumed."""
        if line.verb == "stop":
            if isinstance(outcome, Outcome):
                self.store.end_stop(outcome.data["stopped"], {}, self.now())
            elif isinstance(outcome.error, NotConfirmed):
                data = outcome.error.data
                self.store.end_stop(data["told"], dict(data["untold"]), self.now())
            else:
                self.store.end_stop([], {}, self.now())
        elif line.verb == "resume" and isinstance(outcome, Outcome) and not line.text("NAME"):
            self.store.end_resume()

    @work(exit_on_error=False, group="verbs")
    async def perform(self, line: Line) -> None:
        """Carry out a verb beside everything else; a longer text is shown in a dialog of its own."""
        try:
            text, refusal = await self._carry_out(line)
        except Exception as error:  # the last fence of this task
            log.exception("while doing %s", line.verb)
            self.mend(error)
            return
        if refusal:
            return
        if "\n" in text:
            typed, reading = self.typing, Reading(grammar.form(line, shapes(Where.PROMPT)), text)
            self.push_screen(reading)
            self.comes_unasked(reading, typed=typed)
        else:
            self.tell(text, "good")

    @work(exit_on_error=False, group="calls")
    async def call(self, robot: str, command: str, arguments: Mapping[str, Any], hearer: Hearer) -> None:
        """Have a command carried out beside everything else, and tell whoever asked for it."""
        hearer.began()
        began = self.now()
        try:
            with self.store.asking(robot):
                value = await self.fleet.call(
                    robot, command, arguments, deadline=CALL_LIMIT, on_progress=hearer.went_on
                )
        except VrError as error:
            self.tell(f"{error}{self._took(robot, began)}", "error", robot)
            hearer.failed(str(error))
        except Exception as error:  # the last fence of this task
            log.exception("while calling %s.%s", robot, command)
            self.mend(error)
            hearer.failed(repr(error))
        else:
            shown = wording.value(value) if value is not None else "done"
            self.tell(f"{robot}.{command}: {shown}{self._took(robot, began)}", "good", robot)
            hearer.returned(value, self.now() - began)

    def do(self, verb: str, **values: str) -> None:
        """Carry out a verb with these values."""
        self.perform(Line(verb, values))

    def ask_for(self, verb: str, place: Place = NOWHERE) -> None:
        """Do what a key asks for: open a page, ask what is missing, ask back where it is dangerous."""
        if absent := self.keyboard.elsewhere(verb.split()):
            self.tell(str(absent), "warning")
        else:
            asking.ASK[verb](self, place)

    def obey(self, text: str) -> None:
        """Do what was typed at the prompt."""
        try:
            words = grammar.split(text)
            line = self.prompt.parse(words) if words else None
        except (SupervisorError, VrError) as error:
            self.tell(str(error), "error")
            return
        if line is None:
            return
        if not BY_VERB[line.verb].run:
            self.ask_for(line.verb)
        elif BY_VERB[line.verb].danger:
            self._confirm(line)
        else:
            self.perform(line)

    def _confirm(self, line: Line) -> None:
        """Ask back, unless what the line names is not there."""
        name = line.text("NAME") or line.text("PARENT.SLOT").partition(".")[0]
        if not name or any(one.name == name for one in self.fleet.directory.present("robot")):
            asking.confirm_line(self, line)
        else:
            self._confirm_absent(line, name)

    @work(exit_on_error=False, group="verbs")
    async def _confirm_absent(self, line: Line, name: str) -> None:
        """Say who is not there, or hangs; ask back if it has come just now."""
        try:
            await self.fleet.directory.resolve(name)
        except VrError as error:
            self.tell(str(error), "error")
        else:
            asking.confirm_line(self, line)

    @property
    def main(self) -> MainPage:
        """The main page."""
        return next(screen for screen in self.screen_stack if isinstance(screen, MainPage))

    def words(self) -> completion.Words:
        """Return the names of the moment, for completion (`prompt.Known`)."""
        robots = sorted({*self.store.robots, *self.store.descriptions})
        described = [self.store.descriptions[name] for name in robots if name in self.store.descriptions]
        return completion.Words(
            {
                "NAME": robots,
                "CHILD": sorted(self.store.robots),
                "VIEW": sorted(self.store.views),
                "HOST": self.store.hosts,
                "PARENT.SLOT": [f"{one.name}.{slot.name}" for one in described for slot in one.slots],
                "ROBOT.COMMAND": [
                    f"{one.name}.{command.name}" for one in described for command in one.commands
                ],
            },
            self.prompt.shapes,
        )

    # -- keys of the whole program -----------------------------------------------------------------

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Let a letter be a letter, and space a space, while somebody types."""
        if action == "quiet_verb" and (self.typing or not self.keyboard.has(BY_VERB[str(parameters[0])])):
            return False
        return super().check_action(action, parameters)

    def overtakes(self, key: Key, before: list[Event]) -> bool:
        """Let the stop wait for no other key, unless it is a space to be typed (`KeysInOrder.overtakes`)."""
        stop = BY_VERB["stop"]
        if key.key != stop.key:
            return key.key == stop.typing_key
        typed_next = any(isinstance(one, Key) and one.key in self.line_keys for one in before)
        return not self.typing and not (typed_next and isinstance(self.screen, MainPage))

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

    def open_teleoperation(self, robot: RobotDescription) -> None:
        """Open the tele-operation of a robot, if it can be tele-operated."""
        found = bounds(robot)
        if found is None:
            self.tell(
                f"{robot.name} cannot be tele-operated: it needs go_to with x, y, z, twist and get_info",
                "warning",
            )
        else:
            self.push_screen(TeleopPage(robot, found))

    def get_line_filters(self) -> Sequence[LineFilter]:
        """Return what every line of every widget goes through: Textual's filters, and ours."""
        return [*super().get_line_filters(), self._harmless]

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Offer the registry in the palette, beside what Textual offers."""
        for group, actions in self.keyboard.groups.items():
            for action in actions:
                title = f"{group}: {action.verb}" + (
                    f"  ({self.keymap.spelled(action.verb)})" if action.key else ""
                )
                yield SystemCommand(title, action.help, lambda verb=action.verb: self._from_palette(verb))
        yield from super().get_system_commands(screen)  # pyright: ignore[reportUnknownMemberType] # Textual leaves it open

    def _from_palette(self, verb: str) -> None:
        if BY_VERB[verb].scope is Scope.PROGRAM:
            self.ask_for(verb)
        else:
            self.main.action_verb(verb)
