"""The watchdog of the link: who must be heard, and for how long silence is borne.

While a goal runs, it is its sender who must be heard: another voice on another link (a display, a logger)
must not hide that the one who commands has died. While nothing runs, anybody will do. Times are controller
time, so a simulation that runs faster or slower than the wall clock keeps its promises.

Pure.
"""

from typing import TypeAlias

Voice: TypeAlias = tuple[int, int]
"""System and component of a speaker; whichever link it uses."""


class Watchdog:
    """Counts silence.

    Args:
        patience: silence that is borne [ms].
    """

    def __init__(self, patience: int) -> None:
        self.patience = patience
        self._commander: Voice | None = None
        self._heard: int | None = None

    @property
    def silence(self) -> float:
        """The patience in [s], as people tune it."""
        return self.patience / 1000

    @silence.setter
    def silence(self, seconds: float) -> None:
        self.patience = round(1000 * seconds)

    def hear(self, voice: Voice, now: int) -> None:
        """Somebody was heard at `now` [ms]."""
        if self._commander in {None, voice}:
            self._heard = now

    def obey(self, voice: Voice, now: int) -> None:
        """From `now` [ms] on it is `voice` who must be heard."""
        self._commander, self._heard = voice, now

    def rest(self, now: int) -> None:
        """From `now` [ms] on anybody will do."""
        if self._commander is not None:
            self._commander, self._heard = None, now

    def silent(self, now: int) -> bool:
        """Whether it has been too quiet at `now` [ms]; never before the first word."""
        return self._heard is not None and now - self._heard > self.patience
