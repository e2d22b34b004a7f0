"""The metadata of parameters for ground stations: texts, units and limits, as files that they read by FTP.

COMPONENT_METADATA names the general file, and that one the file of the parameters
(https://mavlink.io/en/services/component_information.html). Both are made once, at the start.

Pure.
"""

from collections.abc import Iterable
from typing import Final

import msgspec

from robotree.protocol.messages import ComponentMetadata
from robotree.protocol.services.files import Files, crc32
from robotree.sim.firmware.device import Tunable

GENERAL: Final = "general.json"
PARAMETERS: Final = "parameter.json"
_PARAMETER: Final = 1
"""COMP_METADATA_TYPE_PARAMETER."""
_DIGITS: Final = 3
"""Decimal places that a station shows."""


class Metadata:
    """The metadata of one component.

    Args:
        parameters: what can be tuned, with the value at the start.
    """

    def __init__(self, parameters: Iterable[tuple[Tunable, float]]) -> None:
        document = {"version": 1, "parameters": [_described(each, value) for each, value in parameters]}
        content = msgspec.json.encode(document)
        kinds = [{"type": _PARAMETER, "uri": _uri(PARAMETERS), "fileCrc": crc32(content)}]
        general = msgspec.json.encode({"version": 1, "metadataTypes": kinds})
        self.files = Files({GENERAL: general, PARAMETERS: content})
        self._crc = crc32(general)

    def told(self, boot_ms: int) -> ComponentMetadata:
        """Where it is."""
        return ComponentMetadata(boot_ms, self._crc, _uri(GENERAL))


def _uri(name: str) -> str:
    return f"mftp:///{name}"


def _described(parameter: Tunable, value: float) -> dict[str, object]:
    """One parameter as the schema of MAVLink's parameter metadata has it."""
    unit, _, text = parameter.text.partition(", ")
    return {
        "name": parameter.name,
        "type": "Float",
        "group": parameter.name.partition("_")[0].capitalize(),
        "shortDesc": text[:1].upper() + text[1:],
        "units": unit,
        "default": value,
        "min": parameter.lower,
        "max": parameter.upper,
        "decimalPlaces": _DIGITS,
    }
