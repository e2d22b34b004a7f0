"""Robots that are known while no lookup service runs: those that are seen alive describe themselves."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.base.description import Listing, RobotDescription
    from robotree.vr.supervision.realm_client import RealmClient


async def known(realm_client: RealmClient, role: Literal["robot", "view"]) -> Sequence[Listing]:
    """Return what a lookup service would list, as far as it can be known.

    Args:
        realm_client: what it remembers of lookup services that were lost is part of it.
        role: of the agents.

    Returns:
        A listing each; robots that are enslaved are left out, as they are from every list.
    """
    return await views(realm_client) if role == "view" else robots(realm_client, await realm_client.tree())


def robots(realm_client: RealmClient, tree: Sequence[RobotDescription]) -> list[Listing]:
    """Return what is known of the free robots: `known`, by one who has asked for the tree already."""
    described = {robot.name: robot for robot in tree}
    remembered = [one for one in realm_client.robots() if one.name not in described]
    return [*remembered, *(_listing(robot) for robot in described.values() if robot.bond is None)]


def _listing(robot: RobotDescription) -> Listing:
    from robotree.vr.base.description import Listing

    return Listing(
        address=robot.address,
        kinds=robot.kinds,
        doc=robot.doc.partition("\n")[0],
        host=robot.host,
        commands=tuple(command.name for command in robot.commands if command.available),
        attributes=robot.attributes,
    )


async def views(realm_client: RealmClient) -> list[Listing]:
    """Return what is known of the views: see `known`."""
    from robotree.vr.base.description import Listing
    from robotree.vr.base.errors import VrError

    found = {view.name: view for view in realm_client.views()}
    for address in realm_client.present("view"):
        with contextlib.suppress(VrError):  # it has gone meanwhile
            cameras = (await realm_client.describe_view(address.name)).cameras
            found.setdefault(
                address.name,
                Listing(address=address, kinds=("View",), attributes={"cameras": ", ".join(cameras)}),
            )
    return list(found.values())
