"""The messages and enumerations of robotree.xml, which says what they mean."""

from __future__ import annotations

from enum import IntEnum
from typing import ClassVar

from robotree.protocol.messages.base import Message, wire


class Verb(IntEnum):
    """ROBOTREE_VERB: what a goal asks for."""

    STATUS = 0
    GO_TO = 1
    GRIP = 2
    MOVE = 3
    HOLD = 4


class GoalState(IntEnum):
    """ROBOTREE_GOAL_STATE: the life of a goal."""

    UNKNOWN = 0
    ACCEPTED = 1
    ACTIVE = 2
    SUCCEEDED = 3
    REFUSED = 4
    FAILED = 5
    CANCELLED = 6
    EXPIRED = 7

    @property
    def final(self) -> bool:
        """Whether nothing more will come of the goal."""
        return self >= GoalState.SUCCEEDED


class Reason(IntEnum):
    """ROBOTREE_REASON: why a goal ended as it did, or why a mode was entered."""

    NONE = 0
    OUT_OF_REACH = 1
    PATH_BLOCKED = 2
    BAD_ARGUMENT = 3
    UNKNOWN_VERB = 4
    STALE_EPOCH = 5
    KEY_REUSED = 6
    STOPPED = 7
    BLOCKED = 8
    SUPERSEDED = 9
    LINK_SILENT = 10
    OPERATOR = 11
    FAULT = 12
    NOT_IN_CONTROL = 13
    BAD_EPOCH = 14
    OTHER_LIFE = 15


class ModeKind(IntEnum):
    """ROBOTREE_MODE_KIND: what the controller is doing as a whole."""

    STARTING = 0
    READY = 1
    ACTIVE = 2
    HOLD = 3
    SAFE_STOP = 4
    FAULT = 5


class ClaimWish(IntEnum):
    """ROBOTREE_CLAIM_WISH: what a claim asks for."""

    KEEP = 1
    TAKE_OVER = 2
    RELEASE = 3


class GripperState(IntEnum):
    """ROBOTREE_GRIPPER_STATE: what the gripper is doing."""

    AT_WIDTH = 0
    MOVING = 1
    HOLDING = 2


class SetpointKind(IntEnum):
    """ROBOTREE_SETPOINT_KIND: what a set-point says."""

    TOOL_POSE = 1
    TOOL_VELOCITY = 2
    BASE_VELOCITY = 3
    JOINTS = 4


@wire("ROBOTREE_JOINTS")
class Joints(Message, frozen=True, gc=False):
    """Joint positions; the first `count` of the eight are used."""

    finite: ClassVar[bool] = True

    time_boot_ms: int
    position: tuple[float, ...]
    """(8,) [rad] or [m]."""
    count: int


@wire("ROBOTREE_TOOL")
class Tool(Message, frozen=True, gc=False):
    """Pose of the tool in W, and the wrench of the world on it."""

    finite: ClassVar[bool] = True

    time_boot_ms: int
    x: float
    y: float
    z: float
    fx: float
    fy: float
    fz: float
    tx: float
    ty: float
    tz: float
    q: tuple[int, ...]
    """(4,) unit quaternion w, x, y, z, each times 32767."""
    busy: int


@wire("ROBOTREE_GRIPPER")
class Gripper(Message, frozen=True, gc=False):
    """State of the gripper."""

    finite: ClassVar[bool] = True

    time_boot_ms: int
    width: float
    commanded: float
    force: float
    state: int


@wire("ROBOTREE_GOAL")
class Goal(Message, frozen=True, gc=False):
    """Asks for one movement, at most once per key."""

    key: int
    epoch: int
    ttl_ms: int
    args: tuple[float, ...]
    """(7,) arguments of the verb; NaN: as it is now."""
    verb: int
    target_system: int
    target_component: int
    life: int = 0


@wire("ROBOTREE_GOAL_STATUS")
class GoalStatus(Message, frozen=True, gc=False):
    """Where a goal stands."""

    key: int
    epoch: int
    progress: float
    sequence: int
    reason: int
    target_system: int
    target_component: int
    state: int
    text: str = ""


@wire("ROBOTREE_GOAL_CANCEL")
class GoalCancel(Message, frozen=True, gc=False):
    """Ends a goal; key 0: whichever is active."""

    key: int
    epoch: int
    target_system: int
    target_component: int
    life: int = 0


@wire("ROBOTREE_MODE")
class Mode(Message, frozen=True, gc=False):
    """What the controller is doing as a whole."""

    time_boot_ms: int
    epoch: int
    silence_ms: int
    mode: int
    reason: int
    stops: int = 0
    life: int = 0


@wire("ROBOTREE_SET_MODE")
class SetMode(Message, frozen=True, gc=False):
    """Safe stop and its release."""

    epoch: int
    target_system: int
    target_component: int
    mode: int
    stops: int = 0
    life: int = 0


@wire("ROBOTREE_PICTURE_REQUEST")
class PictureRequest(Message, frozen=True, gc=False):
    """Asks a camera component for one JPEG picture."""

    width: int
    height: int
    target_system: int
    target_component: int
    quality: int


@wire("ROBOTREE_SETPOINT")
class Setpoint(Message, frozen=True, gc=False):
    """Where to be now, as part of a stream that ends by itself."""

    time_boot_ms: int
    epoch: int
    number: int
    args: tuple[float, ...]
    """(7,) arguments of the kind; NaN: as it is now."""
    ttl_ms: int
    target_system: int
    target_component: int
    kind: int
    life: int = 0


@wire("ROBOTREE_CLAIM")
class Claim(Message, frozen=True, gc=False):
    """Claims the command of a controller for one holder, and keeps alive what moves under it."""

    holder: int
    epoch: int
    term_ms: int
    life: int
    target_system: int
    target_component: int
    wish: int
    name: str


@wire("ROBOTREE_CLAIM_STATUS")
class ClaimStatus(Message, frozen=True, gc=False):
    """Who holds the command of a controller, and why a claim was refused."""

    holder: int
    epoch: int
    term_ms: int
    life: int
    target_system: int
    target_component: int
    holder_system: int
    holder_component: int
    reason: int
    name: str
