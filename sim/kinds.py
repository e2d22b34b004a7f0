"""The kinds of robot that can be simulated: one registry. Listing it loads no physics, building from it does.

The engines are therefore imported inside the functions. To simulate another robot: a folder with a model, a
device with verbs, its telemetry and its world, and one line here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, Generic, Protocol, TypeVar

from robotree.protocol.messages import MavComponent, MavProtocolCapability, MavType
from robotree.sim.errors import UnknownKind

if TYPE_CHECKING:
    from robotree.protocol.services.fence import Fence
    from robotree.sim.arm.world import ArmWorld
    from robotree.sim.controller.controller import Controller
    from robotree.sim.controller.fence_file import FenceFile
    from robotree.sim.firmware import Identity
    from robotree.sim.firmware.telemetry import Stream
    from robotree.sim.physics.cell import Cell
    from robotree.sim.rover.world import RoverWorld

NOTHING_MORE: Final = MavProtocolCapability(0)
"""What a kind offers beyond every controller of ours, if nothing."""


class World(Protocol):
    """A cell, and what is known of the things in it."""

    @property
    def cell(self) -> "Cell":
        """The physics, and the one device that moves in it."""
        ...


W = TypeVar("W", bound=World)


@dataclass(frozen=True, slots=True)
class Kind(Generic[W]):
    """A kind of robot.

    Attributes:
        name: as people write it.
        summary: one line for people.
        world: builds its world, in its first place.
        streams: what it tells about itself in that world.
        mav_type: what its heartbeats say that it is.
        cameras: names of the cameras in its cell by their MAVLink component.
        capabilities: what it offers beyond every controller of ours.
    """

    name: str
    summary: str
    world: Callable[[], W]
    streams: "Callable[[W], Sequence[Stream]]"
    mav_type: MavType
    cameras: Mapping[int, str] = field(default_factory=dict[int, str])
    capabilities: MavProtocolCapability = NOTHING_MORE

    def build(self, system: int, silence: float, memory: "FenceFile | None" = None) -> "Controller":
        """A controller with a world of its own.

        Args:
            system: its MAVLink system id.
            silence: of the link that it bears [s].
            memory: what it knows of its earlier lives; None: nothing, and it keeps nothing.
        """
        from robotree.sim.controller.fence_file import FenceFile

        known = memory or FenceFile(None)
        return self.controller(self.world(), system, silence, self._identity(system, known.life), known.fence)

    def controller(
        self,
        world: W,
        system: int,
        silence: float,
        identity: "Identity | None" = None,
        fence: "Fence | None" = None,
    ) -> "Controller":
        """A controller of a world that was built already; without an identity it tells no wall clock."""
        from robotree.sim.controller.controller import Controller
        from robotree.sim.firmware import Firmware

        firmware = Firmware(
            world.cell.device,
            self.streams(world),
            system=system,
            mav_type=self.mav_type,
            silence=silence,
            identity=identity,
            fence=fence,
        )
        return Controller(world.cell, firmware, self.cameras)

    def _identity(self, system: int, life: int) -> "Identity":
        """What the controller says of itself; its uid is the same at every start, its life is not."""
        from hashlib import sha256
        from importlib.metadata import version
        from time import time

        from robotree.sim.firmware import Identity

        uid = int.from_bytes(sha256(f"robotree {self.name} {system}".encode()).digest()[:8])
        return Identity(
            version=version("robotree"), uid=uid, capabilities=self.capabilities, wall=time, life=life
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


def _arm_streams(world: "ArmWorld") -> "Sequence[Stream]":
    from robotree.sim.arm import telemetry

    return telemetry.streams(world)


def _rover_world() -> "RoverWorld":
    from robotree.sim.rover import world

    return world.build()


def _rover_streams(world: "RoverWorld") -> "Sequence[Stream]":
    from robotree.sim.rover.world import streams

    return streams(world)


ARM: Final["Kind[ArmWorld]"] = Kind(
    "arm",
    "a compliant six-joint arm with a gripper, at a table with a bistable lever",
    _arm_world,
    _arm_streams,
    MavType.GENERIC,
    {MavComponent.CAMERA: "cell", MavComponent.CAMERA2: "arm/wrist"},
    MavProtocolCapability.GRIPPER,
)
ROVER: Final["Kind[RoverWorld]"] = Kind(
    "rover",
    "a holonomic mobile robot on a walled floor",
    _rover_world,
    _rover_streams,
    MavType.GROUND_ROVER,
    {MavComponent.CAMERA: "cell", MavComponent.CAMERA2: "rover/front"},
)
KINDS: Final[Mapping[str, Kind[Any]]] = {each.name: each for each in (ARM, ROVER)}
"""The worlds that can be simulated."""
