"""The functions that tests call; what they need is loaded when they are called."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from robotree.testing.parts import PageSource, Parts

if TYPE_CHECKING:
    from robotree.testing.seeds import Check
    from robotree.testing.simulated import Simulated
    from robotree.testing.team import Team


def rehearse(
    page: PageSource, /, *, seed: int = 0, settings: Mapping[str, Any] | None = None, **children: Parts
) -> Team:
    """Let a page live in virtual time, with these robots in its slots.

        team = rehearse(PickAndPlace, arm=Fake(Arm))

    Args:
        page: its class, or the path of its file.
        seed: of the order of events; the same seed, the same order.
        settings: of the page, as `robotree create … name=value` gives them.
        **children: what is in each slot; a slot that is not named stays empty.

    Returns:
        The team, ready to be called. It ends with its `with` block; pytest also ends it with the test.

    Raises:
        TypeError: the page has no such slot, or a child is nothing that can be in one.
        VrError: the page cannot be made, or does not take a child.
    """
    from robotree.testing.team import Team

    return Team(page, children, seed=seed, settings=dict(settings or {}))


def rehearse_seeds(
    page: PageSource,
    command: str,
    arguments: Mapping[str, Any] | None = None,
    /,
    *,
    seeds: int | Iterable[int] = 100,
    within: float = 60.0,
    check: Check | None = None,
    settings: Mapping[str, Any] | None = None,
    **children: Parts,
) -> None:
    """Call a command under many seeds, with faults that each seed draws, and check the laws of `seeds`.

    Args:
        page: its class, or the path of its file.
        command: of the page.
        arguments: of the command.
        seeds: how many, or which.
        within: [s] of virtual time that the command has.
        check: called with the team after each seed; what it raises is a failure of that seed.
        settings: see `rehearse`.
        **children: see `rehearse`.

    Raises:
        AssertionError: a law is broken; it names the seed, what was done, and how to play it again.
    """
    from robotree.testing.seeds import Trial, play_seeds

    trial = Trial(page, command, dict(arguments or {}), within, check, dict(settings or {}), children)
    play_seeds(trial, seeds)


def cell(kind: str = "arm") -> Simulated:
    """Return the simulated robot of a kind, with its real proxy and firmware, in virtual time.

    Args:
        kind: `arm` or `rover`.

    Raises:
        ValueError: there is no such kind.
        ImportError: the simulation is not installed; it names the command that installs it.
    """
    from robotree.testing.simulated import Simulated
    from robotree.vr.base.extras import lacks

    for lack in lacks("sim"):
        raise ImportError(str(lack))
    return Simulated(kind)
