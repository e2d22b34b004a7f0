"""The selected robot, beside the list: who it is, what it can, what it reads."""

from __future__ import annotations

from rich.text import Text

from robotree.tui.screen.widgets.gauges import rank
from robotree.tui.screen.widgets.marks import mood_mark, tint
from robotree.tui.screen.widgets.still import Still
from robotree.tui.seen import wording
from robotree.tui.seen.store import Store

READINGS = 10
"""Readings that are shown however little room there is."""
FRAME = 2
"""Lines of the border."""


class Details(Still):
    """Draws one robot from the store."""

    def draw(self, store: Store, name: str, now: float) -> None:
        """Draw the robot of this name, or a hint when there is none."""
        self.border_title = name
        robot = store.descriptions.get(name)
        listing = store.robots.get(name)
        muted = tint(self.app, "muted")
        if robot is None:
            about = wording.summary(listing.doc) if listing else "Nothing is selected."
            self.show(Text(about, muted))
            return
        text = Text.assemble(
            (" < ".join(robot.kinds), muted),
            "\n",
            mood_mark(self.app, store.mood(name, now), store.doing(name, now)),
        )
        if (state := store.state(name)) and state.stop_reason:
            text.append(f"\n{state.stop_reason}", tint(self.app, "error"))
        if robot.doc:
            text.append(f"\n\n{wording.summary(robot.doc)}")
        self._slots(text, store, name)
        self._commands(text, store, name)
        self._readings(text, store, name)
        self.show(text)

    def _slots(self, text: Text, store: Store, name: str) -> None:
        slots = store.descriptions[name].slots
        if not slots:
            return
        self._heading(text, "slots")
        for slot in slots:
            text.append(f"\n{slot.name}", "bold")
            text.append(f": {slot.kind}  ", tint(self.app, "muted"))
            if slot.child:
                text.append(slot.child.name, tint(self.app, "primary"))
            else:
                text.append(slot.lost or "empty", tint(self.app, "warning"))

    def _commands(self, text: Text, store: Store, name: str) -> None:
        robot = store.descriptions[name]
        if not robot.commands:
            return
        muted = tint(self.app, "muted")
        self._heading(text, "commands")
        for command in robot.commands:
            text.append(f"\n{command.name}", "bold" if command.available else muted)
            names = ", ".join(field.name for field in command.parameters)
            text.append(f"({names})", muted)
            if count := robot.calls.get(command.name):
                text.append(f"  {count}x", muted)

    def _readings(self, text: Text, store: Store, name: str) -> None:
        readings = store.readings(name)
        if not readings:
            return
        muted, units = tint(self.app, "muted"), store.units(name)
        self._heading(text, "readings")
        width = max(len(key) for key in readings)
        room = self.container_size.height - FRAME - text.plain.count("\n") - 1
        for key in sorted(readings, key=rank)[: max(room, READINGS)]:
            text.append(f"\n{key.ljust(width)} ", muted)
            text.append(f"{wording.number(readings[key], 3):>9}")
            text.append(f" {units.get(key, '')}".rstrip(), muted)

    def _heading(self, text: Text, word: str) -> None:
        text.append(f"\n\n{word}", tint(self.app, "primary"))
