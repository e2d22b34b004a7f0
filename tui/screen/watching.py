"""What a person watches over time: ticked readings, the streams and wires from which they come, alarms."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

from textual.app import App

from robotree.tui.processes.layout import LayoutFile
from robotree.tui.processes.wire_watch import WireMessage, WireWatch
from robotree.tui.seen.series import Reading, named, reading_of
from robotree.tui.seen.streams import HeardStreams
from robotree.tui.seen.watched import WatchedReadings

if TYPE_CHECKING:
    from robotree.vr.supervision.realm_client import RealmClient


class Watching:
    """The part of an app that listens to what its operator has ticked, and to nothing else."""

    def __init__(
        self,
        app: App[int],
        realm_client: RealmClient,
        realm: str,
        watched: WatchedReadings,
        layout: LayoutFile,
        now: Callable[[], float],
    ) -> None:
        """Watch what was watched when this person left.

        Args:
            app: whose workers listen.
            realm_client: the agents of the realm.
            realm: its name, under which it is kept what is ticked.
            watched: where samples are kept.
            layout: how this person has arranged the screen; keeps what is ticked.
            now: returns [s] on the clock of the samples.
        """
        self._app, self._realm_client, self._realm = app, realm_client, realm
        self._watched, self._layout, self._now = watched, layout, now
        self.wires: dict[str, WireWatch] = {}
        """By robot: wires that are watched."""
        self._streams = HeardStreams(realm_client, self._take)
        for name in layout.layout.ticked.get(self._realm, ()):
            if reading := reading_of(name):
                watched.ticked.tick(reading)
        self._rung = watched.rung

    def tick(self, reading: Reading) -> None:
        """Watch a reading over time, or end that."""
        ticked = self._watched.ticked
        if reading in ticked.series:
            ticked.untick(reading)
        else:
            ticked.tick(reading)
        for robot in [robot for robot in self.wires if not self._has_ticked_fields(robot)]:
            if not any(getattr(page, "robot", "") == robot for page in self._app.screen_stack):
                self.leave_wire(robot)
        self.hear_streams()
        names = [named(each) for each in ticked.series if "." not in each[1]]  # wires are not watched unasked
        kept = {**self._layout.layout.ticked, self._realm: names}
        self._layout.change(ticked={realm: names for realm, names in kept.items() if names})

    def hear_streams(self) -> None:
        """Listen to the streams that are ticked, and to no other."""
        following = self._streams.follow(list(self._watched.ticked.series))
        self._app.run_worker(following, exit_on_error=False, group="streams")

    def _take(self, robot: str, numbers: Mapping[str, float]) -> None:
        self._watched.take(robot, numbers, self._now())

    def watch_wire(self, robot: str) -> None:
        """Listen to the controller of a proxy, if that is not done already."""
        if robot not in self.wires:
            self.wires[robot] = WireWatch(self._realm_client.realm, robot, partial(self._heard_wire, robot))

    def _heard_wire(self, robot: str, messages: Sequence[WireMessage]) -> None:
        if robot in self._watched.ticked.robots:
            now = self._now()
            for message in messages:
                fields = {f"{message.name}.{name}": value for name, value in message.numbers().items()}
                self._watched.ticked.take(robot, fields, now)

    def _has_ticked_fields(self, robot: str) -> bool:
        return any("." in name for name in self._watched.ticked.robots.get(robot, ()))

    def leave_wire(self, robot: str) -> None:
        """Listen no longer, unless a field of it is ticked."""
        if not self._has_ticked_fields(robot) and (watch := self.wires.pop(robot, None)):
            self._app.run_worker(watch.close(), exit_on_error=False, group="wires")

    def ring(self) -> None:
        """Ring the bell of the terminal, once for each time that alarms were raised."""
        if self._watched.rung != self._rung:
            self._rung = self._watched.rung
            self._app.bell()

    async def close(self) -> None:
        """Listen to nothing any more."""
        while self.wires:
            await self.wires.popitem()[1].close()
        await self._streams.follow(())
