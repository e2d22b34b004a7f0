"""Carrying out one line over a realm: the same way at the prompt, on the command line and in a session."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, NamedTuple

from robotree.tui.errors import NotForRobots, SupervisorError, sentence
from robotree.tui.line import away, groups
from robotree.tui.line.actions import BY_VERB
from robotree.tui.line.grammar import Line
from robotree.tui.line.verbs import Outcome, Run, Teller

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.vr.supervision.realm_client import RealmClient


Program = Callable[[Line, str], int | Coroutine[Any, Any, int]]
"""Carries a line of the shell out in a realm: returns its exit code, or what an event loop makes it from."""


class Refusal(NamedTuple):
    """A line that was refused, or failed: nothing of it is left running."""

    error: Exception

    def __str__(self) -> str:
        """Return what it says to a person."""
        return sentence(self.error)


class Silent:
    """A teller that nobody hears."""

    def progress(self, fraction: float, text: str) -> None:
        """Take no notice."""

    def warn(self, text: str) -> None:
        """Take no notice."""

    def outcome(self, outcome: Outcome) -> None:
        """Take no notice."""


def function_of(verb: str) -> Run:
    """Return the function that carries a verb out.

    Raises:
        NotForRobots: it starts a program, or is one of the screen alone.
    """
    if not BY_VERB[verb].run:
        raise NotForRobots(verb)
    run: Run = resolve_name(f"robotree.tui.{BY_VERB[verb].run}")
    return run


def program_of(verb: str) -> Program:
    """Return what a verb starts in a shell."""
    program: Program = resolve_name(f"robotree.tui.{BY_VERB[verb].start or 'line.shell:ask'}")
    return program


async def carry_out(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome | Refusal:
    """Carry out one line.

    Args:
        realm_client: over which it is carried out.
        line: a verb and its values.
        teller: hears of it while it goes on.

    Returns:
        What came of it; or why nothing did, where that is for people. Mistakes of ours pass through.
    """
    from robotree.vr.base.errors import NoSuchRobot, VrError

    try:
        run = function_of(line.verb)
        if group := groups.meant(realm_client, line):
            return await groups.for_all(run, realm_client, line, teller, group)
        return await run(realm_client, line, teller)
    except NoSuchRobot as error:
        return Refusal(await asyncio.to_thread(away.explained, realm_client.realm, error))
    except (VrError, SupervisorError, OSError) as error:
        return Refusal(error)
    except ImportError as error:
        from robotree.tui.line.installed import lacking

        if lack := lacking(line.verb, error):
            return Refusal(lack)
        raise
