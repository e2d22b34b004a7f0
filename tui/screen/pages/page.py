"""The base of full pages: top line, banner, flash line, keys; drawn a few times a second."""

from __future__ import annotations

from typing import ClassVar

from textual import on
from textual.app import ComposeResult
from textual.events import Key
from textual.widget import Widget

from robotree.tui.line.action import Scope
from robotree.tui.line.actions import ACTIONS
from robotree.tui.screen.bindings import named_keys, refusal
from robotree.tui.screen.part import Leaving, Part
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.flash import FlashLine
from robotree.tui.screen.widgets.key_line import KeyLine
from robotree.tui.screen.widgets.prompt import Kind, Prompt
from robotree.tui.screen.widgets.topbar import Banner, TopBar

CALM_TICK = 1.0
"""[s] between two drawings on a slow line."""

TICK = 0.25
"""[s] between two drawings of a page: tables cost too much for more."""


class Page(Part, Leaving[None]):
    """A full page."""

    PAGE: ClassVar[str] = ""
    SCOPES: ClassVar[frozenset[Scope]] = frozenset({Scope.PROGRAM})
    """Which keys of the registry's verbs work here."""
    HORIZONTAL_BREAKPOINTS: list[tuple[int, str]] | None = [  # noqa: RUF012 # as Textual declares it
        (0, "-slim"),
        (60, "-narrow"),
        (100, "-wide"),
        (140, "-broad"),
    ]
    VERTICAL_BREAKPOINTS: list[tuple[int, str]] | None = [(0, "-low"), (32, "-high")]  # noqa: RUF012

    _due = False
    """It will be drawn before the next tick."""
    _left_for_line: Widget | None = None
    """The widget that had the focus before the prompt."""

    def compose(self) -> ComposeResult:
        """Frame the page's own parts."""
        yield TopBar(classes="topbar")
        yield Banner(classes="banner")
        yield from self.parts()
        yield Prompt(id="prompt")
        yield from self.messages()
        yield KeyLine()

    def parts(self) -> ComposeResult:
        """Yield the page's own parts."""
        yield from ()

    def messages(self) -> ComposeResult:
        """Yield what shows what happened last."""
        yield FlashLine(classes="flash")

    def on_mount(self) -> None:
        """Draw now and then regularly."""
        self.draw()
        self.set_interval(CALM_TICK if self.app.calm else TICK, self.guarded(self._tick))

    @on(CachedText.Resized)
    def _resized(self) -> None:
        """Draw what depends on the room as soon as the parts have their new sizes, once for all of them."""
        if not self._due:
            self._due = True
            self.call_later(self._draw_due)

    def _draw_due(self) -> None:
        self._due = False
        if self.is_active:
            self.draw()

    def on_screen_resume(self) -> None:
        """Draw what changed while another page was in front."""
        self.draw()

    def _tick(self) -> None:
        if self.is_active or self._behind_a_question():
            self.draw()

    def _behind_a_question(self) -> bool:
        """Whether this page is seen behind dialogs."""
        pages = [screen for screen in self.app.screen_stack if not screen.is_modal]
        return bool(pages) and pages[-1] is self

    def action_back(self) -> None:
        """Leave; what runs goes on."""
        self.dismiss()

    # -- the prompt --------------------------------------------------------------------------------

    def open_line(self, kind: Kind, text: str = "") -> None:
        """Open the line below, for a verb or for a filter: all keys but that of the stop are text then."""
        self._left_for_line = self.focused
        self.query_one(Prompt).open(kind, text)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Take no key of the page while somebody types at the prompt, and none of what is absent."""
        if self.focused is not None and self.focused.id == Prompt.LINE:
            return False
        if refusal(self, self.app.keyboard, action, parameters):
            return False
        return super().check_action(action, parameters)

    def on_key(self, event: Key) -> None:
        """Say why nothing comes of a key that is absent since one may only look."""
        if not self.app.readonly or self.app.typing:
            return
        verbs = {one.verb: one.verb for one in ACTIONS if one.key and one.scope in self.SCOPES}
        for name, verb in {**named_keys(self.focused), **named_keys(self), **verbs}.items():
            if verb and event.key in self.app.keymap.keys(name) and self.app.withheld(verb):
                return

    @on(Prompt.Entered)
    def _typed(self, event: Prompt.Entered) -> None:
        self.app.run_typed(event.text)

    @on(Prompt.Left)
    def _left_prompt(self) -> None:
        if not self.query_one(Prompt).display:  # it may be open again
            self.focus_again()

    def focus_again(self) -> None:
        """Give the focus back to what had it before the prompt."""
        before, self._left_for_line = self._left_for_line, None
        self.set_focus(before if before is not None and before.is_attached else None)

    # -- drawing -----------------------------------------------------------------------------------

    def title_of_page(self) -> str:
        """Return what stands in the line on top."""
        return self.PAGE

    def draw(self) -> None:
        """Draw everything that may have changed; pages add their own."""
        app = self.app
        self.query_one(TopBar).draw(app.store, app.heading, self.title_of_page())
        self.query_one(Banner).draw(app.store)
        app.ring()
        for line in self.children:  # a query would look at each widget of the page, four times a second
            if isinstance(line, FlashLine):
                line.draw(app.store, app.now())

    def paint(self, widget: Widget) -> None:
        """Send what differs in a widget to the terminal now.

        Textual gathers what is to be drawn and draws it together, at most 60 times a second, from a task of
        its own (8.2.8, `Screen._on_timer_update`). A part that stays where it is need not wait for that. If
        the page is to be laid out anew, or is covered, it is drawn in Textual's way.
        """
        if self.app.screen is not self or self._layout_required or self.app._batch_count:  # noqa: SLF001 # pyright: ignore[reportPrivateUsage] # Textual says it nowhere else
            return
        others = self._dirty_widgets - {widget}
        self._compositor.update_widgets({widget})
        self._compositor_refresh()
        self._dirty_widgets |= others  # the refresh takes all of them for drawn
