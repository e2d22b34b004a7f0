"""Answers of a controller without files, missions, logs, extended parameters and control by passkey.

A ground station without an answer repeats its question for long: MAVProxy 1.8.75 spends 11 s on a file before
it asks for the parameters. So each question gets the answer that MAVLink defines for "not here"
(https://mavlink.io/en/services: ftp, mission, parameter_ext, and common.xml for LOG_* and
CHANGE_OPERATOR_CONTROL). Where MAVLink defines none (PARAM_EXT_REQUEST_LIST, PARAM_EXT_REQUEST_READ,
LOG_ERASE, LOG_REQUEST_END), nothing is sent.

Pure.
"""

from __future__ import annotations

from enum import IntEnum
from struct import Struct
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
_HEADER: Final = Struct("<HBBBBBxI")
"""Of the payload of FILE_TRANSFER_PROTOCOL: sequence, session, opcode, size, the opcode that is answered, end
of a burst, padding, offset; then come the data."""
_PAYLOAD: Final = 251
"""[bytes]"""
_WORD: Final = 0xFFFF


class FtpOpcode(IntEnum):
    """MAV_FTP_OPCODE, as far as we need it."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    ACK = 128
    NAK = 129


UNKNOWN_COMMAND: Final = 7
"""MAV_FTP_ERR_UNKNOWNCOMMAND."""
_NOTHING_TO_DO: Final = {FtpOpcode.NONE, FtpOpcode.TERMINATE_SESSION, FtpOpcode.RESET_SESSIONS}
"""Requests that succeed where no session is open."""


def answer(question: AnyMessage, asker: Peer) -> AnyMessage | None:
    """Return what to send back to who asks for something that is not here; None: there is no such answer."""
    how = _ANSWERS.get(question.codec.definition.name)
    return None if how is None else how(fields_of(question), asker)


def _no_files(asked: Mapping[str, Value], asker: Peer) -> AnyMessage | None:
    payload = asked["payload"]
    assert isinstance(payload, bytes)  # noqa: S101  an array of uint8_t
    sequence, session, opcode, _, _, _, offset = _HEADER.unpack_from(payload)
    if opcode in {FtpOpcode.ACK, FtpOpcode.NAK}:  # an answer is not answered
        return None
    done = opcode in _NOTHING_TO_DO
    code, data = (FtpOpcode.ACK, b"") if done else (FtpOpcode.NAK, bytes((UNKNOWN_COMMAND,)))
    said = _HEADER.pack(sequence + 1 & _WORD, session, code, len(data), opcode, 0, offset) + data
    target = {"target_system": asker.system, "target_component": asker.component}
    return make("FILE_TRANSFER_PROTOCOL", target_network=0, **target, payload=said.ljust(_PAYLOAD, b"\0"))


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
    "FILE_TRANSFER_PROTOCOL": _no_files,
    "LOG_REQUEST_LIST": _no_logs,
    "LOG_REQUEST_DATA": _end_of_log,
    "PARAM_EXT_SET": _not_set,
    **dict.fromkeys(_MISSION, _no_mission),
}
