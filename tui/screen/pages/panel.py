"""The panel of one robot: a form for each of its commands, made from their types, and what it reads.

Beside the form of a command that runs: the branch of the tree that works, and the workspace.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import TYPE_CHECKING, ClassVar

from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical, VerticalScroll
from textual.widgets import ContentSwitcher, OptionList
from textual.widgets.option_list import Option

from robotree.tui.processes.trust import gate_for
from robotree.tui.screen.jog import bounds
from robotree.tui.screen.pages.dialogs import Confirm
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.part import Part
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.cameras import Cameras, PictureView
from robotree.tui.screen.widgets.command_form import CommandForm
from robotree.tui.screen.widgets.laid_out import LaidOut
from robotree.tui.screen.widgets.marks import status_mark, tint
from robotree.tui.screen.widgets.program_panel import ProgramPanel
from robotree.tui.screen.widgets.readings import Readings, ShownReadings
from robotree.tui.seen import wording
from robotree.tui.seen.cells import seen
from robotree.tui.seen.errand import CallListener
from robotree.tui.seen.rows import rails
from robotree.tui.seen.store import Store
from robotree.vr.base.errors import VrError
from robotree.vr.base.readable import command_as_shown

if TYPE_CHECKING:
    from robotree.vr.base.description import RobotDescription


class Branch(CachedText):
    """Draws the branch of one robot, a line for each slot."""

    def draw(self, store: Store, name: str, now: float) -> None:
        """Draw the robot of this name and those beneath it."""
        text = Text(no_wrap=True, overflow="ellipsis")
        lines = list(_lines(store, name))
        leads = rails([depth for depth, *_ in lines])
        for lead, (_, slot, robot, needed) in zip(leads, lines, strict=True):
            text.append(lead, tint(self.app, "muted"))
            text.append(f"{slot}: " if slot else "", tint(self.app, "muted"))
            if robot:
                text.append(f"{robot}  ", "bold")
                text.append_text(status_mark(self.app, store.status(robot, now), store.doing(robot, now)))
            else:
                text.append("empty", tint(self.app, "warning" if needed else "muted"))
            text.append("\n")
        text.rstrip()
        self.show(text)


def _lines(
    store: Store, name: str, slot: str = "", above: tuple[str, ...] = ()
) -> Iterator[tuple[int, str, str, bool]]:
    """Yield depth, slot and robot of each line, and whether it is needed; an empty slot has no robot."""
    yield len(above), slot, name, True
    robot = store.described(name)
    if robot is None or name in above:
        return
    for one in robot.slots:
        if one.child:
            yield from _lines(store, one.child.name, one.name, (*above, name))
        elif not one.watched:  # who is only watched has a place of its own
            yield len(above) + 1, one.name, "", not one.optional


class SidePane(Part, Vertical):
    """Branch above, picture below. It asks for pictures only where it can be seen."""

    def compose(self) -> ComposeResult:
        """Branch, name of the camera, picture."""
        yield Branch(classes="branch")
        yield Cameras()
        yield PictureView()

    def on_mount(self) -> None:
        """Point the picture."""
        self.query_one(Cameras).attach(self.query_one(PictureView))

    def draw(self, name: str) -> None:
        """Draw the branch of a robot."""
        self.query_one(Branch).draw(self.app.store, name, self.app.now())
        self.query_one(Cameras).draw()


SCRIPT = "Script"
"""Kind of robots that are led by rules."""
BEGINS = "start"
"""The command of a script that a person needs first."""
GLANCE = 1.0
"""[s] between two looks at the facts of a script, and for its answer."""

LETTERS = {"teleoperate", "cancel", "about", "halt"}
"""Actions whose keys are letters."""


class PanelPage(Page):
    """Commands on the left, the form of the chosen one on the right."""

    KEYS_OF = "panel"
    BESIDE: ClassVar[str] = "readings"
    """What stands below the commands."""

    def __init__(self, robot: RobotDescription, command: str = "") -> None:
        """Open the panel of a robot as it described itself, at a command or at the first."""
        super().__init__()
        self.robot, self._command = robot, command
        self._ended = False
        """Whether the program of the robot's own panel has ended here: it is not started again."""
        self._left_off: dict[str, tuple[dict[str, str], str]] = {}
        """The texts typed into forms that are made anew, and the field with the cursor, by command."""

    def title_of_page(self) -> str:
        """Return the robot's name."""
        return f"{self.robot.name} / panel"

    def parts(self) -> ComposeResult:
        """List of commands, form, readings."""
        yield CachedText(id="who")
        with Horizontal(classes="columns"):
            with Vertical(classes="side"):
                yield OptionList(
                    *map(self._option, range(len(self.robot.commands))), id="commands", markup=False
                )
                yield SidePane(classes="beside -within")
                yield Readings(id="readings")
                if self._leads:
                    with VerticalScroll(id="rules", can_focus=False):
                        yield CachedText(id="facts")
            yield ContentSwitcher(id="forms")
            yield SidePane(classes="beside -own")

    def _option(self, index: int) -> Option:
        command = self.robot.commands[index]
        muted, denied = tint(self.app, "muted"), bool(self._denied(command.name))
        style = "bold" if command.available and not denied else muted
        return Option(Text(command.name + " ✗" * denied, style), id=_form_id(index))

    def _denied(self, command: str) -> str:
        """Return why the policy denies a command to who sits here, as a sentence; empty: it does not."""
        denied = self.app.realm_client.refused("command", self.robot.name, self.robot.kinds, command)
        return "" if denied is None else str(denied)

    def on_mount(self) -> None:
        """Open the first form."""
        commands = self.query_one("#commands", OptionList)
        commands.border_title, self.query_one("#readings").border_title = "commands", self.BESIDE
        if self.robot.commands:
            names = [command.name for command in self.robot.commands]
            wanted = self._command or (BEGINS if self._leads else "")
            commands.highlighted = names.index(wanted) if wanted in names else 0
        commands.focus()
        if self.robot.page:
            self._look_for_own()
        if self._leads:
            self.query_one("#rules").border_title = "rules"
            self._watch_rules()

    @work(exclusive=True, exit_on_error=False, group="own panel")
    async def _look_for_own(self) -> None:
        """Show the panel that the robot brings, if this machine trusts it; else say why it is not shown."""
        found = await self.app.realm_client.panel(self.robot, gate_for(self.app.realm))
        if found.reason:
            self.app.tell(found.reason, "warning")
        own: LaidOut | ProgramPanel | None = None
        if found.program is not None and not self._ended:
            own = ProgramPanel(found.program, self.robot)
            own.border_title = "panel"
        elif found.panel is not None:
            own = LaidOut(found.panel, self.robot, self._readings)
            own.border_title = Text(seen(found.panel.title) or "panel")
        if own is None:
            return
        own.add_class("own-panel")
        forms = self.query_one("#forms", ContentSwitcher)
        await forms.remove_children(".own-panel")
        own.id, own.display = self._own, False
        await forms.mount(own)
        commands = self.query_one("#commands", OptionList)
        if commands.option_count == len(self.robot.commands):
            commands.add_option(Option(Text("its own panel", "italic"), id=self._own))
        if not self._command and commands.has_focus and commands.highlighted in (None, 0):
            commands.highlighted = len(self.robot.commands)

    @on(ProgramPanel.Ended)
    async def _lose_own(self, event: ProgramPanel.Ended) -> None:
        """Show the generated form again, or the panel without a program, and say why."""
        self._ended = True
        self.app.tell(f"the panel of {self.robot.name} is not shown: {event.reason}", "warning")
        commands = self.query_one("#commands", OptionList)
        if event.panel.display:
            commands.highlighted = 0 if self.robot.commands else None
        if event.panel.has_focus:
            commands.focus()
        if commands.option_count > len(self.robot.commands):
            commands.remove_option(self._own)
        await event.panel.remove()
        self._look_for_own()

    @property
    def _own(self) -> str:
        """Id of the panel that the robot brings: it comes behind the forms of its commands."""
        return _form_id(len(self.robot.commands))

    @on(LaidOut.Pressed)
    def _press(self, event: LaidOut.Pressed) -> None:
        """Have the command of a button carried out, after the question that belongs to it."""
        part, robot = event.part, self.robot

        def begin(_yes: str = "") -> None:
            self.app.call(robot.name, part.command, part.arguments, CallListener())

        if part.confirm:
            what = f"{robot.name}.{part.command} begins"
            self.app.ask(Confirm(seen(part.confirm), what, "Begin"), begin)
        else:
            begin()

    @property
    def _leads(self) -> bool:
        """Whether the robot is a script, which shows what its rules know."""
        return SCRIPT in self.robot.kinds and self.robot.command("facts") is not None

    @work(exclusive=True, exit_on_error=False, group="rules")
    async def _watch_rules(self) -> None:
        """Show facts, agenda and firings, live, until the panel is left."""
        while True:
            try:
                answer = str(await self.app.realm_client.call(self.robot.name, "facts", {}, deadline=GLANCE))
            except VrError as error:
                answer = str(error)
            self.query_one("#facts", CachedText).show(Text(answer))
            await asyncio.sleep(GLANCE)

    @property
    def _answers(self) -> bool:
        return self.app.store.answers(self.robot.name, self.app.now())

    @property
    def _readings(self) -> dict[str, float]:
        return self.app.store.readings(self.robot.name)

    # -- forms -------------------------------------------------------------------------------------

    @on(OptionList.OptionHighlighted, "#commands")
    async def _show(self) -> None:
        """Show the form of a command; it is made when it is shown first, and keeps what was typed."""
        forms, at = self.query_one("#forms", ContentSwitcher), self._at
        if at is None:
            if self.query(".own-panel") and self.query_one("#commands", OptionList).highlighted is not None:
                forms.current = self._own
            return
        wanted = _form_id(at)
        if not forms.query(f"#{wanted}"):
            spec = self.robot.commands[at]
            form = CommandForm(self.robot.name, spec, self._readings)
            form.id = wanted
            form.answers, form.denied = self._answers, self._denied(spec.name)
            form.display = False  # until all of it is there
            form.border_title = Text(wording.signature(command_as_shown(spec)))
            await forms.mount(form)
            form.restore(*self._left_off.pop(spec.name, ({}, "")))
        forms.current = wanted

    @on(OptionList.OptionSelected, "#commands")
    def action_fill_in(self) -> None:
        """Go into the form in front."""
        if self._at is None:
            self.query(ProgramPanel).focus()
        elif form := self._ready:
            form.focus_first()

    @on(CommandForm.Run)
    def _run(self, event: CommandForm.Run) -> None:
        """Have a command carried out; it goes on when this page is left, for then one looks at the robot."""
        self.app.call(self.robot.name, event.form.spec.name, event.arguments, event.form)

    @on(CommandForm.Cancel)
    def action_cancel(self) -> None:
        """Cancel everything that the robot does."""
        self.app.do("cancel", NAME=self.robot.name)

    def action_halt(self) -> None:
        """Stop this robot alone, as a person sees it move: the other ones go on."""
        self.app.do("stop", NAME=self.robot.name)

    # -- keys --------------------------------------------------------------------------------------

    def action_back(self) -> None:
        """Leave; what runs goes on."""
        for form in self.query(CommandForm):
            if form.running:
                self.app.tell(f"{self.robot.name}.{form.spec.name} goes on", "plain")
        self.dismiss()

    def action_list(self) -> None:
        """Go to the list of commands."""
        self.query_one("#commands").focus()

    @property
    def _at(self) -> int | None:
        """Which command is chosen."""
        at = self.query_one("#commands", OptionList).highlighted
        return at if at is not None and at < len(self.robot.commands) else None

    @property
    def _in_front(self) -> CommandForm | None:
        """The form of the chosen command; None: it is still being made."""
        forms, at = self.query_one("#forms", ContentSwitcher), self._at
        if at is None or forms.current != _form_id(at):
            return None
        found = (form for form in forms.children if form.id == forms.current)  # it may just be taken out
        return next((form for form in found if isinstance(form, CommandForm)), None)

    @property
    def _ready(self) -> CommandForm | None:
        """The same for a key; a message shows that it came too early."""
        form, at = self._in_front, self._at
        if form is None and at is not None:
            self.app.tell(f"the form of {self.robot.commands[at].name} is being made: press again", "warning")
        return form

    def action_follow(self) -> None:
        """Let a field follow the robot again."""
        if form := self._ready:
            form.follow()

    def action_copy(self) -> None:
        """Copy the command line that does the same as the form in front."""
        if form := self._ready:
            self.app.copy_to_clipboard(form.line)
            self.app.tell(f"copied: {form.line}", "good")

    def action_run(self) -> None:
        """Have the command in front carried out, as it is filled in."""
        if form := self._ready:
            form.send()

    def action_about(self) -> None:
        """Describe the robot in full."""
        self.app.do("show", NAME=self.robot.name)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer tele-operation only to robots that have it, and letters only where nobody may be typing."""
        if action == "teleoperate" and bounds(self.robot) is None:
            return False
        if action in LETTERS and self.is_mounted and not self._at_rest(action):
            return False
        return super().check_action(action, parameters)

    def _at_rest(self, action: str) -> bool:
        """Whether a letter is a key: at the list of commands; `c` and `!` also in a form that runs."""
        focused = self.focused
        if focused is None:
            return False
        if action in {"cancel", "halt"} and any(
            isinstance(one, CommandForm) and one.running for one in focused.ancestors_with_self
        ):
            return True
        return focused.id in {"commands", action}

    def action_teleoperate(self) -> None:
        """Open the tele-operation panel."""
        self.app.open_teleoperation(self.robot)

    # -- drawing -----------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw who it is, how it is, what it reads."""
        super().draw()
        store, now, name = self.app.store, self.app.now(), self.robot.name
        newest = store.descriptions.get(name)
        self._notice(newest)
        muted = tint(self.app, "muted")
        state = status_mark(self.app, store.status(name, now), store.doing(name, now))
        about = wording.summary(self.robot.doc)
        line = Text.assemble(
            " ",
            (name, "bold"),
            f"  {wording.kind(self.robot.kind, self.robot.attributes)}  ",
            state,
            f"   {about}",
            no_wrap=True,
        )
        line.stylize(muted, len(line) - len(about))
        self.query_one("#who", CachedText).show(line)
        self.query_one(Readings).draw(ShownReadings.of(store, name, now))
        if form := self._in_front:
            form.draw(self._readings)
        for laid_out in self.query(LaidOut):
            laid_out.draw(self._readings, store.units(name))
        for program in self.query(ProgramPanel):
            program.draw(self._readings, store.units(name), str(store.status(name, now)))
        # both stay: no part moves when a command ends
        if store.views and not self.app.calm:
            self.add_class("-pictures")
        if any(form.running for form in self.query(CommandForm)):
            self.add_class("-ran")
        if self.has_class("-ran") or self.has_class("-pictures"):
            for beside in self.query(SidePane):
                beside.draw(name)

    def _notice(self, newest: RobotDescription | None) -> None:
        """Follow the robot: it may go, come back as another incarnation, or have other commands now."""
        for form in self.query(CommandForm):
            form.note_answers(answers=self._answers)
        if newest is None:
            return
        if newest.address != self.robot.address or _forms(newest) != _forms(self.robot):
            self.robot = newest
            self._rebuild()
        elif newest.commands != self.robot.commands:
            for form in self.query(CommandForm):
                if (spec := newest.command(form.spec.name)) is not None:
                    form.follow_settings(spec)
        self.robot = newest

    @work(exclusive=True, exit_on_error=False, group="rebuild")
    async def _rebuild(self) -> None:
        """Make the forms anew, of the commands that the robot has now; what was typed is kept."""
        forms = self.query_one("#forms", ContentSwitcher)
        self._left_off |= {form.spec.name: (form.typed, form.at) for form in self.query(CommandForm)}
        forms.current = None
        await forms.remove_children()
        commands = self.query_one("#commands", OptionList)
        at = commands.highlighted or 0
        commands.clear_options()
        commands.add_options(map(self._option, range(len(self.robot.commands))))
        if self.robot.commands:
            commands.highlighted = min(at, len(self.robot.commands) - 1)
        if self.robot.page:
            self._look_for_own()
        self.refresh_bindings()


def _forms(robot: RobotDescription) -> list[object]:
    """Return what the forms of a robot are made from: of settings all but their present values."""
    import msgspec

    plain = [msgspec.structs.replace(setting, default=None) for setting in wording.settings(robot)]
    return [plain if command.beside and not command.through else command for command in robot.commands]


def _form_id(index: int) -> str:
    """Return a widget's id: names of commands may have characters that an id may not."""
    return f"command-{index}"
