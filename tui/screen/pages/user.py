"""What people see who do not operate robots: one list, and a page for each thing that they begin.

They can write a script, too: a text of when and then, checked as one types, and made a robot of its own.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Horizontal, VerticalScroll
from textual.widgets import Button, Input, Label, Static, TextArea

from robotree.files import text as read_text
from robotree.tui.errors import SupervisorError
from robotree.tui.line import ordering
from robotree.tui.line.carrying import Refusal, carry_out
from robotree.tui.line.grammar import Line
from robotree.tui.line.known_kinds import checked_script
from robotree.tui.screen.pages.dialogs import Answer, Confirm, Question
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.pages.permits import ask_about_permit, ask_question
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.field_row import Choice, FieldRow, filled_in
from robotree.tui.screen.widgets.key_line import KeyLine
from robotree.tui.screen.widgets.log_pane import FlashLine
from robotree.tui.screen.widgets.marks import DIM, tint
from robotree.tui.screen.widgets.row_list import Row, RowList
from robotree.tui.seen import absence
from robotree.tui.seen.asked import questions_of
from robotree.tui.seen.behaviours import SCRIPT, START, Behaviour, titles
from robotree.tui.seen.cells import seen
from robotree.tui.seen.selection import Place
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robotree.tui.screen.user_desk import UserDesk
    from robotree.vr.base.description import FieldSpec, RobotDescription
    from robotree.vr.base.order import Order

LOOK = 1.0
"""[s] between two looks at the orders."""
ANYBODY = ""
"""The choice of whoever can do it first."""


class PlainPage(Page):
    """A page without the words of operators: a line on top, what happened last, keys."""

    def __init__(self, desk: UserDesk) -> None:
        """Show what is on a desk."""
        super().__init__()
        self.desk = desk

    def compose(self) -> ComposeResult:
        """Frame the page's own parts."""
        yield CachedText(id="head", classes="topbar")
        yield from self.parts()
        yield FlashLine(classes="flash")
        yield KeyLine()

    def draw(self) -> None:
        """Draw the line on top, and what happened last."""
        app = self.app
        asker = app.realm_client.asker
        who = asker.name if asker is not None else ""
        place = "without network: what was taken along" if self.desk.alone else f"{app.realm}  {who}"
        head = Text.assemble(
            (" robotree ", tint(app, "primary", bold=True)), place, no_wrap=True, overflow="ellipsis"
        )
        if drills := app.store.drills:
            head.append(f"  drill: {', '.join(map(seen, drills))}", tint(app, "warning", bold=True))
        self.query_one("#head", CachedText).show(head)
        self.query_one(FlashLine).draw(app.store, app.now(), logs=False)


class UserPage(PlainPage):
    """The list: questions, what is under way, results, what waits, and what can be done."""

    KEYS_OF = "user"

    def __init__(self, desk: UserDesk) -> None:
        """Nothing is known yet."""
        super().__init__(desk)
        self._open: dict[str, Callable[[], object]] = {}
        """What ⏎ does, by row."""

    def parts(self) -> ComposeResult:
        """The list."""
        yield RowList(id="can")

    def on_mount(self) -> None:
        """Draw now and then, and look at the orders."""
        self.query_one(RowList).focus()
        self._look()
        self.set_interval(LOOK, self._look)

    @work(exclusive=True, exit_on_error=False, group="look")
    async def _look(self) -> None:
        try:
            await self.desk.look()
        except VrError as error:
            self.app.tell(str(error), "warning")
        if self.is_active:
            self.draw()

    def action_open(self) -> None:
        """Open what is chosen."""
        self.query_one(RowList).action_select()

    def action_leave(self) -> None:
        """Leave the program."""
        self.app.ask_for("quit")

    @on(RowList.OptionSelected)
    def _selected(self, event: RowList.OptionSelected) -> None:
        self._open.get(str(event.key), _nothing)()

    # -- the rows ----------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw the list where it differs."""
        super().draw()
        self._open = {}
        self.query_one(RowList).fill(self._all_rows())

    def _all_rows(self) -> Iterator[Row]:
        found = self.desk.behaviours()
        known = titles(found)
        can = list(self._possible(found))
        sections = (
            ("Questions", list(self._questions(known))),
            ("Under way", list(self._under_way(known))),
            ("Results", list(self._results(known))),
            ("Left for later", list(self._waiting(known))),
            ("What can be done", can or [self._row("nothing", "", "nobody is here yet", _nothing)]),
            ("More", list(self._more(found))),
        )
        for title, rows in sections:
            if rows:
                yield Row(None, Text(title, tint(self.app, "primary", bold=True)))
                yield from rows

    def _row(
        self,
        key: str,
        title: str,
        about: str,
        opened: Callable[[], object],
        *,
        sign: str = " ",
        colour: str = "muted",
        dim: bool = False,
    ) -> Row:
        style = DIM if colour == "muted" else tint(self.app, colour)
        text = Text.assemble((f"{sign} ", style), (title, DIM if dim else "bold"))
        if about:
            text.append(f"\n  {about}" if title else about, style)
        self._open[key] = opened
        return Row(key, text)

    def _questions(self, known: dict[tuple[str, str], str]) -> Iterator[Row]:
        asked = partial(self._row, sign="?", colour="warning")
        for order in self.desk.orders:
            if order.asks and not order.confirmed_by and not order.over:
                title = known.get((order.robot, order.command), order.command)
                yield asked(f"asks:{order.key}", order.asks, title, partial(self._ask_about, order))
        for name, robot in sorted(self.app.store.descriptions.items()):
            for question in questions_of(robot):
                yield asked(
                    f"question:{name}:{question.id}",
                    question.text,
                    f"{name} asks {question.more}".rstrip(),
                    partial(ask_question, self.app, question),
                )
        for permit in self.app.store.permits:
            yield asked(
                f"permit:{permit.id}",
                f"May {permit.assistant} do this?",
                f"{permit.call}: «{permit.why}»",
                partial(ask_about_permit, self.app, permit),
            )
        if self.app.store.stopped:
            yield self._row(
                "stopped",
                "Everything that is stopped may go on?",
                f"stopped: {', '.join(self.app.store.stopped)}",
                lambda: self.app.ask_for("resume"),
                sign="■",
                colour="error",
            )

    def _under_way(self, known: dict[tuple[str, str], str]) -> Iterator[Row]:
        now, own = self.app.now(), set[str]()
        for at, errand in enumerate(self.desk.errands):
            if errand.runs:
                own.add(errand.robot)
                yield self._row(
                    f"runs:{at}",
                    errand.title,
                    errand.words(now),
                    partial(self._end, errand.robot, errand.title),
                    sign="◐",
                    colour="accent",
                )
        for name, robot in sorted(self.app.store.descriptions.items()):
            state = self.app.store.state(name)
            busy = (state.busy if state else robot.busy) or ""
            if not busy or name in own or robot.bond is not None:
                continue
            about = " ".join(filter(None, (self.app.store.doing(name, now), self._by(name))))
            title = known.get((name, busy)) or _title_of(robot, busy)
            yield self._row(
                f"busy:{name}",
                title,
                about,
                partial(self._end, name, title),
                sign="◐",
                colour="accent",
            )

    def _by(self, name: str) -> str:
        by = self.app.store.by(name)
        return f"for {by}" if by else ""

    def _results(self, known: dict[tuple[str, str], str]) -> Iterator[Row]:
        now = self.app.now()
        for at, errand in enumerate(self.desk.errands):
            if not errand.runs:
                yield self._row(
                    f"over:{at}:{errand.began}",
                    errand.title,
                    errand.words(now),
                    partial(self.desk.settle, [errand]),
                    sign="✗" if errand.why else "✓",
                    colour="error" if errand.why else "success",
                )
        for order in self.desk.orders:
            if order.over and not order.seen and order.state != "cancelled":
                yield self._row(
                    f"result:{order.key}",
                    known.get((order.robot, order.command), order.command),
                    f"{absence.clock(order.at)}  {order.shown}: {ordering.about(order)}".rstrip(": "),
                    partial(self.desk.decide_order, order, "seen"),
                    sign="✓" if order.state == "done" else "✗",
                    colour="success" if order.state == "done" else "error",
                )

    def _waiting(self, known: dict[tuple[str, str], str]) -> Iterator[Row]:
        for order in self.desk.orders:
            if not order.over:
                taken = "its robot carries it out" if order.state == "taken" else "waits"
                yield self._row(
                    f"order:{order.key}",
                    known.get((order.robot, order.command), order.command),
                    f"{taken}, to begin by {absence.clock(order.begin_by)}",
                    partial(self._ask_about, order),
                    sign="·",
                )

    def _possible(self, found: list[Behaviour]) -> Iterator[Row]:
        for one in found:
            sign = "▶" if any(doer.begins for doer in one.doers) else "…" if one.possible else "✗"
            yield self._row(
                f"can:{one.key}",
                one.title,
                f"tell {one.robot.name}" if one.told else one.state,
                partial(self._show, one),
                sign=sign,
                dim=not one.possible,
            )

    def _more(self, found: list[Behaviour]) -> Iterator[Row]:
        for name, robot in sorted(self.app.store.descriptions.items()):
            roles = robot.attributes.get("roles", "").split()
            if len(roles) > 1:
                role = robot.attributes.get("role", "")
                denied = self.app.realm_client.refused("command", name, robot.kinds, "play")
                why = "" if denied is None else str(denied)
                yield self._row(
                    f"role:{name}",
                    f"How {name} behaves",
                    f"not allowed: {why}" if why else f"as {role}; choose another role",
                    partial(self._role, name, why),
                    dim=bool(why),
                )
        if not (self.desk.alone or self.app.readonly):
            yield self._row(
                "write",
                "Write a script of your own",
                "what shall happen when",
                lambda: self.app.push_screen(WritePage(found)),
                sign="+",
            )

    # -- what ⏎ does -------------------------------------------------------------------------------

    def _ask_about(self, order: Order) -> None:
        asks = order.asks and not order.confirmed_by
        given = ", ".join(f"{name} {value}" for name, value in order.arguments.items())
        answers = [Answer("Let it begin", "confirm")] if asks else []
        question = Question(
            order.asks if asks else f"Left {absence.clock(order.left)}",
            f"{order.command} {given}\n{'' if asks else ordering.about(order)}",
            *answers,
            Answer("Do not do it", "cancel", "error"),
            harmless="Leave it",
        )
        self.app.ask(question, partial(self.desk.decide_order, order))

    def _show(self, behaviour: Behaviour) -> None:
        self.app.push_screen(DoingPage(self.desk, behaviour))

    def _role(self, name: str, why: str) -> None:
        if why:
            self.app.tell(why, "warning")
        else:
            self.app.ask_for("role", Place(name))

    def _end(self, robot: str, title: str) -> None:
        question = Confirm("End it?", f"{title} ends where it is.", "End it")
        self.app.ask(question, lambda _yes: self.app.do("cancel", NAME=robot))


def _nothing() -> None:
    """There is nothing to open."""


def _title_of(robot: RobotDescription, command: str) -> str:
    spec = robot.command(command)
    if SCRIPT in robot.kinds and command == START and robot.doc:
        return robot.doc.strip().partition("\n")[0]  # what it is for, not that it leads
    return (spec.doc.strip().partition("\n")[0] if spec else "") or command


class DoingPage(PlainPage):
    """One behaviour: what it is, what it needs to know, and to begin it now or leave it as an order."""

    KEYS_OF = "doing"

    def __init__(self, desk: UserDesk, behaviour: Behaviour) -> None:
        """Take what can be done."""
        super().__init__(desk)
        self.behaviour = behaviour
        self._sent = False

    def parts(self) -> ComposeResult:
        """Title, fields, buttons."""
        one = self.behaviour
        with VerticalScroll(id="doing", can_focus=False):
            yield Label(one.title, classes="dialog-title", markup=False)
            if rest := one.about.removeprefix(one.title).strip():
                yield Label(rest, classes="form-doc", markup=False)
            yield CachedText(id="when")
            if len(one.doers) > 1:
                yield Choice(
                    [("whoever can", ANYBODY), *((doer.name, doer.name) for doer in one.doers)],
                    chosen=ANYBODY,
                    id="who-does",
                    classes="entry",
                )
            for field in one.spec.parameters:
                yield FieldRow(field, {})
            with Horizontal(classes="buttons"):
                yield Button("Say it" if one.told else "Begin", variant="primary", id="begin", compact=True)
            if not one.told:
                yield Label("or as an order, to begin within", classes="caption", markup=False)
                yield Input("24h", compact=True, id="until", classes="entry")
                with Horizontal(classes="buttons"):
                    yield Button("Leave order", id="order", compact=True)
            yield Static("", id="outcome", markup=False)

    def on_mount(self) -> None:
        """Point at the first field, else at the way back: nothing begins by a hasty key."""
        rows = list(self.query(FieldRow))
        if rows:
            rows[0].focus_entry()

    def draw(self) -> None:
        """Show when it can be done, as it is now."""
        super().draw()
        newest = next((each for each in self.desk.behaviours() if each.key == self.behaviour.key), None)
        if newest is not None:
            self.behaviour = newest
        begins, orders = self._doer(now=True), self._doer(now=False)
        self.query_one("#when", CachedText).show(Text(self._when(), tint(self.app, "muted")))
        self.query_one("#begin", Button).disabled = begins is None
        if not self.behaviour.told:
            self.query_one("#order", Button).disabled = orders is None
            self.query_one("#until", Input).disabled = orders is None

    def _when(self) -> str:
        one = self.behaviour
        doer = self._doer(now=True) or self._doer(now=False)
        who = f"by {doer.name}, " if doer is not None and not one.told else ""
        orders = "" if one.told or self._doer(now=False) else f"; no order: {one.doers[0].unordered}"
        return f"{who}{one.state}{orders}"

    def _doer(self, *, now: bool) -> Any:
        """Return who would do it now, or take the order; None: nobody."""
        wanted = self.query_one("#who-does", Choice).chosen if self.query("#who-does") else ANYBODY
        fit = [
            doer
            for doer in self.behaviour.doers
            if (doer.begins if now else doer.takes_orders) and wanted in {ANYBODY, doer.name}
        ]
        return fit[0] if fit else None

    @on(FieldRow.Onward)
    def _onward(self) -> None:
        self.focus_next()

    @on(Button.Pressed, "#begin")
    def action_begin(self) -> None:
        """Begin, and go back to the list, which shows how far it is."""
        doer = self._doer(now=True)
        arguments = filled_in(self.behaviour.spec, self.query(FieldRow))
        if doer is None:
            self.app.tell(self.behaviour.state, "warning")
        elif arguments is not None and not self._sent:
            self._sent = True
            self.desk.begin(self.behaviour, doer.name, arguments)
            self.dismiss()

    @on(Button.Pressed, "#order")
    def _order(self) -> None:
        doer = self._doer(now=False)
        arguments = filled_in(self.behaviour.spec, self.query(FieldRow))
        if doer is not None and arguments is not None and not self._sent:
            self._sent = True
            self._leave(doer.name, arguments)

    @work(exit_on_error=False, group="orders")
    async def _leave(self, robot: str, arguments: dict[str, Any]) -> None:
        try:
            await self.desk.leave_order(
                self.behaviour, robot, arguments, self.query_one("#until", Input).value
            )
        except (VrError, SupervisorError) as error:
            self._sent = False
            self.query_one("#outcome", Static).update(Text(f"✗ {error}", tint(self.app, "error")))
        else:
            self.dismiss()


# -- a script of one's own -------------------------------------------------------------------------

LARGEST = 200_000
"""[bytes] of a script."""
FIRST = "mine"
"""Name of the script, until the person writes another one."""


class WritePage(Page):
    """A name, the text, and what is wrong with it."""

    KEYS_OF = "writing"

    def __init__(self, found: Sequence[Behaviour]) -> None:
        """Begin with a script that does the first of these behaviours once."""
        super().__init__()
        self._found = [one for one in found if not (one.leads or one.told)]

    def compose(self) -> ComposeResult:
        """Name, text, buttons, what is wrong."""
        with Horizontal(id="naming"):
            yield Static("name ", classes="field-name", markup=False)
            yield Input(FIRST, compact=True, id="script-name", classes="entry")
        yield TextArea(template(FIRST, self._found), id="script", compact=True)
        yield Static("", id="outcome", markup=False)
        with Horizontal(classes="buttons"):
            yield Button("Check", id="check", compact=True)
            yield Button("Make it", id="make", variant="primary", compact=True)
        yield FlashLine(classes="flash")
        yield KeyLine()

    def on_mount(self) -> None:
        """Begin in the text."""
        self.query_one(TextArea).focus()

    def draw(self) -> None:
        """Draw what happened last."""
        self.query_one(FlashLine).draw(self.app.store, self.app.now())

    @property
    def _named(self) -> str:
        return self.query_one("#script-name", Input).value.strip()

    @on(Input.Changed, "#script-name")
    def _renamed(self) -> None:
        """Have the text say the name, where it says one in its first line."""
        area = self.query_one(TextArea)
        first = area.document.get_line(0)
        if first.startswith("script:") and self._named:
            area.replace(f"script: {self._named}", (0, 0), (0, len(first)))

    @on(Button.Pressed, "#check")
    @work(exclusive=True, exit_on_error=False, group="script")
    async def _check(self) -> None:
        await self._good()

    async def _good(self) -> bool:
        """Say whether the text is a script; returns whether it is."""
        source, name = self.query_one(TextArea).text, self._named
        try:
            rules = await asyncio.to_thread(checked_script, source, f"{name}.yaml")
        except (VrError, SupervisorError, ImportError) as error:
            self._say(f"✗ {error}", "error")
            return False
        self._say(f"✓ good: {rules} rule{'s' * (rules != 1)}", "success")
        return True

    @on(Button.Pressed, "#make")
    @work(exclusive=True, exit_on_error=False, group="script")
    async def action_make(self) -> None:
        """Check, keep and make it."""
        if not await self._good():
            return
        path = Path(f"{self._named}.yaml")
        source = self.query_one(TextArea).text
        try:
            await asyncio.to_thread(keep, path, source)
        except (OSError, FileExistsError) as error:
            self._say(f"✗ {error}", "error")
            return
        made = await carry_out(
            self.app.realm_client, Line("create", {"FILE": str(path), "NAME": self._named}), self.app
        )
        self.app.feed.hint()
        if isinstance(made, Refusal):
            self._say(f"✗ {made}", "error")
            return
        self.app.tell(f"{self._named} is made, and kept in {path}: it stands in the list", "good")
        self.dismiss()

    def _say(self, text: str, colour: str) -> None:
        self.query_one("#outcome", Static).update(Text(text, tint(self.app, colour)))


def keep(path: Path, source: str) -> None:
    """Write a script into a file; one that is another script is not replaced.

    Raises:
        FileExistsError: there is another file of this name.
        OSError: it cannot be written.
    """
    from robotree.files import overwrite

    if path.exists() and read_text(path, LARGEST) != source:
        raise FileExistsError(f"there is another {path} in this folder; give the script another name")
    overwrite(path, source.encode())


def template(name: str, found: Sequence[Behaviour]) -> str:
    """Return a script that has a robot do the first behaviour once, and ends then."""
    one = found[0] if found else None
    kind, command = (one.robot.kind, one.spec.name) if one else ("Arm", "hold")
    needed = [field for field in one.spec.parameters if field.required] if one else []
    given = ", ".join(f"{field.name}: {_example(field)}" for field in needed)
    others = "".join(f"  #   {each.spec.name}: {each.title}\n" for each in found[1:6])
    return (
        f"script: {name}\ndoc: What it is for.\n\npartners:\n"
        f"  robot: {{kind: {kind}, needs: [{command}], choose: free}}\n\nrules:\n"
        f"  - rule: begin\n    when:\n      - start\n    then:\n      - do: robot.{command}\n"
        + (f"        with: {{{given}}}\n" if given else "")
        + f"\n  - rule: finish\n    when:\n      - done: {{partner: robot, act: {command}}}\n"
        f"    then:\n      - end: it is done\n" + (f"  # other acts:\n{others}" if others else "")
    )


def _example(field: FieldSpec) -> str:
    """Return a value that a field takes."""
    if field.choices:
        return field.choices[0]
    if field.type == "str":
        return "text"
    if field.type == "bool":
        return "no"
    low = field.lower if field.lower is not None else 0
    high = field.upper if field.upper is not None else low + 1
    return "0" if low <= 0 <= high else f"{low:g}"
