"""The list of robots, drawn line by line: only lines that differ are drawn again.

Textual's own table draws all that is visible again when one cell changes; with a hundred robots at work that
took a third of a core (docs/performance.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from rich.cells import cell_len
from rich.segment import Segment
from rich.style import Style
from textual.binding import Binding, BindingType
from textual.events import Click
from textual.geometry import Region, Size
from textual.message import Message
from textual.scroll_view import ScrollView
from textual.strip import Strip
from textual.timer import Timer

from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.marks import STATUSES, tint, tint_on_panel
from robotree.tui.seen import wording
from robotree.tui.seen.cells import clip, fit
from robotree.tui.seen.rows import GAP, MOST, Column, Placement, RobotRow, columns, row
from robotree.tui.seen.status import CALM, UNGUARDED
from robotree.tui.words import chosen, say, say_state

HEADER = 1
"""Lines above the first robot."""
CALM_LINES = 2
"""Lines that are drawn at once on a slow line of those that only make progress."""
PORTION = 12
"""Lines that are looked at and drawn in one go; a key waits for no more than that."""
PAUSE = 0.01
"""[s] between two portions: time for all that follows from a key."""
STATES = 26
"""Cells that states like to have: their words change all the time, and no column may move with them."""

WORD = 7
"""Cells of a state that an alarm beside it leaves."""

DENIED = " ✗"
"""Beside a robot of which the policy denies all commands to who sits here."""

PERSON = 12
"""Cells for the name of a person who commands a robot: `anna@pts/12`."""


class RobotTable(Part, ScrollView, can_focus=True):
    """One line for each robot; the cursor is the app's selection."""

    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("up", "move(-1)", "Up", show=False),
        Binding("down", "move(1)", "Down", show=False),
        Binding("pageup", "page(-1)", "Page up", show=False),
        Binding("pagedown", "page(1)", "Page down", show=False),
        Binding("home,ctrl+home", "move_to(0)", "First", show=False),
        Binding("end,ctrl+end", "move_to(-1)", "Last", show=False),
    ]
    COMPONENT_CLASSES: ClassVar[set[str]] = {"robot-table--cursor", "robot-table--header"}

    class Opened(Message):
        """A robot was clicked that is selected already."""

    def __init__(self, *, id: str | None = None) -> None:  # noqa: A002 # Textual's name for it
        """Make an empty list."""
        super().__init__(id=id)
        self._placements: tuple[Placement, ...] = ()
        self._marks: frozenset[str] = frozenset()
        self._at = -1
        self._drawn: dict[int, tuple[RobotRow, bool]] = {}
        """By line: what stands there, and whether the cursor is on it."""
        self._turn = 0
        """The last line that was drawn in its turn on a slow line."""
        self._columns: tuple[Column, ...] = ()
        self.room = 0
        """Cells that they share."""
        self._theme = ""
        self._rest: Timer | None = None
        """Will draw the lines below those that were drawn last."""
        self.wide = False
        """It has more columns."""

    # -- what is asked -----------------------------------------------------------------------------

    @property
    def names(self) -> list[str]:
        """Names of the robots that are shown, in their order."""
        return [placement.name for placement in self._placements if placement.name]

    @property
    def row_count(self) -> int:
        """How many robots are shown."""
        return len(self.names)

    @property
    def selected(self) -> str:
        """Name of the robot under the cursor; empty: none."""
        return self._placements[self._at].name if 0 <= self._at < len(self._placements) else ""

    # -- drawing -----------------------------------------------------------------------------------

    def draw(
        self, placements: tuple[Placement, ...], selected: str, marks: frozenset[str] = frozenset()
    ) -> None:
        """Draw these robots, in this order, the cursor on the selected one."""
        self._marks = marks
        if placements is not self._placements and placements != self._placements:
            self._placements = placements
            self.virtual_size = Size(self.size.width, len(placements) + HEADER)
            self._lay_out()
        elif self.room != self.scrollable_content_region.width:  # a scrollbar has come or gone
            self._lay_out()
        at = _position(placements, selected)
        if at != self._at:
            self._at = at
            self.scroll_to_cursor()
        if (look := f"{self.app.theme} {chosen()}") != self._theme:
            self._theme = look
            self._drawn.clear()
            self.refresh()
        self._redraw()

    def point(self, selected: str) -> None:
        """Put the cursor on another robot, and draw no more than that: two lines, or all when it scrolls."""
        before, top = self._at, self.scroll_offset.y
        self._at = _position(self._placements, selected)
        self.scroll_to_cursor()
        if self.scroll_offset.y != top:
            self._redraw()
            return
        lines = [at - top + HEADER for at in {before, self._at} if at >= top]
        if seen := [Region(0, line, self.size.width, 1) for line in lines if line < self.size.height]:
            self.refresh(*seen)

    def widen(self, *, wide: bool) -> None:
        """Have more columns, or not."""
        self.wide = wide
        self._lay_out()

    def _lay_out(self) -> None:
        """Share the width anew; everything is drawn again."""
        store = self.app.store
        longest = {"STATE": STATES}
        for placement in self._placements:
            if placement.heading:
                continue
            known = store.described(placement.name) or store.robots.get(placement.name)
            words = {
                "ROBOT": cell_len(_lead(placement, MOST["ROBOT"])) + cell_len(placement.name) + 1,
                "KIND": cell_len(wording.kind(known.kind, known.attributes)) if known else 0,
                "HOST": cell_len(known.host) if known else 0,
                "BY": max(cell_len(placement.parent), PERSON),
            }
            for title, cells in words.items():
                longest[title] = max(longest.get(title, 0), cells)
        self.room = self.scrollable_content_region.width
        self._columns = columns(self.room, longest, wide=self.wide)
        self._drawn.clear()
        self.refresh()

    def _redraw(self) -> None:
        """Draw the visible lines that differ from what stands there: the first ones now, the rest soon."""
        if self.app.calm:
            if dirty := self._few(self._differing(HEADER, self.size.height), self.scroll_offset.y):
                self.refresh(*dirty)
            return
        after = self._redraw_from(HEADER)
        if self._rest is None:
            self._redraw_soon(after)

    def _redraw_from(self, first: int) -> int:
        """Draw a portion of the lines, from this one on, and return the first line that is left."""
        end = min(first + PORTION, self.size.height)
        if dirty := self._differing(first, end):
            self.refresh(*dirty)
        return end

    def _redraw_soon(self, first: int) -> None:
        """Draw the lines from this one on, a portion after the other; keys are dealt with in between."""
        used = HEADER + len(self._placements) - self.scroll_offset.y

        def go_on() -> None:
            self._redraw_soon(self._redraw_from(first))

        more = first < min(self.size.height, used)
        self._rest = self.set_timer(PAUSE, self.guarded(go_on)) if more else None

    def _differing(self, first: int, end: int) -> list[Region]:
        """Return the lines from `first` to before `end` that differ from what stands there."""
        top, width = self.scroll_offset.y, self.scrollable_content_region.width
        wanted = ((line, self._wanted(top + line - HEADER)) for line in range(first, end))
        return [Region(0, line, width, 1) for line, one in wanted if one and self._drawn.get(line) != one]

    def _few(self, dirty: list[Region], top: int) -> list[Region]:
        """Choose what is drawn now on a slow line: other statuses at once, the rest in turn."""
        urgent, rest = list[Region](), list[Region]()
        for region in dirty:
            drawn, wanted = self._drawn.get(region.y), self._wanted(top + region.y - HEADER)
            (rest if _outline(drawn) == _outline(wanted) else urgent).append(region)
        rest = [one for one in rest if one.y > self._turn] + [one for one in rest if one.y <= self._turn]
        if rest:
            self._turn = rest[:CALM_LINES][-1].y
        return urgent + rest[:CALM_LINES]

    def _wanted(self, position: int) -> tuple[RobotRow, bool] | None:
        if not 0 <= position < len(self._placements):
            return None
        placement = self._placements[position]
        if placement.heading:
            return RobotRow(placement, kind="", status="free", state="", by="", host="", about=""), False
        made = row(self.app.store, placement, self.app.now(), self._marks, wide=self.wide)
        return made, position == self._at

    def render_line(self, y: int) -> Strip:
        """Draw one line of cells; see `ScrollView`."""
        width = self.size.width
        base = self.rich_style
        if y < HEADER:
            style = base + tint(self.app, "muted")
            # a cell for marks stands before the names
            titles = [Segment(" ", style)]
            for column in self._columns:
                room = column.room - (column.title == "ROBOT")
                titles.append(Segment(fit(say(column.title), room) + " " * GAP, style))
            return Strip(titles).adjust_cell_length(width, base)
        wanted = self._wanted(self.scroll_offset.y + y - HEADER)
        if wanted is None:
            self._drawn.pop(y, None)
            return Strip.blank(width, base)
        self._drawn[y] = wanted
        shown, under_cursor = wanted
        if shown.placement.heading:
            words = clip(f" {shown.placement.heading}", width)
            heading = Segment(words, base + tint(self.app, "primary", bold=True))
            return Strip([heading]).adjust_cell_length(width, base)
        if under_cursor:
            cursor = self.get_component_rich_style("robot-table--cursor")
            base += Style(bgcolor=cursor.bgcolor, bold=cursor.bold, reverse=self.app.no_color)
        segments = self._segments(shown, base, under_cursor=under_cursor)
        return Strip(segments).simplify().adjust_cell_length(width, base)

    def _segments(self, shown: RobotRow, base: Style, *, under_cursor: bool) -> list[Segment]:
        muted = base + tint(self.app, "muted")
        sign, colour = STATUSES[shown.status]
        tinted = tint_on_panel if under_cursor else tint
        strong = base + tinted(self.app, colour, bold=shown.status == "hangs")
        plain = muted if shown.old or shown.denied else base
        cells: list[Segment] = []
        gap = " " * GAP  # of the style before it: what is the same to the terminal is sent as one
        for column in self._columns:
            room = column.room
            match column.title:
                case "ROBOT":
                    lead = _lead(shown.placement, room - 1)
                    fresh = base + tint(self.app, "accent", bold=True)
                    known = fresh if shown.fresh else base + Style(bold=True)
                    name = muted if shown.old or shown.denied else known
                    cells.append(Segment("*" if shown.marked else " ", fresh))
                    cells.append(Segment(lead, muted))
                    cells.append(Segment(fit(shown.name, room - 1 - cell_len(lead)) + gap, name))
                case "STATE":
                    words = strong if shown.status not in CALM else plain
                    place = f" · {shown.place}" if shown.place else ""  # is read however little room there is
                    long = room >= STATES + len(place)
                    tail = (f", {UNGUARDED}" if long else " open") if shown.unguarded else ""
                    tail += " stale" if shown.unlisted else ""
                    tail = f" ({self.app.keymap.spelled('enslave')})" if shown.status == "needs" else tail
                    tail += DENIED if shown.denied else ""
                    alarm = f"▲ {shown.alarm}" if shown.alarm else ""
                    tail = place + tail if shown.state.endswith(place) else tail
                    most = max(room - 2, 0)
                    left = max(most - cell_len(alarm) - 1, min(WORD, most)) if alarm else most
                    text = clip(say_state(shown.state.removesuffix(place)), max(left - len(tail), 0)) + tail
                    cells += [Segment(fit(sign, min(2, room)), strong)]
                    if alarm:
                        text = f"{clip(text, left)} "
                        loud = base + tinted(self.app, "error", bold=True)
                        cells += [
                            Segment(text, words),
                            Segment(fit(alarm, max(most - cell_len(text), 0)) + gap, loud),
                        ]
                    else:
                        cells += [Segment(fit(text, most) + gap, words)]
                case "KIND":
                    cells.append(Segment(fit(_short_kind(shown.kind, room), room) + gap, plain))
                case title:
                    text = {
                        "BY": f"{shown.by}, then {shown.waits}" if shown.waits else shown.by,
                        "HEARD": shown.heard or "-",
                        "HOST": shown.host or "-",
                        "EPOCH": shown.epoch or "-",
                        "LEASE": shown.lease or "-",
                        "PROCESS": shown.process or "-",
                    }.get(title, shown.about)
                    if title == "BY" and cell_len(text) > room:  # who waits for an answer is read first
                        text = text[max(text.find("→"), 0) :]
                    cells.append(Segment(fit(text, room) + gap, muted))
        return cells

    # -- the cursor --------------------------------------------------------------------------------

    def scroll_to_cursor(self) -> None:
        """Have the selected robot in sight."""
        rows = max(self.size.height - HEADER, 1)
        top = self.scroll_offset.y
        first = self._at - 1 if self._at > 0 and self._placements[self._at - 1].heading else self._at
        if self._at < 0 or top <= first <= self._at < top + rows:
            return
        self.scroll_to(y=first if first < top else self._at - rows + 1, animate=False, immediate=True)

    def action_move(self, by: int) -> None:
        """Select the robot so many lines below."""
        if not self.row_count:
            return
        wanted = min(max(self._at + by, 0), len(self._placements) - 1)
        way = 1 if by > 0 else -1
        if self._placements[wanted].heading:
            wanted += way if 0 <= wanted + way < len(self._placements) else -way
        self._choose(wanted)

    def action_page(self, by: int) -> None:
        """Select the robot a page below."""
        self.action_move(by * max(self.size.height - HEADER - 1, 1))

    def action_move_to(self, position: int) -> None:
        """Select the robot in this position; negative: counted from the end."""
        if self.row_count:
            position %= len(self._placements)
            self._choose(position + 1 if self._placements[position].heading else position)

    def _choose(self, position: int) -> None:
        self.app.choose(self._placements[position].name)

    def on_click(self, event: Click) -> None:
        """Select a robot; once more opens it."""
        position = self.scroll_offset.y + event.y - HEADER
        if event.y < HEADER or not 0 <= position < len(self._placements):
            return
        if self._placements[position].heading:
            return
        if position == self._at:
            self.post_message(self.Opened())
        else:
            self._choose(position)

    # -- its size ----------------------------------------------------------------------------------

    def on_resize(self) -> None:
        """Share the width anew, and keep the selected robot in sight."""
        self.virtual_size = Size(self.size.width, len(self._placements) + HEADER)
        self._lay_out()
        self.scroll_to_cursor()


def _outline(line: tuple[RobotRow, bool] | None) -> object:
    """Return what of a line is shown at once when it differs."""
    return line and (line[0].name, line[0].status, line[1])


def _position(placements: Sequence[Placement], name: str) -> int:
    """Return where a robot stands; -1: nowhere."""
    return next((at for at, one in enumerate(placements) if one.name == name and name), -1)


def _short_kind(kind: str, room: int) -> str:
    """Return a kind that fits; whether the robot is real or simulated is not what is cut."""
    words, bracket, origin = kind.rpartition(" (")
    if not bracket or cell_len(kind) <= room:
        return kind
    return clip(words, max(room - cell_len(bracket + origin), 1)) + bracket + origin


def _lead(placement: Placement, room: int) -> str:
    """Return what stands before a robot's name: how deep it is, and its slot; it leaves half the room."""
    if not placement.depth:
        return ""
    lead = placement.rail[max(len(placement.rail) - max(room // 3, 0), 0) :]
    free = max(room // 2, room - cell_len(placement.name) - 1) - cell_len(lead)
    slot = clip(f"{placement.slot}:", max(free, 0)) if placement.slot else ""
    return f"{lead}{slot} " if slot else lead
