"""The kinds of robot that can be simulated: one registry. Only to build a robot loads the physics.

The engines are therefore imported inside the functions. To simulate another robot: add a folder with a model,
a device with verbs, its telemetry and its world, and one line here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Generic, NamedTuple, Protocol, TypeVar

from robotree.protocol.messages import MavComponent, MavProtocolCapability, MavType, Speech
from robotree.sim.errors import UnknownKind

if TYPE_CHECKING:
    from robotree.sim.arm.world import ArmWorld
    from robotree.sim.companion.world import CompanionWorld
    from robotree.sim.controller.controller import Controller
    from robotree.sim.controller.fence_file import FenceFile
    from robotree.sim.firmware import Gauges, Identity
    from robotree.sim.firmware.device import Device
    from robotree.sim.firmware.telemetry import Stream
    from robotree.sim.physics.cell import Cell
    from robotree.sim.rover.world import RoverWorld

NOTHING_MORE: Final = MavProtocolCapability(0)
"""The capabilities of a kind that has none beyond those of every controller of ours."""


BASE: Final = MavComponent.AUTOPILOT1
LEFT_ARM, RIGHT_ARM, HEAD = 25, 26, 27
"""Components of the companion; MAVLink leaves 25 to 99 to its users."""
EYE: Final = 102
"""MAV_COMP_ID_CAMERA3: the right eye; the left one is CAMERA2."""


class World(Protocol):
    """A cell, and what is known of the things in it."""

    @property
    def cell(self) -> "Cell":
        """The physics, and what moves in it."""
        ...


W = TypeVar("W", bound=World)


class Part(NamedTuple):
    """One MAVLink component of a controller, and the device that it moves.

    Attributes:
        component: its id.
        device: what it moves.
        streams: what it reports about that.
        mav_type: what its heartbeats say that it is.
        capabilities: what it offers beyond every controller of ours.
        speech: takes a text that is to be spoken; None: it cannot speak.
    """

    component: int
    device: "Device"
    streams: "Sequence[Stream]"
    mav_type: MavType
    capabilities: MavProtocolCapability = NOTHING_MORE
    speech: "Callable[[Speech], None] | None" = None


def _counters(_: World) -> "Gauges":
    from robotree.sim.firmware import Gauges

    return Gauges()


@dataclass(frozen=True, slots=True)
class Kind(Generic[W]):
    """A kind of robot.

    Attributes:
        name: as people write it.
        summary: one line for people.
        world: builds its world, in its first place.
        parts: the components of its controller in that world; the first one answers for all.
        cameras: names of the cameras in its cell by their MAVLink component.
        gauges: what is measured of it outside of its programs.
    """

    name: str
    summary: str
    world: Callable[[], W]
    parts: "Callable[[W], Sequence[Part]]"
    cameras: Mapping[int, str] = field(default_factory=dict[int, str])
    gauges: "Callable[[W], Gauges]" = _counters

    def build(self, system: int, silence: float, memory: "FenceFile | None" = None) -> "Controller":
        """A controller with a world of its own.

        Args:
            system: its MAVLink system id.
            silence: of the link that it bears [s].
            memory: what it knows of its earlier lives; None: nothing, and it keeps nothing.
        """
        from robotree.sim.controller.fence_file import FenceFile

        return self._controller(self.world(), system, silence, memory or FenceFile(None))

    def controller(self, world: W, system: int, silence: float) -> "Controller":
        """A controller of a world that was built already; it reports no wall clock, and keeps nothing."""
        return self._controller(world, system, silence, None)

    def _controller(self, world: W, system: int, silence: float, memory: "FenceFile | None") -> "Controller":
        from robotree.sim.controller.controller import Controller
        from robotree.sim.firmware import COMPONENT, Firmware

        gauges = self.gauges(world)
        programs: list[Firmware] = []
        for part in self.parts(world):
            known = memory and (
                memory if part.component == COMPONENT else memory.of_component(part.component)
            )
            programs.append(
                Firmware(
                    part.device,
                    part.streams,
                    system=system,
                    component=part.component,
                    mav_type=part.mav_type,
                    silence=silence,
                    identity=None if known is None else self._identity(system, part, known.life),
                    fence=None if known is None else known.fence,
                    gauges=gauges,
                    speech=part.speech,
                )
            )
        return Controller(world.cell, programs[0], self.cameras, programs[1:])

    def _identity(self, system: int, part: Part, life: int) -> "Identity":
        """The identity of a component; its uid is the same at every start, its life is not."""
        from hashlib import sha256
        from importlib.metadata import version
        from time import time

        from robotree.sim.firmware import Identity

        uid = int.from_bytes(sha256(f"robotree {self.name} {system}".encode()).digest()[:8])
        return Identity(
            version=version("robotree"), uid=uid, capabilities=part.capabilities, wall=time, life=life
        )


def kind(name: str) -> Kind[Any]:
    """The kind of that name.

    Raises:
        UnknownKind: there is none.
    """
    if (found := KINDS.get(name)) is None:
        raise UnknownKind(name, KINDS)
    return found


def _arm_world() -> "ArmWorld":
    from robotree.sim.arm import world

    return world.build()


def _arm_parts(world: "ArmWorld") -> "Sequence[Part]":
    from robotree.sim.arm.world import streams

    return (
        Part(
            MavComponent.AUTOPILOT1, world.arm, streams(world), MavType.GENERIC, MavProtocolCapability.GRIPPER
        ),
    )


def _rover_world() -> "RoverWorld":
    from robotree.sim.rover import world

    return world.build()


def _rover_parts(world: "RoverWorld") -> "Sequence[Part]":
    from robotree.sim.rover.world import streams

    return (Part(MavComponent.AUTOPILOT1, world.rover, streams(world), MavType.GROUND_ROVER),)


def _companion_world() -> "CompanionWorld":
    from robotree.sim.companion import world

    return world.build()


def _companion_parts(world: "CompanionWorld") -> "Sequence[Part]":
    from robotree.sim.companion.world import base_streams, head_streams, limb_streams

    body, gripper = world.body, MavProtocolCapability.GRIPPER
    left, right = body.limbs
    head = head_streams(world)
    return (
        Part(BASE, body.base, base_streams(world), MavType.GROUND_ROVER),
        Part(LEFT_ARM, left, limb_streams(left), MavType.GENERIC, gripper),
        Part(RIGHT_ARM, right, limb_streams(right), MavType.GENERIC, gripper),
        Part(HEAD, body.head, head, MavType.GENERIC, speech=body.head.hear),
    )


ARM: Final["Kind[ArmWorld]"] = Kind(
    "arm",
    "a compliant six-joint arm with a gripper, at a table with a bistable lever",
    _arm_world,
    _arm_parts,
    {MavComponent.CAMERA: "cell", MavComponent.CAMERA2: "arm/wrist"},
)
ROVER: Final["Kind[RoverWorld]"] = Kind(
    "rover",
    "a holonomic mobile robot on a walled floor",
    _rover_world,
    _rover_parts,
    {MavComponent.CAMERA: "cell", MavComponent.CAMERA2: "rover/front"},
)
COMPANION: Final["Kind[CompanionWorld]"] = Kind(
    "companion",
    "a wheeled base with a waist, two arms and a head, in a flat with cups and visitors",
    _companion_world,
    _companion_parts,
    {MavComponent.CAMERA: "cell", MavComponent.CAMERA2: "companion/eye_left", EYE: "companion/eye_right"},
    lambda world: world.gauges,
)
KINDS: Final[Mapping[str, Kind[Any]]] = {each.name: each for each in (ARM, ROVER, COMPANION)}
"""The worlds that can be simulated."""
