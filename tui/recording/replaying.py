"""The full screen over a recording: `robotree replay FILE`. Everything can be seen, nothing be commanded."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from rich.text import Text
from textual import work
from textual.app import SystemCommand
from textual.binding import Binding, BindingType
from textual.screen import Screen

from robotree.tui import exit_codes
from robotree.tui.errors import BadRecordedRealm, NeedsTerminal
from robotree.tui.line import values
from robotree.tui.line.action import spell
from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.grammar import Line
from robotree.tui.processes.ending import to_the_end
from robotree.tui.recording.comparing import Beside
from robotree.tui.recording.exports import opened, within
from robotree.tui.recording.playback import Playback
from robotree.tui.recording.tape import Tape
from robotree.tui.recording.transport import RecordedTransport
from robotree.tui.screen.app import Supervisor
from robotree.tui.screen.driver import LEAVE, OutlivingDriver
from robotree.tui.screen.pages.dialogs import Broken, Choosing, Reading
from robotree.tui.screen.supervise import supervise
from robotree.tui.seen.cells import seen
from robotree.tui.seen.selection import NOWHERE, Place
from robotree.tui.terminal import no_screen, put
from robotree.vr.supervision.realm_client import RealmClient

TICK = 0.1
"""[s] between two steps of a recording that is played."""

LOOK = 0.5
"""[s] between two looks at what differs from the other recording."""

LEAP, LONG_LEAP = 5.0, 30.0
"""[s] that a key goes forward or back."""

SLOWEST, FASTEST = 0.125, 64.0
"""How fast a recording is played at least and at most, as a multiple of its own speed."""

AGAIN = -1
"""The code with which the screen ends when it shall be opened at an earlier moment."""


ONLY_SEEN = "nothing in a recording can be commanded"

_HOLD = spell(BY_VERB["stop"].key)

NOT_RECORDED = {
    **dict.fromkeys(("history", "why"), "a recording keeps no history: its log says who asked for what"),
    "where": "a recording does not hold where robots are in their pages",
    **dict.fromkeys(("orders", "order show", "inbox"), "a recording holds no orders and no results of them"),
    **dict.fromkeys(("who", "say"), "nobody else is in a recording"),
    "permits": "a recording holds no permits",
    "messages": "a recording holds no messages of wires; `robotree wire record` records them",
    "questions": "a recording holds no questions",
    "space ls": "a recording holds no spaces",
    "alarms": "alarms are about what robots read now; those of then are in the log of the recording",
    "dismiss": "who is in the list of a recording was there then",
}
"""Verbs that make no sense over a recording, and why."""


class Replay(Supervisor):
    """One recording at one moment, which moves while it is played."""

    STOP_WORD: ClassVar[str] = "PAUSE"
    OWN_KEYS: ClassVar[Sequence[tuple[str, str]]] = (
        (_HOLD, "Hold the recording, or let it go on; no robot hears it."),
        ("← →", f"Go {LEAP:g} s back, forward; with shift {LONG_LEAP:g} s."),
        ("[ ]", "Play slower, faster."),
        ("=", "Show what differs from another recording at this moment, and close that."),
    )
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("left", f"leap({-LEAP})", "Back", priority=True),
        Binding("right", f"leap({LEAP})", "Forward", priority=True),
        Binding("shift+left", f"leap({-LONG_LEAP})", show=False, priority=True),
        Binding("shift+right", f"leap({LONG_LEAP})", show=False, priority=True),
        Binding("left_square_bracket", "pace(0.5)", "Slower", priority=True),
        Binding("right_square_bracket", "pace(2.0)", "Faster", priority=True),
        Binding("equals_sign", "compare", "Compare", priority=True),
    ]

    def __init__(self, player: Player, *args: Any, **options: Any) -> None:
        """Show what a player plays; the rest as for a supervisor."""
        self.player = player
        self._zero = time.monotonic() - player.playback.position
        super().__init__(*args, **options)
        self.feed.moment_of = lambda line: self._zero + line.unix
        self.keyboard = self.keyboard._replace(why_readonly=ONLY_SEEN, absent=NOT_RECORDED)
        self.prompt = self.prompt._replace(
            why_readonly=ONLY_SEEN,
            absent={**NOT_RECORDED, "stop": f"{ONLY_SEEN}; {_HOLD} holds the recording"},
        )

    def opened(self) -> None:
        """Begin to play."""
        self.player.repeat()
        self.set_interval(TICK, self.player.tick)

    def now(self) -> float:  # type: ignore[override] # pyright: ignore[reportIncompatibleMethodOverride]
        """[s] on the store's clock: it stands still with the recording."""
        return self._zero + self.player.playback.position

    def wall(self) -> float:  # type: ignore[override] # pyright: ignore[reportIncompatibleMethodOverride]
        """[s] since 1970, when that was recorded."""
        return self.player.playback.position

    @property
    def asked(self) -> float:
        """[s] when a key was pressed: nothing moves by itself between a look and a key that matters here."""
        return self.now()

    @property
    def heading(self) -> str:
        """Return what stands in the line on top instead of the realm."""
        return self.player.words

    def ask_for(self, verb: str, place: Place = NOWHERE) -> None:
        """Do what a key asks for; the key of the stop holds the recording."""
        if verb == "stop":
            self.player.hold_or_go_on()
        else:
            super().ask_for(verb, place)

    def get_system_commands(self, screen: Screen[object]) -> Iterable[SystemCommand]:
        """Offer what the keys of a recording do, and what a supervisor offers but the stop."""
        acts: tuple[tuple[str, Callable[[], object]], ...] = (
            ("hold, go on", self.player.hold_or_go_on),
            ("forward", partial(self.action_leap, LEAP)),
            ("faster", partial(self.action_pace, 2.0)),
            ("compare", self.action_compare),
        )
        for (keys, doc), (name, act) in zip(self.OWN_KEYS, acts, strict=True):
            yield SystemCommand(f"Recording: {name}  ({keys})", doc, act)
        yield from super().get_system_commands(screen)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        """Give keys to the field in which somebody types."""
        if action in {"leap", "pace", "compare"} and self.guard.typing:
            return False
        return super().check_action(action, parameters)

    def action_help_quit(self) -> None:
        """Say at ctrl+c what leaves."""
        self.tell(f"ctrl+q leaves; {_HOLD} holds the recording, or lets it go on")

    def action_leap(self, seconds: float) -> None:
        """Go forward, or back: then the screen is opened anew at that moment."""
        if seconds > 0:
            self.player.go_to(self.player.playback.position + seconds)
        else:
            self.player.begin_at = max(self.player.playback.position + seconds, self.player.tape.began)
            if isinstance(self._driver, OutlivingDriver):
                self._driver.stays = True  # the next screen is drawn over this one
            self.exit(AGAIN)

    def action_compare(self) -> None:
        """Show what differs from a second recording at this moment; the first time it is chosen."""
        if isinstance(self.screen, BesideReading):
            self.screen.dismiss()
        elif self.player.beside is not None:
            self.push_screen(BesideReading(self.player, self.player.beside))
        elif files := self.player.files_beside():

            def chosen(name: str | None) -> None:
                if name is not None:
                    self._open_beside(name)

            self.push_screen(Choosing("which recording is beside this one?", files), chosen)
        else:
            self.tell("no other recording lies in the folder of this one; --beside OTHER names one elsewhere")

    @work(exit_on_error=False)
    async def _open_beside(self, name: str) -> None:
        try:
            await asyncio.to_thread(self.player.open_beside, name)
        except BadRecordedRealm as error:
            self.tell(str(error), "error")
        else:
            self.action_compare()

    def action_pace(self, factor: float) -> None:
        """Play faster or slower."""
        self.player.speed = min(max(self.player.speed * factor, SLOWEST), FASTEST)


class BesideReading(Reading):
    """Two recordings at the same time after their beginnings; it goes along with the one that is replayed."""

    def __init__(self, player: Player, beside: Beside) -> None:
        """Begin with the present moment."""
        self._player, self._beside = player, beside
        super().__init__(beside.title, self._present())

    def on_mount(self) -> None:
        """Go along; Textual calls that of `Reading`, too."""
        self.set_interval(LOOK, self.guarded(lambda: self.query_one(Broken).replace(Text(self._present()))))

    def _present(self) -> str:
        return self._beside.text(self._player.playback.position - self._player.tape.began)


class Player:
    """Plays one recording."""

    def __init__(self, tape: Tape, speed: float, beside: Tape | None = None) -> None:
        """Begin at the beginning, at a multiple of the recording's own speed, beside another recording."""
        self.tape, self.speed = tape, speed
        self.beside = None if beside is None else Beside(tape, beside)
        self.begin_at = tape.began
        """[s] since 1970: where it is opened next."""
        self.held = False
        self.playback = Playback(tape)
        self.transport: RecordedTransport | None = None

    def open(self) -> RecordedTransport:
        """Begin at `begin_at`; returns the way to who was there then."""
        self.playback = Playback(self.tape)
        self.playback.advance(self.begin_at)
        self.transport = RecordedTransport(self.playback)
        return self.transport

    def repeat(self) -> None:
        """Have those who listen now hear how it is."""
        if self.transport is not None:
            self.transport.deliver(self.playback.moment())

    def tick(self) -> None:
        """Go on by one step."""
        if not self.held:
            self.go_to(self.playback.position + TICK * self.speed)

    def go_to(self, unix: float) -> None:
        """Go forward to a moment."""
        if self.transport is not None:
            self.transport.deliver(self.playback.advance(unix))

    def files_beside(self) -> list[tuple[str, str]]:
        """Return the other recordings in the folder of this one, and when each was written."""
        own = Path(self.tape.name)
        found = (path for path in sorted(own.parent.glob(f"*{own.suffix}")) if path.name != own.name)
        return [(str(path), time.strftime("%c", time.localtime(path.stat().st_mtime))) for path in found]

    def open_beside(self, name: str) -> None:
        """Have a second recording beside this one.

        Raises:
            BadRecordedRealm: it cannot be read.
        """
        self.beside = Beside(self.tape, opened(name))

    def hold_or_go_on(self) -> None:
        """Hold the recording, or let it go on."""
        self.held = not self.held

    @property
    def words(self) -> str:
        """Return which moment is shown, for people."""
        at, length = self.playback.position - self.tape.began, self.tape.ended - self.tape.began
        state = "held" if self.held else "ended" if self.playback.over else f"x{self.speed:g}"
        cut = "" if self.tape.whole else ", being written" if self.tape.growing else ", cut off"
        other = self.beside.words(at) if self.beside is not None else ""
        differs = f"  {seen(other)}" if other else ""
        return f"REPLAY {_clock(at)} of {_clock(length)}{cut}  {state}{differs}"


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02}"


def replay(line: Line, _realm: str) -> int:
    """Show a recording until the person leaves; returns the exit code.

    Raises:
        NeedsTerminal: this is no terminal.
        BadRecordedRealm: the recording cannot be read.
    """
    if without := no_screen():
        raise NeedsTerminal(without)
    beside = opened(line.text("--beside")) if line.text("--beside") else None
    refusal = f"is no speed from {SLOWEST:g} to {FASTEST:g}"
    speed = values.ranged("SPEED", line.text("--speed", "1").removeprefix("x"), SLOWEST, FASTEST, refusal)
    player = Player(opened(line.text("FILE")), speed, beside)
    if line.text("--from"):
        player.begin_at += within(player.tape, line.text("--from"))
    return to_the_end(_played(player), on_screen=True)


async def _played(player: Player) -> int:
    code = exit_codes.DONE
    try:
        code = await _shown(player)
        while code == AGAIN:
            code = await _shown(player)
    finally:
        if code == AGAIN:  # the screen was kept for another one, which has not come
            put(LEAVE)
    return code or exit_codes.DONE


async def _shown(player: Player) -> int:
    """Show the recording from a moment on; returns `AGAIN` when it shall be shown from another one."""
    realm_client = RealmClient(player.open())
    await realm_client.start()
    try:
        return await supervise(realm_client, "", readonly=True, screen=partial(Replay, player))
    finally:
        await realm_client.close()
