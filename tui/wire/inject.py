"""Faults on the way between two programs: `robotree wire inject --listen URL --connect URL`.

While it runs it reads lines from standard input, and answers each with what is in force:

    loss 20%          this share of the frames is lost; so for delay 50ms, jitter 10ms, duplication 1%
    cut 3s            nothing passes for so long; links stay open, and those that come are as deaf
    break             all links end at once; who dials again is joined again, also to a cut in force
    heal              nothing is done to frames any more, and a cut ends; links that ended stay ended
"""

from __future__ import annotations

import asyncio
import math
import sys
import threading
from collections.abc import Callable

import msgspec

from robotree.protocol.links.loopback import Faults
from robotree.protocol.tools.relay import Relay, relaying
from robotree.tui import exit_codes
from robotree.tui.errors import SupervisorError, ValueRefused
from robotree.tui.line import values
from robotree.tui.line.grammar import Line
from robotree.tui.terminal import answer, complain, note, put
from robotree.tui.wire.lasting import lasting


def share(text: str) -> float:
    """Read `20%` or `0.2`.

    Raises:
        ValueRefused: it is no share.
    """
    number, percent = (text[:-1], 0.01) if text.endswith("%") else (text, 1.0)
    try:
        found = float(number) * percent
    except ValueError:
        found = -1.0
    if not 0 <= found <= 1:
        raise ValueRefused("SHARE", f"{text!r} is no share; write for example 20% or 0.2")
    return found


ACCIDENTS: dict[str, Callable[[str], float]] = {
    "loss": share,
    "delay": values.duration,
    "jitter": values.duration,
    "duplication": share,
}
"""The settings, as options and while it runs, and how their values are read."""


def inject(line: Line, _realm: str) -> int:
    """Relay until the process is ended."""
    settings = {
        name: read(line.text(f"--{name}")) for name, read in ACCIDENTS.items() if line.text(f"--{name}")
    }
    seed = values.whole("NUMBER", line.text("--seed", "0"), 0, math.inf, "is no seed; write a whole number")
    return asyncio.run(_relay(line, Faults(**settings, seed=seed)))


async def _relay(line: Line, faults: Faults) -> int:
    async with (
        lasting(line) as here,
        relaying(line.text("--listen"), line.text("--connect"), faults) as relay,
    ):
        relay.on_refused = complain
        address = relay.address
        answer(f"ready {address}", lambda: {"ready": address})
        note(faults_in_words(faults))  # so that --delay 20 is seen to be 20 s
        loop = asyncio.get_running_loop()
        threading.Thread(target=_read, args=(loop, relay), name="faults", daemon=True).start()
        await here.wait()
        traffic = relay.traffic
    if line.flag("--json"):
        put(msgspec.json.encode({"traffic": traffic, "refused": relay.refused}).decode())
    else:
        for side, one in traffic.items():
            withheld = f"; {one.withheld} with keys were kept back" if one.withheld else ""
            put(f"from the {side} side: {one.taken} frames came, {one.passed} passed{withheld}")
    if relay.refused and not relay.joined:
        return here.exit_code() or exit_codes.REFUSED
    return here.exit_code()


def faults_in_words(faults: Faults, cut_left: float = 0.0) -> str:
    """The faults of the link, for people; a cut has `cut_left` [s] to go."""
    loss, duplication = f"{faults.loss * 100:.3g}%", f"{faults.duplication * 100:.3g}%"
    delay, jitter = _time(faults.delay), _time(faults.jitter)
    cut = f"; cut, {math.ceil(cut_left * 10) / 10:g} s left" if cut_left else ""
    return f"loss {loss}, delay {delay}, jitter {jitter}, duplication {duplication}{cut}"


def _time(seconds: float) -> str:
    return f"{seconds:g} s" if seconds >= 1 else f"{seconds * 1e3:g} ms"


def _read(loop: asyncio.AbstractEventLoop, relay: Relay) -> None:
    """Read standard input in a thread, for it may be anything."""
    for text in sys.stdin:
        if loop.is_closed():
            return
        loop.call_soon_threadsafe(obey, relay, text)


def obey(relay: Relay, text: str) -> None:
    """Do what one line says; complain about one that says nothing."""
    word, _, value = text.strip().partition(" ")
    try:
        match word:
            case "":
                return
            case "cut":
                relay.cut(values.duration(value))
            case "break":
                relay.end()
            case "heal":
                relay.faults = Faults(seed=relay.faults.seed)
                relay.cut(0.0)
            case _ if word in ACCIDENTS:
                relay.faults = msgspec.structs.replace(relay.faults, **{word: ACCIDENTS[word](value)})
            case _:
                known = ", ".join([*(f"{name} VALUE" for name in ACCIDENTS), "cut TIME", "break", "heal"])
                raise ValueRefused("LINE", f"{word!r} is no fault; there is {known}")
    except SupervisorError as error:
        complain(error)
    else:
        note(faults_in_words(relay.faults, relay.cut_left))
