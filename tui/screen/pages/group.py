"""The panel of a group: the commands that all its members have, and an answer from each of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any, ClassVar

import msgspec
from rich.text import Text
from textual import on, work
from textual.app import ComposeResult
from textual.containers import Horizontal, Vertical
from textual.widgets import ContentSwitcher, OptionList

from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.widgets.cached_text import CachedText
from robotree.tui.screen.widgets.command_form import CommandForm
from robotree.tui.screen.widgets.marks import status_mark, tint
from robotree.tui.screen.widgets.readings import Readings
from robotree.tui.seen import wording
from robotree.tui.seen.cells import seen
from robotree.tui.seen.errand import CallListener
from robotree.tui.seen.store import SeenGroup, Store
from robotree.vr.base.address import Address
from robotree.vr.base.description import CommandSpec, RobotDescription
from robotree.vr.base.errors import GroupEmpty, VrError
from robotree.vr.supervision.groups import members_of

GROUP = "group"
"""Kind of the description that stands for a group."""


def together(name: str, group: SeenGroup, store: Store) -> RobotDescription:
    """Return a description that stands for a group: what a form needs of a robot.

    It has the commands that each member has with the same parameters.
    """
    robots = [robot for one in group.members if (robot := store.described(one))]
    commands = robots[0].commands if robots else ()
    shared = [_shared(spec, [one.command(spec.name) for one in robots]) for spec in commands]
    return RobotDescription(
        address=Address("robot", name, GROUP),
        kinds=(GROUP,),
        doc=group.about,
        commands=tuple(spec for spec in shared if spec),
    )


def _shared(spec: CommandSpec, others: Sequence[CommandSpec | None]) -> CommandSpec | None:
    """Return a command as all members have it; None: one of them has it not, or with other parameters."""
    fields = [None if one is None else _fields(one) for one in others]
    if any(one != fields[0] for one in fields):
        return None
    return msgspec.structs.replace(spec, available=all(one.available for one in others if one))


def _fields(spec: CommandSpec) -> list[tuple[str, str]]:
    return [(field.name, field.type) for field in spec.parameters]


class _Answer(CallListener):
    """One member's part of a command that was given to its group."""

    def __init__(self, page: GroupPanel, name: str) -> None:
        self.name, self.mark, self.words, self.ok = name, "◐", "asked", True
        self.ended = False
        self._page = page

    def progressed(self, fraction: float, text: str) -> None:
        """It says how far it is."""
        self.words = f"{fraction:.0%} {text}".strip()
        self._page.answers_came()

    def succeeded(self, value: Any, seconds: float) -> None:
        """It has done it."""
        del seconds
        self._end("✓", "done" if value is None else wording.value(value), ok=True)

    def failed(self, reason: str) -> None:
        """It has not."""
        self._end("✗", reason, ok=False)

    def _end(self, mark: str, words: str, *, ok: bool) -> None:
        self.mark, self.words, self.ok, self.ended = mark, words, ok, True
        self._page.answers_came()


class GroupPanel(PanelPage):
    """The forms of a group; below the commands stand its members, and what each has answered."""

    BESIDE: ClassVar[str] = "members"

    def __init__(self, name: str, store: Store, command: str = "") -> None:
        """Open the panel of a group that the store knows."""
        self.name_of_group = name
        self._store = store
        super().__init__(together(name, self._group, store), command)
        self._given: tuple[_Answer, ...] = ()
        """The answers to the command that was given last."""
        self._form: CallListener | None = None
        self._asked_at = 0.0

    @property
    def _group(self) -> SeenGroup:
        return self._store.group(self.name_of_group) or SeenGroup("there is no such group any more")

    def title_of_page(self) -> str:
        """Return the group's name."""
        return f"{self.name_of_group} / group"

    def parts(self) -> ComposeResult:
        """List of commands, members, form; no pane beside them, for a group has no branch and no camera."""
        yield CachedText(id="who")
        with Horizontal(classes="columns"):
            with Vertical(classes="side"):
                yield OptionList(
                    *map(self._option, range(len(self.robot.commands))), id="commands", markup=False
                )
                yield Readings(id="readings")
            yield ContentSwitcher(id="forms")

    def on_mount(self) -> None:
        """Say so if there is nothing to fill in."""
        if not self.robot.commands:
            self.app.tell(f"no command is common to all members of {self.name_of_group}", "warning")

    def _denied(self, command: str) -> str:
        """Return why the policy denies a command of each member to who sits here; empty: not of each."""
        reasons = [
            self._store.denies(name, robot.kinds, command)
            for name in self._group.members
            if (robot := self._store.described(name))
        ]
        return reasons[0] if reasons and all(reasons) else ""

    @property
    def _answers(self) -> bool:
        return self._store.answers(self.name_of_group, self.app.now())

    @on(CommandForm.Run)
    def _run(self, event: CommandForm.Run) -> None:
        """Give a command to each member; who is one is looked at anew."""
        event.prevent_default()  # a group is no robot: the panel's own way is not for it
        event.form.started()
        self._give(event)

    @work(exit_on_error=False, group="groups")
    async def _give(self, event: CommandForm.Run) -> None:
        client, name = self.app.realm_client, self.name_of_group
        try:
            group = client.groups.find(name)
            names = [one.name for one in await members_of(client, group) if one.sure]
            if not names:
                raise GroupEmpty(group=name, about=group.about)
        except VrError as error:
            event.form.failed(str(error))
            return
        self._form, self._asked_at = event.form, self.app.now()
        self._given = tuple(_Answer(self, one) for one in names)
        for answer in self._given:
            self.app.call(answer.name, event.form.spec.name, event.arguments, answer)

    def answers_came(self) -> None:
        """Tell the form when all have answered, and who has not done it."""
        given, form = self._given, self._form
        ended = [one for one in given if one.ended]
        if form is None:
            return
        if len(ended) < len(given):
            form.progressed(len(ended) / len(given), f"{len(ended)} of {len(given)} have answered")
            return
        self._form = None
        failed = [one for one in given if not one.ok]
        if failed:
            first = f"{failed[0].name}: {failed[0].words}"
            form.failed(f"{len(failed)} of {len(given)} robots did not do it: {first}")
        else:
            form.succeeded(None, self.app.now() - self._asked_at)

    def action_about(self) -> None:
        """Show who is in the group, and why."""
        self.app.do("groups", GROUP=self.name_of_group)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Offer no tele-operation: one hand for several robots would be none."""
        return False if action == "teleoperate" else super().check_action(action, parameters)

    # -- drawing -----------------------------------------------------------------------------------

    def draw(self) -> None:
        """Draw who they are, how each is, and what it has answered."""
        super(PanelPage, self).draw()
        store, now, name, group = self._store, self.app.now(), self.name_of_group, self._group
        self._follow(together(name, group, store))
        state = status_mark(self.app, store.status(name, now), store.doing(name, now))
        head = Text.assemble(" ", (name, "bold"), f"  group of {len(group.members)}  ", state, no_wrap=True)
        head.append(f"   {group.about}", tint(self.app, "muted"))
        self.query_one("#who", CachedText).show(head)
        self.query_one(Readings).show(Text("\n").join(self._lines(group.members, now)))
        if form := self._in_front:
            form.draw({})

    def _follow(self, newest: RobotDescription) -> None:
        """Have the commands that all members have now."""
        for form in self.query(CommandForm):
            form.note_answers(answers=self._answers)
        if [_fields(one) for one in newest.commands] != [_fields(one) for one in self.robot.commands]:
            self.robot = newest
            self._rebuild()
        self.robot = newest

    def _lines(self, members: Iterable[str], now: float) -> Iterable[Text]:
        answers = {one.name: one for one in self._given}
        doing = partial(self._store.doing, now=now)
        for name in dict.fromkeys([*members, *answers]):
            line = Text.assemble((seen(name), "bold"), "  ")
            line.append_text(status_mark(self.app, self._store.status(name, now), doing(name)))
            if answer := answers.get(name):
                tone = "error" if not answer.ok else "success" if answer.ended else "accent"
                line.append(f"\n  {answer.mark} {answer.words}", tint(self.app, tone))
            yield line
