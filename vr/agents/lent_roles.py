"""The roles that services lend to one robot: offered while a service is listed, taken back when it leaves.

A service lists its roles (`Listing.roles`), so what ends the listing ends the loan: its end, the death of its
process, a lease of the lookup that ran out. A robot knows them as SERVICE-ROLE; the name of a service is its
own in the realm, and that of a role has no `-`, so none can lend under the name of another one. Only services
of the same user and the same site lend: what stands in a role is said and done by the robot.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from robotree.vr.agents.shared import DirectoryTask, Shared
from robotree.vr.base.address import user_of
from robotree.vr.base.description import Template
from robotree.vr.base.errors import VrError
from robotree.vr.base.transport import Transport
from robotree.vr.lookup.directory import Directory
from robotree.vr.lookup.union import Change
from robotree.vr.running.robot_runtime import RobotRuntime

if TYPE_CHECKING:
    from robotree.vr.scripts.roles.profile import Profile

_SERVICES = Template(role="robot", kind="Service")
_log = logging.getLogger(__name__)


def _is_of_a_service(change: Change) -> bool:
    return change.listing is not None and _SERVICES.matches(change.listing)


class LentRoles:
    """Has one robot know the roles of the services that are here. Lives on the event loop."""

    def __init__(self, runtime: RobotRuntime, transport: Transport, shared: Shared) -> None:
        """Look at nothing yet."""
        self._runtime = runtime
        failed = f"{runtime.name} is lent no more roles"
        self._task = DirectoryTask(shared, transport, self._look, concerns=_is_of_a_service, failed=failed)
        self._said: list[str] = []
        """What was logged at the last look."""

    def begin(self) -> None:
        """Look from now on, if the robot plays roles; look again: it has another page."""
        self._task.wake()
        if "RolePlayer" in self._runtime.robot.kinds():
            self._task.begin()

    async def close(self) -> None:
        """Look no more."""
        await self._task.close()

    async def _look(self, directory: Directory) -> None:
        from robotree.vr.scripts.roles.player import RolePlayer  # loaded already where one is

        robot = self._runtime.robot
        if not isinstance(robot, RolePlayer):
            return
        before = robot.attributes
        try:
            offered, said = self._offered(directory)
            said += robot.lend(offered)
        except VrError as error:  # it has just left for another host, where its next agent looks
            _log.debug("%s: %s", self._runtime.name, error)
            return
        for sentence in said:
            if sentence not in self._said:
                self._runtime.log.say("warning", sentence)
        self._said = said
        if robot.attributes != before:
            self._runtime.changed()

    def _offered(self, directory: Directory) -> tuple[dict[str, Profile], list[str]]:
        """Return the roles of the services that are listed, by the names by which robots know them.

        Returns:
            The roles, and a sentence for each service whose roles cannot be lent, whatever it has published.
        """
        from robotree.vr.scripts.roles.profile import lent_by

        user, offered, refused = user_of(self._runtime.key), dict[str, "Profile"](), list[str]()
        for listing in directory.find(_SERVICES):
            key = listing.address.key
            if not listing.roles or user_of(key) != user or directory.places.site_of(key):
                continue
            try:
                offered |= lent_by(listing.address.plain_name, listing.roles)
            except (VrError, TypeError) as error:
                refused.append(f"it does not take the roles of {listing.name}: {error}")
        return offered, refused
