"""What a person who operates no robots can do, has begun and has left for later: the state of `user_app`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from robotree.tui.errors import SupervisorError
from robotree.tui.line import ordering, taken
from robotree.tui.line.verbs import SCRIPT_LIMIT
from robotree.tui.seen import absence
from robotree.tui.seen.behaviours import Behaviour, How, Known, yet
from robotree.tui.seen.errand import Errand
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from robotree.tui.screen.operator_app import OperatorApp
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.base.order import KnownAgent, Order

FRESH = 0.2
"""[s] for which a list of behaviours is shown: all robots are looked at for it."""


class UserDesk:
    """One person's desk."""

    def __init__(self, app: OperatorApp) -> None:
        """Begin with nothing; `app` shows it."""
        self._app = app
        self.errands: list[Errand] = []
        """Errands that were begun on this screen, the oldest first."""
        self.carried: tuple[KnownAgent, ...] = ()
        """Robots that were taken along, where nobody is in the realm."""
        self.orders: tuple[Order, ...] = ()
        """Orders of this person, the oldest first."""
        self.alone = False
        """Whether nobody is in the realm."""
        self._behaviours: tuple[float, list[Behaviour]] = (float("-inf"), [])

    # -- what there is --------------------------------------------------------------------------------

    def behaviours(self) -> list[Behaviour]:
        """Return what can be done now or later, as it was a moment ago at the most."""
        made, found = self._behaviours
        if self._app.now() - made >= FRESH:
            found = self._found()
            self._behaviours = self._app.now(), found
        return found

    def _found(self) -> list[Behaviour]:
        robots, carried = self._robots(), {each.name: each for each in self.carried}
        now = self._app.now()

        def how(name: str) -> tuple[How, str]:
            if self.alone:
                return "away", absence.how(carried[name], time.time())
            if self._app.store.is_away(name):
                return "away", self._app.store.away[name].words
            words = self._app.store.doing(name, now)
            status = self._app.store.status(name, now)
            if status == "needs":
                return "unable", yet(self._app.store.lacks(name)) or words
            known: dict[str, How] = {"free": "now", "busy": "busy"}
            return known.get(status, "unable"), words

        def refusal(right: str, robot: RobotDescription, command: str) -> str:
            if self._app.readonly:
                return "this is read-only"
            denied = self._app.realm_client.refused(right, robot.name, robot.kinds, command)
            return "" if denied is None else str(denied)

        ordering_works = self.alone or bool(self._app.realm_client.orders.directories)
        return Known(robots, how, refusal, ordering=ordering_works).behaviours()

    def _robots(self) -> list[RobotDescription]:
        if self.alone:
            return [each.robot for each in self.carried if each.robot is not None]
        away = [
            self._app.store.away[name].robot for name in self._app.store.away if self._app.store.is_away(name)
        ]
        return [*self._app.store.descriptions.values(), *away]

    async def look(self) -> None:
        """Look at the orders of this person, and whether anybody is there."""
        desk = self._app.realm_client.orders
        inhabited = bool(self._app.store.known) or bool(self._app.realm_client.present("robot"))
        if desk.directories or inhabited or not taken.exists(self._app.realm):
            if self.alone:
                self.alone, self.carried = False, ()
                await taken.merge(self._app.realm_client, self._app)
            board = await desk.board(mine=True) if desk.directories else None
            self.orders = tuple(board.orders) if board else ()
            return
        with taken.opened(self._app.realm) as book:
            book.sweep()
            agents = book.store.agents.values()
            self.carried = tuple(each for each in agents if each.role == "robot" and not each.deleted)
            self.orders = tuple(sorted(book.store.orders.values(), key=lambda each: each.left))
        self.alone = True

    # -- what a person does ----------------------------------------------------------------------------

    def begin(self, behaviour: Behaviour, robot: str, arguments: dict[str, Any]) -> Errand:
        """Have something carried out; a script goes on by itself."""
        errand = Errand(behaviour, robot, self._app.now())
        self.errands.append(errand)
        if behaviour.leads or behaviour.told:
            self._app.run_worker(self._tell(errand, arguments), group="calls", exit_on_error=False)
        else:
            self._app.call(robot, behaviour.spec.name, arguments, errand)
        return errand

    async def _tell(self, errand: Errand, arguments: dict[str, Any]) -> None:
        """Begin something that goes on by itself, or say something to a script."""
        if self._app.withheld("call"):
            errand.failed(self._app.keyboard.refusal("call"))
            return
        try:
            await self._app.realm_client.tell(
                errand.robot, errand.behaviour.spec.name, arguments, deadline=SCRIPT_LIMIT
            )
        except VrError as error:
            errand.failed(str(error))
            self._app.tell(str(error), "error")
        else:
            self.errands.remove(errand)
            said = "is said" if errand.behaviour.told else "has begun, and goes on by itself"
            self._app.tell(f"{errand.title}: {said}", "good")

    async def leave_order(
        self, behaviour: Behaviour, robot: str, arguments: dict[str, Any], until: str
    ) -> None:
        """Leave something as an order; errors of the order pass through.

        Raises:
            VrError: it was refused.
            SupervisorError: `until` says no end.
        """
        if self._app.withheld("call"):
            return
        within = ordering.until(until)
        if self.alone:
            order = taken.left_here(self._app.realm, robot, behaviour.spec.name, arguments, within)
            self._app.tell(f"{behaviour.title}: left here; it goes to the robots at the next contact", "good")
        else:
            left = await self._app.realm_client.orders.leave(
                robot, behaviour.spec.name, arguments, begin_within=within
            )
            order = left.order
            self._app.tell(f"{behaviour.title}: left, to begin by {absence.clock(order.begin_by)}", "good")
        self.orders = (*self.orders, order)

    def decide_order(self, order: Order, answer: str) -> None:
        """End an order (`cancel`), let it begin (`confirm`), or take its result (`seen`)."""
        self._app.run_worker(self._decide(order, answer), group="orders", exit_on_error=False)

    async def _decide(self, order: Order, answer: str) -> None:
        if self._app.withheld("order cancel"):
            return
        desk = self._app.realm_client.orders
        try:
            if self.alone:
                taken.cancelled_here(self._app.realm, order.key) if answer == "cancel" else None
            elif answer == "cancel":
                await desk.cancel(order.key)
            elif answer == "confirm":
                await desk.confirm(order.key)
            else:
                await desk.mark_seen([order])
            await self.look()
        except (VrError, SupervisorError) as error:
            self._app.tell(str(error), "error")

    def settle(self, errands: Sequence[Errand]) -> None:
        """Take what is over off the list."""
        self.errands = [each for each in self.errands if each not in errands or each.runs]
