"""The robots as the main page lists them: children below their parents, or sorted; one row each. Pure.

The placements are computed again only when a robot came, left or has another parent; a row is made when it is
looked at, so that a thousand robots cost what the visible ones cost.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, cast, get_args

from robotree.tui.seen import matching, wording
from robotree.tui.seen.status import PROBLEMS, STATUSES, UNGUARDED, Status, span
from robotree.tui.seen.store import Store
from robotree.tui.seen.watched import Alarm
from robotree.vr.base.readable import entered

SortOrder = Literal["tree", "problems", "name", "kind", "state", "by", "host"]
Division = Literal["", "site", "kind", "state"]
DIVISIONS: tuple[Division, ...] = get_args(Division)
"""By what the list is divided into parts with a heading each; empty: it is not."""
HERE = "this machine"
"""Heading of the robots that are at no other site."""
RHYTHM = 1.25
"""[s] An idle robot is heard each second: up to this age it is `≤1 s`, and its line is not drawn again."""
EXACT = 10.0
"""[s] Up to this age tenths are shown."""
ORDERS: tuple[SortOrder, ...] = get_args(SortOrder)
"""How the list can be sorted; `tree`: by name, children below their parents; `problems`: the same, but the
trees in which something is wrong come first, the worst one on top."""

_DIGITS = re.compile(r"([0-9]+)")


@dataclass(frozen=True, slots=True)
class Placement:
    """The place of one robot in the list."""

    name: str
    depth: int = 0
    """How many robots are above it."""
    parent: str = ""
    slot: str = ""
    """The parent's slot that it is in."""
    rail: str = ""
    """The lines of the tree before its name."""
    group: bool = False
    """It is a group of robots, and no robot."""
    heading: str = ""
    """It is no robot, but the line above those that belong together: `hall: 3 robots`."""


@dataclass(frozen=True, slots=True)
class RobotRow:
    """One robot as the list shows it."""

    placement: Placement
    kind: str
    status: Status
    state: str
    """The status in words, with the command that runs."""
    by: str
    """The robot or person that commands it; empty: none."""
    host: str
    about: str
    fresh: bool = False
    """It has just come."""
    place: str = ""
    """The other site at which it is, and how old what is shown of it is: the end of `state`."""
    old: bool = False
    """Whether its own report is old."""
    marked: bool = False
    unlisted: bool = False
    """No lookup service says that it is still there."""
    epoch: str = ""
    """Of its newest lease; it, `lease` and `process` only where the list is wide."""
    lease: str = ""
    """How long its parent's lease still holds, in the latest report."""
    process: str = ""
    """The process that holds it."""
    unguarded: bool = False
    """Its controller obeys every program that reaches it: the link has no key."""
    denied: bool = False
    """The policy lets who sits here command nothing of it."""
    heard: str = ""
    """How long ago it was heard: `1.4 s`."""
    waits: str = ""
    """Who asked for the commands that wait behind the running one."""
    alarm: str = ""
    """The alarm at which a person must look: `fz > 20`."""

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.placement.name


@lru_cache(maxsize=8192)
def natural(text: str) -> tuple[tuple[str | tuple[int, str], ...], str]:
    """Return a key that sorts `r2` before `r10`; texts that differ only in case stand together."""
    parts = _DIGITS.split(text.casefold())
    numbers = ((len(digits), digits) for digits in (part.lstrip("0") for part in parts[1::2]))
    key: list[str | tuple[int, str]] = []
    for word, number in zip(parts[0::2], [*numbers, (0, "")], strict=True):
        key += [word, number]
    return tuple(key), text


def family(store: Store) -> tuple[Placement, ...]:
    """Return the places of all known robots as trees: by name, children below their parents by slot."""
    names = store.known
    below: dict[str, dict[str, str]] = {}
    above: dict[str, str] = {}
    for name in sorted(names, key=natural):
        robot, absent = store.described(name), store.absent.get(name)
        gone = absent and not absent.hangs  # nobody commands who has gone
        for slot in robot.slots if robot and not gone else ():
            if slot.child and slot.child.name in names - above.keys():
                above[slot.child.name] = name
                below.setdefault(name, {})[slot.child.name] = slot.name
    for name in sorted(names - above.keys(), key=natural):
        robot = store.described(name)  # its parent hangs, and cannot say what it commands
        if robot and robot.bond and robot.bond.parent.name in names:
            above[name] = robot.bond.parent.name
            below.setdefault(robot.bond.parent.name, {})[name] = robot.bond.slot
    placements: dict[str, Placement] = {}
    roots = sorted(names - above.keys(), key=natural)
    # the rest is a circle of parents: a fault, which must be seen
    for root in [*roots, *sorted(above, key=natural)]:
        stack = [Placement(root)]
        while stack:
            placement = stack.pop()
            if placement.name in placements:
                continue
            placements[placement.name] = placement
            children = reversed(below.get(placement.name, {}).items())
            stack += [Placement(name, placement.depth + 1, placement.name, slot) for name, slot in children]
    groups = [Placement(name, group=True) for name in sorted(store.groups.keys() - names, key=natural)]
    return (*groups, *_railed(placements.values()))


def _railed(placements: Iterable[Placement]) -> tuple[Placement, ...]:
    """Return the places with the lines of the tree, as they stand below each other."""
    shown = list(placements)
    drawn = rails([placement.depth for placement in shown])
    return tuple(replace(one, rail=rail) if rail else one for one, rail in zip(shown, drawn, strict=True))


def row(
    store: Store, placement: Placement, now: float, marks: Container[str] = (), *, wide: bool = False
) -> RobotRow:
    """Return one robot as the list shows it at this moment [s]; `wide`: with epoch, lease and process."""
    name = placement.name
    if placement.group:
        return _group_row(store, placement, now, marked=name in marks)
    known, agent = store.described(name) or store.robots.get(name), store.known_of(name)
    epoch, lease, process = _more(store, name) if wide else ("", "", "")
    return RobotRow(
        placement,
        kind=wording.kind(agent.kind, agent.attributes) if agent else "",
        status=store.status(name, now),
        state=store.doing(name, now) if agent else "does not answer",
        place=store.place(name, now),
        by=store.by(name),
        host=agent.host if agent else "",
        about=wording.summary(known.doc) if known else "",
        fresh=store.came(name, now),
        old=store.old(name, now),
        marked=name in marks,
        unlisted=store.stale and name in store.robots,
        epoch=epoch,
        lease=lease,
        process=process,
        unguarded=known is not None and known.unguarded,
        denied=bool(store.denied(name)),
        heard=heard(store.age(name, now)),
        waits=", ".join(store.waiters(name)),
        alarm=next((_alarm_words(one) for one in store.watched.open(name)), ""),
    )


def _group_row(store: Store, placement: Placement, now: float, *, marked: bool) -> RobotRow:
    """Return a group as the list shows it: how its members are, and who they are."""
    group, name = store.group(placement.name), placement.name
    count = len(group.members) if group else 0
    return RobotRow(
        placement,
        kind=f"group of {count}",
        status=store.status(name, now),
        state=store.doing(name, now),
        by="",
        host="",
        about=wording.summary(group.about) if group else "",
        marked=marked,
    )


def _alarm_words(alarm: Alarm) -> str:
    return f"{alarm.reading} {alarm.sign} {entered(alarm.limit, alarm.unit)}"


def heard(age: float | None) -> str:
    """Write how long ago [s] a robot was heard; None: never."""
    if age is None:
        return ""
    if age <= RHYTHM:
        return "≤1 s"
    return f"{age:.1f} s" if age < EXACT else span(age)


def _more(store: Store, name: str) -> tuple[str, str, str]:
    """Return epoch, lease and process of a robot."""
    robot, state, absent = store.described(name), store.state(name), store.absent.get(name)
    epoch = state.epoch if state else robot.epoch if robot else 0
    lease = span(robot.bond.remaining) if robot and robot.bond else ""
    process = absent.pid if absent else store.processes.get(name, "").removeprefix("process ")
    return str(epoch or ""), lease, process


_KEYS: Mapping[SortOrder, Callable[[RobotRow], tuple[Any, ...]]] = {
    "kind": lambda one: natural(one.kind),
    "state": lambda one: (STATUSES.index(one.status), one.state),
    "by": lambda one: (not one.by, natural(one.by)),
    "host": lambda one: (not one.host, natural(one.host)),
}


def listed(
    store: Store,
    placements: Sequence[Placement],
    now: float,
    *,
    order: SortOrder = "tree",
    letters: str = "",
    division: Division = "",
) -> tuple[Placement, ...]:
    """Return the places that are shown.

    Args:
        store: what is known.
        placements: all places, from `family`.
        now: [s]
        order: by which they are sorted; all but `tree` and `problems` ignore parents.
        letters: of the filter (`matching`); who is below a robot that is hidden moves up.
        division: by what they stand together, each part in this order below its heading.
    """
    if letters.strip():
        placements = _matching(store, placements, now, letters)
    if not division:
        return _ordered(store, placements, now, order)
    parts: dict[str, list[Placement]] = {}
    part_of = _PARTS[division]
    for placement in placements:
        parts.setdefault(part_of(store, placement.name, now), []).append(placement)
    found: list[Placement] = []
    for part in sorted(parts, key=_RANKS.get(division, natural)):
        inside = _ordered(store, _moved_up(parts[part]), now, order)
        found += [Placement("", heading=_heading(store, part, inside, now)), *inside]
    return tuple(found)


def _heading(store: Store, part: str, inside: Sequence[Placement], now: float) -> str:
    """Return the heading of a part: its name, how many robots it has, and what is wrong with them."""
    wrong = Counter(status for one in inside if (status := store.status(one.name, now)) in PROBLEMS)
    count = f"{len(inside)} robot{'' if len(inside) == 1 else 's'}"
    faults = [f"{wrong[status]} {status}" for status in STATUSES if wrong[status] and status != part]
    return f"{part}: {', '.join([count, *faults])}"


def _site(store: Store, name: str, _now: float) -> str:
    where = store.elsewhere.get(name)
    return where.site if where else HERE


def _kind(store: Store, name: str, _now: float) -> str:
    if store.group(name):
        return "groups"
    known = store.known_of(name)
    return (known.kind if known else "") or "of unknown kind"


_PARTS: Mapping[Division, Callable[[Store, str, float], str]] = {
    "site": _site,
    "kind": _kind,
    "state": lambda store, name, now: store.status(name, now),
}
_RANKS: Mapping[Division, Callable[[str], Any]] = {
    "site": lambda part: (part != HERE, natural(part)),
    "state": lambda part: STATUSES.index(cast("Status", part)),
}
"""How parts are sorted that are not sorted by name."""


def _moved_up(placements: Iterable[Placement]) -> list[Placement]:
    """Return places as they are without those that are not among them: who is below one of these moves up."""
    depths: dict[str, int] = {}
    found: list[Placement] = []
    for one in placements:
        depths[one.name] = depths.get(one.parent, -1) + 1
        found.append(replace(one, depth=depths[one.name], rail=""))
    return found


def _ordered(
    store: Store, placements: Sequence[Placement], now: float, order: SortOrder
) -> tuple[Placement, ...]:
    if order == "tree":
        return _railed(placements)
    if order == "problems":
        return _railed(_worst_first(store, placements, now))
    flat = [Placement(one.name, parent=one.parent, group=one.group) for one in placements]
    flat.sort(key=lambda placement: natural(placement.name))
    if key := _KEYS.get(order):
        made = {placement.name: key(row(store, placement, now)) for placement in flat}
        flat.sort(key=lambda placement: made[placement.name])
    return tuple(flat)


def _matching(store: Store, placements: Sequence[Placement], now: float, letters: str) -> list[Placement]:
    wanted = matching.terms(letters)
    depths: dict[str, int] = {}
    found: list[Placement] = []
    for placement in placements:
        above = depths.get(placement.parent, -1)
        if matching.matches(wanted, FilterFields(store, placement, now)):
            depths[placement.name] = above + 1
            found.append(replace(placement, depth=above + 1, rail=""))
        else:
            depths[placement.name] = above
    return found


def _worst_first(store: Store, placements: Iterable[Placement], now: float) -> list[Placement]:
    """Return the trees sorted by the worst status in each; those without a problem keep their order."""
    trees: list[list[Placement]] = []
    for placement in placements:
        if placement.depth and trees:
            trees[-1].append(placement)
        else:
            trees.append([placement])

    def worst(tree: list[Placement]) -> int:
        found = {store.status(placement.name, now) for placement in tree} & PROBLEMS
        alarmed = any(store.watched.open(placement.name) for placement in tree)
        rest = STATUSES.index("abandoned") if alarmed else len(STATUSES)  # a person must look
        return min(map(STATUSES.index, found), default=rest)

    return [placement for tree in sorted(trees, key=worst) for placement in tree]


class FilterFields(Mapping[str, str]):
    """The fields of one robot for a filter. A field is made when it is looked at, the costly ones last."""

    def __init__(self, store: Store, placement: Placement, now: float) -> None:
        """Look at a robot at this moment [s]."""
        self._store, self._placement, self._now = store, placement, now

    def __getitem__(self, field: str) -> str:
        """Return the text of a field."""
        return _FILTER_FIELDS[field](self._store, self._placement, self._now)

    def __iter__(self) -> Iterator[str]:
        """Go through the names of the fields."""
        return iter(_FILTER_FIELDS)

    def __len__(self) -> int:
        """Count the fields."""
        return len(_FILTER_FIELDS)


def _kinds(store: Store, placement: Placement, _now: float) -> str:
    if placement.group:
        return "group"
    known = store.described(placement.name) or store.robots.get(placement.name)
    return " ".join(known.kinds) if known else ""


def _host(store: Store, placement: Placement, _now: float) -> str:
    known = store.known_of(placement.name)
    return known.host if known else ""


def _about(store: Store, placement: Placement, _now: float) -> str:
    if group := store.group(placement.name):
        return f"{group.about} {' '.join(group.members)}"
    return f"{placement.slot} {store.speaks_of(placement.name)}"


def _state(store: Store, placement: Placement, now: float) -> str:
    known = store.described(placement.name) or store.robots.get(placement.name)
    link = UNGUARDED if known and known.unguarded else ""
    alarm = "alarm" if store.watched.open(placement.name) else ""
    return f"{store.status(placement.name, now)} {store.doing(placement.name, now)} {link} {alarm}"


_FILTER_FIELDS: Mapping[str, Callable[[Store, Placement, float], str]] = {
    "name": lambda _store, placement, _now: placement.name,
    "kind": _kinds,
    "host": _host,
    "by": lambda store, placement, _now: store.by(placement.name),
    "about": _about,
    "state": _state,
}


@dataclass(frozen=True, slots=True)
class Column:
    """A column of the list, and its cells."""

    title: str
    room: int


LEAST = {"ROBOT": 16, "KIND": 11, "STATE": 22, "HEARD": 6, "BY": 9, "HOST": 7, "ABOUT": 20}
"""Cells that a column needs. Where they are not there, ABOUT goes, then HEARD, then HOST, then BY."""
MOST = {"ROBOT": 36, "KIND": 18, "STATE": 34, "HEARD": 6, "BY": 28, "HOST": 14}
"""Cells that it takes however long its words are."""
MORE = {"EPOCH": 11, "LEASE": 5, "PROCESS": 9}
"""Columns that a wide list has before ABOUT, and their cells. They go after ABOUT, the last one first."""
GOES = ("ABOUT", "HEARD", "HOST", "BY")
GAP = 2
_SHRINKS = (("STATE", 14), ("ROBOT", 12), ("KIND", 0), ("ROBOT", 4), ("STATE", 0))
"""To how many cells columns shrink, one after the other, where not even those have room that stay."""


def columns(width: int, longest: Mapping[str, int], *, wide: bool = False) -> tuple[Column, ...]:
    """Share the width of the list among its columns.

    Args:
        width: [cells], with a gap of `GAP` after each column but the last.
        longest: cells of the longest words in a column, by title.
        wide: with the columns of `MORE`.

    Returns:
        The columns that have room, in their order; ROBOT, KIND and STATE always.
    """
    extra = MORE if wide else {}
    needs = {**LEAST, **extra}
    titles = [title for title in LEAST if title != "ABOUT"] + [*extra, "ABOUT"]
    for one in ("", "ABOUT", *reversed(extra), *GOES[1:]):
        titles = [title for title in titles if title != one]
        if sum(needs[title] + GAP for title in titles) - GAP <= width:
            break
    rooms = {title: needs[title] for title in titles}
    left = width - sum(rooms.values()) - GAP * (len(titles) - 1)
    for title, least in _SHRINKS:
        cut = min(max(-left, 0), rooms[title] - least)
        rooms[title] -= cut
        left += cut
    for title in ("STATE", "ROBOT", "KIND", "BY", "HOST"):
        if title in rooms:
            more = min(max(min(longest.get(title, 0), MOST[title]) - rooms[title], 0), left)
            rooms[title] += more
            left -= more
    rooms[titles[-1]] += max(left, 0)
    return tuple(Column(title, room) for title, room in rooms.items())


def rails(depths: Sequence[int]) -> list[str]:
    """Return what stands before each line of a tree, two cells for each level.

    Args:
        depths: how many lines are above each line in the tree, from the top; roots have 0.
    """
    found: list[str] = []
    following: set[int] = set()
    """Depths at which another line follows, under the same line of the tree."""
    for depth in reversed(depths):
        following = {level for level in following if level <= depth}
        bars = ["│ " if level in following else "  " for level in range(1, depth)]
        elbow = "" if not depth else "├ " if depth in following else "└ "
        found.append("".join(bars) + elbow)
        following.add(depth)
    return found[::-1]
