"""Agents as people are shown them: with their site, where another site has an agent of that name. Pure."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import msgspec

from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing, RobotDescription
from robotree.vr.base.presence import Held
from robotree.vr.base.requests import HostDescribed, SpaceDescribed

Show = Callable[[Address], Address]
"""Returns an address as people are shown it (`Places.shown`)."""

_Agent = TypeVar("_Agent", Listing, HostDescribed, SpaceDescribed)


def shown_agent(agent: _Agent, show: Show) -> _Agent:
    """Return a listing, or what a host or a space says of itself."""
    address = show(agent.address)
    found = agent if address is agent.address else msgspec.structs.replace(agent, address=address)
    if isinstance(found, HostDescribed) and (robots := tuple(map(show, found.robots))) != found.robots:
        return msgspec.structs.replace(found, robots=robots)
    return found


def shown_robot(robot: RobotDescription, show: Show) -> RobotDescription:
    """Return a description in which the robot, its parent and its children are named."""
    slots = tuple(
        slot
        if slot.child is None or (child := show(slot.child)) is slot.child
        else msgspec.structs.replace(slot, child=child)
        for slot in robot.slots
    )
    bond = robot.bond
    if bond is not None and (parent := show(bond.parent)) is not bond.parent:
        bond = msgspec.structs.replace(bond, parent=parent)
    address = show(robot.address)
    if address is robot.address and bond is robot.bond and slots == robot.slots:
        return robot
    return msgspec.structs.replace(robot, address=address, bond=bond, slots=slots)


def shown_held(held: Held, show: Show) -> Held:
    """Return what a process holds, with a key that `shown_address` reads."""
    address = Address.parse(held.key)
    if address is None or (found := show(address)) is address:
        return held
    return msgspec.structs.replace(held, key=f"{found.role}/{found.name}/{found.incarnation}")
