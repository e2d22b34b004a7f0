"""What the screen must never show or do: a wrong target, a missing robot, old readings; words that steer."""

from __future__ import annotations

import asyncio
import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest
from hypothesis import HealthCheck, Phase, example, given, settings
from hypothesis import strategies as st
from textual.app import ComposeResult
from textual.containers import VerticalScroll

from robotree.tui.screen.app import CONTROL_FILTER, Supervisor
from robotree.tui.screen.keymap import read
from robotree.tui.screen.pages.dialogs import Choosing, Confirm, Modal, Reading
from robotree.tui.screen.pages.enslave import EnslaveDialog, Opening
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.pages.panel import Branch
from robotree.tui.screen.widgets.cameras import PictureView
from robotree.tui.screen.widgets.command_form import CommandForm
from robotree.tui.screen.widgets.field_row import Choice
from robotree.tui.screen.widgets.robot_table import RobotTable
from robotree.tui.seen.cells import seen
from robotree.tui.seen.status import STATUSES
from robotree.tui.terminal import STEERING
from robotree.vr.base.address import Address
from robotree.vr.base.description import CommandSpec, FieldSpec, Listing, RobotDescription, SlotSpec
from robotree.vr.base.policy import PolicyGate

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm

    from robotree.tui.seen.feeding import Feed
    from robotree.vr.supervision.realm_client import RealmClient


async def known(operator: Operator, *names: str) -> None:
    await operator.until(lambda: set(names) <= operator.app.store.descriptions.keys(), str(names))
    await operator.until(lambda: set(names) <= set(operator.one(RobotTable).names), str(names))


async def test_the_selection_stays_on_its_robot_when_it_is_enslaved(realm: Realm, operator: Operator) -> None:
    await realm.create("move_to.py", "mover")
    await known(operator, "mover", "arm-1", "rover-1")
    operator.app.choose("arm-1")
    await operator.press("e")
    await operator.at(EnslaveDialog)
    await operator.press("enter")
    await operator.at(MainPage)
    await operator.until(lambda: "arm-1" not in operator.app.store.robots, "it is enslaved")
    await operator.sees("└ arm: arm-1")
    assert operator.app.selection.name == operator.one(RobotTable).selected == "arm-1"


async def test_the_selection_goes_to_what_was_just_made_and_a_hasty_key_is_refused(
    operator: Operator,
) -> None:
    await known(operator, "arm-1", "rover-1")
    operator.app.choose("rover-1")
    times = [operator.app.now()]
    operator.app.now = lambda: times[0]  # type: ignore[method-assign] # time is ours
    await operator.obey("create examples/move_to.py as mover")
    await known(operator, "mover")
    await operator.until(lambda: operator.app.selection.name == "mover", "it is selected")
    for key in ("d", "enter", "c", "r"):
        operator.burst({"enter": "\r"}.get(key, key), at=times[0] + 0.3)
        await operator.sees("the selection has just gone from rover-1 to mover: press again")
        assert isinstance(operator.app.screen, MainPage), key
    times[0] += 0.6
    operator.burst("d", at=times[0])
    await operator.at(Confirm)
    await operator.sees("delete mover?")


OTHER = read('[keys]\ndismiss = "f6"', "keys.toml")


async def test_a_robot_that_hangs_stays_until_it_is_dismissed_or_back(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client, keymap=OTHER) as operator:
        await known(operator, "arm-1", "rover-1")
        operator.app.choose("rover-1")
        realm.network.freeze(realm.members["rover-1"])
        await operator.sees("✗ HANGS (pid rover-1)", "its process hangs", "thaw rover-1")
        assert "left the list" not in operator.text
        await operator.press("enter")
        await operator.sees("rover-1 hangs: thaw rover-1, or f6 takes it off the list")
        realm.network.thaw(realm.members["rover-1"])
        await operator.sees("rover-1 (Rover) answers again")
        await operator.until(lambda: "HANGS" not in operator.text, "it is as before")
        await operator.press("f6")
        await operator.sees("rover-1 answers: only a robot that hangs or has gone can be dismissed")
        realm.network.kill(realm.members["rover-1"])
        await operator.sees("✗ GONE", "its process has gone")
        await operator.press("enter")
        await operator.sees("its process has gone: start it again, or f6 takes it off the list")
        await operator.press("f6")
        await operator.sees("rover-1 is off the list")
        await operator.until(lambda: operator.one(RobotTable).names == ["arm-1"], "dismissed")


async def test_what_the_page_behind_a_question_says_does_not_stand_still(
    realm: Realm, operator: Operator
) -> None:
    await known(operator, "arm-1", "rover-1")
    realm.network.kill(realm.members["rover-1"])
    await operator.sees("✗ GONE")
    operator.app.push_screen(Confirm("Really?", "", "Yes"))
    await operator.at(Confirm)
    began = re.search(r"GONE (\d+) s", operator.text)
    assert began
    await operator.until(
        lambda: (now := re.search(r"GONE (\d+) s", operator.text)) is not None and now[1] != began[1],
        "the time goes on",
    )


async def test_the_banner_names_first_who_has_not_confirmed_a_stop(realm: Realm, operator: Operator) -> None:
    await known(operator, "arm-1", "rover-1")
    realm.network.freeze(realm.members["rover-1"])
    await operator.sees("HANGS")
    await operator.press("space")
    await operator.sees(
        "■ NOT CONFIRMED: rover-1 (in rover-1, which hangs)", "■ PROTECTIVE STOP: arm-1  after 0."
    )
    lines = operator.text.splitlines()
    first, second = (
        next(i for i, line in enumerate(lines) if word in line) for word in ("NOT CONF", "PROTECT")
    )
    assert first < second
    realm.network.thaw(realm.members["rover-1"])
    await operator.until(lambda: "HANGS" not in operator.text, "it is awake")
    await realm.realm_client.stop("rover-1")
    await operator.until(lambda: "NOT CONFIRMED" not in operator.text, "it is settled")
    await operator.sees("PROTECTIVE STOP: arm-1, rover-1")
    await operator.press("R")
    await operator.at(Confirm)
    await operator.press("right", "enter")
    await operator.until(lambda: operator.app.store.stop is None, "resumed")
    await operator.until(lambda: "PROTECTIVE" not in operator.text, "the banner goes")


async def test_the_last_picture_of_a_view_that_is_silent_or_leaves_is_kept_with_its_age_until_it_is_back(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with operate(realm.realm_client, size=(120, 40)) as operator:
        await known(operator, "arm-1")
        operator.app.choose("arm-1")
        picture = operator.one(PictureView, "#picture-box PictureView")
        await operator.until(lambda: picture.frames > 0, "a picture")
        assert " old" not in operator.text, "a live one has no age"
        realm.network.freeze(realm.members["cell"])
        before = operator.app.now
        with monkeypatch.context() as later:
            later.setattr(operator.app, "now", lambda: before() + 20.0)
            silent = re.compile(r"[23]\d s old: its view does not answer")
            await operator.until(lambda: bool(silent.search(operator.text)), "its age")
            await operator.sees("▀▀▀")
        realm.network.thaw(realm.members["cell"])
        await operator.until(lambda: "s old: " not in operator.text, "it is live again")
        await realm.members["cell"].close()
        await operator.until(lambda: not operator.app.store.views, "it is listed no more")
        await operator.sees("cell / cell", "not listed any more", "▀▀▀")
        old = re.compile(r"\d s old: (?!its view does not answer)")
        await operator.until(lambda: bool(old.search(operator.text)), "its age, and the error")
        seen = picture.frames
        await realm.view()
        await operator.until(lambda: picture.frames > seen, "the next picture")
        await operator.until(lambda: "not listed" not in operator.text, "it is listed again")


async def test_a_lost_child_that_is_back_is_offered_to_be_bound_again(realm: Realm, operate: Operate) -> None:
    await realm.create("move_to.py", "mover")
    await realm.realm_client.enslave("mover", "arm", "arm-1")
    async with operate(realm.realm_client) as operator:
        await known(operator, "mover", "arm-1")
        operator.app.choose("mover")
        realm.network.kill(realm.members["arm-1"])
        await operator.sees("its process has gone", "○ needs arm: Arm (e)")
        await realm.robot(type(realm.arm)("arm-1"))
        await operator.sees("re-bond mover.arm to arm-1? ⏎")
        await operator.press("enter")
        await operator.at(EnslaveDialog)
        await operator.press("enter")
        await operator.at(MainPage)
        await operator.sees("└ arm: arm-1", "mover.arm commands arm-1")


async def test_marked_robots_are_cancelled_and_deleted_together(realm: Realm, operator: Operator) -> None:
    for name in ("a-1", "a-2", "a-10"):
        await realm.create("move_to.py", name)
    await known(operator, "a-1", "a-2", "a-10")
    assert operator.one(RobotTable).names[:3] == ["a-1", "a-2", "a-10"], "in natural order"
    await operator.press("home", "m", "m")
    await operator.sees("*a-1", "*a-2")
    await operator.press("d")
    await operator.at(Confirm)
    await operator.sees("delete 2 marked robots?", "a-1, a-2")
    await operator.press("right", "enter")
    await operator.until(lambda: set(operator.app.store.robots) == {"a-10", "arm-1", "rover-1"}, "deleted")
    assert not operator.app.marks


async def test_the_log_has_a_level_and_a_filter_of_its_own(operator: Operator) -> None:
    await known(operator, "arm-1")
    await operator.obey("call arm-1.get_info")
    await operator.press("escape")
    await operator.obey("call arm-1.stumble")
    await operator.obey("call arm-1.hold")
    await operator.sees("arm-1: hold by ", "is done: ran")
    await operator.press("g", "L", "L")
    await operator.sees("log  errors", "a stone")
    await operator.until(lambda: "hold by" not in operator.text, "only errors")
    await operator.press("L", "slash")
    await operator.type("!stone")
    await operator.press("enter")
    await operator.until(lambda: "a stone" not in operator.text, "filtered")
    await operator.sees("hold by", "log  /!stone")
    await operator.press("l")
    await operator.until(lambda: "/!stone" not in operator.text, "the robots have a filter of their own")


async def test_every_status_has_a_sign() -> None:
    from robotree.tui.screen.widgets import marks

    assert set(marks.STATUSES) == set(STATUSES)
    assert (
        len({sign for status, (sign, _) in marks.STATUSES.items() if status not in {"hangs", "gone"}})
        == len(STATUSES) - 2
    )


async def test_on_a_slow_line_there_are_no_pictures_and_other_statuses_come_at_once(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client, calm=True) as operator:
        await known(operator, "arm-1", "rover-1")
        await realm.realm_client.stop("rover-1")
        await operator.sees("■ stopped", "PROTECTIVE STOP: rover-1")
        assert realm.cell.looks == []
        await operator.press("v")
        await operator.sees("skeleton: from the left side, and from above", "tool")
        assert realm.cell.looks == []


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
