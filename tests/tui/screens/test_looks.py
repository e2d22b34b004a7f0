"""Other colours and other words, chosen by key or line; at 80 by 24 they fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest
from textual.widgets._footer import FooterKey

from robotree.tui import words
from robotree.tui.screen.pages.dialogs import Confirm
from robotree.tui.screen.themes import chosen, read
from robotree.tui.screen.widgets.key_line import KeyLine

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


@pytest.mark.parametrize("code", ["de", "ar"])
async def test_a_person_reads_keys_headers_states_and_questions_in_another_language(
    realm: Realm, operate: Operate, code: str
) -> None:
    await realm.create("move_to.py", "mover")
    async with operate(realm.realm_client, size=(80, 24)) as operator:
        await operator.sees("mover", "rover-1", "STATE")
        await operator.press("colon")
        await operator.type(f"language {code}")
        await operator.press("enter")
        say = words.say
        await operator.sees(say("free"), say("STATE"), say("STOP"), say("New"), say("Help"))
        footer = [key.description for key in operator.one(KeyLine).query(FooterKey)]
        assert say("Help") in footer
        assert say("New") in footer
        assert all(len(line) <= 80 for line in operator.text.splitlines())
        operator.app.choose("mover")
        await operator.press("d")
        await operator.until(lambda: isinstance(operator.app.screen, Confirm), "a question")
        await operator.sees("delete mover?", say("Cancel"), say("Delete"))
        await operator.press("escape", "space")
        await operator.sees(say("PROTECTIVE STOP"), say("{key} resumes", key="R"), say("stopped"))
        await operator.press("colon")
        await operator.type("language xx")
        await operator.press("enter")
        await operator.sees("no language 'xx'")


async def test_a_person_changes_the_colours_by_key_and_by_name(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client, size=(80, 24)) as operator:
        app = operator.app
        app.wear(app.looks, [read('[colours]\nprimary = "#ffffff"\n', "desk", "desk.toml")])
        await operator.sees("rover-1")
        before = app.theme
        await operator.press("f8")
        assert app.theme != before
        await operator.press("colon")
        await operator.type("theme desk")
        await operator.press("enter")
        await operator.sees("theme desk")
        assert app.theme == chosen("desk", app.console.color_system, app.own_themes).name
        await operator.press("colon")
        await operator.type("theme neon")
        await operator.press("enter")
        await operator.sees("no theme 'neon'")
        assert app.store.entries[-1].text.endswith("robotree/themes/NAME.toml, read at the start")
        assert app.looks.get("theme", "") == "desk"
