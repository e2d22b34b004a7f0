"""The panel: a form for each command, made from its types, or what the robot brings; scripts, roles."""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import pytest
from msgspec.structs import replace
from textual.widgets import Button, Input, OptionList

from robotree.tui.panels import outside
from robotree.tui.screen.pages import panel as panels
from robotree.tui.screen.pages.dialogs import Choosing, Confirm
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.widgets.command_form import CommandForm
from robotree.tui.screen.widgets.field_row import Choice, FieldRow
from robotree.tui.screen.widgets.laid_out import LaidOut, curve
from robotree.tui.screen.widgets.program_panel import ProgramPanel
from robotree.vr import Robot, command
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import user_name
from robotree.vr.bundle import Bundle
from robotree.vr.scripts.roles import RolePlayer
from tests.screen import row
from tests.waiting import PATIENCE

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


async def open_panel(operator: Operator, name: str) -> PanelPage:
    await operator.until(lambda: name in operator.app.store.descriptions, name)
    await operator.select(name)
    await operator.until(lambda: operator.app.store.state(name) is not None, "its state")
    await operator.press("enter")
    return await operator.at(PanelPage)


async def choose(operator: Operator, page: PanelPage, name: str) -> CommandForm:
    """Open the form of a command."""
    commands = page.query_one("#commands", OptionList)
    commands.focus()
    commands.highlighted = [command.name for command in page.robot.commands].index(name)
    forms = page.query_one("#forms")
    await operator.until(
        lambda: any(form.spec.name == name and form.display for form in forms.query(CommandForm)), name
    )
    return next(form for form in forms.query(CommandForm) if form.spec.name == name)


@asynccontextmanager
async def panel(
    realm: Realm, operate: Operate, name: str, command: str
) -> AsyncIterator[tuple[Operator, PanelPage, CommandForm]]:
    """Open the panel of a robot at the form of a command."""
    async with operate(realm.realm_client) as operator:
        page = await open_panel(operator, name)
        yield operator, page, await choose(operator, page, command)


async def fill(operator: Operator, form: CommandForm, name: str, text: str) -> None:
    entry = row(form, name).query_one(Input)
    entry.focus()
    await operator.press("home", "shift+end", "delete")
    entry.value = text


def complaint(form: CommandForm, name: str) -> str:
    return str(row(form, name).query_one(".field-complaint").render())


async def test_a_command_that_the_policy_denies_is_marked_and_says_why(
    realm: Realm, operate: Operate, monkeypatch: pytest.MonkeyPatch
) -> None:
    gate, me = PolicyGate(), user_name(os.geteuid())
    gate.policy = read_policy(
        f"realm: test\nversion: 1\npersons: {{'{me}': some}}\n"
        "roles: {some: {see: '*', command: arm-1.grip}}"
    )
    monkeypatch.setattr(realm.realm_client._transport, "gate", gate)
    with sitting_at("pts/3"):
        async with panel(realm, operate, "arm-1", "go_to") as (operator, page, form):
            await operator.sees(
                "go_to ✗", "may not command arm-1.go_to: line 4 allows command only of", "ask who"
            )
            assert form.query_one("#run", Button).disabled
            form.send()
            assert not form.running
            assert not (await choose(operator, page, "grip")).query_one("#run", Button).disabled


async def test_wrong_input_is_explained_beside_each_field_and_nothing_is_sent(
    realm: Realm, operate: Operate
) -> None:
    async with panel(realm, operate, "arm-1", "go_to") as (operator, _page, form):
        for name, text in (("x", "9"), ("y", "near"), ("z", ""), ("twist", "3 kg"), ("speed", "nan")):
            await fill(operator, form, name, text)
        await operator.press("ctrl+r")
        await operator.until(lambda: "9 is out of range" in complaint(form, "x"), "a complaint")
        assert "is not a number in m" in complaint(form, "y")
        assert "needs a number in m" in complaint(form, "z")
        assert "give it in °" in complaint(form, "twist")
        assert "not a number" in complaint(form, "speed")
        assert realm.arm.calls == []
        assert row(form, "x").query_one(Input).has_focus, "the first wrong field has the cursor"
        await fill(operator, form, "x", "0.4")
        await operator.until(lambda: complaint(form, "x") == "", "the complaint goes while one types")
        await fill(operator, form, "x", "far")
        await operator.press("tab")
        await operator.until(
            lambda: "is not a number" in complaint(form, "x"), "it complains when it is left"
        )
        assert row(form, "y").query_one(Input).has_focus, "and lets go of the cursor"


async def test_hasty_enters_lead_through_a_form_and_never_run_it(realm: Realm, operate: Operate) -> None:
    async with panel(realm, operate, "arm-1", "go_to") as (operator, page, form):
        await operator.press(*["enter"] * 9)
        await operator.sees("ctrl+r runs it")
        assert row(form, "speed").query_one(Input).has_focus, "the last field"
        hold = await choose(operator, page, "hold")
        await operator.press(*["enter"] * 9)
        await operator.sees("ctrl+r runs it")
        assert page.query_one("#commands").has_focus
        assert not hold.running
        assert realm.arm.calls == []
        calls = operator.app.store.descriptions["arm-1"].calls
        await operator.press("ctrl+r")
        await operator.sees("done in")
        assert "hold" not in calls
        await choose(operator, page, "go_to")
        row(form, "y").focus_entry()
        await operator.press("ctrl+r")
        await operator.until(lambda: realm.arm.calls == ["go_to"], "it runs")
        await operator.until(lambda: row(form, "y").query_one(Input).has_focus, "the cursor is where it was")


async def test_choices_and_truths_are_chosen_and_texts_stay_texts(realm: Realm, operate: Operate) -> None:
    async with panel(realm, operate, "arm-1", "grip") as (operator, page, form):
        row(form, "width").focus_entry()
        await operator.press("ctrl+r")
        await operator.until(lambda: "one of open, close, width" in complaint(form, "action"), "a complaint")
        row(form, "action").query_one(Choice).value = "close"
        form.query_one("#run", Button).press()
        await operator.until(lambda: realm.arm.width == 0.0, "the gripper is closed")
        shout = await choose(operator, page, "shout")
        await fill(operator, shout, "text", "[/x] hey")
        row(shout, "loud").query_one(Choice).value = "yes"
        shout.query_one("#run", Button).press()
        await operator.sees("[/X] HEY")
        stumble = await choose(operator, page, "stumble")
        await operator.press("ctrl+r")
        outcome = stumble.query_one("#outcome")
        await operator.until(lambda: "a stone [/x] lay there" in str(outcome.render()), "the failure")


async def test_a_command_through_an_empty_slot_says_what_is_missing(realm: Realm, operate: Operate) -> None:
    await realm.create("move_to.py", "mover")
    async with panel(realm, operate, "mover", "go_to") as (operator, page, form):
        await operator.sees("the slot arm is empty")
        assert form.query_one("#run", Button).disabled
        await realm.realm_client.enslave("mover", "arm", "arm-1")
        await operator.until(
            lambda: any(
                form.spec.name == "go_to" and not button.disabled
                for form in page.query(CommandForm)
                for button in form.query("#run").results(Button)
            ),
            "the panel follows",
        )
        await operator.sees("now 0.35")


def in_front(page: PanelPage) -> Any:
    return page._in_front


async def test_a_robot_that_comes_back_can_be_commanded_in_the_same_panel(
    realm: Realm, operator: Operator
) -> None:
    late = await realm.robot(Odd("odd-1"))
    page = await open_panel(operator, "odd-1")
    await late.close()
    await operator.sees("✗ has left")
    await choose(operator, page, "poke")
    before = in_front(page)
    await fill(operator, before, "bracket", "[bold]")
    await realm.robot(Odd("odd-1"))
    await operator.until(lambda: in_front(page) not in {None, before}, "it is back, with a form anew")
    await operator.until(lambda: in_front(page).typed == {"bracket": "[bold]"}, "what was typed is kept")
    assert in_front(page).at == "bracket", "and the cursor is where it was"
    await operator.press("ctrl+r")
    await operator.sees("{[bold]}")


class Odd(Robot):
    """A robot [/b] with [red]odd[/red] words :warning:."""

    @command(effect="read")
    def poke(self, bracket: Annotated[str, "a [/ bracket"] = "[/") -> str:
        """Poke it [/x]."""
        return "{" + bracket + "}"

    @command
    def nothing(self) -> None:
        pass

    def readings(self) -> dict[str, float]:
        return {"[/x]": 1.0, "": 2.0, "nan": float("nan"), "inf": float("inf"), "a" * 60: -1e300}


TEAM = """
from typing import Annotated
from robotree.vr import Range, Unit, VirtualRobot, command

class Team(VirtualRobot):
    speed: Annotated[float, Unit("m/s"), Range(0.01, 0.3)] = 0.1
    label: str = "left"

    @command
    def told(self) -> str:
        return f"{self.speed:g} {self.label}"
"""


async def test_settings_are_changed_in_the_form_that_the_key_opens(
    realm: Realm, operator: Operator, tmp_path: Path
) -> None:
    (tmp_path / "team.py").write_text(TEAM)
    await realm.realm_client.create(str(tmp_path / "team.py"), "team")
    await operator.until(lambda: "team" in operator.app.store.descriptions, "team")
    await operator.select("team")
    await operator.press("s")
    page = await operator.at(PanelPage)
    await operator.until(lambda: any(one.display for one in page.query(CommandForm)), "the form")
    form = next(one for one in page.query(CommandForm) if one.display)
    assert form.spec.name == "set"
    assert {one.spec.name: one.text for one in form.query(FieldRow)} == {"speed": "0.1", "label": "left"}
    await fill(operator, form, "speed", "20 cm/s")
    await realm.realm_client.call("team", "set", {"label": "right"})
    await operator.press("ctrl+r")
    await operator.sees("done in")
    assert await realm.realm_client.call("team", "told", {}) == "0.2 right", "what was not edited stays"


@pytest.mark.parametrize("size", [(160, 48), (80, 24)])
async def test_no_part_of_the_panel_moves_when_a_command_begins_or_ends(
    realm: Realm, operate: Operate, size: tuple[int, int]
) -> None:
    def places(page: PanelPage) -> list[object]:
        parts = [page.query_one("#commands"), page.query_one("#readings"), page.query_one("#forms")]
        return [one.region for one in (*parts, *page.query(".beside"))]

    async with operate(realm.realm_client, size=size) as operator:
        page = await open_panel(operator, "arm-1")
        form = page.query_one(CommandForm)
        await operator.until(lambda: bool(form.texts["x"]), "the form has its values")
        await operator.until(lambda: page.has_class("-pictures"), "the picture is there")
        await operator.until(lambda: not page._layout_required, "its layout")
        before = places(page)
        realm.arm.under_way = True
        await operator.press("ctrl+r")
        await operator.until(lambda: form.running and page.has_class("-ran"), "it runs")
        await operator.until(lambda: not page._layout_required, "its layout")
        assert places(page) == before
        realm.arm.under_way = False
        await operator.until(lambda: not form.running, "it has ended")
        await operator.until(lambda: not page._layout_required, "its layout")
        assert places(page) == before


# -- the panel that a robot brings ------------------------------------------------------------------

OWN_PANEL = """
title: Waving
parts:
  - text: It waves.
  - button: wave
    label: twice
    arguments: {times: 2}
  - button: wave
    label: often
    arguments: {times: 9}
    confirm: Is the way free?
  - bar: waved
    from: 0
    to: 10
"""
WAVER = """
from robotree.vr import VirtualRobot, command, state

class Waver(VirtualRobot):
    total: int = state(0)

    @command
    def wave(self, times: int) -> int:
        self.total += times
        return self.total

    def readings(self) -> dict[str, float]:
        return {"waved": float(self.total)}
"""


async def test_a_robot_brings_its_own_panel(realm: Realm, operator: Operator, tmp_path: Path) -> None:
    (tmp_path / "waver.py").write_text(WAVER)
    (tmp_path / "waver.panel.yaml").write_text(OWN_PANEL)
    await realm.realm_client.create(str(tmp_path / "waver.py"), "waver")
    page = await open_panel(operator, "waver")
    await operator.until(lambda: any(one.display for one in page.query(LaidOut)), "its own panel")
    laid_out = page.query_one(LaidOut)
    twice, often = laid_out.query(Button)
    assert (str(twice.label), str(often.label)) == ("▶ twice", "▶ often")
    twice.press()
    await operator.until(lambda: "waved          █████░" in operator.text, "the bar of what it waved")
    often.press()
    question = await operator.at(Confirm)
    assert "Is the way free?" in operator.text
    question.query_one("#no", Button).press()
    await operator.at(PanelPage)
    often.press()
    question = await operator.at(Confirm)
    question.query_one("#yes", Button).press()
    await operator.until(lambda: "█ 11" in operator.text, "it waved on, and only once")


def test_a_plot_shows_the_course_of_a_reading() -> None:
    rising = [(float(second), float(second)) for second in range(25)]
    drawn = curve(rising, 24.0, 24.0)
    assert drawn[0] == "▁"
    assert drawn[-1] == "█"
    assert list(drawn) == sorted(drawn)
    assert curve([], 0.0, 10.0).strip() == ""
    assert set(curve([(0.0, 3.0), (1.0, 3.0)], 1.0, 1.0).replace(" ", "")) == {"▅"}


async def test_without_trust_the_generated_form_is_shown_and_the_reason(
    realm: Realm, operator: Operator, tmp_path: Path
) -> None:
    (tmp_path / "waver.py").write_text(WAVER)
    (tmp_path / "waver.panel.yaml").write_text(OWN_PANEL.replace("button: wave", "button: melt"))
    await realm.realm_client.create(str(tmp_path / "waver.py"), "waver")
    page = await open_panel(operator, "waver")
    reason = "the panel waver.panel.yaml is not shown: Waver has no command 'melt'"
    await operator.until(lambda: reason in operator.text, "the reason")
    await choose(operator, page, "wave")
    assert not page.query(LaidOut)


async def test_code_of_anybody_stays_red_on_the_screen(
    realm: Realm, operator: Operator, tmp_path: Path
) -> None:
    (tmp_path / "waver.py").write_text(WAVER)
    host = await realm.host("careless")
    await host.create(Bundle.read(tmp_path / "waver.py"), "own")
    host.gate.any_signer = True
    await host.create(replace(Bundle.read(tmp_path / "waver.py"), sender="anna@lab"), "foreign")
    red = "✗ CODE OF ANYBODY: foreign (--insecure-any-signer)"
    await operator.until(lambda: red in operator.text, "the banner")
    await open_panel(operator, "own")
    await operator.until(lambda: red in operator.text, "the banner, on each page")


PROGRAM = """
from textual.widgets import Label

from robotree.tui.panels.author import RobotPanel


class Waving(RobotPanel, can_focus=True):
    TITLE = "Waving by key"
    BINDINGS = [("w", "wave", "wave"), ("x", "crash", "crash")]

    def compose(self):
        yield Label("press w", id="said")

    def on_mount(self):
        self.focus()

    def see(self):
        self.query_one("#said", Label).update(f"waved {self.readings.get('waved', 0):.0f} times by key")

    def action_wave(self):
        self.ask("wave", times=7)

    def action_crash(self):
        import os

        os._exit(1)
"""


async def test_a_robot_brings_a_panel_that_is_a_program_until_that_ends(
    realm: Realm, operator: Operator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(outside, "SILENT", PATIENCE)
    monkeypatch.setattr(outside, "START", PATIENCE)
    (tmp_path / "waver.py").write_text(WAVER)
    (tmp_path / "waver.panel.py").write_text(PROGRAM)
    await realm.realm_client.create(str(tmp_path / "waver.py"), "waver")
    page = await open_panel(operator, "waver")
    await operator.until(lambda: "waved 0 times by key" in operator.text, "its own panel")
    await operator.press("enter")  # into it
    program = page.query_one(ProgramPanel)
    assert program.has_focus
    await operator.press("w")
    await operator.until(lambda: "waved 7 times by key" in operator.text, "it waved")
    await operator.press("x")
    told = operator.app.store.entries  # on a busy machine the line has gone before anybody looks
    ended = "is not shown: its process has ended"
    await operator.until(lambda: any(ended in entry.text for entry in told), "the reason")
    await choose(operator, page, "wave")  # the generated form is there
    assert not page.query(ProgramPanel)
    await operator.press("escape")
    await operator.until(lambda: not isinstance(operator.app.screen, PanelPage), "it was left")


COUNTS = """
script: doorman
partners: {robot: Butler}
hears: {bell: {who: text}}
facts: {count: {guests: 0}}
begin with:
  - count: {guests: 0}
rules:
  - rule: greet
    when:
      - bell: {who: $who}
      - count: {guests: $n}
        as: c
    then:
      - update c: {guests: = $n + 1}
      - do: robot.say
        with: {text: "Welcome, $who"}
  - rule: go-on
    when: [failed: {act: say}]
    then: [log: nobody spoke]
"""


class Butler(RolePlayer):
    @command
    def say(self, text: str) -> str:
        """Say something."""
        return self.manner.words(text)


async def led(realm: Realm, folder: Path) -> None:
    """Have a script lead a robot that plays roles."""
    await realm.robot(Butler("james"))
    file = folder / "doorman.yaml"
    await asyncio.to_thread(file.write_text, COUNTS)
    await realm.realm_client.create(str(file), "doorman")
    await realm.realm_client.enslave("doorman", "robot", "james")


def chosen_command(page: PanelPage) -> str:
    """Return the command whose form a panel shows; empty: none yet."""
    place = page.query_one("#commands", OptionList).highlighted
    return "" if place is None else page.robot.commands[place].name


async def test_the_panel_of_a_script_opens_at_its_start_and_shows_its_facts_and_firings_live(
    realm: Realm, operate: Operate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(panels, "GLANCE", 0.1)
    await led(realm, tmp_path)
    async with operate(realm.realm_client, size=(130, 50)) as operator:
        page = await open_panel(operator, "doorman")
        await operator.until(lambda: chosen_command(page) == "start", "the command that it begins with")
        await operator.sees("rules", "ready", "it is not started")
        await realm.realm_client.tell("doorman", "start", {}, deadline=60.0)
        await operator.sees("active", "count: {guests: 0}", "fired (0)")
        await realm.realm_client.call("doorman", "bell", {"who": "Anna"})
        await operator.sees("count: {guests: 1}", "greet")
        await realm.realm_client.release("doorman", "robot")
        await operator.sees("it has ended", "released")


async def choose_role(operator: Operator, name: str) -> Choosing:
    """Press the key of roles on a robot."""
    await operator.select(name)
    await operator.until(lambda: name in operator.app.store.descriptions, "its description")
    await operator.press("p")
    return await operator.at(Choosing)


async def test_a_role_is_chosen_on_the_screen_and_the_present_one_is_marked(
    realm: Realm, operator: Operator
) -> None:
    robot = Butler("james")
    await realm.robot(robot)
    dialog = await choose_role(operator, "james")
    await operator.sees("Which role does james play from its next act on?", "neutral  now", "child")
    options = dialog.query_one(OptionList)
    names = [str(option.prompt).split()[0] for option in options.options]
    assert names[0] == "neutral"
    for _ in range(names.index("butler")):
        await operator.press("down")
    await operator.press("enter")
    await operator.at(MainPage)
    await operator.sees("james plays butler from its next act on")
    assert robot.role == "butler"
    await choose_role(operator, "james")
    await operator.sees("butler  now")
    await operator.press("escape")
    await operator.at(MainPage)
    assert robot.role == "butler", "escape changes nothing"
    await operator.select("arm-1")
    await operator.press("p")
    await operator.sees("arm-1 plays no roles")


async def test_the_role_of_a_led_robot_is_changed_through_its_script(
    realm: Realm, operator: Operator, tmp_path: Path
) -> None:
    await led(realm, tmp_path)
    await operator.obey("role james child")
    await operator.sees("james plays child from its next act on")
    assert (await realm.realm_client.describe("james")).attributes["role"] == "child"
