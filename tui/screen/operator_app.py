"""One operator at one realm: what is known, selected and marked, and how a command is carried out.

Pages and widgets know this class and nothing above it; `app.Supervisor` puts the pages in front of
the operator.
"""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from textual import work
from textual.driver import Driver
from textual.screen import Screen
from textual.theme import Theme

from robotree.tui import words
from robotree.tui.errors import SupervisorError
from robotree.tui.line import completion, ordering
from robotree.tui.line.action import Where
from robotree.tui.line.carrying import Refusal, carry_out
from robotree.tui.line.grammar import Line
from robotree.tui.line.installed import lacking
from robotree.tui.line.surface import Surface
from robotree.tui.line.verbs import CALL_LIMIT, Outcome
from robotree.tui.processes.alarm_file import alarms_of
from robotree.tui.processes.choices import Choices
from robotree.tui.processes.layout import LayoutFile
from robotree.tui.processes.terminal_graphics import CELLS
from robotree.tui.processes.wire_watch import WireMessage, WireWatch
from robotree.tui.screen import themes
from robotree.tui.screen.error_boundary import ErrorBoundary
from robotree.tui.screen.foresight import Foresight
from robotree.tui.screen.key_guard import KeyGuard
from robotree.tui.screen.keymap import Keymap
from robotree.tui.screen.palette import reduced_theme
from robotree.tui.screen.themes import OURS, REDUCED, SIXTEEN, chosen
from robotree.tui.seen import wording
from robotree.tui.seen.errand import CallListener
from robotree.tui.seen.feeding import Feed
from robotree.tui.seen.selection import NOWHERE, Place, Selection
from robotree.tui.seen.series import Reading, named, reading_of
from robotree.tui.seen.store import Store, Weight
from robotree.tui.seen.streams import HeardStreams
from robotree.tui.words import say
from robotree.vr.base.errors import ChildCancelled, CommandCancelled, NotConfirmed, VrError
from robotree.vr.exchange.attendance import Attendance
from robotree.vr.network.realms import DEFAULT_REALM

if TYPE_CHECKING:
    from robotree.vr.base.description import FieldSpec, RobotDescription
    from robotree.vr.supervision.realm_client import RealmClient

log = logging.getLogger(__name__)

Answer = TypeVar("Answer")


Denials = dict[tuple[str, tuple[str, ...], str], str]
"""What a policy said: its refusal, or nothing, by robot, kinds and command."""
LOOKS = frozenset({"theme", "language"})
"""Verbs about how the screen looks."""


CONTROL = {"control get", "control offer", "control take", "control leave"}
"""Verbs by which control of a robot changes hands, or stays as it is."""


class OperatorApp(ErrorBoundary, KeyGuard[int]):
    """The interface of the app for its pages and widgets."""

    STOP_WORD: ClassVar[str] = "STOP"
    """What the key of the stop does, in the line on top."""
    OWN_KEYS: ClassVar[Sequence[tuple[str, str]]] = ()
    """Keys of this screen and what they do, in the help instead of the stop; none: it stops robots."""

    def __init__(  # noqa: PLR0913 # what a person has kept, beside the options of the command line
        self,
        realm_client: RealmClient,
        *,
        realm: str,
        store: Store | None = None,
        farewell: str = "",
        readonly: bool = False,
        keymap: Keymap | None = None,
        calm: bool = False,
        steps: Choices | None = None,
        layout: LayoutFile | None = None,
    ) -> None:
        """Supervise a realm client that has been joined.

        Args:
            realm_client: the agents of the realm.
            realm: its name, to be shown.
            store: what is known already, when the screen is opened anew.
            farewell: what ends with this screen, as a sentence to ask back with; empty: nothing does.
            readonly: whether all that changes robots is absent.
            keymap: the operator's keys; None: those of the registry.
            calm: whether the line is slow: no pictures, and what changes all the time is drawn seldom.
            steps: which step of tele-operation was chosen last; None: nothing is kept.
            layout: how this person has arranged the screen; None: nothing is kept.
        """
        super().__init__()
        self.calm, self.readonly = calm, readonly
        self.keymap = keymap or Keymap()
        self.set_keymap(dict(self.keymap.changed))
        shell = f"robotree --realm {realm}" if realm != DEFAULT_REALM else "robotree"
        self.prompt = Surface(Where.PROMPT, readonly, shell=shell)  # the actions that can be typed
        self.keyboard = Surface(Where.SCREEN, readonly)  # the actions that have keys
        self._take_theme()
        self.realm_client, self.realm, self.farewell = realm_client, realm, farewell
        self.store = store or Store()
        self.store.denies = self._denies
        self._denied: tuple[object, Denials] = (None, {})  # what a policy was asked, and what it said
        self.feed = Feed(realm_client, self.store, self.now, alarms_of(realm_client.realm))
        self.selection = Selection()  # the robot that keys are about, whatever page is in front
        self.marks: frozenset[str] = frozenset()  # robots that an action may take together
        self.past: list[str] = []  # lines that were typed at the prompt, on whatever page
        self._ordered = False  # whether the terminal leaves the order of letters to us
        self.looks = Choices()  # what was chosen last of how the screen looks
        self.own_themes: tuple[Theme, ...] = ()
        self.steps = steps or Choices()  # the step of tele-operation that was chosen last, by robot
        self.pictures = CELLS
        """How pictures are drawn in this terminal; `supervise` finds it out."""
        self.foresight = Foresight()  # what a robot says of the way that somebody is about to send it
        self.layout = layout or LayoutFile()  # how this person has arranged the screen
        if readonly:
            self.layout.keep_nothing()
            self.steps.keep_nothing()
        self.wires: dict[str, WireWatch] = {}  # by robot: wires that are watched
        self.streams = HeardStreams(realm_client, self._heard_stream)
        self._tick_again()
        self._rung = self.store.watched.rung
        self.errors: list[Exception] = []  # those that the fence held back

    @property
    def driver(self) -> Driver | None:
        """Textual's way to the terminal; None: there is none."""
        return self._driver

    def _take_theme(self) -> None:
        """Register our themes, and take the one that the environment wants."""
        for theme in (*OURS, *REDUCED.values(), *SIXTEEN.values()):
            self.register_theme(theme)
        wanted = os.environ.get("TEXTUAL_THEME", "")
        ours = chosen(wanted, self.console.color_system).name
        self.theme = wanted if wanted in self.available_themes and wanted not in REDUCED else ours

    # -- looks -------------------------------------------------------------------------------------

    def wear(self, looks: Choices, themes: Sequence[Theme]) -> None:
        """Look as the operator has chosen last, or once and for all.

        Args:
            looks: what was chosen; what will be is kept there.
            themes: of the operator's own.

        Raises:
            NoSuchLanguage: `$ROBOTREE_LANGUAGE` names none.
        """
        self.looks, self.own_themes = looks, tuple(themes)
        if self.readonly:
            looks.keep_nothing()
        for theme in themes:
            self.register_theme(theme)
            self.register_theme(reduced_theme(theme))
        kept = looks.get("language", "")
        words.choose(words.wanted() or (kept if kept in words.LANGUAGES else "en"))
        wanted = os.environ.get("TEXTUAL_THEME", "") or looks.get("theme", "")
        if wanted.removeprefix("robotree-") in self._theme_names:
            self.theme = chosen(wanted, self.console.color_system, self.own_themes).name

    @property
    def _theme_names(self) -> list[str]:
        return [theme.name.removeprefix("robotree-") for theme in (*OURS, *self.own_themes)]

    def change_look(self, what: str, name: str = "") -> None:
        """Show other colours, or other words: `theme` and `language`; without a name, the next ones."""
        if what == "language":
            self._speak(name or _behind(words.chosen(), list(words.LANGUAGES)))
            return
        known = self._theme_names
        now = self.theme.removeprefix("robotree-").removesuffix("-256").removesuffix("-16")
        name = name.removeprefix("robotree-") or _behind(now, known)
        if name in known:
            self.theme = chosen(name, self.console.color_system, self.own_themes).name
        elif name in self.available_themes:
            self.theme = name
        else:
            own = f"one of yours is a file {themes.folder()}/NAME.toml, read at the start"
            self.tell(f"there is no theme {name!r}; there are {', '.join(known)}; {own}", "error")
            return
        self.looks.choose("theme", name)
        self.tell(f"theme {name}", "good")

    def _speak(self, code: str) -> None:
        try:
            words.choose(code)
        except (SupervisorError, ImportError) as error:
            lack = lacking("language", error) if isinstance(error, ImportError) else error
            self.tell(str(lack or error), "error")
            return
        self.looks.choose("language", code)
        self.order_letters()
        for screen in self.screen_stack:
            for line in screen.query("KeyLine"):
                line.refresh(recompose=True)
        self.tell(f"language {code}", "good")

    def order_letters(self, *, ends: bool = False) -> None:
        """Tell the terminal who sees to the order of letters: we, as long as words go from right to left."""
        if self._driver is not None and (words.chosen() in words.LEFTWARDS or self._ordered):
            self._ordered = words.chosen() in words.LEFTWARDS and not ends
            self._driver.write(words.EXPLICIT if self._ordered else words.IMPLICIT)

    @staticmethod
    def now() -> float:
        """[s] on the store's clock, which is that of events."""
        return time.monotonic()

    @property
    def heading(self) -> str:
        """Return what stands in the line on top behind the program's name."""
        realm = say("realm {name}", name=self.realm)
        return f"{realm} ({say('read-only')})" if self.readonly else realm

    @staticmethod
    def wall() -> float:
        """[s] since 1970, at the same moment as `now`."""
        return time.time()

    # -- telling -----------------------------------------------------------------------------------

    def tell(self, text: str, weight: Weight = "plain", robot: str = "") -> None:
        """Enter something in the log, of a robot or of none; the flash line shows it."""
        self.store.tell(text, weight, self.now(), robot)

    def report_error(self, error: Exception) -> None:
        """Go on after an error that should not have been."""
        self.errors.append(error)
        if any(repr(error) in entry.text for entry in list(self.store.entries)[-3:]):
            return  # what goes wrong at every drawing is told once
        self.tell(f"something went wrong in here, not in the robots: {error!r}", "error")

    def tell_dropped(self, what: str, why: str) -> None:
        """Tell which keys had no effect (`KeyGuard.tell_dropped`)."""
        self.tell(f"{what}: {why}", "warning")

    def _denies(self, robot: str, kinds: Sequence[str], command: str) -> str:
        """Return why the policy denies a command to who sits here; see `Store.denies`."""
        gate = self.realm_client.gate
        if not gate.closed:
            return ""
        if self._denied[0] is not gate.policy:
            self._denied = (gate.policy, {})
        asked, known = (robot, tuple(kinds), command), self._denied[1]
        if asked not in known:
            refused = self.realm_client.refused("command", robot, kinds, command)
            known[asked] = "" if refused is None else str(refused)
        return known[asked]

    # -- readings over time ------------------------------------------------------------------------

    def tick(self, reading: Reading) -> None:
        """Watch a reading over time, or end that; which are watched is kept for this person and realm."""
        ticked = self.store.watched.ticked
        if reading in ticked.series:
            ticked.untick(reading)
        else:
            ticked.tick(reading)
        for robot in [one for one in self.wires if not self._has_ticked_fields(one)]:
            if not any(getattr(page, "robot", "") == robot for page in self.screen_stack):
                self.leave_wire(robot)
        self.hear_streams()
        names = [named(one) for one in ticked.series if "." not in one[1]]  # wires are not watched unasked
        kept = {**self.layout.layout.ticked, self.realm: names}
        self.layout.change(ticked={realm: names for realm, names in kept.items() if names})

    def _tick_again(self) -> None:
        """Watch what was watched when this person left."""
        for name in self.layout.layout.ticked.get(self.realm, ()):
            if reading := reading_of(name):
                self.store.watched.ticked.tick(reading)

    def hear_streams(self) -> None:
        """Listen to the streams that are ticked, and to no other."""
        following = self.streams.follow(list(self.store.watched.ticked.series))
        self.run_worker(following, exit_on_error=False, group="streams")

    def _heard_stream(self, robot: str, numbers: Mapping[str, float]) -> None:
        self.store.watched.take(robot, numbers, self.now())

    # -- the wires of proxies ----------------------------------------------------------------------

    def watch_wire(self, robot: str) -> None:
        """Listen to the controller of a proxy, if that is not done already."""
        if robot not in self.wires:
            self.wires[robot] = WireWatch(self.realm_client.realm, robot, partial(self._heard_wire, robot))

    def _heard_wire(self, robot: str, messages: Sequence[WireMessage]) -> None:
        if robot in self.store.watched.ticked.robots:
            now = self.now()
            for one in messages:
                fields = {f"{one.name}.{name}": value for name, value in one.numbers().items()}
                self.store.watched.ticked.take(robot, fields, now)

    def _has_ticked_fields(self, robot: str) -> bool:
        return any("." in name for name in self.store.watched.ticked.robots.get(robot, ()))

    def leave_wire(self, robot: str) -> None:
        """Listen no longer, unless a field of it is ticked."""
        if not self._has_ticked_fields(robot) and (watch := self.wires.pop(robot, None)):
            self.run_worker(watch.close(), exit_on_error=False, group="wires")

    async def close_wires(self) -> None:
        """End all of them."""
        while self.wires:
            await self.wires.popitem()[1].close()

    def ring(self) -> None:
        """Ring the bell of the terminal, once for each time that alarms were raised."""
        if self.store.watched.rung != self._rung:
            self._rung = self.store.watched.rung
            self.bell()

    # -- the selection -----------------------------------------------------------------------------

    @property
    def asked(self) -> float:
        """[s] when the key was pressed that is being dealt with; now, where there is none."""
        return self.now() if self._under_way is None else self._under_way.event.time

    def certain(self) -> bool:
        """Whether a key is meant for the robot that is selected now; else the log shows the reason."""
        refusal = self.selection.refusal(self.asked)
        if refusal:
            self.tell(refusal, "warning")
        return not refusal

    def turn(self, names: Iterable[str], by: int) -> None:
        """Select the robot so many places after the selected one among these; there is one at least."""
        names = sorted(names)
        at = names.index(self.selection.name) if self.selection.name in names else -1
        self.choose(names[(at + by) % len(names)])

    # -- verbs -------------------------------------------------------------------------------------

    def foresee(self, robot: RobotDescription, at: Mapping[str, float], frame: str) -> None:
        """Ask a robot whether it would go to a point in a frame [m, rad], and which way: see `foresight`."""
        asking: Any = self.foresight.ask(self.realm_client, robot, at, frame, self.store.readings(robot.name))
        if asking is not None:
            self.run_worker(asking, group="foresight", exclusive=True, exit_on_error=False)

    def progress(self, fraction: float, text: str) -> None:
        """Take how far a verb is (`verbs.Teller`). The list shows it; the log would overflow."""
        del fraction, text

    def warn(self, text: str) -> None:
        """Hear what a person should know before a verb has ended (`verbs.Teller`)."""
        self.tell(text, "warning")

    def outcome(self, outcome: Outcome) -> None:
        """Hear one of many outcomes of a verb (`verbs.Teller`)."""
        self.tell(outcome.text)

    async def attempt(self, line: Line) -> str:
        """Carry out a verb and report its result.

        Returns:
            Why it was refused or failed; empty: it was done.
        """
        text, refusal = await self._carry_out(line)
        if text:
            self.tell(text, "good")
        return refusal

    def withheld(self, verb: str) -> bool:
        """Whether one may only look, and the verb does more: then it is told, whatever has asked for it."""
        why = self.keyboard.refusal(verb)
        if why:
            self.tell(why, "warning")
        return bool(why)

    async def _carry_out(self, line: Line) -> tuple[str, str]:
        if self.withheld(line.verb):
            return "", self.keyboard.refusal(line.verb)
        if line.verb == "stop":
            self.store.begin_stop(line.text("NAME"), self.now())
        robot, _, command = line.text("ROBOT.COMMAND").partition(".")
        state = self.store.state(line.text("NAME"))
        holder = state.operator if state else ""
        try:
            outcome = await carry_out(self.realm_client, line, self)
        finally:
            self.feed.hint()
        self._note_stop(line, outcome)
        if isinstance(outcome, Refusal):
            self._tell_refusal(outcome.error, str(outcome), robot)
            return "", str(outcome)
        if outcome.doubt:
            self.tell(str(outcome.doubt), "warning")
        if line.verb == "create":
            self.selection = self.selection.go_to(line.text("NAME"), self.now())
        changed = line.verb in CONTROL and outcome.data["operator"] != holder  # the store tells it
        called = line.verb == "call" and outcome.data is None and self._enters(robot, command)
        return "" if changed or called or outcome.logged else outcome.text, ""

    def _tell_refusal(self, error: Exception, sentence: str, robot: str) -> None:
        """Tell why something was not done, unless the log of its robot does."""
        if not (isinstance(error, VrError) and error.entered):
            self.tell(sentence, weight_of(error), robot)

    def _enters(self, robot: str, command: str) -> bool:
        """Whether a robot's log tells of each end of a command: of those that only read, failures alone."""
        described = self.store.described(robot)
        spec = described.command(command) if described else None
        return spec is not None and spec.effect != "read" and not spec.beside

    def _note_stop(self, line: Line, outcome: Outcome | Refusal) -> None:
        """Keep who has confirmed a stop and who has not, until it is resumed."""
        if line.verb == "stop":
            if isinstance(outcome, Outcome) and "group" in outcome.data:
                each = outcome.data["members"]
                told = [one["name"] for one in each if one["ok"]]
                untold = {one["name"]: one["detail"] for one in each if not one["ok"]}
                self.store.end_stop(told, untold, self.now())
            elif isinstance(outcome, Outcome):
                self.store.end_stop(outcome.data["stopped"], {}, self.now())
            elif isinstance(outcome.error, NotConfirmed):
                data = outcome.error.data
                self.store.end_stop(data["told"], dict(data["untold"]), self.now())
            else:
                self.store.end_stop([], {}, self.now())
        elif line.verb == "resume" and isinstance(outcome, Outcome) and not line.text("NAME"):
            self.store.stop = None

    @work(exit_on_error=False, group="calls")
    async def call(
        self, robot: str, command: str, arguments: Mapping[str, Any], listener: CallListener
    ) -> None:
        """Carry out a command in the background, and notify the listener."""
        if self.withheld("call"):
            listener.failed(self.keyboard.refusal("call"))
            return
        listener.started()
        began, attendance = self.now(), None
        attended: Callable[[], None] = _nothing
        try:
            fields: list[FieldSpec] = []
            if (described := self.store.described(robot)) and (spec := described.command(command)):
                attendance = Attendance() if spec.attended else None
            if attendance is not None:
                attended = self.hold_key(robot, command, attendance)
            if self.store.is_away(robot):
                left = await self.realm_client.orders.leave(robot, command, arguments, may_take=CALL_LIMIT)
                self.tell(ordering.told_left(left, self).text, "good", robot)
                listener.succeeded(None, self.now() - began)
                return
            value = await self.realm_client.call(
                robot,
                command,
                arguments,
                deadline=CALL_LIMIT,
                on_progress=listener.progressed,
                on_fields=fields.extend,
                attendance=attendance,
            )
        except VrError as error:
            self._tell_refusal(error, str(error), robot)
            listener.failed(str(error))
        except Exception as error:  # the last fence of this task
            log.exception("while calling %s.%s", robot, command)
            self.report_error(error)
            listener.failed(repr(error))
        else:
            rows = wording.result(fields, value)
            if rows or not self._enters(robot, command):
                shown = ", ".join(f"{name} {text}".strip() for name, text in rows) or "done"
                self.tell(f"{robot}.{command}: {shown}", "good", robot)
            listener.succeeded(value, self.now() - began)
        finally:
            attended()

    def do(self, verb: str, **values: str) -> None:
        """Carry out a verb with these values."""
        self.perform(Line(verb, values))

    def words(self) -> completion.Words:
        """Return the names of the moment, for completion."""
        store = self.store
        return completion.words_of(
            store.descriptions.values(),
            free=store.robots,
            views=store.views,
            hosts=store.hosts,
            verbs=self.prompt.shapes,
            groups=self.realm_client.groups.names(),
        )

    def ask(self, question: Screen[Answer], then: Callable[[Answer], object]) -> None:
        """Put a question in front; `then` gets the answer, unless there is none."""

        def answered(answer: Answer | None) -> None:
            if answer:
                then(answer)

        self.push_screen(question, answered)

    # -- what only the app with its pages can do ----------------------------------------------------

    def choose(self, name: str) -> None:
        """Select the robot that a person has chosen."""
        raise NotImplementedError

    def perform(self, line: Line) -> object:
        """Carry out a verb beside everything else."""
        raise NotImplementedError

    def ask_for(self, verb: str, place: Place = NOWHERE) -> None:
        """Do what a key asks for: open a page, ask what is missing, ask back where it is dangerous."""
        raise NotImplementedError

    def run_typed(self, text: str) -> None:
        """Carry out a line that was typed at the prompt."""
        raise NotImplementedError

    def hold_key(self, robot: str, command: str, attendance: Attendance) -> Callable[[], None]:
        """Put in front where a key is held for a command that wants that; returns how to take it away."""
        raise NotImplementedError

    def open_teleoperation(self, robot: RobotDescription) -> None:
        """Open the tele-operation of a robot, if it can be tele-operated."""
        raise NotImplementedError


def _nothing() -> None:
    """No key is held."""


def _behind(now: str, known: Sequence[str]) -> str:
    """Return what comes behind one of several; the first, where it is none of them or the last."""
    return known[(known.index(now) + 1) % len(known)] if now in known else known[0]


def weight_of(error: Exception) -> Weight:
    """Return how an error looks in the log: that somebody cancelled a command is no failure of it."""
    return "warning" if isinstance(error, CommandCancelled | ChildCancelled) else "error"
