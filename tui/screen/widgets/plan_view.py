"""The plan of a place from above, with a cursor: where it is, the selected robot can be sent."""

from __future__ import annotations

from rich.segment import Segment
from rich.style import Style
from textual.events import Click, Resize
from textual.geometry import Region
from textual.strip import Strip

from robotree.tui.processes.place_files import NamedPlace
from robotree.tui.screen.foresight import Foreseen
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.screen.widgets.pointing import Pointing
from robotree.tui.seen.frames import Spot
from robotree.tui.seen.plan import PLACE, Mark, PlanScene, Point, Run, Window, drawn, fitting, heading_sign

ZOOM = 1.5
"""How much nearer one press of a key goes."""
FAR = 5
"""Cells that the cursor goes with shift."""


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
