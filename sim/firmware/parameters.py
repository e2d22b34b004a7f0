"""Parameters: protocol's `ParameterServer` speaks, the robot's tuning has the values.

A change takes effect at once, in the physics thread, and all clients are told.

Pure. `now` is controller time in whole milliseconds.
"""

from collections.abc import Collection, Hashable
from typing import Final

from robotree.protocol.messages import ParamRequestList, ParamRequestRead, ParamSet
from robotree.protocol.services.parameter import Changed, ParameterServer
from robotree.protocol.services.parameter import Parameter as OnTheWire
from robotree.protocol.services.peer import Peer
from robotree.sim.firmware.device import Device, Tunable
from robotree.sim.firmware.outgoing import Outgoing, sends
from robotree.sim.firmware.rights import Rights
from robotree.sim.firmware.watchdog import Watchdog

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
