"""The selected robot, below the list: how it is, what it reads, who commands it, what it can."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.text import Text
from textual.widget import Widget

from robotree.tui.screen.widgets.cached_text import entitle
from robotree.tui.screen.widgets.marks import status_mark, tint
from robotree.tui.screen.widgets.readings import Lines, ShownReadings
from robotree.tui.seen import readiness, wording
from robotree.tui.seen.cells import seen
from robotree.tui.seen.store import SeenGroup, Store

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription


SPARK = 24
"""Cells of the line of a ticked reading."""


class Details(Lines):
    """Draws one robot from the store."""

    folded = True
    """The joints share a line."""

    def draw(self, store: Store, name: str, now: float) -> None:
        """Draw the robot of this name."""
        if isinstance(self.parent, Widget):
            entitle(self.parent, seen(name))
        robot, listing = store.described(name), store.robots.get(name)
        text = Text()
        if group := store.group(name):
            self._members(text, store, group, now)
            self.show(text)
            return
        self._state(text, store, name, now)
        if robot is None:
            self.line(text, "about", Text(wording.summary(listing.doc) if listing else ""))
            self.show(text)
            return
        if lost := store.rebond(name):
            words = Text("re-bond {}.{} to {}? ⏎".format(*lost), tint(self.app, "warning"))
            self.line(text, "next", words)
        self.append_readings(text, ShownReadings.of(store, name, now), folded=self.folded)
        self._over_time(text, store, name)
        self._lease(text, store, robot, now)
        self._slots(text, robot)
        self._streams(text, robot)
        self._commands(text, store, robot)
        self.line(text, "about", Text(wording.summary(robot.doc)))
        self.line(text, "kinds", Text(" < ".join(robot.kinds)))
        for key, value in sorted(robot.attributes.items()):
            self.line(text, key, Text(value))
        self.show(text)

    def _members(self, text: Text, store: Store, group: SeenGroup, now: float) -> None:
        """Draw how each member of a group is."""
        self.line(text, "group", Text(group.about))
        for name in group.members:
            self.line(text, name, status_mark(self.app, store.status(name, now), store.doing(name, now)))
        if not group.members:
            self.line(text, "members", Text("nobody is in it now", tint(self.app, "muted")))

    def _state(self, text: Text, store: Store, name: str, now: float) -> None:
        shown = status_mark(self.app, store.status(name, now), store.doing(name, now))
        self.line(text, "state", shown)
        for number, reason in enumerate(readiness.reasons(store, name, now)):
            answer = reason if number else f"no: {reason}"
            self.line(text, "" if number else "ready", Text(answer, tint(self.app, "warning")))
        if waiters := store.waiters(name):
            self.line(text, "waits", Text(", then ".join(waiters)))

    def _over_time(self, text: Text, store: Store, name: str) -> None:
        """Draw the ticked readings of the robot as sparklines."""
        for reading, series in store.watched.ticked.robots.get(name, {}).items():
            words = Text(series.sparkline(SPARK), tint(self.app, "accent"))
            self.line(text, reading, words)

    def _lease(self, text: Text, store: Store, robot: RobotDescription, now: float) -> None:
        state = store.state(robot.name)
        epoch = state.epoch if state else robot.epoch
        if robot.bond is None:
            holder = Text("nobody holds it", tint(self.app, "muted"))
        else:
            left = robot.bond.remaining - (now - store.described_at)
            holder = Text.assemble(
                (f"{robot.bond.parent.name}.{robot.bond.slot}", tint(self.app, "primary")),
                (f"  {max(left, 0.0):.0f} s left" if left > 0 else "  renewed", tint(self.app, "muted")),
            )
        holder.append(f"  epoch {epoch}", tint(self.app, "muted"))
        self.line(text, "lease", holder)

    def _slots(self, text: Text, robot: RobotDescription) -> None:
        for slot in robot.slots:
            words = Text.assemble((f"{slot.name}: ", "bold"), (f"{slot.kind} ", tint(self.app, "muted")))
            if inhabitant := wording.inhabitant(slot):
                words.append(inhabitant, tint(self.app, "primary"))
            else:
                tone = "muted" if slot.optional and not slot.lost else "warning"
                words.append(slot.lost or wording.vacant(slot), tint(self.app, tone))
            self.line(text, "slot", words)

    def _streams(self, text: Text, robot: RobotDescription) -> None:
        for stream in robot.streams:
            words = Text.assemble((f"{wording.parameter(stream.value)}  ", "bold"))
            words.append(wording.traffic(stream) or "nobody listens", tint(self.app, "muted"))
            self.line(text, "stream", words)

    def _commands(self, text: Text, store: Store, robot: RobotDescription) -> None:
        denied = {one.name: store.denies(robot.name, robot.kinds, one.name) for one in robot.commands}
        for reason in dict.fromkeys(filter(None, denied.values())):
            self.line(text, "policy", Text(reason, tint(self.app, "warning")))
            break  # the others differ in the name of the command
        muted = tint(self.app, "muted")
        words = Text()
        for command in robot.commands:
            words.append("  " if words else "")
            can = command.available and not denied[command.name]
            words.append(command.name + (" ✗" if denied[command.name] else ""), "bold" if can else muted)
            names = ", ".join(field.name for field in command.parameters)
            words.append(f"({names})", muted)
            if count := robot.calls.get(command.name):
                words.append(f" {count}x", muted)
        self.line(text, "can", words)
