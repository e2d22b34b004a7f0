"""`:` opens the prompt on every page; while it is open all keys are text, and none of them stops a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.widgets import Button, Input

from robotree.tui.screen.pages.dialogs import Confirm, Reading
from robotree.tui.screen.pages.main import MainPage
from robotree.tui.screen.pages.new import NewPage
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.pages.teleop import TeleopPage
from robotree.tui.screen.widgets.command_form import CommandForm
from robotree.tui.seen.selection import Place

if TYPE_CHECKING:
    from screens.conftest import Operator
    from tui.conftest import Realm


async def go_to(operator: Operator, page: type[Page]) -> None:
    """Open a page about arm-1, with the focus where no letter is text."""
    await operator.until(lambda: "arm-1" in operator.app.store.descriptions, "it is known")
    operator.app.choose("arm-1")
    if page is NewPage:
        await operator.press("n")
    if page in {PanelPage, TeleopPage}:
        operator.app.ask_for("panel", Place("arm-1"))
        await operator.at(PanelPage)
    if page is TeleopPage:
        await operator.press("x")
    await operator.at(page)


async def test_a_verb_can_be_typed_on_every_page_and_a_space_in_it_is_no_stop(
    realm: Realm, operator: Operator
) -> None:
    for page in (MainPage, PanelPage, TeleopPage, NewPage):
        await go_to(operator, page)
        before = operator.app.screen.focused
        operator.burst(":show rover-1 , x.c")
        line = operator.one(Input, "#line")
        await operator.until(lambda line=line: line.value == "show rover-1 , x.c", "the line")
        await operator.press("ctrl+u")
        await operator.type("show rover-1")
        await operator.press("enter")
        await operator.at(Reading)
        await operator.sees("A rover of paper.")
        await operator.press("escape")
        assert isinstance(await operator.at(page), page)
        assert operator.app.screen.focused is before, "the focus is where it was"
        while operator.app.screen is not operator.app.main:
            operator.app.pop_screen()
    assert operator.app.store.stop is None, "nothing was stopped"
    assert realm.arm.calls == [], "and nothing was moved"


async def test_it_is_open_while_a_command_runs_and_a_verb_about_the_list_leaves_the_panel_for_it(
    realm: Realm, operator: Operator
) -> None:
    await go_to(operator, PanelPage)
    form = operator.app.screen.query_one(CommandForm)
    await operator.until(lambda: bool(form.texts["x"]), "the form has its values")
    realm.arm.under_way = True
    await operator.press("ctrl+r")
    await operator.until(lambda: form.running, "it runs")
    operator.burst(":cancel arm-1\r")
    await operator.until(lambda: not form.running, "it is cancelled")
    realm.arm.under_way = False
    assert operator.app.store.stop is None
    operator.burst(":log\r")
    main = await operator.at(MainPage)
    assert main.pane == "log"
    await go_to(operator, PanelPage)
    await operator.press("colon", "up")
    assert operator.one(Input, "#line").value == "log", "a line that was typed on another page"


async def test_what_is_typed_for_the_prompt_at_a_question_answers_nothing_and_stops_nothing(
    realm: Realm, operator: Operator
) -> None:
    await realm.create("move_to.py", "mover")
    await operator.until(lambda: "mover" in operator.app.store.descriptions, "it is known")
    operator.app.choose("mover")
    await operator.press("d")
    question = await operator.at(Confirm)
    question.query_one("#yes", Button).focus()
    operator.burst(":delete \r")
    entries = operator.app.store.entries
    await operator.until(
        lambda: any("a question or a text is in front" in entry.text for entry in entries), "it is told"
    )
    await operator.until(lambda: any("keys (" in entry.text for entry in entries), "what was dropped is told")
    assert operator.app.screen is question
    assert operator.app.store.stop is None


async def test_verbs_of_other_programs_leave_and_unknown_ones_are_explained(operator: Operator) -> None:
    operator.app.farewell = "The demo ends."
    await go_to(operator, MainPage)
    for line in ("q", "q!", "exit", "quit"):
        operator.app.run_typed(line)
        await operator.at(Confirm)
        await operator.sees("The demo ends.")
        await operator.press("escape")
        await operator.at(MainPage)
    operator.app.run_typed("pods")
    await operator.sees("no verb 'pods'; ? shows all keys and verbs")
    operator.app.run_typed("delte arm-1")
    await operator.sees("no verb 'delte'; did you mean delete?")


async def test_a_verb_of_the_shell_says_what_to_type_there_and_a_name_of_nobody_asks_nothing(
    operator: Operator,
) -> None:
    for line in ("run 'my day.session'", "watch arm-1", "wire", "wire ping --connect tcp:127.0.0.1:5760"):
        await operator.obey(line)
        await operator.sees("it is for a shell:")
        told = operator.app.store.entries[-1].text
        assert f"`robotree --realm test {line}`" in told
    for line, says in (
        ("delete nobody", "no robot named 'nobody' is running"),
        ("delete a/b", "'a/b' cannot be a name"),
        ("release nobody.arm", "no robot named 'nobody' is running"),
        ("resume a..b", "'a..b' cannot be a name"),
        ("call arm-1.go_to x=1 --within soon", "'soon' is no duration"),
    ):
        await operator.obey(line)
        await operator.sees(says)
        assert isinstance(operator.app.screen, MainPage), line
    await operator.obey("delete rover-1")
    await operator.at(Confirm)
