"""The plan of a place from above: its cursor says where the selected robot goes, a text what is known."""

from __future__ import annotations

import time

from rich.segment import Segment
from rich.style import Style
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.events import Click, Resize
from textual.geometry import Region
from textual.strip import Strip
from textual.timer import Timer

from robotree.tui.processes.place_files import NamedPlace, coordinates_in_words, places_beside
from robotree.tui.screen.foresight import Foreseen
from robotree.tui.screen.hanging import broken
from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cached_text import CachedText, entitle
from robotree.tui.screen.widgets.marks import STATUSES, status_mark, tint
from robotree.tui.screen.widgets.pointing import Pointing
from robotree.tui.seen.cells import seen
from robotree.tui.seen.frames import Spot, ground_of, spots
from robotree.tui.seen.plan import PLACE, Mark, PlanScene, Point, Run, Window, drawn, fitting, heading_sign
from robotree.tui.seen.selection import Place

ZOOM = 1.5
"""How much nearer one press of a key goes."""


class PlanView(Pointing):
    """Draws a scene line by line: only lines that differ are drawn again."""

    DEFAULT_CSS = "PlanView { width: 1fr; height: 1fr; }"

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Show an empty place."""
        super().__init__(id=id)
        self._scene = PlanScene()
        self._window: Window | None = None
        self._zoomed = False
        """A person has chosen the part that is seen: it stays."""
        self._lines: list[list[Run]] = []
        self.cursor: tuple[int, int] | None = None
        """Column and row; None: nobody has moved it yet."""

    # -- what is shown -----------------------------------------------------------------------------

    @property
    def has_cursor(self) -> bool:
        """Whether somebody has moved the cursor (`Pointing`)."""
        return self.cursor is not None

    @property
    def point(self) -> Point | None:
        """The point under the cursor [m], in W; None: there is no cursor."""
        return self._window.point(*self.cursor) if self._window and self.cursor else None

    def show(self, scene: PlanScene) -> None:
        """Draw a scene; what leaves the part that is seen widens it, unless a person has chosen that."""
        self._scene = scene
        columns, rows = self.size.width, self.size.height
        if columns < 1 or rows < 1:
            return
        window = self._window
        if window is None or not (self._zoomed or all(map(window.holds, scene.points))):
            point = self.point
            self._window = window = fitting(scene.points, columns, rows)
            self.cursor = self._inside(window.cell(point)) if point else None
        elif (window.columns, window.rows) != (columns, rows):
            self._window = window = window._replace(columns=columns, rows=rows)
        self._draw_lines(drawn(scene, window, self.cursor))

    def _draw_lines(self, lines: list[list[Run]]) -> None:
        before, self._lines = self._lines, lines
        if len(before) != len(lines):
            self.refresh()
            return
        differing = [row for row, (old, new) in enumerate(zip(before, lines, strict=True)) if old != new]
        if differing:
            self.refresh(*(Region(0, row, self.size.width, 1) for row in differing))

    def forget_window(self) -> None:
        """Another place is shown from now on."""
        self._window, self._zoomed, self.cursor = None, False, None

    def on_resize(self, event: Resize) -> None:
        """Fit again."""
        if not self._zoomed:
            self._window = None
        if event.size.area:
            self.show(self._scene)

    def render_line(self, y: int) -> Strip:
        """Draw one line of cells."""
        width, ground = self.size.width, self.rich_style
        if y >= len(self._lines):
            return Strip.blank(width, ground)
        segments = [Segment(text, self._style(tone, ground)) for tone, text in self._lines[y]]
        return Strip(segments, sum(len(text) for _, text in self._lines[y])).adjust_cell_length(width, ground)

    def _style(self, tone: str, ground: Style) -> Style:
        if tone == "cursor":
            return ground + Style(bold=True, reverse=self.has_focus)
        return ground + tint(self.app, tone, bold=tone not in {"muted", "foreground"}) if tone else ground

    def watch_has_focus(self, _value: bool) -> None:  # noqa: FBT001 # Textual's signature
        """Draw the cursor as one that takes keys, or not."""
        self.refresh()

    # -- keys --------------------------------------------------------------------------------------

    def action_cursor(self, across: int, down: int) -> None:
        """Move the cursor by so many cells; the first time it comes to the middle."""
        if self.cursor is None:
            self.cursor = self.size.width // 2, self.size.height // 2
        else:
            self.cursor = self._inside((self.cursor[0] + across, self.cursor[1] + down))
        self._moved()

    def action_zoom(self, steps: int) -> None:
        """Go nearer to the cursor, or away from it; 0: see everything."""
        window, point = self._window, self.point
        if window is None:
            return
        if not steps:
            self._zoomed, self._window = False, None
        else:
            x, y = point or (window.x, window.y)
            self._zoomed, self._window = True, window._replace(x=x, y=y, scale=window.scale * ZOOM**-steps)
        if point and self._window:
            self.cursor = self._inside(self._window.cell(point))
        self.show(self._scene)

    def on_click(self, event: Click) -> None:
        """Move the cursor to where it was clicked; a click on the cursor chooses."""
        cell = self._inside((event.x, event.y))
        if cell == self.cursor:
            self.post_message(self.Chosen(self))
        else:
            self.cursor = cell
            self._moved()

    def _inside(self, cell: tuple[int, int]) -> tuple[int, int]:
        columns, rows = max(self.size.width, 1), max(self.size.height, 1)
        return min(max(cell[0], 0), columns - 1), min(max(cell[1], 0), rows - 1)

    def _moved(self) -> None:
        self.show(self._scene)
        self.post_message(self.Pointed(self))


def scene_of(
    spots: list[Spot],
    places: list[NamedPlace],
    foreseen: Foreseen | None,
    sign_of: dict[str, tuple[str, str]],
) -> PlanScene:
    """Return what a plan shows.

    Args:
        spots: of robots; the selected one last.
        places: in their frame.
        foreseen: of a trip in their frame; None: there is none.
        sign_of: sign and tone of each robot.
    """
    named = [Mark(one.at["x"], one.at["y"], PLACE, "primary", f"@{one.name}") for one in places]
    robots = [
        Mark(
            spot.x,
            spot.y,
            sign_of[spot.name][0] if spot.heading is None else heading_sign(spot.heading),
            sign_of[spot.name][1],
            spot.name,
        )
        for spot in spots
    ]
    if foreseen is None:
        return PlanScene((*named, *robots))
    x, y, _ = foreseen.goal
    here = next(((spot.x, spot.y) for spot in spots if spot.name == foreseen.robot), None)
    way = tuple((px, py) for px, py, _ in foreseen.points)
    if not way and here and not foreseen.refusal:
        way = here, (x, y)
    return PlanScene((*named, *robots), way, (x, y), bool(foreseen.refusal))


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
