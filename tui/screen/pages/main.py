"""The main page: robots, tree, views, log; everything begins here."""

from __future__ import annotations

from typing import ClassVar

from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import Horizontal, VerticalScroll
from textual.widgets import ContentSwitcher, DataTable, Tree

from robotree.tui.line.action import About, Scope, Where
from robotree.tui.line.actions import ACTIONS, BY_VERB
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.widgets.details import Details
from robotree.tui.screen.widgets.happenings import HappeningLog
from robotree.tui.screen.widgets.prompt import Kind, Prompt
from robotree.tui.screen.widgets.robot_table import RobotTable
from robotree.tui.screen.widgets.robot_tree import NOWHERE, Place, RobotTree
from robotree.tui.screen.widgets.still import Still
from robotree.tui.screen.widgets.tabs import TabLine, TabName
from robotree.tui.screen.widgets.views_pane import ViewsPane
from robotree.tui.seen import forest
from robotree.tui.seen.store import Store

PANES = {"robots": "#robots", "tree": "#tree", "views": "#cameras", "log": "#log"}
"""What has the focus in each pane, by the verb that brings it to the front."""
FIRST = next(iter(PANES))
"""The pane to begin with."""
SELECTABLE = {"robots", "tree"}
"""Panes in which a robot can be selected."""

BACK = "Show everything again, or go back to the robots."

EMPTY = """\


Nobody is here yet.

  robotree demo                  starts a simulated cell with an arm and a rover
  robotree lookup lookup-1       starts a lookup service
  robotree proxy arm arm-1 …     brings an arm among the agents

Whoever comes appears here by itself."""

HIDDEN = """\


No free robot{letters}. Those that are enslaved are in the tree: press t."""


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
    """Four panes of one realm, the selected robot beside them, and the prompt below."""

    BINDINGS: ClassVar[list[BindingType]] = _bindings()

    def parts(self) -> ComposeResult:
        """Tabs, panes, details, prompt."""
        yield TabLine({name: BY_VERB[name].key for name in PANES})
        with Horizontal(classes="columns"):
            with ContentSwitcher(initial=FIRST, id="panes"):
                yield RobotTable(id="robots")
                yield RobotTree(id="tree")
                yield ViewsPane(id="views")
                yield HappeningLog(id="log")
            yield Still(id="empty")
            with VerticalScroll(id="details-box", can_focus=False):
                yield Details(id="details")
        yield Prompt(self.app, id="prompt")

    def on_mount(self) -> None:
        """Begin with the robots."""
        self.query_one(RobotTable).focus()

    # -- where one is ------------------------------------------------------------------------------

    @property
    def pane(self) -> str:
        """Name of the pane in front."""
        return self.query_one("#panes", ContentSwitcher).current or FIRST

    def title_of_page(self) -> str:
        """Return the pane's name, and what it is filtered by."""
        letters = self.query_one(Prompt).letters
        return f"{self.pane}  /{letters}" if letters else self.pane

    @property
    def place(self) -> Place:
        """What keys are about: a robot, an empty slot, or nothing."""
        if self.pane == "tree":
            return self.query_one(RobotTree).selected
        return Place(self.query_one(RobotTable).selected if self.pane == "robots" else "")

    @property
    def selected(self) -> str:
        """Name of the robot that keys are about; empty: none."""
        return self.place.name

    def show_pane(self, name: str) -> None:
        """Bring a pane to the front."""
        self.query_one("#panes", ContentSwitcher).current = name
        self._focus_pane()
        self.draw()
        self.refresh_bindings()

    def _focus_pane(self) -> None:
        self.query_one(PANES[self.pane]).focus()

    @on(TabName.Chosen)
    def _clicked(self, event: TabName.Chosen) -> None:
        self.show_pane(event.pane)

    # -- keys --------------------------------------------------------------------------------------

    def action_verb(self, verb: str) -> None:
        """Do what a key of the registry asks for, with what is selected."""
        self.app.ask_for(verb, NOWHERE if BY_VERB[verb].about is About.NOTHING else self.place)

    def open_line(self, kind: Kind) -> None:
        """Open the line below, for a verb or for a filter."""
        self.query_one(Prompt).open(kind)

    @on(DataTable.RowSelected)
    @on(Tree.NodeSelected)
    def _enter(self) -> None:
        self.action_verb("panel")

    def action_clear_filter(self) -> None:
        """Show everything again; from another pane, back to the robots."""
        prompt = self.query_one(Prompt)
        if prompt.letters:
            prompt.letters = ""
        elif self.pane != FIRST:
            self.show_pane(FIRST)
        self.draw()

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Show keys about a robot only where a robot can be selected."""
        concerned = action == "verb" and BY_VERB[str(parameters[0])].about is not About.NOTHING
        if concerned and self.is_mounted and self.pane not in SELECTABLE:
            return False
        return super().check_action(action, parameters)

    # -- the prompt --------------------------------------------------------------------------------

    @on(Prompt.Entered)
    def _typed(self, event: Prompt.Entered) -> None:
        self.app.obey(event.text)

    @on(Prompt.Filtered)
    def _filtered(self) -> None:
        self.draw()

    @on(Prompt.Left)
    def _left_prompt(self) -> None:
        self._focus_pane()

    # -- drawing -----------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw the pane in front."""
        if not self.is_mounted:
            return
        super().draw()
        store, now, pane = self.app.store, self.app.now(), self.pane
        letters = self.query_one(Prompt).letters
        self.query_one(TabLine).draw(pane)
        rows = store.rows(letters, now)
        if pane == "robots":
            self.query_one(RobotTable).draw(rows, letters)
        elif pane == "tree":
            self.query_one(RobotTree).draw(
                _filtered(forest.forest(store.descriptions.values()), store, letters), store, now
            )
        elif pane == "views":
            self.query_one(ViewsPane).draw()
        self.query_one(HappeningLog).draw(store, now, self.wall())
        self._draw_empty(rows=bool(rows), letters=letters)
        self.query_one("#details-box").display = pane in SELECTABLE and bool(self.selected)
        if self.selected:
            self.query_one(Details).draw(store, self.selected, now)

    def _draw_empty(self, *, rows: bool, letters: str) -> None:
        """Say what emptiness means, over the list: one that is hidden would lose the focus."""
        empty, store = self.query_one("#empty", Still), self.app.store
        nothing = self.pane == "robots" and not rows
        empty.display = nothing
        if nothing:
            wanted = f" with {letters!r}" if letters else ""
            empty.show(Text(HIDDEN.format(letters=wanted) if store.descriptions or letters else EMPTY))


def _filtered(roots: tuple[forest.Branch, ...], store: Store, letters: str) -> tuple[forest.Branch, ...]:
    """Keep the trees in which a line contains these letters, or a robot's description."""
    wanted = letters.lower()
    return tuple(
        root
        for root in roots
        if wanted in forest.drawing([root]).lower()
        or any(store.about(name, letters) for name in forest.names(root))
    )
