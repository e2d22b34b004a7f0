"""How a goal ended, as an error for the caller that says what happened and what to do next. Pure.

The controller reports a state, a reason and perhaps a sentence, which is preferred: it knows the numbers.
"""

from __future__ import annotations

from robotree.protocol.messages import GoalState, Reason
from robotree.protocol.services.goal_client import GoalEnded
from robotree.protocol.services.heartbeat import PERIOD
from robotree.vr.base.description import Effect
from robotree.vr.base.errors import (
    CommandCancelled,
    CommandFailed,
    CommandInDoubt,
    DeadlineExceeded,
    StaleEpoch,
    VrError,
)

SENTENCES: dict[Reason, str] = {
    Reason.NONE: "the controller gave no reason",
    Reason.OUT_OF_REACH: "no posture of the arm reaches the point; choose one nearer to it",
    Reason.PATH_BLOCKED: "the point can be reached, but neither straight nor around the base; use two moves",
    Reason.BAD_ARGUMENT: "the controller refuses one of the values",
    Reason.UNKNOWN_VERB: "this controller cannot do that",
    Reason.STALE_EPOCH: "a newer lease is already obeyed",
    Reason.KEY_REUSED: "a different command was sent under the same key",
    Reason.STOPPED: "a safe stop is in force; look at the robot, then resume it",
    Reason.BLOCKED: "something in the way holds the robot",
    Reason.SUPERSEDED: "a newer goal took its place",
    Reason.LINK_SILENT: "the controller heard nothing from the proxy for too long and holds",
    Reason.OPERATOR: "somebody asked for it",
    Reason.FAULT: "the controller found a fault in itself",
    Reason.NOT_IN_CONTROL: "somebody else commands the controller; ask them to give it up",
    Reason.BAD_EPOCH: "its controller finds the epoch impossible; set the clocks of both machines",
    Reason.SELF_COLLISION: "two parts of the robot would touch; choose another point or move the other arm",
    Reason.TIP_OVER: "the robot could tip over; lean or reach less far",
    Reason.TOO_NEAR: "it leads too near to a person; wait, or go another way",
    Reason.OTHER_LIFE: "its controller has restarted meanwhile; look at the robot, then try again",
}
"""One for every reason of the dialect; a test compares."""
LONGEST_TEXT = 80
"""[bytes] The wire cuts a longer sentence."""


def explain(end: GoalEnded) -> str:
    """Why a goal ended, as one sentence without its full stop."""
    if end.text:
        cut = len(end.text.encode()) >= LONGEST_TEXT
        return f"{end.text}…" if cut else end.text.rstrip(". ") or end.text
    return reason_in_words(end.reason)


def reason_in_words(reason: int) -> str:
    """Return the meaning of a reason of the dialect, as a clause."""
    try:
        return SENTENCES[Reason(reason)]
    except ValueError:
        return f"the controller gave reason {reason}, which this proxy does not know"


def silence_in_words(*, acknowledged: bool, heard: float, kind: str) -> str:
    """Return the meaning of missing answers about a goal, as a sentence without its full stop.

    Args:
        acknowledged: whether it ever answered the goal.
        heard: [s] since the controller was heard, whatever it said.
        kind: of robot that its controller is taken for.
    """
    if heard >= 2 * PERIOD:
        return "its controller has fallen silent; look whether the robot still moves"
    if acknowledged:
        return "its controller is online but reports it no more; look whether the robot still moves"
    return f"its controller is online but answers no goals; is it a {kind}? Look whether the robot moves"


def error_of(
    end: GoalEnded, *, robot: str, command: str, epoch: int, obeyed: int, effect: Effect = "once"
) -> VrError | None:
    """The error that the end of a goal means for the caller; None: the goal was reached.

    It was sent under `epoch`, and the controller has reported `obeyed` as the highest one. A command with the
    effect `once` must not be repeated without a look at the robot.
    """
    match end.state:
        case GoalState.SUCCEEDED:
            return None
        case GoalState.REFUSED if end.reason == Reason.STALE_EPOCH:
            return StaleEpoch(robot=robot, epoch=epoch, current=max(obeyed, epoch + 1))
        case GoalState.CANCELLED:
            return CommandCancelled(robot=robot, command=command, reason=explain(end))
        case GoalState.EXPIRED:
            return DeadlineExceeded(robot=robot, command=command)
        case GoalState.UNKNOWN:
            return _unknown(end, robot, command, effect)
        case _:
            return CommandFailed(robot=robot, command=command, detail=explain(end))


def _unknown(end: GoalEnded, robot: str, command: str, effect: Effect) -> VrError:
    """The error for a goal that the controller does not know, but may have carried out."""
    what = "has restarted meanwhile" if end.reason == Reason.OTHER_LIFE else "has forgotten it"
    remedy = ". Look where the robot is before you" if effect == "once" else "; look at the robot, then"
    return unclear(f"its controller {what}{remedy} give it again", robot, command, effect)


def unclear(detail: str, robot: str, command: str, effect: Effect) -> CommandFailed | CommandInDoubt:
    """The error for a motion that was sent and whose end is unknown: what adds up may not be repeated."""
    kind = CommandInDoubt if effect == "once" else CommandFailed
    return kind(robot=robot, command=command, detail=detail)
