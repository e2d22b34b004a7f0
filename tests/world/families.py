"""The families of stories: a seed plays one story of a family, which breaks laws or does not."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from functools import cache, partial
from types import ModuleType
from typing import Any

import robotree.vr.network
import robotree.vr.running
from robotree.vr.agents import callers
from robotree.vr.base import presence
from tests.world import (
    crashes,
    groups,
    hands,
    host,
    mesh,
    moves,
    orders,
    rights,
    sites,
    story,
    threads,
    whole,
)

Played = tuple[str, list[str]]
"""The digest of a trace, and the laws that were broken."""


@cache
def network() -> tuple[ModuleType, ...]:
    """Return the modules of the network, and its table of who is there."""
    return (presence, *_modules_of(robotree.vr.network))


@cache
def running() -> tuple[ModuleType, ...]:
    """Return the modules that carry out the code of robots."""
    return (callers, *_modules_of(robotree.vr.running))


def _modules_of(package: ModuleType) -> list[ModuleType]:
    names = (module.name for module in pkgutil.iter_modules(package.__path__) if not module.ispkg)
    return [importlib.import_module(f"{package.__name__}.{name}") for name in names]


def _realm(seed: int) -> tuple[str, story.Outcome]:
    outcome = story.play(seed)
    return outcome.digest, outcome


STORIES: dict[str, Callable[[int], tuple[str, Any]]] = {
    "realm": _realm,
    "mesh": mesh.play,
    "mesh at statements": lambda seed: mesh.play(seed, network()),
    "disk": crashes.play,
    "moves": moves.play,
    "host": host.play,
    "host at statements": lambda seed: host.play(seed, running()),
    "rights": rights.play,
    "hands": hands.play,
    "orders": orders.play,
    "groups": groups.play,
    "sites": sites.play,
    "whole": whole.play,
    "whole at statements": lambda seed: whole.play(seed, (*network(), *running())),
    **{f"threads of {scene}": partial(threads.play, scene) for scene in threads.SCENES},
}
"""Each plays the story of a seed; gives the digest of its trace, and what has `broken`: the laws.

"At statements": threads lose the processor before any statement, too.
"""


def _judged(family: str, seed: int) -> Played:
    digest, played = STORIES[family](seed)
    return digest, played.broken


FAMILIES: dict[str, Callable[[int], Played]] = {family: partial(_judged, family) for family in STORIES}
