"""One speaker on one link: gives each message our ids and the number of its turn, and hears frames.

Pure: the link is handed in. An endpoint is the `Handler` of its link.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from robotree.protocol.draft import Draft
from robotree.protocol.parser import Parser, ParserStatistics, Verifier

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable

    from robotree.protocol.errors import LinkError
    from robotree.protocol.frame import Frame, Signer
    from robotree.protocol.links.link import Link
    from robotree.protocol.messages import AnyMessage


class Endpoint:
    """Speaks as one system over one link.

    Args:
        link: the open link.
        system: who we are, 1 to 255.
        component: which part of it speaks when `send` names no other.
        on_frame: told every frame that comes.
        on_closed: told once when the link has ended.
        signer: signs what we send.
        verifier: decides which frames pass.
    """

    def __init__(
        self,
        link: Link,
        *,
        system: int,
        component: int,
        on_frame: Callable[[Frame], None],
        on_closed: Callable[[LinkError], None] | None = None,
        signer: Signer | None = None,
        verifier: Verifier | None = None,
    ) -> None:
        self.link = link
        self.system, self.component = system, component
        self._on_frame, self._on_closed = on_frame, on_closed
        self._signer = signer
        self._parser = Parser(verifier)
        self._sequences: dict[int, int] = {}

    @property
    def statistics(self) -> ParserStatistics:
        """What was heard; what was sent is in `link.statistics`."""
        return self._parser.statistics

    def send(
        self,
        message: AnyMessage,
        *,
        telemetry: bool = False,
        component: int | None = None,
        instance: Hashable = None,
    ) -> None:
        """Send a message.

        Args:
            message: what to say.
            telemetry: a newer one may take its place if the far end does not read.
            component: which part of us speaks.
            instance: tells telemetry of the same message apart, such as the name of a value.

        Raises:
            InvalidMessage: a field cannot hold its value.
        """
        speaker = self.component if component is None else component
        draft = Draft(message, self.system, speaker, self._sequences, self._signer)
        self.link.send(draft, (speaker, message.codec.definition.id, instance) if telemetry else None)

    def reseal(self, signer: Signer | None, verifier: Verifier | None) -> None:
        """From now on sign, and decide which frames pass, in another way.

        Frames that came with the same bytes as the one that is being told were already decided on; what waits
        to be sent is signed as it would have been.
        """
        self._signer, self._parser.verifier = signer, verifier

    def received(self, data: bytes) -> None:
        """The link tells: bytes came."""
        for frame in self._parser.feed(data):
            self._on_frame(frame)

    def closed(self, reason: LinkError) -> None:
        """The link tells: it has ended."""
        if self._on_closed is not None:
            self._on_closed(reason)
