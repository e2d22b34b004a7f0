"""Whatever robots, fields and choices are called: forms and dialogs show it as it is, and nothing steers."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st
from textual.app import ComposeResult
from textual.containers import VerticalScroll

from robotree.tui.screen.app import CONTROL_FILTER, Supervisor
from robotree.tui.screen.pages.dialogs import Choosing, Confirm, Modal, Reading
from robotree.tui.screen.pages.enslave import EnslaveDialog, Opening
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.pages.panel import Branch
from robotree.tui.screen.widgets.command_form import CommandForm
from robotree.tui.screen.widgets.field_row import Choice
from robotree.tui.seen.cells import seen
from robotree.tui.terminal import STEERING
from robotree.vr.base.address import Address
from robotree.vr.base.description import CommandSpec, FieldSpec, Listing, RobotDescription, SlotSpec
from robotree.vr.base.policy import PolicyGate

if TYPE_CHECKING:
    from robotree.tui.seen.feeding import Feed
    from robotree.vr.supervision.realm_client import RealmClient

WORDS = st.text(min_size=1, max_size=24) | st.sampled_from(
    ["[", "[/", "[/x]", "[red]x", "[@click=app.quit]x", ":warning:", "\x1b[2J", "\x1b]0;t\x07", "\x9b31m",
     "机器人", "é́́", "👩‍👩‍👧", "\u202egnp", "a\nb", "\t", "x" * 24, "🏳️‍🌈", "\u200d"]
)  # fmt: skip


def described(name: str, words: tuple[str, ...]) -> RobotDescription:
    """Describe a robot in which everything has odd words."""
    fields = tuple(
        FieldSpec(
            name=word,
            type="choice" if index % 2 else "float",
            unit=word,
            doc=word,
            choices=(word,) * (index % 2),
        )
        for index, word in enumerate(words)
    )
    command = CommandSpec(name=name, doc=words[0], parameters=fields)
    slots = (SlotSpec(name=words[-1], kind=name, doc=words[0], child=Address("robot", words[-1], "1")),)
    return RobotDescription(
        address=Address("robot", name, "1"), kinds=(words[0],), doc=name, commands=(command,), slots=slots
    )


class Bare(Supervisor):
    """The supervisor without a realm."""

    CSS_PATH = str(Path(str(sys.modules[Supervisor.__module__].__file__)).with_name("supervisor.tcss"))

    def __init__(self, words: tuple[str, ...]) -> None:
        super().__init__(
            cast("RealmClient", SimpleNamespace(gate=PolicyGate(), realm="", operators=Alone())),
            realm=words[0],
        )
        self.words_shown = words
        robots = [described(word, words) for word in words]
        self.store.descriptions = {robot.name: robot for robot in robots}
        self.store.robots = {
            robot.name: Listing(address=robot.address, kinds=robot.kinds, doc=robot.doc) for robot in robots
        }
        self.feed = cast("Feed", Quiet())


class Alone:
    """No other operator is there."""

    def __init__(self) -> None:
        self.person = "anna@pts/1"
        self.on_said: list[object] = []

    async def open(self) -> None: ...

    async def close(self) -> None: ...

    def show(self, page: str, robot: str) -> None: ...


class Quiet:
    """A feed of which nothing comes."""

    async def open(self) -> None:
        """Tell nothing."""

    async def close(self) -> None:
        """Go on telling nothing."""


class Forms(Page):
    """All forms, one below the other."""

    def parts(self) -> ComposeResult:
        words = cast("Bare", self.app).words_shown
        with VerticalScroll():
            yield Choice([(word, word) for word in dict.fromkeys(words)])
            yield Branch()
            for word in dict.fromkeys(words):
                yield CommandForm(
                    word, self.app.store.descriptions[word].commands[0], dict.fromkeys(words, 1.0)
                )


async def look(words: tuple[str, ...]) -> None:
    app = Bare(words)
    async with app.run_test(size=(120, 40)) as pilot:
        await app.push_screen(Forms())
        await pilot.pause()
        app.screen.query_one(Branch).draw(app.store, words[0], 0.0)
        for form in app.screen.query(CommandForm):
            form.started()
            form.progressed(0.5, words[0])
            form.failed(words[-1])
            form.succeeded({words[0]: words[-1]}, 1.0)
            form.send()
        await pilot.pause()
        check(app)
        dialogs: list[Modal] = [  # type: ignore[type-arg] # of whatever they answer
            Confirm(words[0], words[-1], words[0]),
            Reading(words[0], words[-1]),
            EnslaveDialog(app.store, [Opening(word, word, word, word) for word in words], words[0]),
            Choosing(words[0], [(one, one) for one in words], note=words[-1], at=words[-1]),
        ]
        for dialog in dialogs:
            app.push_screen(dialog)
            await pilot.pause()
            text = check(app)
            if isinstance(dialog, Confirm) and (asked := seen(words[0])) and asked.isascii():
                assert asked in text, "the question is shown as it is"
            app.pop_screen()
            await pilot.pause()
        assert app.errors == []
        assert app.fatal is None


def check(app: Bare) -> str:
    """Return what is on the screen; nothing in it steers a terminal."""
    strips = app.screen._compositor.render_strips()
    filtered = [[CONTROL_FILTER.apply(list(strip), app.screen.background_colors[1])] for strip in strips]
    text = "\n".join("".join(segment.text for segment in line) for (line,) in filtered)
    assert not STEERING.search(text.replace("\n", ""))
    return text


@example(words=("[/x]", "\x1b[2J", "机器人"))
@given(words=st.lists(WORDS, min_size=2, max_size=3, unique=True).map(tuple))
@settings(
    max_examples=1,
    deadline=None,
    phases=[Phase.explicit, Phase.reuse, Phase.generate],  # to shrink would take minutes
    suppress_health_check=[HealthCheck.too_slow],
)
def test_any_words_are_shown_as_they_are(words: tuple[str, ...]) -> None:
    asyncio.run(look(words))
