"""One verb from the command line: join the realm, do it, print, leave.

Results go to standard output, progress and errors to standard error, so that pipes stay clean.
"""

from __future__ import annotations

import asyncio
import json
import math
import os
import sys
import time
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

from robotree.tui import exit_codes
from robotree.tui.line import taken
from robotree.tui.line.carrying import Refusal, carry_out
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome
from robotree.tui.processes.ending import to_the_end
from robotree.tui.seen.wording import without_seconds
from robotree.tui.terminal import complain, note, over, put, put_data, typed

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.exchange.attendance import Attendance
    from robotree.vr.supervision.realm_client import RealmClient

BAR = 24
"""Width of the progress bar in characters."""

PACE = 2.0
"""[s] at least between two lines of progress that say the same and differ by less than `STEP`."""
STEP = 0.1
"""Share of a command that is worth a line of its own."""


class Console:
    """A teller that prints."""

    ends_at_once = True
    """Whether its program ends with the verb: what would last as long as that has a time of its own."""

    def __init__(self, *, as_json: bool, clock: Callable[[], float] = time.monotonic) -> None:
        """Print plain data, or text for people; `clock` [s] paces the progress in logs."""
        self.as_json, self._clock = as_json, clock
        self._open = False
        self._told: tuple[float, str] = (math.nan, "")
        """The last progress that has a line of its own."""
        self._latest = self._told
        self._told_at = clock()
        self._first: asyncio.Future[bool] | None = None
        """Whether somebody presses the first key; None: nobody was asked to."""

    def progress(self, fraction: float, text: str) -> None:
        """Redraw the progress line on standard error, a new one for each text; in a log, add a line."""
        before, self._latest = self._latest, (fraction, text)
        if not sys.stderr.isatty():
            if self._worth_a_line(fraction, text):
                self._log()
            return
        if self._open and without_seconds(text) != without_seconds(before[1]):
            note("")  # what the command said before stays on the screen
        full = 0 if math.isnan(fraction) else round(min(max(fraction, 0.0), 1.0) * BAR)
        share = "" if math.isnan(fraction) else f"{fraction:4.0%} "
        over(f"{'━' * full}{'╌' * (BAR - full)} {share}{text}")
        self._open = True

    def _worth_a_line(self, fraction: float, text: str) -> bool:
        share, shown_text = self._told
        if (
            without_seconds(text) != without_seconds(shown_text)
            or abs(fraction - share) >= STEP
            or math.isnan(share) != math.isnan(fraction)
        ):
            return True
        return self._clock() - self._told_at >= PACE

    def _log(self) -> None:
        fraction, text = self._told = self._latest
        self._told_at = self._clock()
        share = None if math.isnan(fraction) else round(fraction, 4)
        if self.as_json:
            note(json.dumps({"progress": share, "text": text}, ensure_ascii=False))
        else:
            note(f"… {'' if share is None else f'{share:.0%} '}{text}".rstrip())

    @property
    def may_ask(self) -> bool:
        """Whether a person sits there who can be asked something."""
        return not self.as_json and sys.stdin.isatty() and sys.stderr.isatty()

    def hold_key(self, robot: str, command: str, attendance: Attendance) -> Callable[[], None] | None:
        """Ask the person at the terminal to hold a key, and pass each on; None: nobody sits there."""
        if not self.may_ask:
            return None
        import termios
        import tty

        keys, loop = sys.stdin.fileno(), asyncio.get_running_loop()
        before = termios.tcgetattr(keys)
        tty.setcbreak(keys)  # Ctrl-C still ends the program, and with it the command
        self._first = loop.create_future()

        def pressed() -> None:
            there = bool(os.read(keys, 1024))
            if self._first is not None and not self._first.done():
                self._first.set_result(there)
            if not there:  # the terminal has gone
                loop.remove_reader(keys)
                return
            attendance.press()

        def release() -> None:
            loop.remove_reader(keys)
            termios.tcsetattr(keys, termios.TCSAFLUSH, before)

        loop.add_reader(keys, pressed)
        note(
            f"{robot}.{command} begins with a key, goes on while you hold a key, and ends 2 s after the last"
        )
        return release

    async def first_key(self) -> bool:
        """Wait until the person who was asked to hold a key presses the first one; False: nobody will."""
        return self._first is None or await self._first

    def outcome(self, outcome: Outcome) -> None:
        """Print a result on standard output."""
        self.settle()
        if self.as_json:
            if outcome.data is not None:
                put_data(outcome.data)
        elif outcome.text:
            put(outcome.text)

    def warn(self, text: str) -> None:
        """Print a sentence on standard error, at once."""
        self.settle()
        if self.as_json:
            note(json.dumps({"warning": text}, ensure_ascii=False))
        else:
            complain(text)

    def error(self, error: Exception) -> None:
        """Print one sentence on standard error; as an object where plain data was asked for."""
        self.settle()
        complain(error)

    def trace(self, error: Exception) -> None:
        """Print the way of an error through the authors' pages, the outermost line first."""
        lines: tuple[str, ...] = getattr(error, "trace", ())
        if self.as_json and lines:
            note(json.dumps({"trace": lines}, ensure_ascii=False))
        else:
            for row in lines:
                note(row)

    def settle(self) -> None:
        """End the progress line before something else is printed; the last progress is always printed."""
        if self._open:
            note("")
            self._open = False
        elif repr(self._latest) != repr(self._told):  # NaN is like NaN here
            self._log()


async def _wants_to_order(line: Line, error: Exception) -> bool:
    """Ask a person once whether a command is left as an order whose robot is away."""
    from robotree.vr.base.errors import RobotAbsent

    if line.verb != "call" or not isinstance(error, RobotAbsent) or "--queue" not in error.data["advice"]:
        return False
    note(f"{error.data['name']} is {error.data['how']}. Type yes to leave this as an order:")
    return (await typed()).strip() == b"yes"


async def obey(realm_client: RealmClient, line: Line, console: Console) -> int:
    """Carry out one line and print what came of it.

    Returns:
        The exit code.
    """
    outcome = await carry_out(realm_client, line, console)
    if isinstance(outcome, Refusal) and console.may_ask and await _wants_to_order(line, outcome.error):
        ordered = line._replace(values={**line.values, "--queue": True})
        outcome = await carry_out(realm_client, ordered, console)
    if isinstance(outcome, Refusal):
        console.error(outcome.error)
        if line.flag("--trace"):
            console.trace(outcome.error)
        return exit_codes.code_of(outcome.error)
    console.outcome(outcome)
    if outcome.doubt is None:
        return exit_codes.DONE
    console.error(outcome.doubt)
    return exit_codes.code_of(outcome.doubt)


def _obeyed_offline(line: Line, realm: str, console: Console) -> bool:
    """Carry a verb out on what was taken along, where nobody else is; returns whether it was.

    Raises:
        VrError: it is refused.
    """
    outcome = taken.offline(line, realm, console)
    if outcome is not None:
        console.outcome(outcome)
    return outcome is not None


async def _nothing(_realm_client: RealmClient, _line: Line) -> None:
    """Leave at once."""


async def once(
    line: Line, realm: str, before_leaving: Callable[[RealmClient, Line], Awaitable[None]] = _nothing
) -> int:
    """Join the realm, do one verb, leave.

    Args:
        line: the verb and its values.
        realm: in which it is done.
        before_leaving: what is still done there, if it was done.

    Returns:
        The exit code.
    """
    from robotree.client.joining import joined
    from robotree.tui.processes.realm import anybody_met, nothing_to_ask
    from robotree.vr.base.address import ROLES
    from robotree.vr.base.errors import VrError

    console = Console(as_json=line.flag("--json"))
    if not anybody_met(realm):  # joining would leave an empty folder behind
        if _obeyed_offline(line, realm, console):
            return exit_codes.DONE
        console.error(nothing_to_ask(realm))
        return exit_codes.NOBODY
    try:
        async with joined(realm) as realm_client:
            if any(realm_client.directory.present(role) for role in ROLES):
                await taken.merge(realm_client, console)
                code = await obey(realm_client, line, console)
                if code == exit_codes.DONE:
                    await before_leaving(realm_client, line)
                return code
        if _obeyed_offline(line, realm, console):
            return exit_codes.DONE
        console.error(nothing_to_ask(realm))
    except VrError as error:
        console.error(error)
        return exit_codes.code_of(error)
    return exit_codes.NOBODY


def ask(line: Line, realm: str) -> int:
    """Carry out a verb over the robots of a realm."""
    listening = line.verb == "watch" or line.flag("--follow") or line.flag("--watch")
    return to_the_end(once(line, realm), listening=listening)


async def apart(line: Line, realm: str) -> int:
    """Do one verb that needs no realm, with the robots of the realm where there is one.

    Returns:
        The exit code.
    """
    from robotree.client.joining import joined
    from robotree.tui.line.carrying import function_of
    from robotree.tui.processes.realm import anybody_met

    console = Console(as_json=line.flag("--json"))
    if anybody_met(realm):
        async with joined(realm) as realm_client:
            return await obey(realm_client, line, console)
    run: Any = function_of(line.verb)
    console.outcome(await run(None, line, console))
    return exit_codes.DONE
