"""What the rover tells about itself. Pure: readings in, messages out."""

from collections.abc import Sequence

from robotree.protocol.messages import LocalPositionNed, Message
from robotree.sim.firmware.telemetry import HOT, Stream
from robotree.sim.rover.world import RoverWorld


def streams(world: RoverWorld) -> tuple[Stream, ...]:
    """LOCAL_POSITION_NED: W is x forward, y left, z up, the message's frame x forward, y right, z down."""

    def pose(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        state = world.rover.state()
        (x, y), (vx, vy) = state.position.tolist(), state.velocity.tolist()
        return (LocalPositionNed(now, x, -y, 0.0, vx, -vy, 0.0),)

    return (Stream(LocalPositionNed, HOT, pose),)
