"""The watchdog: who must be heard while the robot moves, and how long a silence is allowed.

While something moves, the peer that asked for it must be heard: another sender, even one with the same ids,
must not hide that this peer has died. Under a claim, its holder must be heard, by its CLAIMs; without a
claim, the sender on its link, with any message. While nothing moves, nobody has to be heard. Times are
controller time, so a simulation may run faster or slower than the wall clock.

Pure.
"""

from collections.abc import Hashable


class Watchdog:
    """Counts silence.

    Args:
        patience: silence that is allowed [ms].
    """

    def __init__(self, patience: int) -> None:
        self.patience = patience
        self._commander: Hashable = None
        self._heard = 0
        self._latest: tuple[Hashable, int] | None = None
        """The sender that was heard last, and when its message arrived."""

    @property
    def silence(self) -> float:
        """The patience in [s], as people tune it."""
        return self.patience / 1000

    @silence.setter
    def silence(self, seconds: float) -> None:
        self.patience = round(1000 * seconds)

    def receive(self, voice: Hashable, arrived: int) -> None:
        """A message is handled that arrived at a time [ms]; a stop may be handled before older messages."""
        self._latest = voice, arrived
        if voice == self._commander:
            self._heard = max(self._heard, arrived)

    def obey(self, voice: Hashable, speaker: Hashable, now: int) -> None:
        """From `now` [ms] on `voice` must be heard; a message that waited is no sign of life now.

        Args:
            voice: who must be heard.
            speaker: the sender of the message that is obeyed.
            now: [ms]
        """
        latest, arrived = self._latest or (speaker, now)
        self._commander, self._heard = voice, arrived if latest in {speaker, voice} else now

    def rest(self) -> None:
        """From now on nobody has to be heard."""
        self._commander = None

    def silent(self, now: int) -> bool:
        """Whether the silence is too long at `now` [ms]."""
        return self._commander is not None and now - self._heard > self.patience
