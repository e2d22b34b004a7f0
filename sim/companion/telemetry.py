"""The reports of each component of the companion. Pure: readings in, messages out."""

from collections.abc import Sequence
from typing import Final

from robotree.protocol.messages import (
    BaseState,
    Joints,
    LocalPositionNed,
    Message,
    NamedValueFloat,
    Speech,
    Tags,
)
from robotree.sim.arm.telemetry import hand_streams, padded
from robotree.sim.companion.limb import Limb
from robotree.sim.companion.world import CompanionWorld
from robotree.sim.firmware.telemetry import HOT, WARM, Stream

TOLD_AGAIN: Final = 500
"""[ms] between two repetitions of the latest that was heard."""
PLACES: Final = 12
"""Tags in one message."""
LONGEST_AGO: Final = 0xFFFF


def limb_streams(limb: Limb) -> tuple[Stream, ...]:
    """Those of its hand, in B; `peak_f` (N) less often."""

    def values(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001  the shape of Stream.read
        return (NamedValueFloat(now, "peak_f", limb.state().peak_force),)

    return (*hand_streams(limb), Stream(NamedValueFloat, WARM, values))


def head_streams(world: CompanionWorld) -> tuple[Stream, ...]:
    """JOINTS of the neck often; TAGS that were seen and the latest SPEECH that was heard less so."""
    flat = world.flat

    def joints(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        return (Joints(time_boot_ms=now, position=padded(flat.body.head.q), count=2),)

    def tags(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        seen = sorted(flat.sights.items(), key=lambda each: -each[1].seen)[:PLACES]
        blank = (0.0,) * (PLACES - len(seen))
        x, y, z = ((*(sight.at[axis] for _, sight in seen), *blank) for axis in range(3))
        ages = [min(round(100 * (flat.now - sight.seen)), LONGEST_AGO) for _, sight in seen]
        none = (0,) * (PLACES - len(seen))
        return (Tags(now, x, y, z, (*ages, *none), bytes((*(tag for tag, _ in seen), *none)), len(seen)),)

    def heard(_: int, __: bool) -> Sequence[Message]:  # noqa: FBT001
        latest = flat.heard
        return (Speech(latest.at, latest.number, 0, 0, latest.speaker, latest.text),) if latest.number else ()

    return (
        Stream(Joints, HOT, joints),
        Stream(Tags, WARM, tags),
        Stream(Speech, TOLD_AGAIN, heard),
    )


def base_streams(world: CompanionWorld) -> tuple[Stream, ...]:
    """LOCAL_POSITION_NED and BASE often; SYS_STATUS, which every controller sends, has the battery."""
    flat = world.flat

    def pose(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        look = flat.body.base.look()
        (x, y, _heading), (vx, vy, _turning) = look.place.tolist(), look.rate.tolist()
        return (LocalPositionNed(now, x, -y, 0.0, vx, -vy, 0.0),)

    def base(now: int, _: bool) -> Sequence[Message]:  # noqa: FBT001
        look, body = flat.body.base.look(), flat.body
        x, y, heading = look.place.tolist()
        vx, vy, turning = look.rate.tolist()
        charging = int(flat.battery.charging)
        nearest = min(body.nearest, 100.0)
        return (BaseState(now, x, y, heading, vx, vy, turning, look.lean, body.balance(), nearest, charging),)

    return (Stream(LocalPositionNed, HOT, pose), Stream(BaseState, WARM, base))
