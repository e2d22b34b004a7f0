"""The selected robot, below the list: how it is, what it reads, who commands it, what it can."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.style import Style
from rich.text import Text
from textual.widget import Widget

from robotree.tui.screen.widgets.gauges import ALARM, FULL_FORCE, WARN
from robotree.tui.screen.widgets.marks import mood_mark, tint
from robotree.tui.screen.widgets.still import Still, entitle
from robotree.tui.seen import instruments, wording
from robotree.tui.seen.cells import fit, seen
from robotree.tui.seen.instruments import Figure, Group
from robotree.tui.seen.mood import span
from robotree.tui.seen.store import Store

if TYPE_CHECKING:
    from robotree.vr.description import RobotDescription

LABEL = 8
"""Cells for the name of a line, and a gap."""
SPARK = 8
"""Cells of the line of past forces."""


class Details(Still):
    """Draws one robot from the store."""

    def draw(self, store: Store, name: str, now: float) -> None:
        """Draw the robot of this name."""
        if isinstance(self.parent, Widget):
            entitle(self.parent, seen(name))
        robot, listing = store.described(name), store.robots.get(name)
        text = Text()
        self._state(text, store, name, now)
        if robot is None:
            self._line(text, "about", Text(wording.summary(listing.doc) if listing else ""))
            self.show(text)
            return
        if lost := store.rebond(name):
            words = Text("re-bond {}.{} to {}? ⏎".format(*lost), tint(self.app, "warning"))
            self._line(text, "next", words)
        self._readings(text, store, name, now)
        self._lease(text, store, robot, now)
        self._slots(text, robot)
        self._commands(text, robot)
        self._line(text, "about", Text(wording.summary(robot.doc)))
        self._line(text, "kinds", Text(" < ".join(robot.kinds)))
        for key, value in sorted(robot.attributes.items()):
            self._line(text, key, Text(value))
        self.show(text)

    def _line(self, text: Text, label: str, words: Text) -> None:
        """Append a line, unless it says nothing."""
        if not words:
            return
        if text:
            text.append("\n")
        text.append(fit(label, LABEL - 1) + " ", tint(self.app, "muted"))
        text.append_text(words)

    def _state(self, text: Text, store: Store, name: str, now: float) -> None:
        shown = mood_mark(self.app, store.mood(name, now), store.doing(name, now))
        absent, state = store.absent.get(name), store.state(name)
        if absent:
            shown.append(f"  {absent.remedy or 'start it again, or D takes it off the list'}")
        elif state and state.stop_reason:
            shown.append(f"  {state.stop_reason}", tint(self.app, "error"))
        self._line(text, "state", shown)

    def _readings(self, text: Text, store: Store, name: str, now: float) -> None:
        old = store.old(name, now)
        readings = store.readings(name)
        age = store.age(name, now)
        if old and readings and age is not None:
            self._line(
                text, "", Text(f"{span(max(age, readings.get('age', 0.0)))} old", tint(self.app, "warning"))
            )
        for group in instruments.groups(readings, store.units(name), old=False):
            words = Text()
            if group.label == "force":
                self._force(words, store, group, old=old)
            else:
                self._figures(words, group.figures, "" if not old else tint(self.app, "muted"))
            self._line(text, group.label, words)

    def _figures(self, words: Text, figures: tuple[Figure, ...], style: str | Style) -> None:
        muted = tint(self.app, "muted")
        for one in figures:
            if words:
                words.append(" ")
            if one.name:
                words.append(f"{seen(one.name)} ", muted)
            words.append(one.text, style)
            if one.unit:
                words.append(f" {seen(one.unit)} ", muted)
        words.rstrip()

    def _force(self, words: Text, store: Store, group: Group, *, old: bool) -> None:
        """Draw the size of the force: what it was, as a line of bars; what it is; the largest one."""
        total, past = group.figures[0], [force for _, force in store.forces]
        parts = [one for one in group.figures[1:] if one.name != instruments.PEAK]
        told = [one.text for one in group.figures if one.name == instruments.PEAK]
        peak = told or ([instruments.figure(max(past), "N")[0]] if past else [])
        muted = tint(self.app, "muted")
        now = past[-1] if past else 0.0
        colour = (
            "error" if now >= ALARM * FULL_FORCE else "warning" if now >= WARN * FULL_FORCE else "primary"
        )
        style = muted if old else tint(self.app, colour)
        words.append(instruments.spark(past, FULL_FORCE, SPARK), style)
        words.append(f" {total.text}", style)
        words.append(f" {total.unit}  ", muted)
        words.append("".join(f"peak {one}   " for one in peak))
        self._figures(words, tuple(parts), muted)

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
        self._line(text, "lease", holder)

    def _slots(self, text: Text, robot: RobotDescription) -> None:
        for slot in robot.slots:
            words = Text.assemble((f"{slot.name}: ", "bold"), (f"{slot.kind} ", tint(self.app, "muted")))
            if slot.child:
                words.append(slot.child.name, tint(self.app, "primary"))
            else:
                words.append(slot.lost or "empty", tint(self.app, "warning"))
            self._line(text, "slot", words)

    def _commands(self, text: Text, robot: RobotDescription) -> None:
        muted = tint(self.app, "muted")
        words = Text()
        for command in robot.commands:
            words.append("  " if words else "")
            words.append(command.name, "bold" if command.available else muted)
            names = ", ".join(field.name for field in command.parameters)
            words.append(f"({names})", muted)
            if count := robot.calls.get(command.name):
                words.append(f" {count}x", muted)
        self._line(text, "can", words)
