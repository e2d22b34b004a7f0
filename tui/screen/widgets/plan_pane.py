"""The pane of the plan: the place of the selected robot from above, and what is known of the point."""

from __future__ import annotations

import time

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.timer import Timer

from robotree.tui.processes.place_files import NamedPlace, coordinates_in_words, places_beside
from robotree.tui.screen.foresight import Foreseen
from robotree.tui.screen.hanging import broken
from robotree.tui.screen.part import Part
from robotree.tui.screen.place import Place
from robotree.tui.screen.widgets.cached_text import CachedText, entitle
from robotree.tui.screen.widgets.marks import STATUSES, status_mark, tint
from robotree.tui.screen.widgets.plan_view import PlanView, scene_of
from robotree.tui.seen.cells import seen
from robotree.tui.seen.frames import ground_of, spots

REST = 0.25
"""[s] that the cursor rests before the robot is asked for its way."""
AGAIN = 2.0
"""[s] before the robot is asked again: a stop, or somebody else, may have come or gone."""
LOOK = 1.0
"""[s] between two looks for other named places."""


class PlanPane(Part, Horizontal):
    """The plan on the left, what it says on the right."""

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Know no place yet."""
        super().__init__(id=id)
        self.ground = ""
        """Name of the frame that is shown."""
        self._rest: Timer | None = None
        self._places: dict[str, NamedPlace] = {}
        self._looked = self._asked = float("-inf")

    def compose(self) -> ComposeResult:
        """Plan, and beside it text."""
        yield PlanView(id="plan")
        with Vertical(classes="side plan-side"):
            yield CachedText(id="plan-robot")
            yield CachedText(id="plan-way")
            yield CachedText(id="plan-places")

    def on_mount(self) -> None:
        """Name the parts."""
        for part, title in (("robot", "robot"), ("way", "way"), ("places", "places")):
            self.query_one(f"#plan-{part}").border_title = title

    @property
    def point(self) -> dict[str, float] | None:
        """The point under the cursor [m]; None: there is no cursor."""
        point = self.query_one(PlanView).point
        return None if point is None else {"x": point[0], "y": point[1]}

    def draw(self, now: float) -> None:
        """Draw where all robots of the place are now."""
        app, store, plan = self.app, self.app.store, self.query_one(PlanView)
        selected = app.selection.name
        robot = store.described(selected)
        ground = ground_of(robot, store.descriptions) if robot is not None else self.ground
        if ground != self.ground:
            self.ground = ground
            plan.forget_window()
        self._look_for_places()
        if self._foreseen is not None and now - self._asked > AGAIN:
            self._ask_robot()
        found = spots(store, ground)
        found.sort(key=lambda spot: spot.name == selected)
        sign_of = {spot.name: STATUSES[store.status(spot.name, now)] for spot in found}
        places = [one for one in self._places.values() if one.frame == ground]
        plan.show(scene_of(found, places, self._foreseen, sign_of))
        self._draw_side(now, selected, places)

    @property
    def _foreseen(self) -> Foreseen | None:
        newest = self.app.foresight.newest
        return newest if newest is not None and newest.frame == self.ground else None

    def _look_for_places(self) -> None:
        if time.monotonic() - self._looked > LOOK:
            self._looked = time.monotonic()
            self._places = dict(places_beside(self.app.realm_client.gate).all())

    def _draw_side(self, now: float, selected: str, places: list[NamedPlace]) -> None:
        store, muted = self.app.store, tint(self.app, "muted")
        if selected:
            state = status_mark(self.app, store.status(selected, now), store.doing(selected, now))
            readings = store.readings(selected)
            at = coordinates_in_words({name: readings[name] for name in ("x", "y", "z") if name in readings})
            where = at.replace("  ", "\n") or "it reads no place"
            robot = Text.assemble((seen(selected), "bold"), "  ", state, f"\n{where}")
        else:
            robot = Text("no robot is selected: [ and ] choose one", muted)
        self.query_one("#plan-robot", CachedText).show(robot)
        way = self.query_one("#plan-way", CachedText)
        width = way.content_size.width or self.app.size.width
        way.show(Text("\n").join(broken(self._way_text(), width, self.app.console)))
        listed = [f"@{one.name}  {one.at['x']:.2f}, {one.at['y']:.2f}" for one in places]
        key = self.app.keymap.spelled("places add")
        none = "none" if self.app.keyboard.refusal("places add") else f"none; {key} names a point"
        self.query_one("#plan-places", CachedText).show(
            Text("\n".join(listed) or none, "" if listed else muted)
        )
        entitle(self.query_one(PlanView), f"{self.ground or 'the place'}, from above")

    def _way_text(self) -> Text:
        point, newest = self.point, self._foreseen
        if point is None:
            return Text("arrows, or a click: choose a point", tint(self.app, "muted"))
        text = Text(coordinates_in_words(point).replace("  ", "\n"))
        if newest is not None:
            tone = tint(self.app, "error" if newest.refusal else "accent")
            text.append(f"\n{newest.words}", tone)
            if newest.answered and not newest.refusal and not self.app.keyboard.refusal("go"):
                text.append("\nenter: go there", tint(self.app, "muted"))
        return text

    # -- the cursor --------------------------------------------------------------------------------

    @on(PlanView.Pointed)
    def _pointed(self) -> None:
        self.app.foresight.forget()
        if self._rest is not None:
            self._rest.stop()
        self._rest = self.set_timer(REST, self.guarded(self._ask))
        self._draw_side(self.app.now(), self.app.selection.name, [])
        self.draw(self.app.now())

    def _ask(self) -> None:
        self._ask_robot()
        self.draw(self.app.now())

    def _ask_robot(self) -> None:
        robot, point = self.app.store.described(self.app.selection.name), self.point
        if robot is not None and point is not None:
            self._asked = self.app.now()
            self.app.foresee(robot, point, self.ground)

    @on(PlanView.Chosen)
    def _chosen(self) -> None:
        self.app.ask_for("go", Place(self.app.selection.name))

    @on(PlanView.Turned)
    def _turned(self, event: PlanView.Turned) -> None:
        if names := [spot.name for spot in spots(self.app.store, self.ground)]:
            self.app.turn(names, event.by)
            self._pointed()
