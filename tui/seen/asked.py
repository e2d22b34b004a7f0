"""What a robot asks people, as it describes itself. Pure."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import RobotDescription

DOUBT = ("done", "again", "abort")
"""The answers to whether a command was done, in the middle of which its robot was killed."""
SEPARATOR = " | "
"""Between the answers that a script gives (`scripts.questions`)."""


class AskedQuestion(NamedTuple):
    """One question of one robot."""

    robot: str
    text: str
    answers: tuple[str, ...] = ()
    """Empty: any text."""
    id: str = ""
    """By which the script knows it; empty: it is about a command that was interrupted."""
    more: str = ""
    """`and 2 more`; empty: it is the only one."""

    @property
    def how(self) -> str:
        """The last words of the line that answers it."""
        return "|".join(self.answers) or "TEXT"


def questions_of(robot: RobotDescription) -> Iterator[AskedQuestion]:
    """Return what a robot asks: whether a command was done, and the oldest question of a script."""
    if robot.asks:
        yield AskedQuestion(robot.name, robot.asks, DOUBT)
    said = robot.attributes
    if "question" in said and "question-id" in said:
        answers = tuple(one for one in said.get("answers", "").split(SEPARATOR) if one)
        yield AskedQuestion(robot.name, said["question"], answers, said["question-id"], said.get("asked", ""))
