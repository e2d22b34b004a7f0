"""Where a robot is now: its page with the current line, the calls of its children, results and times."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text
from textual import work
from textual.app import ComposeResult
from textual.containers import Horizontal, VerticalScroll

from robotree.tui.line import standing as words
from robotree.tui.line.past import Known
from robotree.tui.screen.hanging import broken
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.widgets.cached_text import CachedText, entitle
from robotree.tui.screen.widgets.marks import tint
from robotree.tui.seen.cells import seen, spaced
from robotree.tui.seen.standing import ChildStep, Standing, times
from robotree.vr.base.errors import VrError

PERIOD = 1.0
"""[s] between two questions to the hosts, where nothing is seen to change."""
MARGIN = 8
"""Cells for the number of a line, and the bar beside the page."""
SOON = 0.2
"""[s] after a change that was seen: what was done is kept a tenth of a second later."""


class WherePage(Page):
    """Watches one robot. Nothing is asked while it is not in front."""

    KEYS_OF = "where"

    def __init__(self, robot: str) -> None:
        """Look at a robot."""
        super().__init__()
        self.robot = robot
        self.found: Standing | None = None
        self.source: Sequence[str] = ()
        self._known: Known = {}
        self._page = ""
        """Hash of the page whose source is shown."""
        self._note = "its host is asked …"
        self._asked = -PERIOD
        """[s] when the hosts were asked last."""
        self._asking = self._answered = False
        self._seen: tuple[str, str, str] = ("", "", "")
        """What its state said then: what runs, what waits, who has paused it."""
        self._line = 0

    def parts(self) -> ComposeResult:
        """The page of the robot; beside it what it has called."""
        yield CachedText(id="where-head")
        with Horizontal(classes="columns"):
            with VerticalScroll(id="where-source"):
                yield CachedText(id="where-lines")
            with VerticalScroll(id="where-calls"):
                yield CachedText(id="where-steps")

    def on_mount(self) -> None:
        """Begin to look."""
        self.query_one("#where-source").focus()

    def title_of_page(self) -> str:
        """Say which robot it is about."""
        return f"where {self.robot} is"

    # -- keys --------------------------------------------------------------------------------------

    def action_verb(self, verb: str) -> None:
        """Pause the robot, let it take a step, or let it go on."""
        self.app.do(verb, NAME=self.robot)

    # -- looking -----------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw what is known, and ask again where it may have changed."""
        super().draw()
        if not self.is_mounted:
            return
        now, state = self.app.now(), self.app.store.state(self.robot)
        seen_now = (state.busy, state.held, state.paused) if state else ("", "", "")
        due = SOON if seen_now != self._seen else PERIOD
        if self.is_active and not self._asking and now - self._asked >= due:
            self._seen, self._asked, self._asking = seen_now, now, True
            self._ask()
        self._draw_found()

    @work(exclusive=True, exit_on_error=False, group="where")
    async def _ask(self) -> None:
        try:
            found, notes, self._known = await words.find(self.app.realm_client, self.robot)
            if not self.source or (found is not None and found.page != self._page):
                self.source = await words.page_of(self.app.realm_client, self.robot)
                self._page = found.page if found else ""
            nothing = f"{self.robot} has carried nothing out yet, or only what reads"
            self.found, self._note = found, "; ".join(notes) or ("" if found else nothing)
        except VrError as error:
            self._note = str(error)
        finally:
            self._asking, self._answered = False, True
        self._draw_found()

    # -- drawing -----------------------------------------------------------------------------------

    def _draw_found(self) -> None:
        found, wall = self.found, self.app.wall()
        head = Text(no_wrap=True, overflow="ellipsis")
        if found is not None:
            style = tint(self.app, "warning" if found.held else "accent" if found.runs else "muted")
            head.append(f" {spaced(words.head(found, wall, self._known))}", style)
        if self._note:
            head.append(
                f"\n {seen(self._note)}" if head else f" {seen(self._note)}", tint(self.app, "warning")
            )
        self.query_one("#where-head", CachedText).show(head)
        self._draw_source()
        self._draw_steps(wall)

    def _draw_source(self) -> None:
        box, line = self.query_one("#where-source"), self.found.line if self.found else 0
        text, room = Text(), max(box.scrollable_content_region.width - MARGIN, 1)
        for number, code in enumerate(self.source, 1):
            here = number == line
            text.append("\n" if number > 1 else "")
            text.append(f"{'→' if here else ' '}{number:>4}  ", tint(self.app, "accent" if here else "muted"))
            style = tint(self.app, "accent", bold=True) if here else ""
            text.append(spaced(code.expandtabs(4))[:room], style)
        none = "no page: it is a proxy, or its host does not say" if self._answered else ""
        self.query_one("#where-lines", CachedText).show(
            text if self.source else Text(none, tint(self.app, "muted"))
        )
        entitle(box, "its page", f"line {line}" if line else "")
        if line and line != self._line:
            self._line = line
            box.scroll_to(y=max(line - box.size.height // 2, 0), animate=False)

    def _draw_steps(self, wall: float) -> None:
        found, text = self.found, Text()
        for step in found.steps if found else ():
            text.append_text(self._step(step, wall))
            text.append("\n")
        if self._answered and not (found and found.steps):
            text.append(f"{words.NO_CALLS}\n", tint(self.app, "muted"))
        if found and (totals := times(found, wall)):
            text.append("\ntime for each call\n", tint(self.app, "muted"))
            for call, count, seconds in totals:
                text.append(f"  {seen(call)}  {count}x  ", "")
                text.append(f"{seconds:.1f} s\n", "bold")
        text.rstrip()
        self.query_one("#where-steps", CachedText).show(text)
        entitle(self.query_one("#where-calls"), "calls of children")

    def _step(self, step: ChildStep, wall: float) -> Text:
        colour = "accent" if step.open else "error" if step.error else "success"
        written = spaced(words.step_words(step, wall, self._known))
        style, indent = tint(self.app, colour) if step.open or step.error else "", " " * (2 * step.depth + 2)
        width = self.query_one("#where-steps").content_size.width or self.app.size.width
        if len(indent) > width // 2:
            indent = ""
        first, *rest = broken(Text(written, style), max(width - len(indent), 1), self.app.console)
        return Text("\n").join([first, *(Text.assemble(indent, line) for line in rest)])
