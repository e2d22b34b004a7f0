"""One command under many seeds, with faults, and the laws that it must keep whatever goes wrong.

The first play, without faults, must succeed; it shows how many steps and how long the command takes. Then
each seed draws how long messages take and up to three faults: a child refuses, is late, is lost or stands
still; the operator cancels; a protective stop. The laws:

    - the command ends, by a result or an error, soon after its deadline at the latest;
    - a mistake of the page itself (an error that is no `VrError`) never ends it;
    - without a fault that has happened it succeeds;
    - when it has ended, no child goes on with what it had started and not detached, and no child is
      commanded any more;
    - the page takes commands afterwards: no code of it runs on.
"""

from __future__ import annotations

import random
import traceback
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import msgspec

from robotree.testing import chosen
from robotree.testing.parts import Fault, PageSource, Parts
from robotree.testing.team import Going, Team
from robotree.vr.base.errors import VrError

MOST_FAULTS = 3
AFTERWARDS = 3.0
"""[s] after its end in which what it has started must have ended, too."""
SPARE = 20.0
"""[s] after its deadline by which a command has ended, or never will."""
ON_THE_WAY = 1.0
"""[s] that a message to a child may be under way when its command ends."""
SLOWEST = 0.05
"""[s] that a message takes longer at most."""

Check = Callable[[Team], object]
"""Looks at a team after the command has ended, and raises if something is not as it should be."""


class Trial(msgspec.Struct, frozen=True):
    """The story that is played under each seed."""

    page: PageSource
    command: str
    arguments: Mapping[str, Any]
    within: float
    check: Check | None
    settings: Mapping[str, Any]
    children: Mapping[str, Parts]

    @property
    def name(self) -> str:
        """Page and command, for people."""
        page = self.page.__name__ if isinstance(self.page, type) else str(self.page)
        return f"{page}.{self.command}"


class Shape(msgspec.Struct, frozen=True):
    """How the command goes when nothing goes wrong."""

    steps: int
    """Commands of children that move."""
    seconds: float


def play_seeds(trial: Trial, seeds: int | Iterable[int]) -> None:
    """Play a trial under seeds, the first without faults; see `rehearse_seeds`.

    Raises:
        AssertionError: a law is broken.
    """
    shape = _play_in_peace(trial)
    for seed in _chosen(seeds):
        play(trial, shape, seed)


def _chosen(seeds: int | Iterable[int]) -> Iterable[int]:
    if chosen.seed is not None:
        return (chosen.seed,)
    return range(seeds) if isinstance(seeds, int) else seeds


def _play_in_peace(trial: Trial) -> Shape:
    with Team(trial.page, trial.children, seed=0, settings=trial.settings) as team:
        began = team.now
        try:
            team.call(trial.command, within=trial.within, **trial.arguments)
        except VrError as error:
            raise AssertionError(f"{trial.name} fails though nothing goes wrong: {error}") from error
        shape = Shape(len(team.commanded), team.now - began)
        _look_afterwards(trial, team, "without a fault")
        return shape


def play(trial: Trial, shape: Shape, seed: int) -> None:
    """Play a trial under one seed.

    Raises:
        AssertionError: a law is broken.
    """
    with Team(trial.page, trial.children, seed=seed, settings=trial.settings) as team:
        chance = random.Random(f"{seed} faults")
        team.world.network.weather.jitter = chance.choice([0.0, 0.0, SLOWEST * chance.random()])
        for _ in range(chance.randrange(MOST_FAULTS + 1)):
            _plan(team, shape, chance)
        going = team.start(trial.command, within=trial.within, **trial.arguments)
        label = f"seed {seed}"
        try:
            team.wait_until(lambda: going.done, within=trial.within + SPARE)
        except TimeoutError:
            _broken(trial, team, label, f"it has not ended {SPARE:g} s after its deadline")
        _look_at_end(trial, team, label, going)
        _look_afterwards(trial, team, label)


def _plan(team: Team, shape: Shape, chance: random.Random) -> None:
    """Draw one fault."""
    at = chance.randint(1, max(shape.steps, 1))
    after = chance.choice([0.0, chance.uniform(0.0, 1.5)])
    what = chance.choice(["refuse", "delay", "lose", "lose", "freeze", "stop", "cancel", "cancel"])
    team.plan(
        Fault(
            what=what,  # type: ignore[arg-type] # one of its words
            at=at,
            after=0.0 if what in {"refuse", "delay"} else after,
            by=chance.uniform(0.1, 8.0) if what in {"delay", "freeze"} else 0.0,
            why="the seed has it so",
        )
    )


def _look_at_end(trial: Trial, team: Team, label: str, going: Going) -> None:
    try:
        going.result()
    except VrError as error:
        if (mistake := team.raised_in(error)) is not None and not isinstance(mistake, VrError):
            where = "".join(traceback.format_exception(mistake)[-3:]).rstrip()
            _broken(trial, team, label, f"the page itself makes a mistake: {mistake!r}\n{where}", error)
        if not team.struck:
            _broken(trial, team, label, f"it fails though nothing goes wrong: {error}", error)


def _look_afterwards(trial: Trial, team: Team, label: str) -> None:
    ended = team.now
    team.wait(AFTERWARDS)
    for path, agent in team.agents():
        if agent.abandoned:
            _broken(trial, team, label, f"{path or 'the page'} has code that cannot be ended")
        left = agent.runtime.look(
            lambda state: [call.command for call in state.calls.live.values() if not call.detached]
        )
        if left and not team.stands_still(path):
            names = ", ".join(left)
            _broken(trial, team, label, f"{path or 'the page'} goes on with {names} after the end")
    for step in team.steps:
        if step.robot and not step.reads and step.at > ended + ON_THE_WAY:
            _broken(trial, team, label, f"{step.robot}.{step.command} is commanded after the end")
    if trial.check is not None:
        try:
            trial.check(team)
        except Exception as error:  # noqa: BLE001 # whatever a check raises, its seed has to be named
            _broken(trial, team, label, f"the test's own check fails: {error}", error)


def _broken(trial: Trial, team: Team, label: str, law: str, error: Exception | None = None) -> None:
    story = "\n".join(f"    {line}" for line in team.story().splitlines())
    replay = f"{trial.name}, {label}: {law}\n{story}"
    if label.startswith("seed "):
        number = label.removeprefix("seed ")
        replay += f"\n  again: rehearse_seeds(..., seeds=[{number}])  or  pytest --robotree-seed {number}"
    raise AssertionError(replay) from error
