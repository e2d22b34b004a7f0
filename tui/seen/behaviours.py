"""What robots can do, for people who do not operate robots: in the words of the authors. Pure.

A behaviour is a command of a robot that nobody else leads, told by what its author wrote; that of a script
is the script. Where several robots do the same, it is one behaviour, and the robots are those who can do it.
What only reads, and what belongs to the inside of a robot or script, is no behaviour.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from robotree.tui.seen import wording

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import CommandSpec, Lack, RobotDescription

SCRIPT = "Script"
"""Kind of robots that are led by rules."""
START = "start"
ANSWER = "answer"
"""The command of a script that takes the answer to its question: the question has a place of its own."""
INSIDE = frozenset(
    {"halt", "hold", "set", "stop", "finish", "message", "facts", "why", "play", "learn_role", "roles"}
)
"""Commands that are for operators, for other robots, or have a place of their own on the page."""

How = Literal["now", "busy", "away", "unable"]
"""now: it is free. busy: it does something else. away: it is not here. unable: it is here and cannot."""


@dataclass(frozen=True, slots=True)
class Doer:
    """One robot that can carry a behaviour out."""

    name: str
    how: How
    words: str
    """The same for people, with what it waits for or does."""
    denied: str = ""
    """Why this person may not have it done now, as a sentence; empty: it may."""
    unordered: str = ""
    """Why no order can be left for it, as a sentence; empty: one can."""

    @property
    def begins(self) -> bool:
        """Whether it can begin now, at least after what it does."""
        return self.how in {"now", "busy"} and not self.denied

    @property
    def takes_orders(self) -> bool:
        """Whether an order can be left for it."""
        return not self.unordered


@dataclass(frozen=True, slots=True)
class Behaviour:
    """Something that can be done."""

    key: str
    """Of the row: it stays the same as long as the behaviour does."""
    title: str
    """The first sentence of what its author says."""
    about: str
    """All of it."""
    robot: RobotDescription
    """The first one that can do it."""
    spec: CommandSpec
    doers: tuple[Doer, ...]
    """Those who are free come first."""
    leads: bool = False
    """Whether it is a script: it goes on until a rule ends it."""
    told: bool = False
    """Whether it is something that one tells a script which leads now."""

    @property
    def possible(self) -> bool:
        """Whether anybody can do it, now or as an order."""
        return any(doer.begins or doer.takes_orders for doer in self.doers)

    @property
    def state(self) -> str:
        """When it can be done, or why it cannot, in words."""
        begins = [doer for doer in self.doers if doer.begins]
        if begins:
            return "now" if begins[0].how == "now" else f"soon: {begins[0].words}"
        ordered = next((doer for doer in self.doers if doer.takes_orders), None)
        if ordered is not None:
            return f"when {'it is back' if ordered.how == 'away' else 'it can'}: {ordered.words}"
        first = self.doers[0]
        return f"not allowed: {first.denied}" if first.denied else f"not now: {first.words}"


class Known:
    """What a page knows of robots at one moment."""

    def __init__(
        self,
        robots: Iterable[RobotDescription],
        how: Callable[[str], tuple[How, str]],
        refusal: Callable[[str, RobotDescription, str], str],
        *,
        ordering: bool,
    ) -> None:
        """Take it.

        Args:
            robots: descriptions of all, also of those that are away.
            how: returns of a name how the robot is, and that in words.
            refusal: returns why a right is denied for a command of a robot, as a sentence; empty: it is not.
            ordering: whether orders can be left at all: a directory is there, or robots were taken along.
        """
        self._robots, self._how, self._refusal, self._ordering = list(robots), how, refusal, ordering

    def behaviours(self) -> list[Behaviour]:
        """Return what can be done, by title."""
        found: dict[tuple[object, ...], Behaviour] = {}
        for robot in self._robots:
            if robot.bond is not None and self._how(robot.name)[0] != "away":
                continue  # it is a part of what its parent can do
            for one in self._of(robot):
                same = (one.key,) if one.leads or one.told else (one.title, *_form(one.spec))
                known = found.get(same)
                found[same] = one if known is None else replace(known, doers=known.doers + one.doers)
        ordered = [replace(one, doers=tuple(sorted(one.doers, key=_first))) for one in found.values()]
        return sorted(ordered, key=lambda one: (not one.told, not one.possible, one.title.casefold()))

    def _of(self, robot: RobotDescription) -> Iterable[Behaviour]:
        script = SCRIPT in robot.kinds
        leads = script and robot.attributes.get("condition") == "active"
        for spec in robot.commands:
            if (
                spec.name in INSIDE
                or (script and spec.name == ANSWER)
                or (script and spec.name != START and not leads)
            ):
                continue
            if not script and (spec.effect == "read" or _for_hands(spec)):
                continue
            if script and spec.name == START and leads:
                continue
            doc = robot.doc if script and spec.name == START else spec.doc
            yield Behaviour(
                key=f"{robot.name}.{spec.name}",
                title=_begun_large(wording.summary(doc) or _words(spec.name)),
                about=doc.strip(),
                robot=robot,
                spec=spec,
                doers=(self._doer(robot, spec),),
                leads=script and spec.name == START,
                told=script and spec.name != START,
            )

    def _doer(self, robot: RobotDescription, spec: CommandSpec) -> Doer:
        how, words = self._how(robot.name)
        if how in {"now", "busy"} and not spec.available:
            how, words = "unable", f"{robot.name} lacks what it needs for that"
        condition = robot.attributes.get("condition", "")
        if condition.startswith("inactive"):
            how, words = "unable", condition
        return Doer(
            robot.name,
            how,
            words,
            self._refusal("command", robot, spec.name),
            self._unordered(robot, spec),
        )

    def _unordered(self, robot: RobotDescription, spec: CommandSpec) -> str:
        if spec.offline != "queue":
            return "its author allows no order of it"
        if not robot.identity:
            return f"{robot.name} takes no orders"
        if not self._ordering:
            return "nobody is there who keeps orders"
        return self._refusal("order", robot, spec.name)


def _first(doer: Doer) -> tuple[int, str]:
    order: Mapping[How, int] = {"now": 0, "busy": 1, "away": 2, "unable": 3}
    return (order[doer.how] + (4 if doer.denied else 0), doer.name)


def _form(spec: CommandSpec) -> tuple[object, ...]:
    return spec.name, tuple((one.name, one.type, one.unit, one.required) for one in spec.parameters)


def _for_hands(spec: CommandSpec) -> bool:
    """Whether a command is for tele-operation or another robot: it takes what nobody can type."""
    return any(
        one.type in {"bytes", "record", "tuple", "dict", "list"} for one in spec.parameters if one.required
    )


def _begun_large(title: str) -> str:
    """Return a title as a line of the page begins: with a large letter."""
    return title[:1].upper() + title[1:]


def _words(name: str) -> str:
    """Return the name of a command as words."""
    return name.replace("_", " ").capitalize()


def yet(lacks: Iterable[Lack]) -> str:
    """Write for a user which children a robot must still get: `it has no arm yet`; empty: none."""
    found = list[str]()
    for lack in lacks:
        above, _, slot = lack.slot.rpartition(".")
        if not lack.was:
            found.append(f"{above or 'it'} has no {slot} yet")
    return "; ".join(found)


def titles(found: Sequence[Behaviour]) -> dict[tuple[str, str], str]:
    """Return titles by name of the robot and of the command."""
    return {(doer.name, one.spec.name): one.title for one in found for doer in one.doers}
