"""The kinds of robot that can be simulated: one registry. Listing it loads no physics, building from it does.

The engines are therefore imported inside the builders. To simulate another robot: a model, a device with
verbs, a world, its streams, and one line here.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from robotree.protocol.messages import MavComponent, MavProtocolCapability, MavType
from robotree.sim.errors import UnknownKind

if TYPE_CHECKING:
    from robotree.sim.controller import Controller
    from robotree.sim.firmware import Identity

NOTHING_MORE: Final = MavProtocolCapability(0)
"""What a kind offers beyond every controller of ours, if nothing."""


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of robot.

    Attributes:
        name: as people write it.
        summary: one line for people.
        build: makes its controller from a system id and the silence [s] that it bears.
    """

    name: str
    summary: str
    build: "Callable[[int, float], Controller]"


def kind(name: str) -> Kind:
    """The kind of that name.

    Raises:
        UnknownKind: there is none.
    """
    if (found := KINDS.get(name)) is None:
        raise UnknownKind(name, KINDS)
    return found


def _identity(kind: str, system: int, capabilities: MavProtocolCapability = NOTHING_MORE) -> "Identity":
    """What the controller of a simulated robot says of itself; its uid is the same at every start."""
    from hashlib import sha256
    from importlib.metadata import version
    from time import time

    from robotree.sim.firmware import Identity

    uid = int.from_bytes(sha256(f"robotree {kind} {system}".encode()).digest()[:8])
    return Identity(version=version("robotree"), uid=uid, capabilities=capabilities, wall=time)


def _arm(system: int, silence: float) -> "Controller":
    from robotree.sim import telemetry, worlds
    from robotree.sim.controller import Controller
    from robotree.sim.firmware import Firmware

    world = worlds.arm_world()
    streams = telemetry.arm_streams(world)
    identity = _identity("arm", system, MavProtocolCapability.GRIPPER)
    firmware = Firmware(
        world.arm, streams, system=system, mav_type=MavType.GENERIC, silence=silence, identity=identity
    )
    cameras: dict[int, str] = {MavComponent.CAMERA: "cell", MavComponent.CAMERA2: "arm/wrist"}
    return Controller(world.cell, firmware, cameras)


def _rover(system: int, silence: float) -> "Controller":
    from robotree.sim import telemetry, worlds
    from robotree.sim.controller import Controller
    from robotree.sim.firmware import Firmware

    world = worlds.rover_world()
    streams = telemetry.rover_streams(world)
    identity = _identity("rover", system)
    firmware = Firmware(
        world.rover, streams, system=system, mav_type=MavType.GROUND_ROVER, silence=silence, identity=identity
    )
    cameras: dict[int, str] = {MavComponent.CAMERA: "cell", MavComponent.CAMERA2: "rover/front"}
    return Controller(world.cell, firmware, cameras)


KINDS: Final = {
    each.name: each
    for each in (
        Kind("arm", "a compliant six-joint arm with a gripper, at a table with a bistable lever", _arm),
        Kind("rover", "a holonomic mobile robot on a walled floor", _rover),
    )
}
