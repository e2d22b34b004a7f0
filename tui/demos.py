"""The verb `demo`: which story is played, and where."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robotree.tui import demo_companion as names
from robotree.tui.errors import ValueRefused
from robotree.tui.line import values
from robotree.tui.line.installed import require
from robotree.tui.processes.ending import to_the_end
from robotree.tui.processes.realm import only_looking
from robotree.tui.supervising import take_calm
from robotree.tui.terminal import no_screen, note
from robotree.tui.wire import security

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from robotree.tui.line.grammar import Line

EXTRAS = {
    names.NAME: "scripts", names.SITES: "machines", names.TRAVEL: "machines", names.MCP: "mcp",
}  # fmt: skip
"""What a story needs beyond the simulation."""


def demo(line: Line, _realm: str) -> int:
    """Play the demo: on the full screen where there is a terminal for it, else as its script."""
    take_calm(line)
    story, headless = line.text("STORY"), line.flag("--headless")
    if (without := no_screen()) and not headless:
        note(
            f"the full screen needs a terminal, and {without}; the demo plays its script (`demo --headless`)"
        )
    if names.wanted(story) and line.flag("--crash"):
        raise ValueRefused("--crash", "the host of the cell is killed, not that of the companion's flat")
    if line.text("--delay") and story not in {names.SITES, names.TRAVEL}:
        raise ValueRefused("--delay", "only `demo sites` and `demo travel` have a line between sites")
    drawn = not (headless or without)
    require("demo", *([EXTRAS[story]] if story in EXTRAS else []), *(["tui"] if drawn else []))
    if drawn:
        from robotree.tui.screen import keymap

        keymap.load()  # one that is wrong is told before anything begins
    how = {
        "headless": not drawn,
        "realm": line.text("--realm"),
        "readonly": only_looking(given=line.flag("--readonly")),
        "key": security.wanted(line, security.REALM),
    }
    return to_the_end(_story(line, story, how), on_screen=not headless)


def _story(line: Line, story: str, how: dict[str, Any]) -> Coroutine[Any, Any, int]:
    """Return the story that a line wants; what it needs is loaded now."""
    if story in {names.SITES, names.TRAVEL}:
        return _of_sites(line, story, how)
    if story == names.AWAY:
        from robotree.tui.demo_away import away

        return away(**how)
    if story == names.MCP:
        from robotree.tui import demo_mcp

        return demo_mcp.demo(speedup=line.text("--speedup", "1"), **how)
    from robotree.tui import demo as stage
    from robotree.tui import demo_crash

    play: stage.Story = demo_crash.Crash() if line.flag("--crash") else stage.CELL
    if story == names.COMPOSE:
        from robotree.tui import demo_compose

        play = demo_compose.Compose()
    elif story == names.NAME:
        play = names.STORY
    wire = stage.Wire.of(can=line.flag("--can"), classic=line.flag("--classic"))
    return stage.demo(
        play, pictures=line.text("--pictures"), wire=wire, speedup=line.text("--speedup", "1"), **how
    )


def _of_sites(line: Line, story: str, how: dict[str, Any]) -> Coroutine[Any, Any, int]:
    """Return a demo of several machines.

    Raises:
        ValueRefused: it has no such option.
    """
    from robotree.tui import demo_sites, demo_travel

    for option in ("--crash", "--can", "--classic", "--pictures"):
        if line.flag(option) or line.text(option):
            raise ValueRefused(
                option, f"`demo {story}` has a course of its own; it takes --headless, --delay and --speedup"
            )
    travel, longest = story == names.TRAVEL, demo_sites.LONGEST_DELAY
    refusal = f"must be a number of milliseconds from 0 to {longest}"
    return demo_sites.demo(
        delay=values.whole("MS", line.text("--delay", f"{demo_sites.DELAY}"), 0, longest, refusal),
        speedup=line.text("--speedup", demo_travel.SPEEDUP if travel else "1"),
        make=demo_travel.Travel if travel else None,
        **how,
    )
