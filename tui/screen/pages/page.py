"""The base of full pages, drawn a few times a second.

On top where one is and who is there; below it, in red, what one must not overlook; then the page's own parts,
what happened last, and the keys.
"""

from __future__ import annotations

import math
from typing import ClassVar

from rich.cells import cell_len
from rich.text import Text
from textual import on
from textual.app import ComposeResult
from textual.events import Key
from textual.widget import Widget

from robotree.tui.line.action import Scope, spell
from robotree.tui.line.actions import ACTIONS, BY_VERB
from robotree.tui.screen.part import Leaving, Part, named_keys, refusal
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.key_line import KeyLine
from robotree.tui.screen.widgets.log_pane import FlashLine
from robotree.tui.screen.widgets.marks import STATUSES, block, tint, tint_on_panel
from robotree.tui.screen.widgets.prompt import Kind, Prompt
from robotree.tui.seen.cells import clip, seen
from robotree.tui.seen.status import CALM, COUNTED, Status
from robotree.tui.seen.store import Store
from robotree.tui.words import say

COUNT_AGAIN = 1.0
"""[s] between two counts of the robots: each looks at all of them."""
GAP = 3
"""Cells between what stands on the left and on the right, at least."""


NAMES = 12
"""Cells for the names of robots in a banner, before anything else is said there."""


class TopBar(CachedText):
    """Name of the program, realm, page; on the right the counts, and how to stop."""

    _counts: tuple[float, list[tuple[Status, int]]] = (-math.inf, [])
    """When the robots were counted last [s], and how many have each status."""

    def draw(self, store: Store, heading: str, page: str) -> None:
        """Draw the line."""
        muted, strong = tint(self.app, "muted"), tint(self.app, "primary", bold=True)
        left = Text.assemble((" robotree ", strong), " ", heading, ("  ", muted), page)
        stop = Text.assemble((f" {spell(BY_VERB['stop'].key)} {say(self.app.STOP_WORD)} ", block(self.app)))
        if waiting := len(store.permits):
            asks = f" {waiting} permit{' waits' if waiting == 1 else 's wait'}: "
            asks += f"{self.app.keymap.spelled('permits')}  "
            stop = Text.assemble((asks, tint_on_panel(self.app, "warning", bold=True)), stop)
        if alarms := len(store.watched.open()):
            rings = f" ▲ {alarms} alarm{'' if alarms == 1 else 's'}: {self.app.keymap.spelled('readings')}  "
            stop = Text.assemble((rings, tint_on_panel(self.app, "error", bold=True)), stop)
        robots, others = self._robots(store), self._others(store)
        width = max(self.size.width or self.app.size.width, 1)  # the first time it has no size yet
        if left.cell_len >= width - stop.cell_len:  # the page says more than the name of the program
            left = Text.assemble(" ", heading, ("  ", muted), page)
        room = width - left.cell_len - stop.cell_len - GAP
        wanted = (Text.assemble(robots, (" · ", muted), others), robots, Text())
        right = next(text for text in wanted if text.cell_len <= room or not text)
        if right:
            right.append("  ")
        left.truncate(max(width - stop.cell_len - 1, 0), overflow="ellipsis")  # how to stop stays to be read
        gap = max(width - left.cell_len - right.cell_len - stop.cell_len, 1)
        self.show(Text.assemble(left, " " * gap, right, stop, no_wrap=True, overflow="ellipsis"))

    def _robots(self, store: Store) -> Text:
        """Return how many robots have each status, the worst first: `3 hang · 988 free`."""
        now, (counted, _) = self.app.now(), self._counts
        if now - counted >= COUNT_AGAIN or not self._counts[1]:
            self._counts = now, store.count(now)
        muted, text = tint(self.app, "muted"), Text()
        for status, count in self._counts[1]:
            words = f"{count} {say(status if count == 1 else COUNTED.get(status, status))}"
            text.append(" · " if text else "", muted)
            text.append(words, tint_on_panel(self.app, STATUSES[status][1]) if status not in CALM else "")
        return text or Text(say("0 robots"), tint(self.app, "warning"))

    def _others(self, store: Store) -> Text:
        """Return how many views, hosts and lookup services there are."""
        muted, text = tint(self.app, "muted"), Text()
        for count, noun in (
            (len(store.views), "view"),
            (len(store.hosts), "host"),
            (len(store.services), "lookup"),
        ):
            text.append(" · " if text else "", muted)
            text.append(f"{count}", "" if count else tint(self.app, "warning"))
            text.append(f" {say(noun if count == 1 else f'{noun}s')}", muted)
        return text


class Banner(CachedText):
    """A warning that must not be overlooked; hidden when there is none."""

    def draw(self, store: Store) -> None:
        """Draw the banner, or take it away: first who may still move, then who has stopped."""
        lines: list[Text] = []
        ground = block(self.app) if self.app.no_color else ""  # with colours the style sheet gives it
        stop = store.stop
        if stop and stop.open:
            unconfirmed = ", ".join(f"{seen(name)} ({seen(why)})" for name, why in stop.open.items())
            lines.append(Text(f" ■ NOT CONFIRMED: {unconfirmed} ", block(self.app)))
        if drills := store.drills:
            lines.append(Text(f" ▲ DRILL: {'; '.join(f'{seen(n)} {seen(t)}' for n, t in drills.items())} "))
        if unchecked := sorted(name for name, one in store.descriptions.items() if one.unchecked):
            names = ", ".join(map(seen, unchecked))
            lines.append(Text(f" ✗ CODE OF ANYBODY: {names} (--insecure-any-signer) ", block(self.app)))
        if store.stopped:
            stopped = f"■ {say('PROTECTIVE STOP')}: "
            took = f"  after {stop.longest:.2f} s" if stop and stop.confirmed else ""
            resumes = say("{key} resumes", key=self.app.keymap.spelled("resume"))
            tail = f" — {resumes}" if self.app.keyboard.has(BY_VERB["resume"]) else ""
            room = (self.size.width or self.app.size.width - 2) - cell_len(stopped) - cell_len(tail)
            if room - cell_len(took) >= NAMES:  # how to resume is read however little room there is
                tail, room = took + tail, room - cell_len(took)
            names = clip(", ".join(seen(name) for name in store.stopped), max(room, 1))
            lines.append(Text(f"{stopped}{names}{tail}", ground))
        if store.orphaned:
            stale = say("STALE: no lookup service is left; the lists may be old, known robots still obey")
            lines.append(Text(f"✗ {stale}", ground))
        self.display = bool(lines)
        for line in lines:
            line.truncate(max(self.size.width or self.app.size.width - 2, 1), overflow="ellipsis")
        self.show(Text("\n", no_wrap=True).join(lines))


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
        if not self.app.readonly or self.app.guard.typing:
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
        app.watching.ring()
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
