"""What the robot says of a way that somebody is about to send it: asked in the background, shown everywhere.

The plan, the pictures and the dialog draw the same one. Only the newest question counts.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from robotree.tui.errors import SupervisorError
from robotree.tui.line.going import Trip, preview, trip_to, way_in_words
from robotree.tui.seen.frames import frame_of
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.supervision.realm_client import RealmClient

Point = tuple[float, float, float]
"""[m] x, y, z in the robot's frame."""


class Foreseen(NamedTuple):
    """What is known of a trip."""

    robot: str
    frame: str
    """In which its coordinates are."""
    at: Mapping[str, float]
    """Where it is to lead [m, rad]."""
    trip: Trip | None = None
    way: Mapping[str, Any] | None = None
    refusal: str = ""
    """Why it would not begin; empty: nothing is known against it."""
    answered: bool = False

    @property
    def words(self) -> str:
        """Return it for people, as one sentence."""
        if self.refusal:
            return self.refusal
        return way_in_words(self.way) if self.answered else f"asking {self.robot} …"

    @property
    def points(self) -> list[Point]:
        """The way [m]; empty: nobody tells it."""
        if self.way is None:
            return []
        return list(zip(self.way["x"], self.way["y"], self.way["z"], strict=True))

    @property
    def goal(self) -> Point:
        """Where it ends [m]; a height that is not known is that of the floor."""
        known = self.trip.goal if self.trip is not None else self.at
        return known["x"], known["y"], known.get("z", 0.0)


class Foresight:
    """The newest preview of one screen."""

    def __init__(self) -> None:
        """Know nothing."""
        self.newest: Foreseen | None = None
        self._asked: Foreseen | None = None
        """What a robot is asked now."""

    def forget(self) -> None:
        """Nobody is about to send a robot anywhere."""
        self.newest = self._asked = None

    def ask(
        self,
        realm_client: RealmClient,
        robot: RobotDescription,
        at: Mapping[str, float],
        frame: str,
        readings: Mapping[str, float],
    ) -> Callable[[], Coroutine[Any, Any, None]] | None:
        """Ask a robot what it would do.

        Args:
            realm_client: over whose realm.
            robot: which.
            at: coordinates of a point [m, rad].
            frame: in which they are.
            readings: what the robot reads.

        Returns:
            What waits for its answer, to be run in the background; None: it need not be asked.
        """
        before, self._asked = self.newest, None
        if (moves_in := frame_of(robot)) != frame:
            why = f"{robot.name} moves in {moves_in or 'a frame of its own'}, and the point is of {frame}"
            refusal = f"{why}; choose a robot of that place"
            self.newest = Foreseen(robot.name, frame, at, refusal=refusal, answered=True)
            return None
        try:
            trip = trip_to(robot, at, readings)
        except SupervisorError as error:
            self.newest = Foreseen(robot.name, frame, at, refusal=str(error), answered=True)
            return None
        self._asked = asked = Foreseen(robot.name, frame, at, trip)
        if before is None or (before.robot, before.frame, before.at) != (robot.name, frame, at):
            self.newest = asked  # else what was said before stays until it is said again
        return partial(self._answer, realm_client, asked, trip)  # one that never runs is not begun either

    async def _answer(self, realm_client: RealmClient, asked: Foreseen, trip: Trip) -> None:
        try:
            answer = asked._replace(way=await preview(realm_client, trip), answered=True)
        except (VrError, SupervisorError) as error:
            answer = asked._replace(refusal=str(error), answered=True)
        if self._asked is asked:
            self.newest = answer
