"""The verb `restart`: a process that has gone is started again."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.tui.errors import CannotRestart
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome, Teller
from robotree.tui.processes.restarting import start_again

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.supervision.realm_client import RealmClient


async def restart(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Start a proxy, a host or another agent again whose process has gone."""
    from robotree.vr.base.address import ROLES, parted

    site, name = parted(line.text("NAME"))
    if site not in {"", realm_client.places.own}:
        raise CannotRestart(name, f"it is at site {site}: start it there")
    hangs = next((one for one in realm_client.hang() if one.key.split("/")[-2:-1] == [name]), None)
    if hangs is not None:
        raise CannotRestart(name, f"its process hangs: {hangs.remedy}, then start it again")
    if any(one.name == name for role in ROLES for one in realm_client.present(role)):
        raise CannotRestart(name, "it runs")
    said = await start_again(realm_client.realm, name)
    return Outcome({"restarted": name, "how": said}, said)
