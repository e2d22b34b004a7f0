"""The program for people who do not operate robots: one list of what can be done, in plain words.

It knows what the supervisor knows, and shows less of it. Where nobody is in the realm it shows what was taken
along: orders are left in that memory, and go to the directories as soon as one is there.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from textual import work
from textual.binding import Binding, BindingType

from robotree.tui.errors import SupervisorError
from robotree.tui.line import ordering, taken
from robotree.tui.line.action import spell
from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.verbs import SCRIPT_LIMIT
from robotree.tui.screen import asking
from robotree.tui.screen.app import Supervisor, program_keys
from robotree.tui.screen.pages.dialogs import Confirm, Reading
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.pages.user import UserPage
from robotree.tui.screen.place import NOWHERE, Place
from robotree.tui.seen import absence
from robotree.tui.seen.behaviours import Behaviour, How, Known, yet
from robotree.tui.seen.errand import Errand
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.base.order import KnownAgent, Order

SHOWN = frozenset({"stop", "resume", "role"})
"""What this program asks for as operators do, beside what it does in its own way."""
FRESH = 0.2
"""[s] for which a list of behaviours is shown: all robots are looked at for it."""
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
        self.errands: list[Errand] = []
        """What was begun from here, the oldest first."""
        self.carried: tuple[KnownAgent, ...] = ()
        """Robots that were taken along, where nobody is in the realm."""
        self.orders: tuple[Order, ...] = ()
        """Orders of this person, the oldest first."""
        self.alone = False
        """Whether nobody is in the realm."""
        self._behaviours: tuple[float, list[Behaviour]] = (float("-inf"), [])

    def first_page(self) -> Page:
        """Return the list."""
        return UserPage()

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
        if running := ", ".join(each.title for each in self.errands if each.runs):
            question = Confirm("Leave?", f"This ends with it: {running}", "Leave")
            self.ask(question, lambda _yes: self.exit(0))
        else:
            self.exit(0)

    # -- what there is --------------------------------------------------------------------------------

    def behaviours(self) -> list[Behaviour]:
        """Return what can be done now or later, as it was a moment ago at the most."""
        made, found = self._behaviours
        if self.now() - made >= FRESH:
            found = self._found()
            self._behaviours = self.now(), found
        return found

    def _found(self) -> list[Behaviour]:
        robots, carried = self._robots(), {each.name: each for each in self.carried}
        now = self.now()

        def how(name: str) -> tuple[How, str]:
            if self.alone:
                return "away", absence.how(carried[name], time.time())
            if self.store.is_away(name):
                return "away", self.store.away[name].words
            words = self.store.doing(name, now)
            status = self.store.status(name, now)
            if status == "needs":
                return "unable", yet(self.store.lacks(name)) or words
            known: dict[str, How] = {"free": "now", "busy": "busy"}
            return known.get(status, "unable"), words

        def refusal(right: str, robot: RobotDescription, command: str) -> str:
            if self.readonly:
                return "this is read-only"
            denied = self.realm_client.refused(right, robot.name, robot.kinds, command)
            return "" if denied is None else str(denied)

        ordering_works = self.alone or bool(self.realm_client.orders.directories)
        return Known(robots, how, refusal, ordering=ordering_works).behaviours()

    def _robots(self) -> list[RobotDescription]:
        if self.alone:
            return [each.robot for each in self.carried if each.robot is not None]
        away = [self.store.away[name].robot for name in self.store.away if self.store.is_away(name)]
        return [*self.store.descriptions.values(), *away]

    async def look(self) -> None:
        """Look at the orders of this person, and whether anybody is there."""
        desk = self.realm_client.orders
        inhabited = bool(self.store.known) or bool(self.realm_client.present("robot"))
        if desk.directories or inhabited or not taken.exists(self.realm):
            if self.alone:
                self.alone, self.carried = False, ()
                await taken.merge(self.realm_client, self)
            board = await desk.board(mine=True) if desk.directories else None
            self.orders = tuple(board.orders) if board else ()
            return
        with taken.opened(self.realm) as book:
            book.sweep()
            agents = book.store.agents.values()
            self.carried = tuple(each for each in agents if each.role == "robot" and not each.deleted)
            self.orders = tuple(sorted(book.store.orders.values(), key=lambda each: each.left))
        self.alone = True

    # -- what a person does ----------------------------------------------------------------------------

    def begin(self, behaviour: Behaviour, robot: str, arguments: dict[str, Any]) -> Errand:
        """Have something carried out; a script goes on by itself."""
        errand = Errand(behaviour, robot, self.now())
        self.errands.append(errand)
        if behaviour.leads or behaviour.told:
            self._tell(errand, arguments)
        else:
            self.call(robot, behaviour.spec.name, arguments, errand)
        return errand

    @work(exit_on_error=False, group="calls")
    async def _tell(self, errand: Errand, arguments: dict[str, Any]) -> None:
        """Begin something that goes on by itself, or say something to a script."""
        if self.withheld("call"):
            errand.failed(self.keyboard.refusal("call"))
            return
        try:
            await self.realm_client.tell(
                errand.robot, errand.behaviour.spec.name, arguments, deadline=SCRIPT_LIMIT
            )
        except VrError as error:
            errand.failed(str(error))
            self.tell(str(error), "error")
        else:
            self.errands.remove(errand)
            said = "is said" if errand.behaviour.told else "has begun, and goes on by itself"
            self.tell(f"{errand.title}: {said}", "good")

    async def leave_order(
        self, behaviour: Behaviour, robot: str, arguments: dict[str, Any], until: str
    ) -> None:
        """Leave something as an order; errors of the order pass through.

        Raises:
            VrError: it was refused.
            SupervisorError: `until` says no end.
        """
        if self.withheld("call"):
            return
        within = ordering.until(until)
        if self.alone:
            order = taken.left_here(self.realm, robot, behaviour.spec.name, arguments, within)
            self.tell(f"{behaviour.title}: left here; it goes to the robots at the next contact", "good")
        else:
            left = await self.realm_client.orders.leave(
                robot, behaviour.spec.name, arguments, begin_within=within
            )
            order = left.order
            self.tell(f"{behaviour.title}: left, to begin by {absence.clock(order.begin_by)}", "good")
        self.orders = (*self.orders, order)

    @work(exit_on_error=False, group="orders")
    async def decide_order(self, order: Order, answer: str) -> None:
        """End an order (`cancel`), let it begin (`confirm`), or take its result (`seen`)."""
        if self.withheld("order cancel"):
            return
        desk = self.realm_client.orders
        try:
            if self.alone:
                taken.cancelled_here(self.realm, order.key) if answer == "cancel" else None
            elif answer == "cancel":
                await desk.cancel(order.key)
            elif answer == "confirm":
                await desk.confirm(order.key)
            else:
                await desk.mark_seen([order])
            await self.look()
        except (VrError, SupervisorError) as error:
            self.tell(str(error), "error")

    def settle(self, errands: Sequence[Errand]) -> None:
        """Take what is over off the list."""
        self.errands = [each for each in self.errands if each not in errands or each.runs]
