"""Answers of a controller without missions, logs, extended parameters and control by passkey.

A ground station without an answer repeats its question for long. So each question gets the answer that
MAVLink defines for "not here" (https://mavlink.io/en/services: mission, parameter_ext, and common.xml for
LOG_* and CHANGE_OPERATOR_CONTROL). Where MAVLink defines none (PARAM_EXT_REQUEST_LIST,
PARAM_EXT_REQUEST_READ, LOG_ERASE, LOG_REQUEST_END), nothing is sent.

Pure.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from robotree.protocol.messages import AnyMessage, fields_of, make

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from robotree.protocol.codec import Value
    from robotree.protocol.services.peer import Peer

UNSUPPORTED: Final = 3
"""MAV_MISSION_UNSUPPORTED."""
NOT_SET: Final = 2
"""PARAM_ACK_FAILED."""
NO_PASSKEY: Final = 2
"""In CHANGE_OPERATOR_CONTROL_ACK: the encryption of the passkey is not supported.

MAVLink has no code for a message that is not supported. 1 would say that another passkey may help, 3 that
another moment may."""


def answer(question: AnyMessage, asker: Peer) -> AnyMessage | None:
    """Return what to send back to who asks for something that is not here; None: there is no such answer."""
    how = _ANSWERS.get(question.codec.definition.name)
    return None if how is None else how(fields_of(question), asker)


def _no_mission(asked: Mapping[str, Value], asker: Peer) -> AnyMessage:
    target = {"target_system": asker.system, "target_component": asker.component}
    return make("MISSION_ACK", **target, type=UNSUPPORTED, mission_type=asked.get("mission_type", 0))


def _no_logs(_: Mapping[str, Value], __: Peer) -> AnyMessage:
    return make("LOG_ENTRY")


def _end_of_log(asked: Mapping[str, Value], _: Peer) -> AnyMessage:
    return make("LOG_DATA", id=asked["id"], ofs=asked["ofs"], count=0)


def _not_set(asked: Mapping[str, Value], _: Peer) -> AnyMessage:
    same = {name: asked[name] for name in ("param_id", "param_value", "param_type")}
    return make("PARAM_EXT_ACK", **same, param_result=NOT_SET)


def _no_passkey(asked: Mapping[str, Value], asker: Peer) -> AnyMessage:
    """Refuse: control is requested by the command REQUEST_OPERATOR_CONTROL."""
    request = asked["control_request"]
    return make(
        "CHANGE_OPERATOR_CONTROL_ACK", gcs_system_id=asker.system, control_request=request, ack=NO_PASSKEY
    )


_MISSION: Final = (
    "MISSION_REQUEST_PARTIAL_LIST",
    "MISSION_WRITE_PARTIAL_LIST",
    "MISSION_ITEM",
    "MISSION_REQUEST",
    "MISSION_SET_CURRENT",
    "MISSION_COUNT",
    "MISSION_CLEAR_ALL",
    "MISSION_REQUEST_INT",
    "MISSION_ITEM_INT",
)
_ANSWERS: Final[Mapping[str, Callable[[Mapping[str, Value], Peer], AnyMessage | None]]] = {
    "CHANGE_OPERATOR_CONTROL": _no_passkey,
    "LOG_REQUEST_LIST": _no_logs,
    "LOG_REQUEST_DATA": _end_of_log,
    "PARAM_EXT_SET": _not_set,
    **dict.fromkeys(_MISSION, _no_mission),
}
