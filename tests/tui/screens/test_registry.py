"""The registry feeds the keys: what the screen binds, asks and explains comes from there, or is chosen."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pkgutil import iter_modules
from typing import TYPE_CHECKING

import pytest
from textual.binding import Binding
from textual.dom import DOMNode
from textual.widgets import Button, Input
from textual.widgets._footer import FooterKey

from robotree.tui.line.action import About, Scope, Where, spell
from robotree.tui.line.actions import ACTIONS
from robotree.tui.line.page_keys import KEYS_BY_ID, PAGE_KEYS, PAGES, page_keys
from robotree.tui.screen import pages
from robotree.tui.screen.app import Supervisor
from robotree.tui.screen.asking import ASK, DANGERS
from robotree.tui.screen.keymap import Keymap, read
from robotree.tui.screen.pages.dialogs import Confirm, Reading
from robotree.tui.screen.pages.help import help_text, page_rows
from robotree.tui.screen.pages.main import PANES, MainPage
from robotree.tui.screen.pages.page import Page
from robotree.tui.screen.pages.panel import PanelPage
from robotree.tui.screen.widgets.key_line import KeyLine

if TYPE_CHECKING:
    from screens.conftest import Operate, Operator
    from tui.conftest import Realm


def keys(holder: type[Supervisor | Page]) -> set[str]:
    return {binding.key for binding in holder.BINDINGS if isinstance(binding, Binding)}


def test_every_action_of_the_screen_knows_what_to_ask_and_nothing_else_does() -> None:
    shown = {action.verb for action in ACTIONS if action.where & Where.SCREEN}
    typed_alone = {action.verb for action in ACTIONS if action.where & Where.PROMPT and not action.run}
    assert ASK.keys() <= shown | typed_alone
    assert not {action.verb for action in ACTIONS if action.verb in shown - ASK.keys() and not action.run}
    assert typed_alone <= ASK.keys()
    assert DANGERS.keys() >= {action.verb for action in ACTIONS if action.danger}
    assert PANES.keys() <= ASK.keys()


def test_a_key_works_in_the_scope_that_the_registry_says_and_only_there() -> None:
    for action in ACTIONS:
        for key in filter(None, (action.key, action.typing_key)):
            assert (key in keys(Supervisor)) == (action.scope is Scope.PROGRAM), key
            assert (key in keys(MainPage)) == (action.scope is Scope.PAGE), key
    told = {key for one in ACTIONS if one.scope is Scope.PROGRAM for key in (one.key, one.typing_key) if key}
    assert keys(Supervisor) == told, "the program has no key of its own"


def test_only_what_is_on_the_screen_is_about_something_there() -> None:
    assert all(action.key for action in ACTIONS if action.about is not About.NOTHING)
    assert all(action.scope is Scope.PAGE for action in ACTIONS if action.about is not About.NOTHING)


def holders(above: type[DOMNode]) -> Iterator[tuple[str, type[DOMNode]]]:
    """Yield each page and widget that binds keys of a page of the registry, behind the name of that page."""
    for holder in above.__subclasses__():
        names = {key.page for binding in own_bindings(holder) if (key := KEYS_BY_ID.get(binding.id or ""))}
        yield from ((name, holder) for name in names)
        yield from holders(holder)


def own_bindings(holder: type[DOMNode]) -> list[Binding]:
    return [binding for binding in holder.BINDINGS if isinstance(binding, Binding)]


for module in iter_modules(pages.__path__, f"{pages.__name__}."):
    import_module(module.name)
HOLDERS = sorted(set(holders(DOMNode)), key=str)


def test_each_page_of_the_registry_has_somebody_who_binds_its_keys() -> None:
    assert {name for name, _ in HOLDERS} == {page.name for page in PAGES}


@pytest.mark.parametrize(("name", "holder"), HOLDERS)
def test_every_key_of_a_page_comes_from_the_registry_and_is_explained(
    name: str, holder: type[DOMNode]
) -> None:
    bound = {(binding.id, binding.key) for binding in own_bindings(holder)}
    assert bound == {(key.id, key.key) for key in page_keys(name)}
    assert all(key.help.endswith(".") for key in page_keys(name))


def test_one_letter_has_one_meaning_in_the_whole_program() -> None:
    meanings: dict[str, set[str]] = {}
    for action in ACTIONS:
        meanings.setdefault(action.key, set()).add(action.verb)
    for one in PAGE_KEYS:
        for key in one.key.split(","):
            meanings.setdefault(key, set()).add(one.verb or one.id)
    letters = {key: told for key, told in meanings.items() if len(key) == 1}
    assert {key: told for key, told in letters.items() if len(told) > 1} == {}
    assert letters["c"] == {"cancel"}


async def test_the_help_explains_every_key_of_the_registry_and_of_the_pages(operator: Operator) -> None:
    lines = [" ".join(line.split()) for line in help_text(operator.app).plain.splitlines()]
    wanted = [
        f"{spell(action.key)} {f'{action.typing_key} ' if action.typing_key else ''}{action.help}"
        for action in ACTIONS
        if action.key and action.verb != "stop"
    ]
    wanted += [
        f"{told} {meaning}"
        for page in ("panel", "teleop", "new")
        for told, meaning in page_rows(page, operator.app.keymap)
    ]
    assert [one for one in wanted if " ".join(one.split()) not in lines] == []


async def test_the_programs_keys_work_beside_a_button_and_are_letters_in_a_field(
    realm: Realm, operator: Operator
) -> None:
    page = await operator.panel()
    field = page.query(Input).first()
    field.focus()
    await operator.press("ctrl+u", "R", "question_mark", "space")
    assert field.value == "R? "
    assert operator.app.store.stopped == ()
    page.query_one("#run", Button).focus()
    await operator.press("space")
    await operator.until(lambda: len(operator.app.store.stopped) == 2, "the stop")
    assert page.query_one("#run", Button).has_focus
    await operator.press("question_mark")
    await operator.at(Reading)
    await operator.press("escape")
    await operator.at(PanelPage)
    await operator.press("R")
    await operator.at(Confirm)
    assert realm.arm.calls == [], "no key of the program presses the button"


K9S = read('preset = "k9s"\n[keys]\npanel.run = "f5"\nfilter = "f3"\nresume = "f6"', "keys.toml")


async def test_the_keys_of_k9s_and_others_that_a_person_has_chosen(realm: Realm, operate: Operate) -> None:
    await realm.create("move_to.py", "mover")
    async with operate(realm.realm_client, keymap=K9S) as operator:
        await operator.until(lambda: "mover" in operator.app.store.descriptions, "its description")
        operator.app.choose("mover")
        await operator.sees("^d Delete", "f3 Filter")
        await operator.press("d")
        await operator.at(Reading)
        await operator.sees("VirtualRobot")
        await operator.press("escape", "ctrl+d")
        await operator.at(Confirm)
        await operator.sees("delete mover?")
        await operator.press("escape", "question_mark")
        await operator.at(Reading)
        await operator.sees("f6 resumes")
        await operator.press("escape", "f3", "space", "x")
        assert operator.app.store.stopped == (), "a space that is typed stops nobody"
        await operator.press("escape", "space")
        await operator.sees("f6 resumes")
        await operator.press("f6")
        await operator.at(Confirm)
        await operator.press("right", "enter")
        await operator.until(lambda: operator.app.store.stopped == (), "they are resumed")
        await operator.panel()
        await operator.sees("f5 Run")
        await operator.press(*["down"] * 3, "enter")
        await operator.sees("f5 runs it, or the button")
        await operator.press("f5")
        await operator.sees("done in")


async def test_a_changed_key_stays_at_its_place_in_the_footer(realm: Realm, operate: Operate) -> None:
    await realm.create("move_to.py", "mover")

    async def footer(keymap: Keymap) -> list[str]:
        async with operate(realm.realm_client, keymap=keymap) as operator:
            await operator.sees("Help", "Filter")
            line = operator.one(KeyLine)
            before = list(line.children)
            with line._context():
                await line.recompose()
            assert list(line.children) == before, "a line whose keys stay the same is not built anew"
            return [key.description for key in line.query(FooterKey)]

    changed = read('[keys]\ncreate = "f2"\nfilter = "f3"\nhelp = "f4"', "keys.toml")
    usual = await footer(Keymap())
    assert {"New", "Filter", "Help"} <= {*usual}
    assert await footer(changed) == usual
