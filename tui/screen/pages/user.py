"""What people see who do not operate robots: one list, and a page for each thing that they begin."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Protocol, cast

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.binding import BindingType
from textual.containers import Horizontal, VerticalScroll
from textual.widgets import Button, Input, Label, OptionList, Static
from textual.widgets.option_list import Option

from robotree.tui.errors import SupervisorError
from robotree.tui.line import ordering
from robotree.tui.line.grammar import Line
from robotree.tui.screen import entry
from robotree.tui.screen.bindings import bindings
from robotree.tui.screen.pages.dialogs import Confirm, Modal
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.pages.permits import ask_about_permit
from robotree.tui.screen.pages.question import ask_question
from robotree.tui.screen.pages.role import RoleDialog
from robotree.tui.screen.pages.write import WritePage
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.choice import Choice
from robotree.tui.screen.widgets.field_row import FieldRow
from robotree.tui.screen.widgets.flash import FlashLine
from robotree.tui.screen.widgets.key_line import KeyLine
from robotree.tui.screen.widgets.marks import DIM, tint
from robotree.tui.seen import absence
from robotree.tui.seen.asked import questions_of
from robotree.tui.seen.behaviours import SCRIPT, START, Behaviour, titles
from robotree.tui.seen.cells import seen
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robotree.tui.seen.errand import Errand
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.base.order import Order

LOOK = 1.0
"""[s] between two looks at the orders."""
ANYBODY = ""
"""The choice of whoever can do it first."""


class UserDesk(Protocol):
    """What these pages need of their program, beside what every page does (`user_app.UserApp`)."""

    errands: list[Errand]
    orders: tuple[Order, ...]
    alone: bool

    def behaviours(self) -> list[Behaviour]:
        """Return what can be done now or later."""
        ...

    async def look(self) -> None:
        """Look at the orders of this person."""
        ...

    def begin(self, behaviour: Behaviour, robot: str, arguments: dict[str, Any]) -> Errand:
        """Have something carried out."""
        ...

    async def leave_order(
        self, behaviour: Behaviour, robot: str, arguments: dict[str, Any], until: str
    ) -> None:
        """Leave something as an order."""
        ...

    def decide_order(self, order: Order, answer: str) -> object:
        """End an order, let it begin, or take its result."""
        ...

    def settle(self, errands: Sequence[Errand]) -> None:
        """Take what is over off the list."""
        ...


class UserRow(NamedTuple):
    """One row of the list."""

    id: str
    """Empty: a heading."""
    text: Text
    open: Callable[[], object] | None = None
    """What ⏎ does."""


class PlainPage(Page):
    """A page without the words of operators: a line on top, what happened last, keys."""

    def compose(self) -> ComposeResult:
        """Frame the page's own parts."""
        yield CachedText(id="head", classes="topbar")
        yield from self.parts()
        yield FlashLine(classes="flash")
        yield KeyLine()

    @property
    def desk(self) -> UserDesk:
        """The program."""
        return cast("UserDesk", self.app)

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

    KEYS_OF: ClassVar[str] = "user"
    BINDINGS: ClassVar[list[BindingType]] = bindings(KEYS_OF)

    def __init__(self) -> None:
        """Nothing is known yet."""
        super().__init__()
        self._rows: list[UserRow] = []

    def parts(self) -> ComposeResult:
        """The list."""
        yield OptionList(id="can", markup=False)

    def on_mount(self) -> None:
        """Draw now and then, and look at the orders."""
        super().on_mount()
        self.query_one(OptionList).focus()
        self._look()
        self.set_interval(LOOK, self.guarded(self._look_again))

    def _look_again(self) -> None:
        self._look()

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
        self.query_one(OptionList).action_select()

    def action_leave(self) -> None:
        """Leave the program."""
        self.app.ask_for("quit")

    @on(OptionList.OptionSelected)
    def _selected(self, event: OptionList.OptionSelected) -> None:
        row = next((each for each in self._rows if each.id == event.option.id), None)
        if row is not None and row.open is not None:
            row.open()

    # -- the rows ----------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw the list anew where it differs; what is chosen stays chosen."""
        super().draw()
        rows = list(self._all_rows())
        if [(row.id, row.text) for row in rows] == [(row.id, row.text) for row in self._rows]:
            self._rows = rows
            return
        listed = self.query_one(OptionList)
        if [row.id for row in rows] == [row.id for row in self._rows]:
            for place, (row, before) in enumerate(zip(rows, self._rows, strict=True)):
                if row.text != before.text:
                    listed.replace_option_prompt_at_index(place, row.text)
            self._rows = rows
            return
        at = listed.highlighted
        chosen = listed.get_option_at_index(at).id if at is not None and listed.option_count else None
        self._rows = rows
        listed.clear_options()
        listed.add_options([Option(row.text, id=row.id or None, disabled=not row.id) for row in rows])
        ids = [row.id for row in rows]
        fallback = next((place for place, row in enumerate(rows) if row.id), None)
        listed.highlighted = ids.index(chosen) if chosen and chosen in ids else fallback

    def _all_rows(self) -> Iterator[UserRow]:
        found = self.desk.behaviours()
        known = titles(found)
        can = list(self._possible(found))
        sections = (
            ("Questions", list(self._questions(known))),
            ("Under way", list(self._under_way(known))),
            ("Results", list(self._results(known))),
            ("Left for later", list(self._waiting(known))),
            ("What can be done", can or [self._row("nothing", "", "nobody is here yet")]),
            ("More", list(self._more(found))),
        )
        for title, rows in sections:
            if rows:
                yield UserRow("", Text(title, tint(self.app, "primary", bold=True)))
                yield from rows

    def _row(
        self,
        id_: str,
        title: str,
        about: str,
        opened: Callable[[], object] | None = None,
        *,
        sign: str = " ",
        colour: str = "muted",
        dim: bool = False,
    ) -> UserRow:
        style = DIM if colour == "muted" else tint(self.app, colour)
        text = Text.assemble((f"{sign} ", style), (title, DIM if dim else "bold"))
        if about:
            text.append(f"\n  {about}" if title else about, style)
        return UserRow(id_, text, opened)

    def _questions(self, known: dict[tuple[str, str], str]) -> Iterator[UserRow]:
        for order in self.desk.orders:
            if order.asks and not order.confirmed_by and not order.over:
                yield self._row(
                    f"asks:{order.key}",
                    order.asks,
                    known.get((order.robot, order.command), order.command),
                    partial(self._ask_about, order),
                    sign="?",
                    colour="warning",
                )
        for name, robot in sorted(self.app.store.descriptions.items()):
            if robot.asks:
                yield self._row(
                    f"doubt:{name}",
                    robot.asks,
                    name,
                    partial(self._ask_doubt, robot),
                    sign="?",
                    colour="warning",
                )
        for name, robot in sorted(self.app.store.descriptions.items()):
            for question in questions_of(robot):
                if question.id:
                    yield self._row(
                        f"question:{name}:{question.id}",
                        question.text,
                        f"{name} asks {question.more}".rstrip(),
                        partial(ask_question, self.app, question),
                        sign="?",
                        colour="warning",
                    )
        for permit in self.app.store.permits:
            yield self._row(
                f"permit:{permit.id}",
                f"May {permit.assistant} do this?",
                f"{permit.call}: «{permit.why}»",
                partial(ask_about_permit, self.app, permit),
                sign="?",
                colour="warning",
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

    def _under_way(self, known: dict[tuple[str, str], str]) -> Iterator[UserRow]:
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

    def _results(self, known: dict[tuple[str, str], str]) -> Iterator[UserRow]:
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
                    partial(self._take, order),
                    sign="✓" if order.state == "done" else "✗",
                    colour="success" if order.state == "done" else "error",
                )

    def _waiting(self, known: dict[tuple[str, str], str]) -> Iterator[UserRow]:
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

    def _possible(self, found: list[Behaviour]) -> Iterator[UserRow]:
        for one in found:
            sign = "▶" if any(doer.begins for doer in one.doers) else "…" if one.possible else "✗"
            yield self._row(
                f"can:{one.key}",
                one.title,
                f"tell {one.robot.name}" if one.told else one.state,
                partial(self._open, one),
                sign=sign,
                dim=not one.possible,
            )

    def _more(self, found: list[Behaviour]) -> Iterator[UserRow]:
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
                    partial(self._role, name, roles, role, why),
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
        def answered(answer: str | None) -> None:
            if answer:
                self.desk.decide_order(order, answer)

        self.app.push_screen(OrderQuestion(order), answered)

    def _ask_doubt(self, robot: RobotDescription) -> None:
        self.app.push_screen(DoubtDialog(robot), self._decided(robot.name))

    def _open(self, behaviour: Behaviour) -> None:
        self.app.push_screen(DoingPage(behaviour))

    def _take(self, order: Order) -> None:
        self.desk.decide_order(order, "seen")

    def _role(self, name: str, roles: list[str], role: str, why: str) -> None:
        if why:
            self.app.tell(why, "warning")
            return

        def answered(line: Line | None) -> None:
            if line:
                self.app.perform(line)

        self.app.push_screen(RoleDialog(name, roles, role), answered)

    def _decided(self, name: str) -> Callable[[str | None], None]:
        def decided(answer: str | None) -> None:
            if answer:
                self.app.perform(Line("decide", {"NAME": name, "ANSWER": answer}))

        return decided

    def _end(self, robot: str, title: str) -> None:
        def answered(answer: bool | None) -> None:  # noqa: FBT001 # Textual gives the screen's result
            if answer:
                self.app.perform(Line("cancel", {"NAME": robot}))

        self.app.push_screen(Confirm("End it?", f"{title} ends where it is.", "End it"), answered)


def _title_of(robot: RobotDescription, command: str) -> str:
    spec = robot.command(command)
    if SCRIPT in robot.kinds and command == START and robot.doc:
        return robot.doc.strip().partition("\n")[0]  # what it is for, not that it leads
    return (spec.doc.strip().partition("\n")[0] if spec else "") or command


class OrderQuestion(Modal[str]):
    """Asks what shall become of an order. The harmless answer comes first and has the focus."""

    def __init__(self, order: Order) -> None:
        """Take the order."""
        super().__init__()
        self._order = order

    def box(self) -> ComposeResult:
        """What is known of it, and the answers."""
        order = self._order
        asks = order.asks and not order.confirmed_by
        given = ", ".join(f"{name} {value}" for name, value in order.arguments.items())
        with VerticalScroll(classes="dialog"):
            yield Static(
                order.asks if asks else f"Left {absence.clock(order.left)}",
                classes="dialog-title",
                markup=False,
            )
            yield Static(
                f"{order.command} {given}\n{ordering.about(order) if not asks else ''}", markup=False
            )
            with Horizontal(classes="buttons"):
                yield Button("Leave it", id="close", compact=True)
                if asks:
                    yield Button("Let it begin", id="confirm", compact=True)
                yield Button("Do not do it", id="cancel", variant="error", compact=True)

    def on_mount(self) -> None:
        """Focus the harmless answer."""
        self.query_one("#close", Button).focus()

    @on(Button.Pressed)
    def _pressed(self, event: Button.Pressed) -> None:
        self.dismiss("" if event.button.id == "close" else event.button.id or "")


class DoubtDialog(Modal[str]):
    """Asks whether a command was done, in the middle of which its robot was killed."""

    def __init__(self, robot: RobotDescription) -> None:
        """Take the robot that asks."""
        super().__init__()
        self._robot = robot

    def box(self) -> ComposeResult:
        """The question and its three answers."""
        with VerticalScroll(classes="dialog"):
            yield Static(self._robot.asks, classes="dialog-title", markup=False)
            with Horizontal(classes="buttons"):
                yield Button("I do not know", id="close", compact=True)
                yield Button("It is done", id="done", compact=True)
                yield Button("Again", id="again", compact=True)
                yield Button("End it", id="abort", variant="error", compact=True)

    def on_mount(self) -> None:
        """Focus the harmless answer."""
        self.query_one("#close", Button).focus()

    @on(Button.Pressed)
    def _pressed(self, event: Button.Pressed) -> None:
        self.dismiss("" if event.button.id == "close" else event.button.id or "")


class DoingPage(PlainPage):
    """One behaviour: what it is, what it needs to know, and to begin it now or leave it as an order."""

    KEYS_OF: ClassVar[str] = "doing"
    BINDINGS: ClassVar[list[BindingType]] = bindings(KEYS_OF)

    def __init__(self, behaviour: Behaviour) -> None:
        """Take what can be done."""
        super().__init__()
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
        super().on_mount()
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

    def _arguments(self) -> dict[str, Any] | None:
        """Return what is filled in; None: something is wrong, which stands beside its field."""
        rows = {row.spec.name: row for row in self.query(FieldRow)}
        read = entry.read(self.behaviour.spec, {name: row.text for name, row in rows.items()})
        for name, row in rows.items():
            row.complain(read.complaints.get(name, ""))
        if read.complaints:
            rows[next(iter(read.complaints))].focus_entry()
            return None
        return dict(read.arguments)

    @on(FieldRow.Onward)
    def _onward(self) -> None:
        self.focus_next()

    @on(Button.Pressed, "#begin")
    def action_begin(self) -> None:
        """Begin, and go back to the list, which shows how far it is."""
        doer, arguments = self._doer(now=True), self._arguments()
        if doer is None:
            self.app.tell(self.behaviour.state, "warning")
        elif arguments is not None and not self._sent:
            self._sent = True
            self.desk.begin(self.behaviour, doer.name, arguments)
            self.dismiss()

    @on(Button.Pressed, "#order")
    def _order(self) -> None:
        doer, arguments = self._doer(now=False), self._arguments()
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

    def action_back(self) -> None:
        """Go back to the list."""
        self.dismiss()
