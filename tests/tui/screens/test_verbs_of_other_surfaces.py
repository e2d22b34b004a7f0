"""A verb of another surface only says where it works; a screen that may only look offers no changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.tui.screen.pages.dialogs import Confirm
from robotree.tui.screen.pages.help import help_text
from robotree.tui.screen.pages.main import MainPage

if TYPE_CHECKING:
    from screens.conftest import Operate
    from tui.conftest import Realm


async def test_a_verb_of_the_shell_says_what_to_type_there_and_a_name_of_nobody_asks_nothing(
    realm: Realm, operate: Operate
) -> None:
    async with operate(realm.realm_client) as operator:
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


async def test_who_may_only_look_has_keys_that_look_and_the_stop(realm: Realm, operate: Operate) -> None:
    async with operate(realm.realm_client, readonly=True) as operator:
        await operator.until(lambda: "arm-1" in operator.app.store.descriptions)
        page = operator.app.main
        await operator.sees("realm test (read-only)")
        bound = {binding.binding.id for binding in page.active_bindings.values() if binding.enabled}
        assert bound.isdisjoint({"create", "enslave", "release", "delete", "cancel", "resume", "panel"})
        assert {"show", "stop", "help", "quit"} <= bound
        await operator.press("n", "e", "d", "enter", "R")
        assert operator.app.screen is page
        await operator.obey("delete rover-1")
        await operator.sees("no verb 'delete': this is read-only")
        shown = help_text(operator.app).plain
        assert "enslave PARENT.SLOT CHILD" not in shown
        assert "stop [NAME]" in shown
        assert all("delete" not in command.title for command in operator.app.get_system_commands(page))
        await operator.press("space")
        await operator.until(lambda: len(operator.app.store.stopped) == 2, "the stop")
