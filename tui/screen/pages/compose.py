"""The composer: steps that one chooses or shows by hand, tried in a twin, made a page of one's own."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Horizontal
from textual.widgets import Input, OptionList, Static
from textual.widgets.option_list import Option

from robotree.tui.composing import demonstration, offers
from robotree.tui.composing.gathering import Felt, gathered
from robotree.tui.composing.lines import BLOCKS, StepLine, line_of, read_line, read_steps, step_lines
from robotree.tui.composing.steps import (
    Composition,
    checked,
    slots_of,
    variables,
)
from robotree.tui.composing.writing import KnownRobots, Prepared, prepared, tried, write
from robotree.tui.errors import BadComposition
from robotree.tui.line.past import settled_events
from robotree.tui.screen.jog import bounds
from robotree.tui.screen.pages.dialogs import Choosing, Confirm
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.screen.widgets.marks import tint
from robotree.vr.base.errors import VrError

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription

FIRST = "mine"
"""Name of the page, until the person writes another one."""
ORIGIN = "Made with the composer of robotree."
EMPTY = "no step yet: a adds one, T shows them by hand"


class ComposePage(Page):
    """The steps, one line each; below them the line that is edited, and whether it can be meant."""

    PAGE = "composer"
    KEYS_OF = "compose"

    def __init__(self) -> None:
        """Begin without a step."""
        super().__init__()
        self.rows: list[StepLine] = []
        self.parameters: dict[str, Any] = {}
        self.filled: dict[str, str] = {}
        """The slot of each robot that is used, by the robot's name."""
        self._kinds: dict[str, str] = {}
        """The kind of each slot."""
        self._does = Composition("", command="carry_out")
        self._at: int | None = None
        """The row that is edited; None: none is."""
        self._fresh = False
        """Whether that row was just added: it goes again if it is left."""
        self.said = ""

    def parts(self) -> ComposeResult:
        """Name, slots and parameters, the steps, the line, what is wrong."""
        with Horizontal(id="naming"):
            yield Static("name ", classes="field-name", markup=False)
            yield Input(FIRST, compact=True, id="compose-name", classes="entry")
            yield Static("", id="compose-about", markup=False)
        yield OptionList(id="steps", markup=False)
        yield Input("", compact=True, id="step-line")
        yield Static("", id="compose-state", markup=False)

    def on_mount(self) -> None:
        """Begin in the list."""
        self.query_one("#step-line", Input).display = False
        self._show(0)
        self.query_one("#steps", OptionList).focus()

    # -- what is composed --------------------------------------------------------------------------

    @property
    def named(self) -> str:
        """The name of the page."""
        return self.query_one("#compose-name", Input).value.strip()

    def composition(self) -> Composition:
        """Return what stands there.

        Raises:
            BadComposition: a line lies too deep.
        """
        steps = read_steps(self.rows)
        used, names = slots_of(steps), variables(steps)
        return msgspec.structs.replace(
            self._does,
            name=self.named,
            slots=tuple((slot, kind) for slot, kind in self._kinds.items() if slot in used),
            steps=steps,
            parameters=tuple((name, self.parameters[name]) for name in names if name in self.parameters),
        )

    def known(self) -> KnownRobots:
        """Return the kinds that come with robotree, and those of the robots here."""
        return KnownRobots.of(self.app.store.descriptions.values())

    def _show(self, at: int | None = None) -> None:
        """Draw all steps, with the cursor on one of them."""
        steps = self.query_one("#steps", OptionList)
        at = (steps.highlighted or 0) if at is None else at
        steps.clear_options()
        muted = tint(self.app, "muted")
        steps.add_options([Option(Text(f"{'  ' * row.depth}{row.text}")) for row in self.rows])
        if not self.rows:
            steps.add_option(Option(Text(EMPTY, muted), disabled=True))
        else:
            steps.highlighted = min(max(at, 0), len(self.rows) - 1)
        self._judge()

    def _judge(self) -> None:
        """Say whether the steps can be meant."""
        try:
            made = self.composition()
            good = checked(made, self.known().kinds) if self.rows else None
        except BadComposition as error:
            self._say(f"✗ {error}", "warning")
        else:
            robots = {slot: robot for robot, slot in self.filled.items()}
            slots = [f"{slot}: {kind} ({robots.get(slot, '?')})" for slot, kind in made.slots]
            values = [f"{name}={value}" for name, value in made.parameters]
            self.query_one("#compose-about", Static).update("  ".join([*slots, *values]))
            if good is not None:
                self._say(f"✓ {_steps(len(self.rows))}, which can be tried and made", "success")
            else:
                self._say("", "muted")

    def _say(self, text: str, colour: str) -> None:
        self.said = text
        self.query_one("#compose-state", Static).update(Text(text, tint(self.app, colour)))

    @on(Input.Changed, "#compose-name")
    def _renamed(self) -> None:
        self._judge()

    @on(Input.Submitted, "#compose-name")
    def _to_steps(self) -> None:
        self.query_one("#steps", OptionList).focus()

    # -- editing -----------------------------------------------------------------------------------

    @property
    def _cursor(self) -> int:
        return self.query_one("#steps", OptionList).highlighted or 0

    def _slot(self, robot: RobotDescription) -> str:
        """Return the slot of a robot; one that has none gets one."""
        if robot.name not in self.filled:
            slot = demonstration.slot_for(robot.kind, self._kinds)
            self.filled[robot.name], self._kinds[slot] = slot, robot.kind
        return self.filled[robot.name]

    def action_add(self) -> None:
        """Choose a step, which comes below the cursor."""
        robots = sorted(self.app.store.descriptions.items())
        found = [(offer, robot) for _, robot in robots for offer in offers.of_robot(robot, self._read(robot))]
        asked = [(offer, robot) for _, robot in robots for offer in offers.asked_of(robot)]
        every = [*found, *((offer, None) for offer in offers.of_blocks()), *asked]
        by_name = {offer.shown: (offer, robot) for offer, robot in every}

        def chosen(word: str) -> None:
            offer, robot = by_name[word]
            self._insert(offer.text("" if robot is None else self._slot(robot)))

        self.app.ask(Choosing("add a step", [(offer.shown, offer.about) for offer, _ in every]), chosen)

    def _read(self, robot: RobotDescription) -> Mapping[str, float]:
        """Return the readings of a robot: those of its description are one sample old."""
        return {**robot.readings, **self.app.store.readings(robot.name)}

    def _insert(self, text: str) -> None:
        at, depth = 0, 0
        if self.rows:
            above = self.rows[self._cursor]
            at = self._cursor + 1
            depth = above.depth + (above.text.split(" ")[0] in BLOCKS)
        if text == "else":
            depth = max(depth - 1, 0)
        if text.split(" ", maxsplit=1)[0] == "part":
            names = {row.text for row in self.rows}
            count = next(number for number in range(1, 400) if f"part part{number}" not in names)
            text = f"part part{count}"
        self.rows.insert(at, StepLine(depth, text))
        self._show(at)
        self._edit(at, fresh=True)

    @on(OptionList.OptionSelected, "#steps")
    def _selected(self, event: OptionList.OptionSelected) -> None:
        if self.rows:
            self._edit(event.option_index, fresh=False)

    def _edit(self, at: int, *, fresh: bool) -> None:
        self._at, self._fresh = at, fresh
        field = self.query_one("#step-line", Input)
        field.value, field.display = self.rows[at].text, True
        field.focus()

    @on(Input.Submitted, "#step-line")
    def _take_line(self) -> bool:
        """Take the line that is edited; False: it is no step, and that was said."""
        at, text = self._at, self.query_one("#step-line", Input).value.strip()
        if at is None:
            return True
        try:
            step = read_line(text)
        except BadComposition as error:
            self._say(f"✗ {error}", "error")
            return False
        self.rows[at] = self.rows[at]._replace(text=line_of(step) if step is not None else "else")
        self._leave_line(at)
        return True

    def _leave_line(self, at: int) -> None:
        self._at = None
        self.query_one("#step-line", Input).display = False
        self._show(at)
        self.query_one("#steps", OptionList).focus()

    def action_remove(self) -> None:
        """Take the step out, and what is in it."""
        if self.rows:
            first, last = self._extent(self._cursor)
            del self.rows[first:last]
            self._show(first)

    def _extent(self, at: int) -> tuple[int, int]:
        """Return the first row of a step and the one behind it and all that is in it."""
        last = at + 1
        while last < len(self.rows) and self.rows[last].depth > self.rows[at].depth:
            last += 1
        return at, last

    def action_move(self, by: int) -> None:
        """Move a step, and what is in it, over the one above or below."""
        if not self.rows:
            return
        first, last = self._extent(self._cursor)
        taken = self.rows[first:last]
        if by < 0 < first:
            above = first - 1
            while above > 0 and self.rows[above].depth > taken[0].depth:
                above -= 1
            goal = above
        elif by > 0 and last < len(self.rows):
            goal = first + self._extent(last)[1] - last
        else:
            return
        del self.rows[first:last]
        self.rows[goal:goal] = taken
        self._show(goal)

    def action_nest(self, by: int) -> None:
        """Put a step into the one above, or out of the one that it is in."""
        if not self.rows:
            return
        first, last = self._extent(self._cursor)
        depth = self.rows[first].depth + by
        deepest = self.rows[first - 1].depth + 1 if first else 0
        if 0 <= depth <= deepest:
            self.rows[first:last] = [row._replace(depth=row.depth + by) for row in self.rows[first:last]]
            self._show(first)

    def action_parametrise(self) -> None:
        """Make a value of the step a parameter, which begins with that value."""
        values = offers.values_in(self.rows[self._cursor].text) if self.rows else {}
        if not values:
            self.app.tell("this step has no value that could become a parameter", "warning")
            return
        which = Choosing("which value becomes a parameter?", values.items())
        self.app.ask(which, lambda word: self._make_parameter(word, values[word]))

    def _make_parameter(self, argument: str, value: str) -> None:
        name = demonstration.free(argument, {*self.parameters, *self.filled.values()})
        row = self.rows[self._cursor]
        self.parameters[name] = value
        self.rows[self._cursor] = row._replace(text=offers.with_parameter(row.text, argument, name))
        self._show()

    def action_back(self) -> None:
        """Leave the line; else leave the page, if nothing is lost or that is meant."""
        if self._at is not None:
            at = self._at
            if self._fresh:
                del self.rows[at]
            self._leave_line(max(at - self._fresh, 0))
        elif self.rows and not self.said.startswith("✓ made"):
            question = Confirm("Leave the composer?", "The steps are not kept.", "Leave")
            self.app.ask(question, lambda _yes: self.dismiss())
        else:
            self.dismiss()

    # -- by hand -----------------------------------------------------------------------------------

    def action_show(self) -> None:
        """Lead a robot by hand, and take what it did as steps."""
        robots = {
            name: robot for name, robot in self.app.store.descriptions.items() if bounds(robot) is not None
        }
        if not robots:
            self.app.tell("no robot here can be led by hand: it needs go_to, grip and get_info", "warning")
        elif len(robots) == 1:
            self._lead(*robots.values())
        else:
            offered = [(name, robot.kind) for name, robot in sorted(robots.items())]
            which = Choosing("which robot is led by hand?", offered)
            self.app.ask(which, lambda name: self._lead(robots[name]))

    def _lead(self, robot: RobotDescription) -> None:
        found = bounds(robot)
        if found is None or self.app.withheld("compose"):
            return
        now = self.app.store.described(robot.name) or robot
        if now.bond is not None:
            holder, slot = now.bond.parent.name, now.bond.slot
            self.app.tell(
                f"{robot.name} is commanded by {holder}: `release {holder}.{slot}` before it is led",
                "warning",
            )
            return
        since, readings = time.time(), self._read(robot)
        self.app.tell(f"lead {robot.name}; esc ends it, and makes steps of what it did")

        page = TeleopPage(robot, found)

        def left(_: None) -> None:
            self._gather(robot, since, readings, page.felt)

        self.app.push_screen(page, left)

    @work(exit_on_error=False, group="compose", exclusive=True)
    async def _gather(
        self, robot: RobotDescription, since: float, readings: Mapping[str, float], felt: Sequence[Felt]
    ) -> None:
        self._say("… what was shown is read", "muted")
        try:
            events = await settled_events(self.app.realm_client, robot.name, since)
            found = gathered(events, {robot.name: robot}, (robot.name,), {robot.name: readings}, felt)
            before = self.composition() if self.rows else None
            made = demonstration.composed(
                self.named, found.robots, found.shown, starts=found.starts, before=before, filled=self.filled
            )
        except (BadComposition, VrError) as error:
            self._say(f"✗ {error}", "error")
            return
        count = len(self.rows)
        self._take(made)
        self._slot(robot)
        self._show(count)
        left = f"; {found.failed} that failed are left out" if found.failed else ""
        self.app.tell(f"{len(found.shown)} commands became {_steps(len(self.rows) - count)}{left}", "good")

    def _take(self, made: Composition) -> None:
        self.rows = step_lines(made.steps)
        self.parameters |= dict(made.parameters)
        self._kinds |= dict(made.slots)
        self._does = made
        taken = set(self.filled.values())
        for slot, kind in made.slots:
            if slot not in taken:
                names = [name for name, one in self.app.store.descriptions.items() if one.kind == kind]
                if len(names) == 1:
                    self.filled[names[0]] = slot

    # -- trying and making -------------------------------------------------------------------------

    def action_try(self) -> None:
        """Carry it out in a twin of the cell, with the line that is edited."""
        if self._take_line():
            self._try()

    @work(exit_on_error=False, group="compose", exclusive=True)
    async def _try(self) -> None:
        ready = await self._prepared()
        if ready is None:
            return
        self._say("… it is tried in a twin of the cell, where nothing real moves", "accent")
        try:
            went = await asyncio.to_thread(tried, ready)
        except OSError as error:
            self._say(f"✗ it cannot be tried: {error}", "error")
            return
        self._say(f"{'✓' if went.ok else '✗'} {went.told}", "success" if went.ok else "error")

    async def _prepared(self) -> Prepared | None:
        """Return the files; None: they cannot be, and that was said."""
        try:
            return await asyncio.to_thread(prepared, self.composition(), self.known(), ORIGIN)
        except (BadComposition, OSError) as error:
            self._say(f"✗ {error}", "error")
            return None

    def action_make(self) -> None:
        """Write the page, its panel and its test into this folder, with the line that is edited."""
        if self._take_line():
            self._make()

    @work(exit_on_error=False, group="compose", exclusive=True)
    async def _make(self, *, replace: bool = False) -> None:
        ready = await self._prepared()
        if ready is None:
            return
        try:
            await asyncio.to_thread(write, ready, Path(), replace=replace)
        except FileExistsError as error:
            question = Confirm(f"Replace {ready.page}?", f"{error}.", "Replace")
            self.app.ask(question, lambda _yes: self._make(replace=True))
        except OSError as error:
            self._say(f"✗ {error}", "error")
        else:
            name = ready.checked.composition.name
            self._say(
                f"✓ made {', '.join(ready.files)}; the page has {ready.lines} lines and is yours;"
                f" :create {ready.page} as {name} makes the robot",
                "success",
            )
            self.app.tell(f"{ready.page} is made: {ready.lines} lines", "good")


def _steps(count: int) -> str:
    return "1 step" if count == 1 else f"{count} steps"
