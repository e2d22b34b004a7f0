"""The main page: all robots as one list, the selected one below it, and what happened last."""

from __future__ import annotations

from typing import ClassVar, cast

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.timer import Timer
from textual.widgets import ContentSwitcher

from robotree.tui.line.action import About, Scope, Where
from robotree.tui.line.actions import ACTIONS, BY_VERB
from robotree.tui.processes.layout import LEAST, MOST
from robotree.tui.screen.operator_app import OperatorApp
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.cameras import PictureBox
from robotree.tui.screen.widgets.details import Details
from robotree.tui.screen.widgets.log_pane import LastLines, LogPane
from robotree.tui.screen.widgets.plan_pane import PlanPane
from robotree.tui.screen.widgets.prompt import Prompt
from robotree.tui.screen.widgets.robot_table import RobotTable
from robotree.tui.screen.widgets.views_pane import ViewsPane
from robotree.tui.seen import matching
from robotree.tui.seen.rows import DIVISIONS, ORDERS, Division, Placement, SortOrder, family, listed
from robotree.tui.seen.selection import NOWHERE, Place
from robotree.tui.seen.store import Weight
from robotree.tui.words import say

PANES = {"robots": "#robots", "plan": "#plan", "views": "#cameras", "log": "#log"}
"""The widget with the focus in each pane, by the verb that brings it to the front."""
FIRST = next(iter(PANES))
"""The pane to begin with."""

POINTING = {"go", "places add"}
"""The actions with the point that is pointed at in a picture."""
SELECTING = {"robots", "plan"}
"""The panes in which a robot is selected, so that keys can be about it."""

CALM_DETAILS = 4.0
"""[s] between two drawings of the selected robot on a slow line."""

SOON = 0.04
"""[s] from a key that selects a robot until the details follow: the cursor comes first, also at repeat."""

PICTURES = 2.0
"""[Hz] of the picture beside the selected robot."""

BACK = "Show everything again, or go back to the robots."

EMPTY = """\


No robot is here yet.

robotree demo
  starts a simulated arm and rover
robotree lookup lookup-1
  starts a lookup service
robotree proxy arm arm-1 …
  brings your own arm in

A new robot appears here by itself."""


def _empty() -> str:
    """Return what stands where no robot is, in the chosen language; lines to type stay as they are."""
    lines = ((line, line.strip()) for line in EMPTY.split("\n"))
    return "\n".join(line.replace(text, say(text)) if text else line for line, text in lines)


HIDDEN = """\


No robot with {letters!r}. Escape shows all again."""


def _bindings() -> list[BindingType]:
    """Make the page's keys from the registry."""
    found: list[BindingType] = [
        Binding(
            action.key,
            f"verb('{action.verb}')",
            action.label,
            show=bool(action.label),
            tooltip=action.help,
            id=action.verb,
        )
        for action in ACTIONS
        if action.key and Where.SCREEN in action.where and action.scope is Scope.PAGE
    ]
    return [*found, Binding("escape", "clear_filter", "Clear", show=False, tooltip=BACK)]


class MainPage(Page):
    """Three panes of one realm."""

    BINDINGS: ClassVar[list[BindingType]] = _bindings()
    SCOPES: ClassVar[frozenset[Scope]] = frozenset(Scope)
    VERTICAL_BREAKPOINTS: list[tuple[int, str]] | None = [  # noqa: RUF012 # as Textual declares it
        (0, "-short"),
        (20, "-low"),
        (32, "-high"),
    ]

    def __init__(self) -> None:
        """Begin with all robots, as a tree."""
        super().__init__()
        self.order: SortOrder = "tree"
        self.level: Weight = "good"
        """The level of the log: less important lines are left out."""
        self._detailed = ("", 0.0)
        """The robot whose details were drawn last, and when [s]."""
        self.filters: dict[str, str] = {}
        """Letters that a pane is filtered by."""
        self._family: tuple[int, tuple[Placement, ...]] = (-1, ())
        self._shown: tuple[Placement, ...] = ()
        self._following: Timer | None = None
        """Will draw the details of the robot that was selected."""
        self.division: Division = ""
        """By what the list is divided into parts."""
        self.viewed = ""
        """Name of the saved filter that is in use."""

    def parts(self) -> ComposeResult:
        """Panes."""
        with Horizontal(classes="columns"):
            with ContentSwitcher(initial=_pane_id(FIRST), id="panes"):
                with Vertical(id=_pane_id("robots")):
                    yield RobotTable(id="robots")
                    with Horizontal(id="below"):
                        with VerticalScroll(id="details-box", can_focus=False):
                            yield Details(id="details")
                        yield PictureBox(id="picture-box", rate=PICTURES)
                yield PlanPane(id=_pane_id("plan"))
                yield ViewsPane(id=_pane_id("views"))
                with Vertical(id=_pane_id("log")):
                    yield LogPane(id="log")
            yield CachedText(id="empty")

    def messages(self) -> ComposeResult:
        """Yield the last lines of the log."""
        yield LastLines(id="last")

    def on_mount(self) -> None:
        """Begin as this person has left it."""
        layout = self.app.layout.layout
        self.order, self.level = cast("SortOrder", layout.sort), cast("Weight", layout.level)
        self.division = cast("Division", layout.divide)
        self.query_one(Details).folded = not layout.joints
        self.share(0)
        self.share_picture(0)
        if layout.wide:
            self.widen()
        if layout.page in PANES:
            self.query_one("#panes", ContentSwitcher).current = _pane_id(layout.page)
        self._focus_pane()
        if self.app.layout.fault:
            self.app.tell(self.app.layout.fault, "warning")

    # -- where one is ------------------------------------------------------------------------------

    @property
    def pane(self) -> str:
        """Name of the pane in front."""
        # None, once the page is on its way out. Each key asks: Textual keeps what this finds, unlike a query.
        panes = self.query_one_optional("#panes", ContentSwitcher)
        return panes.current.removeprefix(_pane_id("")) if panes and panes.current else FIRST

    def title_of_page(self) -> str:
        """Return the pane's name, how it is sorted, and what it is filtered by."""
        letters, title = self.filters.get(self.pane, ""), say(self.pane)
        if self.pane == FIRST and self.order != "tree":
            title += ", problems first" if self.order == "problems" else f" by {self.order}"
        if self.pane == FIRST and self.division:
            title += f", in parts by {self.division}"
        if self.pane == "log" and self.level != "good":
            title += f"  {self.level}s" + (" and errors" if self.level == "warning" else "")
        if letters:
            title += f"  {self.viewed} " if self.viewed and self.pane == FIRST else "  "
            title += f"/{letters}"
        if self.pane == FIRST and letters:
            title += f"  {len(self.shown)} of {len(self._family[1])}"
        return "; ".join([title, *matching.faults(letters)])

    @property
    def shown(self) -> tuple[Placement, ...]:
        """The robots that the list shows, in their order."""
        return tuple(placement for placement in self._shown if placement.name)

    @property
    def place(self) -> Place:
        """The object of keys: the selected robot, or nothing where none can be selected."""
        if self.pane not in {*SELECTING, "views"} or not self.selected:
            return NOWHERE
        bond = (robot := self.app.store.described(self.selected)) and robot.bond
        return Place(self.selected, bond.parent.name, bond.slot) if bond else Place(self.selected)

    @property
    def selected(self) -> str:
        """Name of the robot that is selected; empty: none."""
        return self.app.selection.name

    @property
    def point(self) -> dict[str, float] | None:
        """The point that is pointed at [m], in the frame `ground`; None: nobody points."""
        if self.pane == "views":
            pointing = self.query_one(ViewsPane).pointing
            return None if pointing is None else pointing.point
        return self.query_one(PlanPane).point if self.pane == "plan" else None

    @property
    def ground(self) -> str:
        """Name of the frame of that point."""
        pointing = self.query_one(ViewsPane).pointing if self.pane == "views" else None
        return self.query_one(PlanPane).ground if pointing is None else pointing.ground

    def set_side_by_side(self) -> None:
        """Show all cameras side by side, or one."""
        self.show_pane("views")
        self.query_one(ViewsPane).beside()

    def set_bare(self) -> None:
        """Show the arm as a skeleton instead of pictures, or not."""
        self.show_pane("views")
        self.query_one(ViewsPane).bare()

    def show_pane(self, name: str) -> None:
        """Bring a pane to the front."""
        self.query_one("#panes", ContentSwitcher).current = _pane_id(name)
        self.query_one(Prompt).letters = self.filters.get(name, "")
        self.app.layout.change(page=name)
        self._focus_pane()
        self.draw()
        self.refresh_bindings()

    def reveal(self) -> None:
        """Bring the whole list of robots to the front, without a filter."""
        self.filters.pop(FIRST, None)
        self.show_pane(FIRST)

    def _focus_pane(self) -> None:
        self.query_one(PANES[self.pane]).focus()

    # -- keys --------------------------------------------------------------------------------------

    def action_verb(self, verb: str) -> None:
        """Do what a key of the registry asks for, with what is selected."""
        if BY_VERB[verb].about is About.NOTHING:
            self.app.ask_for(verb, NOWHERE)
        elif self.app.certain():
            self.app.ask_for(verb, self.place)

    def sort(self, order: SortOrder | None = None) -> None:
        """Sort the robots so, or by what comes after the present order."""
        self.order = order or ORDERS[(ORDERS.index(self.order) + 1) % len(ORDERS)]
        named = {
            "tree": "robots by name, children below their parents",
            "problems": "robots with problems first, children below their parents",
        }
        self.app.tell(named.get(self.order, f"robots by {self.order}"))
        self.app.layout.change(sort=self.order)
        self.show_pane(FIRST)

    def divide(self) -> None:
        """Divide the list into parts in the next way: by site, kind, state, or not at all."""
        self.division = DIVISIONS[(DIVISIONS.index(self.division) + 1) % len(DIVISIONS)]
        self.app.tell(f"robots in parts by {self.division}" if self.division else "robots in one list")
        self.app.layout.change(divide=self.division)
        self.show_pane(FIRST)

    def share(self, by: int) -> None:
        """Give the part below the list so many percent of the page more."""
        wanted = min(max(self.app.layout.layout.share + by, LEAST), MOST)
        if by:
            self.app.layout.change(share=wanted)
        self.query_one("#below").styles.height = f"{wanted}%"
        if by:
            self.draw()

    def share_picture(self, by: int) -> None:
        """Give the picture so many percent more of what is below the list."""
        wanted = min(max(self.app.layout.layout.picture + by, LEAST), MOST)
        if by:
            self.app.layout.change(picture=wanted)
        self.query_one("#picture-box").styles.width = f"{wanted}fr"
        self.query_one("#details-box").styles.width = f"{100 - wanted}fr"
        if by:
            self.draw()

    # -- saved filters -----------------------------------------------------------------------------

    def save_filter(self, name: str) -> None:
        """Keep the letters by which the list of robots is filtered now."""
        letters = self.filters.get(FIRST, "").strip()
        if not letters:
            key = self.app.keymap.spelled("filter")
            self.app.tell(f"nothing is filtered: {key} and some letters first, then save", "warning")
            return
        self.app.layout.change(filters={**self.app.layout.layout.filters, name: letters})
        self.viewed = name
        self.app.tell(f"the filter {letters} is kept as {name}", "good")
        self.draw()

    def use_filter(self, name: str) -> None:
        """Filter the list of robots by what was saved under a name."""
        saved = self.app.layout.layout.filters
        if name not in saved:
            known = f"there are {', '.join(saved)}" if saved else "no filter is saved yet: `view save NAME`"
            self.app.tell(f"no saved filter {name!r}; {known}" if name else known, "warning")
            return
        self.viewed, self.filters[FIRST] = name, saved[name]
        self.show_pane(FIRST)

    def next_filter(self) -> None:
        """Use the next saved filter; after the last one show everything."""
        names = list(self.app.layout.layout.filters)
        after = names.index(self.viewed) + 1 if self.viewed in names else 0
        if not names:
            self.use_filter("")
        elif after < len(names):
            self.use_filter(names[after])
        else:
            self.viewed = ""
            self.reveal()

    def drop_filter(self, name: str) -> None:
        """Keep a filter no longer."""
        saved = dict(self.app.layout.layout.filters)
        if saved.pop(name, None) is None:
            self.use_filter(name)  # it says what there is
            return
        self.viewed = "" if self.viewed == name else self.viewed
        self.app.layout.change(filters=saved)
        self.app.tell(f"the filter {name} is kept no longer")

    def widen(self) -> None:
        """Give the whole page to the list, with more columns, and back."""
        self.toggle_class("-all")
        wide = self.has_class("-all")
        self.query_one(RobotTable).widen(wide=wide)
        if wide != self.app.layout.layout.wide:
            self.app.layout.change(wide=wide)

    def unfold(self) -> None:
        """Give each joint of the selected robot a line of its own, and back."""
        details = self.query_one(Details)
        details.folded = not details.folded
        self.app.layout.change(joints=not details.folded)
        self._detailed = ("", 0.0)
        self.draw()

    def raise_level(self) -> None:
        """Leave more out of the log: all, warnings and errors, errors."""
        levels: tuple[Weight, ...] = ("good", "warning", "error")
        self.level = levels[(levels.index(self.level) + 1) % len(levels)]
        self.app.layout.change(level=self.level)
        self.show_pane("log")

    def mark(self, name: str) -> None:
        """Mark a robot, or take its mark away, and go on to the next one."""
        if not name:
            self.app.tell("no robot is selected", "warning")
            return
        self.app.marks ^= {name}
        self.query_one(RobotTable).action_move(1)
        self.draw()

    def turn(self) -> None:
        """Look through the next camera."""
        if self.pane == "views":
            self.query_one(ViewsPane).turn()
        else:
            self.query_one(PictureBox).turn()

    def unmark(self) -> None:
        """Take all marks away."""
        self.app.marks = frozenset()
        self.draw()

    @on(RobotTable.Opened)
    def _enter(self) -> None:
        self.action_verb("panel")

    def action_clear_filter(self) -> None:
        """Show everything again; from another pane, back to the robots."""
        if self.filters.pop(self.pane, ""):
            self.viewed = "" if self.pane == FIRST else self.viewed
            self.query_one(Prompt).letters = ""
        elif self.pane != FIRST:
            self.show_pane(FIRST)
        else:
            self.unmark()
        self.draw()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show keys about a robot only where a robot can be selected, and none of what is absent."""
        if action == "verb" and not self.app.keyboard.has(BY_VERB[str(parameters[0])]):
            return False
        if action == "verb" and self.app.guard.typing:
            return False  # the keys are letters now
        concerned = action == "verb" and BY_VERB[str(parameters[0])].about is not About.NOTHING
        pointing = self.pane == "views" and bool(parameters) and parameters[0] in POINTING
        if concerned and self.is_mounted and self.pane not in SELECTING and not pointing:
            return False
        return super().check_action(action, parameters)

    # -- the prompt --------------------------------------------------------------------------------

    @on(LogPane.Resized)
    def _rewrite_log(self) -> None:
        self.draw()

    @on(Prompt.Filtered)
    def _filtered(self) -> None:
        self.filters[self.pane] = self.query_one(Prompt).letters  # the present ones
        self.draw()

    def focus_again(self) -> None:
        """Give the focus to the pane in front, which may be another one than before."""
        self._focus_pane()

    # -- drawing -----------------------------------------------------------------------------------

    def _placements(self, now: float) -> tuple[Placement, ...]:
        """Return the places that are shown, found anew only when that may differ."""
        store = self.app.store
        if self._family[0] != store.family:
            self._family = (store.family, family(store))
        placements = self._family[1]
        letters = self.filters.get(FIRST, "")
        if self.order == "tree" and not letters.strip() and not self.division:
            return placements
        return listed(store, placements, now, order=self.order, letters=letters, division=self.division)

    def draw(self) -> None:
        """Draw the pane in front."""
        if not self.is_mounted:
            return
        app, now = self.app, self.app.now()
        before, self._shown = self._shown, self._placements(now)
        names = [placement.name for placement in self.shown]
        there = [placement.name for placement in before if placement.name]
        app.selection = app.selection.among(there, names, now)
        super().draw()
        if self.pane == "robots":
            self.query_one(RobotTable).draw(self._shown, self.selected, app.marks)
            self._draw_selected(now)
        elif self.pane == "views":
            self.query_one(ViewsPane).draw()
        elif self.pane == "plan":
            self.query_one(PlanPane).draw(now)
        self.query_one(LogPane).draw(
            app.store, now, self.app.wall(), letters=self.filters.get("log", ""), level=self.level
        )
        last = self.query_one(LastLines)
        last.display = self.pane != "log"
        last.draw(app.store, now, self.app.wall())
        self._draw_empty()

    def follow(self) -> None:
        """Show at once which robot a person has selected, and the rest of it soon after."""
        table = self.query_one(RobotTable)
        table.point(self.selected)
        self.paint(table)
        if self._following is None:
            self._following = self.set_timer(SOON, self.guarded(self._followed))

    def _followed(self) -> None:
        self._following = None
        self.draw()

    def _draw_selected(self, now: float) -> None:
        self.query_one("#below").set_class(not self.selected, "-nothing")
        self.app.store.attend(self.selected)
        if self.selected:
            self._draw_details(now)
        self.query_one(PictureBox).draw()

    def _draw_details(self, now: float) -> None:
        """Draw the selected robot; on a slow line again only after a while."""
        if self.app.calm and self._detailed[0] == self.selected and now - self._detailed[1] < CALM_DETAILS:
            return
        self._detailed = (self.selected, now)
        self.query_one(Details).draw(self.app.store, self.selected, now)

    def _draw_empty(self) -> None:
        """Say what emptiness means, over the list: one that is hidden would lose the focus."""
        empty, letters = self.query_one("#empty", CachedText), self.filters.get(FIRST, "")
        nothing = self.pane == "robots" and not self._shown
        empty.display = nothing
        if nothing:
            empty.show(Text(HIDDEN.format(letters=letters) if self._family[1] else _empty()))


def _pane_id(name: str) -> str:
    return f"pane-{name}"


def main_page(app: OperatorApp) -> MainPage:
    """Return the main page of an app."""
    return next(screen for screen in app.screen_stack if isinstance(screen, MainPage))


def in_front(app: OperatorApp) -> MainPage:
    """Return the main page, after the pages over it were left; what runs there goes on."""
    while not isinstance(app.screen, MainPage):
        app.pop_screen()
    return main_page(app)
