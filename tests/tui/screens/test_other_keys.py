"""With the preset of k9s the screen has its keys, in footer and help, too; the stop stays where it was."""

from __future__ import annotations

from typing import TYPE_CHECKING

from textual.widgets._footer import FooterKey

from robotree.tui.screen.keymap import Keymap, read
from robotree.tui.screen.pages.dialogs import Confirm, Reading
from robotree.tui.screen.widgets.key_line import KeyLine

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm

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
