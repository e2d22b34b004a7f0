"""What the supervisor asks of the agents, and nothing more: the narrow door to `robotree.vr.fleet`.

`Fleet` there fulfils it; tests of layout may bring a smaller one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from robotree.vr.description import Listing, RobotDescription
from robotree.vr.requests import HostDescribed, Picture, State, ViewDescribed
from robotree.vr.transport import Registration

OnProgress = Callable[[float, str], None]
"""Takes how far a command is: 0 to 1 (NaN: unknown) and a word about it."""

OnState = Callable[[str, State], None]
"""Takes the name of a robot and how it is now."""


class FleetDoor(Protocol):
    """All agents of one realm, by name."""

    @property
    def services(self) -> Sequence[str]:
        """Names of the lookup services that live."""
        ...

    @property
    def stale(self) -> bool:
        """Whether no lookup service lives, so that the lists may be old."""
        ...

    def robots(self) -> Sequence[Listing]:
        """Return the robots that are listed: an enslaved one is not."""
        ...

    def views(self) -> Sequence[Listing]:
        """Return the views."""
        ...

    async def hosts(self) -> Sequence[HostDescribed]:
        """Ask all hosts what they run."""
        ...

    def on_change(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Call back after each change of the lists; returns how to end that."""
        ...

    async def watch_state(self, name: str | None, callback: OnState) -> Registration:
        """Hear the states of one robot, or of all."""
        ...

    async def describe(self, name: str) -> RobotDescription:
        """Ask a robot who it is, enslaved or not."""
        ...

    async def describe_view(self, name: str) -> ViewDescribed:
        """Ask a view for its cameras and readings."""
        ...

    async def tree(self) -> Sequence[RobotDescription]:
        """Describe all robots, the free ones first, then their children."""
        ...

    async def create(self, path: str, name: str, host: str = "", wanted: str = "") -> RobotDescription:
        """Make a virtual robot from a source file."""
        ...

    async def enslave(self, parent: str, slot: str, child: str) -> RobotDescription:
        """Bind a child to a slot."""
        ...

    async def release(self, parent: str, slot: str) -> RobotDescription:
        """Release the child in a slot."""
        ...

    async def call(
        self,
        name: str,
        command: str,
        arguments: Mapping[str, Any],
        *,
        deadline: float,
        on_progress: OnProgress | None = None,
    ) -> Any:
        """Have a command carried out and return its result."""
        ...

    async def cancel(self, name: str) -> None:
        """End all commands of a robot."""
        ...

    async def delete(self, name: str) -> None:
        """End a virtual robot; its children are released."""
        ...

    async def stop(self, name: str | None) -> Sequence[str]:
        """Protective stop of one robot or of all; returns who was told."""
        ...

    async def resume(self, name: str | None) -> Sequence[str]:
        """Release the protective stop; returns who was told."""
        ...

    async def readings(self, name: str) -> Mapping[str, float]:
        """Return the newest readings of a robot."""
        ...

    async def look(self, view: str, *, camera: str, width: int, height: int, quality: int) -> Picture:
        """Fetch one picture."""
        ...
