"""Parameters: protocol's `ParameterServer` speaks, the robot's tuning has the values.

A change takes effect at once, in the physics thread, and all clients are told. Texts, units and limits are
there as files that ground stations read by FTP: COMPONENT_METADATA names the general file, and that one the
file of the parameters (https://mavlink.io/en/services/component_information.html).

Pure. `now` is controller time in whole milliseconds.
"""

from collections.abc import Collection, Hashable, Iterable
from typing import Final

import msgspec

from robotree.protocol.messages import ComponentMetadata, ParamRequestList, ParamRequestRead, ParamSet
from robotree.protocol.services.files import Files, crc32
from robotree.protocol.services.parameter import Changed, ParameterServer
from robotree.protocol.services.parameter import Parameter as OnTheWire
from robotree.protocol.services.peer import Peer
from robotree.sim.firmware.device import Device, Tunable
from robotree.sim.firmware.movement import Watchdog
from robotree.sim.firmware.outgoing import Outgoing, sends
from robotree.sim.firmware.rights import Rights

LINK_SILENCE: Final = Tunable(
    "LINK_SILENCE", "silence", 0.01, 3600.0, "s, silence of the link after which the robot holds"
)
"""The parameters that every controller has."""


class Parameters:
    """The parameters of one controller.

    Args:
        device: whose tuning they are.
        watchdog: whose patience is one of them.
        rights: who may set them.
    """

    def __init__(self, device: Device, watchdog: Watchdog, rights: Rights) -> None:
        self._owners: dict[str, tuple[object, Tunable]] = {
            **{each.name: (device.tuned, each) for each in device.parameters},
            LINK_SILENCE.name: (watchdog, LINK_SILENCE),
        }
        self._server = ParameterServer(
            (
                OnTheWire(
                    name=name, value=each.read(owner), lower=each.lower, upper=each.upper, text=each.text
                )
                for name, (owner, each) in self._owners.items()
            ),
            rights.may_set,
        )

    @property
    def described(self) -> list[tuple[Tunable, float]]:
        """Each parameter, with its value now."""
        return [(each, each.read(owner)) for owner, each in self._owners.values()]

    def receive(
        self,
        message: ParamRequestRead | ParamRequestList | ParamSet,
        peer: Peer,
        now: int,
        others: Collection[Hashable],
    ) -> list[Outgoing]:
        """Take a question or a change; `others`: the links that are told of a change."""
        out: list[Outgoing] = []
        for effect in self._server.receive(message, peer, now / 1000):
            if isinstance(effect, Changed):
                owner, parameter = self._owners[effect.name]
                parameter.write(owner, effect.value)
                value_message = self._server.value_message(effect.name)
                out += [Outgoing(value_message, via) for via in others if via != peer.via]
            else:
                out += sends([effect])
        return out

    @property
    def due(self) -> float:
        """When to call `tick` next, in controller time [s]."""
        return self._server.due

    def tick(self, now: int) -> list[Outgoing]:
        """The next ones of the lists that are being sent."""
        return sends(self._server.tick(now / 1000))

    def link_closed(self, via: Hashable) -> None:
        """A link ended, and with it the lists that were sent on it."""
        self._server.link_closed(via)


GENERAL: Final = "general.json"
PARAMETERS: Final = "parameter.json"
_PARAMETER: Final = 1
"""COMP_METADATA_TYPE_PARAMETER."""
_DIGITS: Final = 3
"""Decimal places that a station shows."""


class Metadata:
    """The metadata of one component, made once, at the start.

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
