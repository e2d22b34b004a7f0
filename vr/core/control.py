"""Which operator has a robot for themselves, and how it passes from hand to hand. Pure.

Without control each person who may command a free robot commands it: calls wait for each other. Who
*gets control* has it alone: what moves, and comes from another person, is refused by the robot, until
control is given away, offered, taken by right, or lost with the program that had it. Everybody may stop,
cancel and look.

    nobody ──get──► anna ──leave, gone──► nobody, or who has asked
                     │  ask by ben (30 s), then anna offers:        anna ──► ben
                     │  offer to ben (30 s), then ben gets control: anna ──► ben
                     └─ take by ben, who has the right to:          anna ──► ben, anna's commands end

One change of hands is one change of this value, by one robot, so there are never two holders. Whoever takes
says which change of hands was the last that they saw: of two takers at once the second is refused.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec

from robotree.vr.base.errors import ControlRefused, HeldByOperator
from robotree.vr.base.principal import Principal

OPEN_FOR: Final = 30.0
"""[s] for which an offer, or somebody's question, stays open."""
LONGEST: Final = 3600.0
"""[s] for which control may be had without a program that is present."""
ANY: Final = -1
"""Instead of a number of changes of hands: whichever."""


class Operator(msgspec.Struct, frozen=True):
    """A person, and the program by which that person is present."""

    person: str
    """`anna@pts/3`"""
    user: str = ""
    """Of the system, with the site: by this one knows who sits at another terminal."""
    agent: str = ""
    """Key under which the program is present; empty: control ends with its time alone."""


NOBODY: Final = Operator("")


def operator_of(principal: Principal, *, present: bool = True) -> Operator:
    """Return who asks; `present`: control ends with the program."""
    user = f"{principal.user}@{principal.site}" if principal.site else principal.user
    agent = principal.agent if present else ""
    return Operator(principal.person, f"{user}/{principal.assistant}", agent)


class RobotControl(msgspec.Struct, kw_only=True):
    """See the module."""

    holder: Operator = NOBODY
    since: float = 0.0
    """[s] since 1970."""
    until: float = math.inf
    """[s] on the robot's clock, when it ends; infinite: with the program."""
    asks: Operator = NOBODY
    """Who asks for it."""
    asks_until: float = math.inf
    """[s] on the robot's clock."""
    asks_for: float = 0.0
    """[s] for which the one who asks would have it; 0: as long as the program is present."""
    offered: str = ""
    """The person to whom it is offered."""
    offered_until: float = math.inf
    """[s] on the robot's clock."""
    hands: int = 0
    """How often it has changed hands."""

    @property
    def due(self) -> float:
        """[s] when `tick` will change something."""
        return min(
            self.until if self.holder.person else math.inf,
            self.asks_until if self.asks.person else math.inf,
            self.offered_until if self.offered else math.inf,
        )

    @property
    def agents(self) -> frozenset[str]:
        """Keys under which those must stay present who have it or ask for it."""
        return frozenset({self.holder.agent, self.asks.agent} - {""})

    def expect(self, robot: str, principal: Principal) -> None:
        """Refuse a person who has not the control that somebody else has.

        Raises:
            HeldByOperator: somebody else has it.
        """
        person = principal.person
        if self.holder.person and person and person != self.holder.person:
            raise HeldByOperator(robot=robot, holder=self.holder.person)

    def get(self, robot: str, asker: Operator, now: float, unix: float, within: float) -> None:
        """Get it, if nobody has it, or it is offered to who asks; again, it is prolonged.

        Args:
            robot: name, for messages.
            asker: who gets it.
            now: [s]
            unix: [s] since 1970.
            within: [s] for which; 0: as long as the program is present.

        Raises:
            HeldByOperator: somebody else has it.
        """
        held = self.holder.person
        if held and asker.person not in {held, self.offered}:
            raise HeldByOperator(robot=robot, holder=held)
        self._pass_to(asker, now, unix, within)

    def take(  # as `get`, and what was seen
        self, robot: str, asker: Operator, now: float, unix: float, within: float, seen: int
    ) -> bool:
        """Take it from whoever has it; returns whether somebody else had it.

        Args:
            robot: name, for messages.
            asker: who takes it, and may.
            now: [s]
            unix: [s] since 1970.
            within: as in `get`.
            seen: how often it had changed hands when the person decided; `ANY`: not known.

        Raises:
            ControlRefused: it has changed hands since then.
        """
        held = self.holder
        if seen not in {ANY, self.hands} and held.person != asker.person:
            who = f"{held.person} got control of it" if held.person else "its control was given up"
            raise ControlRefused(robot=robot, reason=f"{who} a moment ago; look, and take it again")
        self._pass_to(asker, now, unix, within)
        return held.person not in {"", asker.person}

    def ask(self, robot: str, asker: Operator, now: float, within: float) -> None:
        """Ask its holder for it, for `OPEN_FOR`.

        Raises:
            ControlRefused: nobody has it, the asker has, or somebody else asks already.
        """
        if self.holder.person in {"", asker.person}:
            whose = "you have control of it" if self.holder.person else "nobody has control of it"
            raise ControlRefused(robot=robot, reason=f"{whose}; `robotree control get {robot}` keeps it")
        if self.asks.person not in {"", asker.person}:
            left = self.asks_until - now
            reason = f"{self.asks.person} asks {self.holder.person} for it already, for {left:.0f} s more"
            raise ControlRefused(robot=robot, reason=reason)
        self.asks, self.asks_until, self.asks_for = asker, now + OPEN_FOR, within

    def offer(self, robot: str, asker: Operator, person: str, now: float, unix: float) -> None:
        """Hand it to who asks for it, or offer it to a person for `OPEN_FOR`.

        Args:
            robot: name, for messages.
            asker: its holder.
            person: `ben@pts/4`; empty: who asks for it.
            now: [s]
            unix: [s] since 1970.

        Raises:
            HeldByOperator: somebody else has it.
            ControlRefused: nobody has it, or nobody is meant.
        """
        if not self.holder.person:
            raise ControlRefused(robot=robot, reason="nobody has control of it, so nobody can offer it")
        if self.holder.person != asker.person:
            raise HeldByOperator(robot=robot, holder=self.holder.person)
        if not person and not self.asks.person:
            raise ControlRefused(
                robot=robot, reason="nobody asks for it; name the person to whom you offer it"
            )
        if person in {"", self.asks.person}:
            self._pass_to(self.asks, now, unix, self.asks_for)
        else:
            self.offered, self.offered_until = person, now + OPEN_FOR

    def leave(self, robot: str, asker: Operator, now: float, unix: float) -> None:
        """Give it up, or take the question for it back; who asks for it has it then.

        Raises:
            HeldByOperator: somebody else has it.
        """
        if self.asks.person == asker.person:
            self.asks = NOBODY
            return
        if self.holder.person not in {"", asker.person}:
            raise HeldByOperator(robot=robot, holder=self.holder.person)
        self._give_up(now, unix)

    def lose(self, agent: str, now: float, unix: float) -> bool:
        """Take note that a program has gone: its person loses what was theirs, and nothing else.

        Returns:
            Whether the holder has gone.
        """
        if self.asks.agent == agent:
            self.asks = NOBODY
        if not self.holder.person or self.holder.agent != agent:
            return False
        self._give_up(now, unix)
        return True

    def tick(self, now: float, unix: float) -> bool:
        """End what is due; returns whether something was."""
        before = self.due
        if self.asks.person and self.asks_until <= now:
            self.asks = NOBODY
        if self.offered and self.offered_until <= now:
            self.offered = ""
        if self.holder.person and self.until <= now:
            self._give_up(now, unix)
        return before <= now

    def _give_up(self, now: float, unix: float) -> None:
        self._pass_to(self.asks, now, unix, self.asks_for)

    def _pass_to(self, operator: Operator, now: float, unix: float, within: float) -> None:
        """Put it into other hands, nobody's included; this is the one place where it changes them."""
        if operator.person != self.holder.person:
            self.hands += 1
            self.since = unix
        if operator.person in {self.asks.person, ""} or self.asks.person == "":
            self.asks = NOBODY
        self.holder, self.offered = operator, ""
        self.until = now + min(within, LONGEST) if within > 0 else math.inf
        if operator.person and not operator.agent and not within:
            self.until = now + LONGEST
