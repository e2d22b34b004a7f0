"""The families of stories: a seed plays one story of a family, which breaks laws or does not."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from functools import cache, partial
from types import ModuleType

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


def _realm(seed: int) -> Played:
    outcome = story.play(seed)
    return outcome.digest, outcome.broken


def _mesh(seed: int, among: tuple[ModuleType, ...] = ()) -> Played:
    digest, played = mesh.play(seed, among)
    return digest, played.broken


def _host(seed: int, among: tuple[ModuleType, ...] = ()) -> Played:
    digest, played = host.play(seed, among)
    return digest, played.broken


def _disk(seed: int) -> Played:
    digest, played = crashes.play(seed)
    return digest, played.judge.broken


def _moves(seed: int) -> Played:
    digest, played = moves.play(seed)
    return digest, played.judge.broken


def _whole(seed: int, among: tuple[ModuleType, ...] = ()) -> Played:
    digest, played = whole.play(seed, among)
    return digest, played.judge.broken


def _sites(seed: int) -> Played:
    digest, judge = sites.play(seed)
    return digest, judge.broken


def _rights(seed: int) -> Played:
    digest, judge = rights.play(seed)
    return digest, judge.broken


def _hands(seed: int) -> Played:
    digest, judge = hands.play(seed)
    return digest, judge.broken


def _orders(seed: int) -> Played:
    digest, played = orders.play(seed)
    return digest, played.broken


def _groups(seed: int) -> Played:
    digest, played = groups.play(seed)
    return digest, played.broken


FAMILIES: dict[str, Callable[[int], Played]] = {
    "realm": _realm,
    "mesh": _mesh,
    "mesh at statements": lambda seed: _mesh(seed, network()),
    "disk": _disk,
    "moves": _moves,
    "host": _host,
    "host at statements": lambda seed: _host(seed, running()),
    "rights": _rights,
    "hands": _hands,
    "orders": _orders,
    "groups": _groups,
    "sites": _sites,
    "whole": _whole,
    "whole at statements": lambda seed: _whole(seed, (*network(), *running())),
    **{f"threads of {scene}": partial(threads.play, scene) for scene in threads.SCENES},
}
"""Each plays the story of a seed. "At statements": threads lose the processor before any statement, too."""
