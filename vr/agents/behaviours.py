"""The behaviours of the services of one host: which of its robots belong to which service."""

from __future__ import annotations

from typing import NamedTuple

from robotree.vr.agents.agent import RobotAgent
from robotree.vr.author.robot import Robot
from robotree.vr.author.service import Service
from robotree.vr.base.address import check_name
from robotree.vr.base.description import SlotSpec
from robotree.vr.bundle import Bundle


class Behaviour(NamedTuple):
    """One behaviour of a service, as it is to be."""

    name: str
    """Of its robot: `SERVICE-BEHAVIOUR`."""
    bundle: Bundle


def behaviours_of(robot: Robot, path: str) -> list[Behaviour]:
    """Return the behaviours that a service brings; of another robot, none.

    Args:
        robot: the service.
        path: of its page, for messages.

    Raises:
        BadName: the two names together are too long.
    """
    if not isinstance(robot, Service):
        return []
    return [
        Behaviour(check_name(f"{robot.name}-{name}"), Bundle(text, f"{path}/{name}.yaml"))
        for name, text in robot.behaviours.items()
    ]


def own_slots(service: RobotAgent, behaviour: RobotAgent) -> list[SlotSpec]:
    """Return the empty slots of a behaviour that are for the service itself, by its own kind."""
    kind = service.robot.kinds()[0]
    slots = behaviour.description().slots
    return [slot for slot in slots if slot.kind == kind and not slot.filled]
