"""The watchdog of the link: who must be heard, and for how long silence is borne.

While something moves at somebody's word, it is the one who gave it who must be heard: another voice, were it
one with the same ids, must not hide that the one who commands has died. Under a claim its holder must be
heard, by a CLAIM of its own; without one, the speaker on its link, whatever it says. While nothing moves
nobody is missed. Times are controller time, so a simulation that runs faster or slower than the wall clock
keeps its promises.

Pure.
"""

from collections.abc import Hashable


class Watchdog:
    """Counts silence.

    Args:
        patience: silence that is borne [ms].
    """

    def __init__(self, patience: int) -> None:
        self.patience = patience
        self._commander: Hashable = None
        self._heard = 0
        self._latest: tuple[Hashable, int] | None = None
        """Whose voice was heard last, and when it came."""

    @property
    def silence(self) -> float:
        """The patience in [s], as people tune it."""
        return self.patience / 1000

    @silence.setter
    def silence(self, seconds: float) -> None:
        self.patience = round(1000 * seconds)

    def receive(self, voice: Hashable, arrived: int) -> None:
        """A word is heard that arrived at a moment [ms]; a stop may be heard before older words."""
        self._latest = voice, arrived
        if voice == self._commander:
            self._heard = max(self._heard, arrived)

    def obey(self, voice: Hashable, speaker: Hashable, now: int) -> None:
        """From `now` [ms] on it is `voice` who must be heard; a word that waited is no sign of life now.

        Args:
            voice: who must be heard.
            speaker: who has said what is obeyed.
            now: [ms]
        """
        latest, arrived = self._latest or (speaker, now)
        self._commander, self._heard = voice, arrived if latest in {speaker, voice} else now

    def rest(self) -> None:
        """From now on nobody is missed."""
        self._commander = None

    def silent(self, now: int) -> bool:
        """Whether it has been too quiet at `now` [ms]."""
        return self._commander is not None and now - self._heard > self.patience
