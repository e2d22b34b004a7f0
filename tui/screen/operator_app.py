"""One operator at one realm: what is known, selected and marked, and how a command is carried out.

Pages and widgets know this class and nothing above it; `app.Supervisor` puts the pages in front of
the operator.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from textual import work
from textual.driver import Driver
from textual.events import Event
from textual.screen import Screen

from robotree.tui.line import completion, ordering
from robotree.tui.line.action import Where
from robotree.tui.line.carrying import Refusal, carry_out
from robotree.tui.line.grammar import Line
from robotree.tui.line.surface import Surface
from robotree.tui.line.verbs import CALL_LIMIT, Outcome
from robotree.tui.processes.alarm_file import alarms_of
from robotree.tui.processes.choices import Choices
from robotree.tui.processes.layout import LayoutFile
from robotree.tui.processes.terminal_graphics import CELLS
from robotree.tui.screen.error_boundary import ErrorBoundary
from robotree.tui.screen.foresight import Foresight
from robotree.tui.screen.key_guard import KeyGuard, KeysInOrder
from robotree.tui.screen.keymap import Keymap
from robotree.tui.screen.looks import Looks
from robotree.tui.screen.watching import Watching
from robotree.tui.seen import wording
from robotree.tui.seen.errand import CallListener
from robotree.tui.seen.feeding import Feed
from robotree.tui.seen.selection import NOWHERE, Place, Selection
from robotree.tui.seen.store import Store, Weight
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
CONTROL = {"control get", "control offer", "control take", "control leave"}
"""Verbs by which control of a robot changes hands, or stays as it is."""


class OperatorApp(ErrorBoundary, KeysInOrder[int]):
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
        self.guard = KeyGuard(self, self.keymap, self.now, partial(self.tell, weight="warning"))
        shell = f"robotree --realm {realm}" if realm != DEFAULT_REALM else "robotree"
        self.prompt = Surface(Where.PROMPT, readonly, shell=shell)  # the actions that can be typed
        self.keyboard = Surface(Where.SCREEN, readonly)  # the actions that have keys
        self.looks = Looks(self, self.tell, keeps=not readonly)
        self.realm_client, self.realm, self.farewell = realm_client, realm, farewell
        self.store = store or Store()
        self.store.denies = self._denies
        self._denied: tuple[object, Denials] = (None, {})  # what a policy was asked, and what it said
        self.feed = Feed(realm_client, self.store, self.now, alarms_of(realm_client.realm))
        self.selection = Selection()  # the robot that keys are about, whatever page is in front
        self.marks: frozenset[str] = frozenset()  # robots that an action may take together
        self.past: list[str] = []  # lines that were typed at the prompt, on whatever page
        self.steps = steps or Choices()  # the step of tele-operation that was chosen last, by robot
        self.pictures = CELLS
        """How pictures are drawn in this terminal; `supervise` finds it out."""
        self.foresight = Foresight()  # what a robot says of the way that somebody is about to send it
        self.layout = layout or LayoutFile()  # how this person has arranged the screen
        if readonly:
            self.layout.keep_nothing()
            self.steps.keep_nothing()
        self.watching = Watching(self, realm_client, realm, self.store.watched, self.layout, self.now)
        self.errors: list[Exception] = []  # those that the fence held back

    @property
    def driver(self) -> Driver | None:
        """Textual's way to the terminal; None: there is none."""
        return self._driver

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

    # -- keys --------------------------------------------------------------------------------------

    async def on_event(self, event: Event) -> None:
        """Notice who types on and has not looked yet; stops overtake the letters before them."""
        self.guard.notice(event)
        await super().on_event(event)

    def drops(self, event: Event) -> str:
        """See `KeyGuard.drops`."""
        return self.guard.drops(event)

    def dropped(self, event: Event, why: str) -> None:
        """See `KeyGuard.dropped`."""
        self.guard.dropped(event, why)

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


def weight_of(error: Exception) -> Weight:
    """Return how an error looks in the log: that somebody cancelled a command is no failure of it."""
    return "warning" if isinstance(error, CommandCancelled | ChildCancelled) else "error"
