"""The full screen over a realm: that of operators, that of people who do not operate robots, the composer."""

from __future__ import annotations

import os

from robotree.tui.errors import NeedsTerminal
from robotree.tui.line.grammar import Line
from robotree.tui.line.installed import require
from robotree.tui.processes.realm import only_looking
from robotree.tui.processes.to_the_end import to_the_end
from robotree.tui.terminal import no_screen


def supervise(line: Line, realm: str) -> int:
    """Show what is in a realm: drawn, or in lines."""
    if line.flag("--plain") or os.environ.get("ROBOTREE_PLAIN", "") not in {"", "0"}:
        readonly = only_looking(given=line.flag("--readonly"))
        from robotree.tui.plain import supervise_in_lines

        return to_the_end(supervise_in_lines(realm, readonly=readonly), on_screen=True)
    require(line.verb, "tui")
    take_calm(line)
    return to_the_end(_shown(line, realm), on_screen=True)


def compose(line: Line, realm: str) -> int:
    """Make a page of a file, also where no realm is; or open the composer."""
    if not line.text("--from"):
        require(line.verb, "tui")
        return to_the_end(_shown(line, realm), on_screen=True)
    from robotree.tui.line.shell import apart

    return to_the_end(apart(line, realm))


def take_calm(line: Line) -> None:
    """Hand `--calm` over to the screen, and to whatever it starts."""
    if line.flag("--calm"):
        os.environ["ROBOTREE_CALM"] = "1"


async def _shown(line: Line, realm: str) -> int:
    """Join the realm and show the screen of a verb."""
    if without := no_screen():
        raise NeedsTerminal(without)
    from robotree.client.joining import joined
    from robotree.tui.line import taken
    from robotree.tui.line.carrying import Silent
    from robotree.tui.screen import keymap
    from robotree.tui.screen.app import Composer, Supervisor
    from robotree.tui.screen.supervise import supervise
    from robotree.tui.screen.user_app import UserApp

    keymap.load()  # one that is wrong is told before anything begins
    app = {"user": UserApp, "compose": Composer}.get(line.verb, Supervisor)
    readonly = only_looking(given=line.flag("--readonly"))
    async with joined(realm) as realm_client:
        await taken.merge(realm_client, Silent())
        return await supervise(realm_client, realm, readonly=readonly, screen=app)
