"""Messages that the controller's program sends, and their receivers."""

from collections.abc import Hashable, Iterable, Sequence
from typing import Final

import msgspec

from robotree.protocol.messages import AnyMessage, MavComponent, MavSeverity
from robotree.protocol.services.peer import Send
from robotree.protocol.services.statustext import StatustextSender

COMPONENT: Final = MavComponent.AUTOPILOT1
"""The controller's first component, where ground stations look for it; it answers for all."""


class Outgoing(msgspec.Struct, frozen=True):
    """Something to say: to `via` alone, or to all (None); of telemetry only the newest matters.

    `component` is the one of the controller that speaks.
    """

    message: AnyMessage
    via: Hashable | None = None
    telemetry: bool = False
    instance: Hashable = None
    component: int = COMPONENT


def sends(effects: Iterable[object]) -> list[Outgoing]:
    """The messages among what a service asks for."""
    return [Outgoing(effect.message, effect.via) for effect in effects if isinstance(effect, Send)]


class Announcer:
    """Speaks sentences to people: to everyone, or to one link."""

    def __init__(self) -> None:
        self._speaker = StatustextSender()

    def announce(self, severity: MavSeverity, text: str, via: Hashable | None = None) -> list[Outgoing]:
        """A sentence; `via` None: for all."""
        return [Outgoing(chunk, via) for chunk in self._speaker.say(severity, text)]

    def chunks(self, severity: MavSeverity, text: str) -> Sequence[AnyMessage]:
        """The messages of a sentence."""
        return self._speaker.say(severity, text)
