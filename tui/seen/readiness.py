"""Why a robot is not ready for a command: all reasons, not only the one that its status names. Pure."""

from __future__ import annotations

from robotree.tui.seen import status
from robotree.tui.seen.store import Store
from robotree.vr.base.description import lacking


def reasons(store: Store, name: str, now: float) -> tuple[str, ...]:
    """Return all that keeps a robot, or one that it commands, from working; empty: it is ready.

    Args:
        store: what is known.
        name: of the robot.
        now: [s] on the store's clock.
    """
    robot, state = store.described(name), store.state(name)
    condition = state or robot
    found = [*_faults(store, name, now), *_below(store, name, now)]
    parent = store.by(name) if condition and condition.bond is not None else ""
    if parent:
        found.append(f"commanded by {parent}: command that one, or release this one")
    elif condition and condition.busy:
        caller = state.caller if state else ""
        found.append(f"{condition.busy} runs{f', asked for by {caller}' if caller else ''}")
    return tuple(found)


def _below(store: Store, name: str, now: float, above: tuple[str, ...] = ()) -> list[str]:
    """Return what the robots that a robot commands need themselves; their stop is its stop."""
    robot, found = store.described(name), list[str]()
    for slot in robot.slots if robot and name not in above else ():
        if slot.child:
            child = slot.child.name
            found += [f"{child}: {fault}" for fault in _faults(store, child, now, stop=False)]
            found += _below(store, child, now, (*above, name))
    return found


def _faults(store: Store, name: str, now: float, *, stop: bool = True) -> list[str]:
    """Return what is wrong with a robot itself."""
    robot = store.described(name)
    condition = store.state(name) or robot
    found: list[str] = []
    if absent := store.absent.get(name):
        found.append(absent.remedy)
    elif store.status(name, now) == "silent":
        found.append(f"no state has come from it for {status.span(store.age(name, now) or 0.0)}")
    if condition and not condition.online:
        where = robot.attributes.get("controller", "") if robot else ""
        held = robot.attributes.get("held_by", "") if robot else ""
        why = f"is held by {held}" if held else "does not answer"
        said = robot.attributes.get(status.CONDITION, "") if robot else ""
        found.append(said or f"offline: its controller {f'at {where} ' if where else ''}{why}")
    if stop and condition and condition.stopped:
        found.append(stopped(store, name, now))
    if condition and condition.abandoned:
        home = f"host {robot.host}" if robot and robot.host else "its process"
        found.append(f"{', '.join(condition.abandoned)} ignores cancel and still runs: restart {home}")
    found += [
        f"slot {lack.slot} is empty, it takes {lack.kind}"
        if lack.number == 1
        else f"{lack.slot} needs {lack.number} more of kind {lack.kind}"
        for lack in lacking(robot.slots if robot else ())
    ]
    return found


def stopped(store: Store, name: str, now: float) -> str:
    """Return why a robot is in protective stop, for how long, and how soon it confirmed it."""
    condition = store.state(name) or store.described(name)
    parts = [condition.stop_reason if condition and condition.stop_reason else "protective stop"]
    if since := store.stopped_since(name):
        at, whole = since
        parts.append(f"for {'' if whole else 'at least '}{status.span(now - at)}")
    if store.stop and name in store.stop.confirmed:
        parts.append(f"confirmed after {store.stop.confirmed[name]:.2f} s")
    elif store.stop and name in store.stop.open:
        parts.append(f"NOT CONFIRMED: {store.stop.open[name]}")
    return ", ".join(parts)
