"""The verbs as functions over the realm client, without a screen and without a keyboard.

Each takes the realm client, the line that was understood and a `Teller`, and returns an `Outcome`: plain data
for `--json`, text for people. Errors of the agents pass through: they already say what to do.
"""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager, AsyncExitStack
from functools import partial
from math import inf, isfinite, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, NoReturn, Protocol, cast

from robotree.files import overwrite
from robotree.tui.errors import BadLine, OldList, SomeHang, SomeSilent, SupervisorError, ValueRefused
from robotree.tui.line import away, checking, poses, sources, values
from robotree.tui.line.grammar import Line
from robotree.tui.seen import absence, forest, status, unlisted, wording
from robotree.vr.base.readable import quantity

if TYPE_CHECKING:  # help must not wait for the agents
    from collections.abc import Collection, Iterable, Mapping, Sequence

    from robotree.tui.line.sources import PageFiles
    from robotree.tui.seen.store import Weight
    from robotree.vr.base.address import Role
    from robotree.vr.base.description import FieldSpec, Listing, RobotDescription
    from robotree.vr.base.errors import NoSuchRobot
    from robotree.vr.base.order import KnownAgent
    from robotree.vr.base.presence import Held
    from robotree.vr.base.requests import HostDescribed, Level, LoggedLine, Reloaded, SpaceDescribed, State
    from robotree.vr.exchange.attendance import Attendance
    from robotree.vr.supervision.realm_client import Elsewhere, RealmClient

ANSWER_LIMIT = 30.0
"""[s] until a script has taken the answer to its question."""
CALL_LIMIT = 120.0
"""[s] that a command may take when the line does not say."""

SCRIPT_LIMIT = 7 * 24 * 3600.0
"""[s] that a script may lead when the line does not say: a week, the longest that any robot allows."""

LEVELS: Mapping[Weight, Level] = {"good": "info", "plain": "info", "warning": "warning", "error": "error"}
"""Level of what was seen from here, by its weight."""

STEP_WITHIN = 10.0
"""[s] in which `step` waits for the end of the step that it let pass."""
FOLLOWING = 0.1
"""[s] between two looks for what was logged."""

PICTURE = (640, 360)
"""[px] size of a picture when the line does not say: 16:9, about 40 kB."""


class Outcome(NamedTuple):
    """The result of a verb."""

    data: Any
    """Plain data: what `--json` prints."""
    text: str = ""
    """The same for people; may be empty."""
    doubt: SupervisorError | None = None
    """Why the result may be incomplete: printed beside it, and shown by the exit code."""
    logged: bool = False
    """The log of its robot tells the same, and who wanted it; the screen shows that log already."""


class Teller(Protocol):
    """A listener of a verb while it goes on."""

    def progress(self, fraction: float, text: str) -> None:
        """Take the progress of a command: 0 to 1, NaN where it is unknown."""
        ...

    def warn(self, text: str) -> None:
        """Take what a person should know before the verb has ended, as a sentence."""
        ...

    def outcome(self, outcome: Outcome) -> None:
        """Take one of many outcomes (`watch`)."""
        ...


Hold = Callable[[str, str, "Attendance"], Callable[[], None] | None]
"""Method `hold_key` of a teller: asks the person to hold a key for a command of a robot, and passes each on;
returns how to end that, or None: nobody sits there."""

Run = Callable[["RealmClient", Line, Teller], Awaitable[Outcome]]
"""A function that carries out a verb: the registry names these functions, and `carrying` finds them."""


# -- looking ---------------------------------------------------------------------------------------


async def ls(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """List robots, also those that are away where a directory knows them, views, hosts or lookup services."""
    if line.flag("--lookups"):
        names = sorted(realm_client.services)
        silent = _silent(realm_client, "lookup", names)
        lines = [*names, *(f"{name}  {MUTE}" for name, _, _ in silent)]
        data: list[dict[str, Any]] = [{"name": name} for name in names]
        text = "\n".join(lines) or "no lookup service is running"
        return Outcome([*data, *_mute(silent)], text, SomeSilent(silent) if silent else None)
    if line.flag("--hosts"):
        return await _hosts(realm_client)
    what: Literal["view", "robot"] = "view" if line.flag("--views") else "robot"
    doubt = OldList() if realm_client.stale else None
    if realm_client.stale:
        found = await unlisted.known(realm_client, what)
    else:
        found = realm_client.views() if what == "view" else realm_client.robots()
    if what == "view":
        return _listed(found, what, doubt, elsewhere=await realm_client.elsewhere())
    hanging = await _hanging(realm_client)
    answering = {robot.name: robot for robot in await realm_client.tree()}
    unheard, incomplete = _unheard(realm_client, answering, hanging)
    states = {name: status.text(robot, answering.get, hanging) for name, robot in answering.items()} | unheard
    known = {one.name for one in found}
    unseen = [name for name in hanging if name not in known]
    if unseen:
        remembered = {each.name: each for each in await realm_client.orders.known(brief=True)}
        hosts = {one.where: name for name, one in _agents_of("host", await realm_client.hanging()).items()}
        found = [*found, *(_last_known(name, hanging[name][0], remembered, hosts) for name in unseen)]
    away = await absent_robots(realm_client, {*states, *(one.name for one in found)})
    states |= await absent_states(realm_client, away)
    found = [*found, *(_listing_of(each) for each in away)]
    listed = _listed(
        found,
        what,
        doubt or incomplete,
        {one.name: states.get(one.name, MUTE) for one in found},
        await realm_client.elsewhere(),
        {robot.name: robot.operator for robot in answering.values() if robot.operator},
    )
    asked = [f"{one.name} asks: {one.asks}" for one in answering.values() if one.asks]
    hint = ["answer with `robotree decide NAME done|again|abort`"] if asked else []
    return listed._replace(text="\n".join([listed.text, *asked, *hint]))


def _listing_of(known: KnownAgent) -> Listing:
    """Return a robot that is away as a lookup service listed it."""
    from robotree.vr.base.address import Address
    from robotree.vr.base.description import Listing

    robot = known.robot
    if robot is None:
        return _unknown(known.name)
    return Listing(
        address=Address("robot", known.name, ""),
        kinds=robot.kinds,
        doc=robot.doc,
        host=robot.host,
        attributes=robot.attributes,
    )


async def _hosts(realm_client: RealmClient) -> Outcome:
    """List the hosts: what they have to do, how far they are from each other, and their robots."""
    hosts = sorted(await realm_client.hosts(), key=lambda host: host.address.name)
    data: list[dict[str, Any]] = [
        {
            "name": one.address.name,
            "robots": [each.name for each in one.robots],
            "stands_by": one.stands_by,
            "instead_of": one.instead_of,
            "trouble": one.trouble,
            "load": plain(one.load),
            "ways": host_ways(one, hosts),
        }
        for one in hosts
    ]
    silent = _silent(realm_client, "host", [one.address.name for one in hosts])
    rows = [
        (
            host.address.name,
            wording.load(host.load),
            wording.ways(host_ways(host, hosts)),
            ", ".join(each.name for each in host.robots) or "-",
            _condition(one),
        )
        for one, host in zip(data, hosts, strict=True)
    ]
    rows += [(name, "", "", MUTE, "") for name, _, _ in silent]
    head = ("HOST", "LOAD", "WAY TO OTHERS", "ROBOTS", "")
    text = wording.columns([head, *rows]) if rows else "no host is running"
    return Outcome([*data, *_mute(silent)], text, SomeSilent(silent) if silent else None)


def host_ways(host: HostDescribed, hosts: Sequence[HostDescribed]) -> dict[str, float]:
    """Return the round trips [s] from a host to the others, by name."""
    names = {one.address.key: one.address.name for one in hosts}
    return {names[key]: way for key, way in sorted(host.ways.items()) if key in names}


def _condition(host: Mapping[str, str]) -> str:
    """Return for whom a host stands by, whose robots it has, and what is wrong with it, in words."""
    words = {"stands_by": "stands by for ", "instead_of": "instead of ", "trouble": ""}
    return "; ".join(f"{word}{host[key]}" for key, word in words.items() if host[key])


async def space_ls(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """List the spaces, or the entries and fences of one."""
    name, kind = line.text("NAME"), line.text("KIND")
    if name:
        return _contents(await realm_client.look_into_space(name, kind, most=SHOWN))
    spaces = sorted(await realm_client.spaces(), key=lambda space: space.address.name)
    silent = _silent(realm_client, "space", [one.address.name for one in spaces])
    rows: list[tuple[str, ...]] = [("SPACE", "ENTRIES", "TRANSACTIONS", "WAITING", "SURVIVES", "STORE")]
    for one in spaces:
        counts = (sum(one.counts.values()), one.transactions, one.waiting)
        rows.append((one.address.name, *map(str, counts), one.durability, one.store))
    rows += [(name, *["-"] * 4, MUTE) for name, _, _ in silent]
    text = wording.columns(rows) if rows[1:] else "no space is running"
    doubt = SomeSilent(silent) if silent else None
    return Outcome(
        [*({"name": one.address.name} | plain(one) for one in spaces), *_mute(silent)], text, doubt
    )


SHOWN = 200
"""Entries of a space that are listed at most."""


def _contents(space: SpaceDescribed) -> Outcome:
    """Return what is in a space."""
    parts = [f"{count} {kind}" for kind, count in sorted(space.counts.items())]
    paragraphs = [f"{space.address.name}: {', '.join(parts) or 'empty'} ({space.durability}, {space.store})"]
    if space.entries:
        rows: list[tuple[str, ...]] = [("ENTRY", "KIND", "LEASE", "KEY", "FIELDS")]
        for entry in space.entries:
            fields = " ".join(f"{name}={value!r}" for name, value in entry.entry.fields.items())
            lease = "held" if entry.held else _lease(entry.term)
            rows.append((str(entry.id), entry.entry.kind, lease, entry.key or "-", fields))
        paragraphs.append(wording.columns(rows))
    if space.fences:
        rows = [("FENCE", "EPOCH", "HOLDER", "LEFT")]
        rows += [
            (fence.name, str(fence.epoch), fence.holder or "-", _lease(fence.term)) for fence in space.fences
        ]
        paragraphs.append(wording.columns(rows))
    return Outcome(plain(space), "\n\n".join(paragraphs))


def _lease(seconds: float) -> str:
    """Return what is left of a lease."""
    return "-" if not seconds else "for ever" if seconds == inf else f"{seconds:.0f} s"


def _unheard(
    realm_client: RealmClient, answered: Collection[str], hanging: Mapping[str, tuple[str, str]]
) -> tuple[dict[str, str], SupervisorError | None]:
    """Return the states of robots that have not answered, by name, and why a list is not complete, if so."""
    late = set(_robots_of(realm_client.late())) - set(answered)
    silent = _silent(realm_client, "robot", {*answered, *hanging, *late})
    states = dict.fromkeys(late, "late") | {name: MUTE for name, _, _ in silent}
    states |= {name: f"HANGS ({where})" for name, (where, _) in hanging.items()}
    return states, _some_hang(hanging) or (SomeSilent(silent) if silent else None)


def _robots_of(held: Iterable[Held]) -> dict[str, Held]:
    """Return the robots among agents, by name."""
    return _agents_of("robot", held)


def _agents_of(role: Role, held: Iterable[Held]) -> dict[str, Held]:
    """Return the agents of one role, by name."""
    from robotree.vr.base.address import shown_address

    found = ((shown_address(one.key), one) for one in held)
    return {address.name: one for address, one in found if address and address.role == role}


async def _hanging(realm_client: RealmClient) -> dict[str, tuple[str, str]]:
    """Return the robots that live in processes that answer nobody: where, and what can be done about it.

    Those of a frozen process of which nobody knows them have one name: `any robot of process 4711`.
    """
    hanging = _robots_of(await realm_client.hanging()) | {
        f"any robot of {one.where}": one for one in realm_client.unnamed()
    }
    return {name: (one.where, one.remedy) for name, one in hanging.items()}


def _silent(realm_client: RealmClient, role: Role, answered: Collection[str]) -> list[tuple[str, str, str]]:
    """Return which agents of a role run, by the machine's record, and have not answered.

    Returns:
        Name, where it is, and what to do, of each.
    """
    held = _agents_of(role, realm_client.held())
    return sorted((name, one.in_words, one.remedy) for name, one in held.items() if name not in answered)


def _mute(silent: Sequence[tuple[str, str, str]]) -> list[dict[str, Any]]:
    return [{"name": name, "state": MUTE} for name, _, _ in silent]


def _some_hang(hanging: Mapping[str, tuple[str, str]]) -> SomeHang | None:
    return SomeHang([(name, *how) for name, how in sorted(hanging.items())]) if hanging else None


def _unknown(name: str) -> Listing:
    """Return a listing of a robot of which nobody can say what it is."""
    from robotree.vr.base.address import Address
    from robotree.vr.base.description import Listing

    return Listing(address=Address("robot", name, ""), kinds=("?",))


def _last_known(
    name: str, where: str, remembered: Mapping[str, KnownAgent], hosts: Mapping[str, str]
) -> Listing:
    """Return a listing of one that hangs: as directories remember it, or in the host that hangs there."""
    import msgspec

    if name in remembered:
        return _listing_of(remembered[name])
    return msgspec.structs.replace(_unknown(name), host=hosts.get(where, ""))


MUTE = "does not answer"
"""State of a robot that is listed and does not say how it is: its process hangs, or has just gone."""


def _listed(
    listings: Sequence[Listing],
    what: str,
    doubt: SupervisorError | None,
    states: Mapping[str, str] | None = None,
    elsewhere: Mapping[str, Elsewhere] | None = None,
    control: Mapping[str, str] | None = None,
) -> Outcome:
    """Return a list; one in doubt says so in each line, for lines are what programs and people cut out.

    Where agents of other sites are among them, each line says where, and how old it is; where somebody has
    control of a robot, it says who.
    """
    old, elsewhere, control = isinstance(doubt, OldList), elsewhere or {}, control or {}
    extra = {"stale": True} if old else {}
    mark = ("stale",) if old else ()
    data: list[dict[str, Any]] = []
    about = ["STATE", *(["CONTROL"] if control else []), "LINK"] if states else []
    places = ["SITE"] if elsewhere else []
    rows = [("NAME", "KIND", *about, "HOST", *places, *(["LISTED"] if old else []), "ABOUT")]
    for listing in sorted(listings, key=lambda one: one.name):
        held = {"control": control.get(listing.name, "")} if control else {}
        state = {"state": states[listing.name], **held, "link": listing.link} if states else {}
        place = elsewhere.get(listing.name)
        there = {"site": place.site, "age": place.age, "silent": place.silent} if place else {}
        data.append({**plain(listing), **state, **there, **extra})
        cells = (value or "-" for value in (*state.values(), listing.host))
        rows.append(
            (
                listing.name,
                wording.kind(listing.kind, listing.attributes),
                *cells,
                *([place.words if place else "-"] if elsewhere else []),
                *mark,
                wording.summary(listing.doc),
            )
        )
    text = wording.columns(rows) if data else f"no {what} is {'known' if old else 'listed'}"
    return Outcome(data, text, doubt)


async def tree(realm_client: RealmClient, _line: Line, _teller: Teller) -> Outcome:
    """Show the robots as trees; below them those that are away."""
    hanging, robots = await _hanging(realm_client), await realm_client.tree()
    unheard, incomplete = _unheard(realm_client, {robot.name for robot in robots}, hanging)
    elsewhere = await realm_client.elsewhere()
    roots = forest.forest(robots, hanging, unheard, elsewhere)
    drawn = {name for root in roots for name in forest.names(root)}
    lost = {name: state for name, state in sorted(unheard.items()) if name not in drawn}
    away = await absent_robots(realm_client, drawn | lost.keys())
    lost |= await absent_states(realm_client, away)
    rest: list[dict[str, Any]] = [
        {"name": name, "kind": "", "state": state, "children": []} for name, state in lost.items()
    ]
    lines = [forest.drawing(roots), *(f"{name}  {state}" for name, state in lost.items())]
    lines += [f"group {name}: {group.about}" for name, group in realm_client.groups.all().items()]
    text = "\n".join(filter(None, lines)) or "no robot is running"
    return Outcome([*map(forest.structure, roots), *rest], text, incomplete)


async def show(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Describe one robot, with what it reads now."""
    robot = await realm_client.describe(line.text("NAME"))
    readings = {name: value for name, value in robot.readings.items() if isfinite(value)}
    text, place = wording.portrait(robot), (await realm_client.elsewhere()).get(robot.name)
    if place is not None:
        text += f"\n\nat site {place.words}"
    if readings:
        rows = [
            (f"  {name}", quantity(value, robot.units.get(name, "")))
            for name, value in sorted(readings.items())
        ]
        text += f"\n\nreadings\n{wording.columns(rows)}"
    there = {} if place is None else {"site": place.site, "age": place.age}
    return Outcome({**plain(robot), "readings": readings, **there}, text)


async def may(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Explain whether a person may do something."""
    import os

    from robotree.vr.base.policy import Person
    from robotree.vr.base.principal import ASSISTANTS, user_name

    right = _right(line.text("VERB"))
    target = await realm_client.target(right, line.text("TARGET"))
    gate = realm_client.gate
    name = line.text("PERSON")
    role, slash, assistant = name.partition("/")
    if slash and role == ASSISTANTS:  # it may what it and the one who serves it here both may
        asker = gate.user(user_name(os.geteuid()))._replace(assistant=assistant)
    else:
        asker = Person(name, name.rpartition("@")[2] if "@" in name and gate.site else "")
    found = gate.may(asker, right, target)
    words = "may" if found.allowed else "may not"
    text = f"{name} {words} {right} {target}: {found.reason}"
    if not gate.closed:
        text = (
            f"realm {realm_client.realm} has no policy, so everybody of this system's user may do"
            " everything; `robotree policy set FILE` puts one in force"
        )
    if not found.allowed:
        text += f"; ask {gate.ask}"
    data = {
        "person": name, "right": right, "target": str(target), "kinds": list(target.kinds),
        "allowed": found.allowed, "line": found.line, "reason": found.reason, "ask": gate.ask,
        "version": 0 if gate.policy is None else gate.policy.version,
    }  # fmt: skip
    return Outcome(data, text)


def _right(verb: str) -> str:
    """Return the right that a verb needs, or that is called so."""
    from robotree.tui.line.actions import BY_VERB
    from robotree.vr.base.policy import BY_NAME, STOP

    right = verb if verb in (*BY_NAME, STOP) else BY_VERB[verb].right if verb in BY_VERB else ""
    if not right:
        known = ", ".join((*BY_NAME, STOP))
        raise ValueRefused("VERB", f"{verb!r} needs no right of its own; rights are {known}")
    return right


async def stubs(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Write the interface of a robot."""
    import asyncio

    from robotree.vr.author.stubs import interface

    name, path = line.text("NAME"), line.text("--out")
    robot = await realm_client.describe(name)
    source = interface(robot, origin=f"Written by `robotree stubs {name}`.")
    if not path:
        return Outcome({"kind": robot.kind, "source": source}, source.rstrip("\n"))
    await asyncio.to_thread(overwrite, Path(path), source.encode())
    module = Path(path).stem
    told = f"{path}  from {module} import {robot.kind}; then: Child({robot.kind})"
    return Outcome({"kind": robot.kind, "file": path}, told)


async def look(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Fetch one picture into a file."""
    import asyncio

    view, camera = line.text("VIEW"), line.text("--camera")
    width, height = values.size(line.text("--size")) if line.text("--size") else PICTURE
    picture = await realm_client.look(view, camera=camera, width=width, height=height, quality=85)
    # a camera's name comes from afar: it names a file here, never a way to another folder
    path = Path(line.text("FILE") or Path(f"{view}-{picture.camera}.jpg".replace("/", "-")).name)
    await asyncio.to_thread(overwrite, path, picture.jpeg)
    data = {"file": str(path), "camera": picture.camera, "width": picture.width, "height": picture.height}
    return Outcome(data, f"{path}  {picture.width}x{picture.height} from camera {picture.camera}")


async def watch(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Tell each change of state, until it is interrupted or the time is over."""
    import asyncio

    def tell(name: str, state: State) -> None:
        readings = "  ".join(
            f"{key}={quantity(value, units.get(name, {}).get(key, ''))}"
            for key, value in sorted(state.readings.items())
        )
        teller.outcome(
            Outcome({"name": name, **plain(state)}, f"{name}  {status.words(state)}  {readings}".rstrip())
        )

    limit = values.duration(line.text("--within")) if line.text("--within") else None
    name = line.text("NAME")  # one that nobody has would tell nothing for ever
    known = [await realm_client.describe(name)] if name else await realm_client.tree()
    units = {robot.name: robot.units for robot in known}
    watching = await realm_client.watch_state(name or None, tell)
    try:
        async with asyncio.timeout(limit):
            await asyncio.Event().wait()
    except TimeoutError:
        pass
    finally:
        await watching.close()
    return Outcome(None)


async def log(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Tell what the code of a robot, or of all, says, and what became of their commands."""
    name = line.text("NAME")
    if not line.flag("--follow"):
        logged = await _logged(realm_client, name)
        lines = "\n".join(wording.log_line(one, "" if name else robot) for robot, one in logged)
        nothing = f"{name} has logged nothing" if name else "no robot has logged anything"
        return Outcome([{"robot": robot, **plain(one)} for robot, one in logged], lines or nothing)
    await _follow_log(realm_client, name, teller)
    return Outcome(None)


async def _logged(realm_client: RealmClient, name: str) -> list[tuple[str, LoggedLine]]:
    """Return what is logged of one robot, or of all agents (empty name), the oldest first.

    Raises:
        VrError: there is no robot of this name, and nobody remembers one; or it does not answer.
    """
    import asyncio

    from robotree.vr.base.errors import NoSuchRobot, VrError

    found = [(one.name, one.line) for one in await realm_client.read_history(name)]
    if name:
        try:
            found += [(name, one) for one in await realm_client.read_log(name)]
        except NoSuchRobot:
            if not found:
                raise
        return sorted(found, key=lambda entry: entry[1].unix)
    names = [address.name for address in realm_client.present("robot")]
    logs = await asyncio.gather(*map(realm_client.read_log, names), return_exceptions=True)
    if faults := [one for one in logs if isinstance(one, BaseException) and not isinstance(one, VrError)]:
        raise faults[0]
    found += [
        (robot, line)
        for robot, lines in zip(names, logs, strict=True)
        if not isinstance(lines, BaseException)
        for line in lines
    ]
    return sorted(found, key=lambda entry: entry[1].unix)


async def _follow_log(realm_client: RealmClient, name: str, teller: Teller) -> NoReturn:
    """Tell what was logged, then what the full screen's log would show, as it comes, until interrupted."""
    import asyncio
    import time

    from robotree.tui.seen.feeding import Feed
    from robotree.tui.seen.store import Store
    from robotree.vr.base.requests import LoggedLine

    store, printed = Store(), dict[tuple[str, int], None]()
    feed = Feed(realm_client, store, time.monotonic)
    await feed.open()

    def tell(robot: str, one: LoggedLine) -> None:
        teller.outcome(Outcome({"robot": robot, **plain(one)}, wording.log_line(one, "" if name else robot)))

    try:
        for robot, one in await _logged(realm_client, name):
            printed[robot, one.number] = None
            tell(robot, one)
        while True:
            while store.entries:
                entry = store.entries.popleft()
                if name and entry.robot != name:
                    continue
                if entry.line is None:
                    tell(entry.robot, LoggedLine(0, time.time(), LEVELS[entry.weight], entry.text))
                elif (entry.robot, entry.line.number) not in printed:
                    tell(entry.robot, entry.line)
            await asyncio.sleep(FOLLOWING)
    finally:
        await feed.close()


# -- shaping the tree ------------------------------------------------------------------------------


async def create(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Make a virtual robot from a file; with `--watch`, reload it at each save."""
    path, wanted = sources.found(line.text("FILE"))
    files = _files_of(path, wanted) if line.flag("--watch") else None
    name, host = line.text("NAME"), line.text("HOST")
    settings = values.assignments(line.many("PARAMETER=VALUE"))
    async with AsyncExitStack() as stack:
        if line.flag("--own-host"):
            host = await stack.enter_async_context(_own_host(realm_client, name, host))
        isolate = values.isolation(line.text("--isolate"))
        robot = await realm_client.create(
            path, name, host=host, wanted=wanted, settings=settings, isolate=isolate
        )
    made = _did(robot, f"{robot.name} ({robot.kind}) runs" + (f" on {robot.host}" if robot.host else ""))
    if files is not None:
        teller.outcome(made)
        await _follow_saves(realm_client, robot.name, files, teller)
    return made


async def service(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Start a service in a process of its own, or on a host; its behaviours come along."""
    path, wanted = sources.found(line.text("FILE"))
    name, host = line.text("NAME"), line.text("HOST")
    settings = values.assignments(line.many("PARAMETER=VALUE"))
    away = {each.name: each.robot for each in await absent_robots(realm_client, ()) if each.robot}
    if name in away and "Service" not in away[name].kinds:
        raise _name_is_kept(away[name])
    async with AsyncExitStack() as stack:
        if not host:
            host = await stack.enter_async_context(_own_host(realm_client, name, ""))
        robot = await realm_client.create(path, name, host=host, wanted=wanted, settings=settings)
        if "Service" not in robot.kinds:
            await realm_client.delete(name)
            reason = f"{robot.kind} is no Service: `robotree create` makes a virtual robot of it"
            raise ValueRefused("FILE", reason)
    behaviours = [
        script
        for script in await realm_client.tree()
        if script.name.startswith(f"{name}-") and script.host == robot.host and "Script" in script.kinds
    ]
    for script in behaviours:
        if script.name in away and "Script" not in away[script.name].kinds:
            await realm_client.delete(name)
            raise _name_is_kept(away[script.name])
    brought = [f"{script.name} ({script.attributes.get('condition', '')})" for script in behaviours]
    with_them = f" with {', '.join(brought)}" if brought else ""
    lends = f"; it lends {', '.join(f'{name}-{role}' for role in robot.lends)}" if robot.lends else ""
    return _did(robot, f"{name} ({robot.kind}) runs on {robot.host}{with_them}{lends}")


def _name_is_kept(robot: RobotDescription) -> ValueRefused:
    """Return why a service cannot have a name, or bring a behaviour along: a robot has it that is away."""
    reason = f"{robot.name} is a {robot.kind} that is away and could not come back; choose another name"
    return ValueRefused("NAME", reason)


def _own_host(realm_client: RealmClient, robot: str, host: str) -> AbstractAsyncContextManager[str]:
    from robotree.tui.processes.detached import own_host
    from robotree.vr.base.address import check_name
    from robotree.vr.base.errors import DuplicateName

    if host:
        raise BadLine("a robot is created on HOST or with --own-host, not both", "")
    if check_name(robot) in {one.name for one in realm_client.directory.present("robot")}:
        raise DuplicateName(role="robot", name=robot)  # before a process is started for nothing
    return own_host(realm_client.realm, robot)


async def _place(realm_client: RealmClient, line: Line) -> tuple[str, str]:
    """Return the parent and the slot of a line; where the slot is missing, name those that there are."""
    from robotree.vr.base.errors import AddressError

    place = line.text("PARENT.SLOT")
    try:
        return values.dotted(place, "PARENT.SLOT")
    except ValueRefused as error:
        try:
            parent = await realm_client.describe(place.rstrip("."))
        except AddressError:
            raise error from None
        slots = ", ".join(f"{parent.name}.{slot.name}" for slot in parent.slots)
        reason = f"its slots are {slots}" if slots else f"{parent.name} has no slots"
        raise ValueRefused("PARENT.SLOT", f"{place!r} names no slot; {reason}") from None


async def enslave(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Put a robot on top of one or several others; where one refuses, those before it stay enslaved."""
    parent, slot = await _place(realm_client, line)
    children = line.many("CHILD")
    if children[0] == checking.WHERE:
        return _why(await realm_client.choose(parent, slot, " ".join(children[1:])), slot)
    if len(children) > 1:  # before the first of them is enslaved
        slots = (await realm_client.describe(parent)).slots
        if not any(child.group == slot for child in slots):
            reason = f"{parent}.{slot} takes one robot; several go only into a group (Children)"
            raise ValueRefused("CHILD", reason)
    robot = None
    for number, child in enumerate(children):
        try:
            robot = await realm_client.enslave(parent, slot, child)
        except Exception:
            if number:
                bound, left = children[:number], children[number:]
                teller.warn(f"{parent}.{slot}: {_are(bound)} bound now; {_are(left)} not:")
            raise
    assert robot is not None  # noqa: S101 # the grammar wants one child at least
    spec = robot.slot(slot)
    does = "watches" if spec is not None and spec.watch else "commands"
    return _did(robot, f"{parent}.{slot} {does} {', '.join(children)}")


def _why(parent: RobotDescription, slot: str) -> Outcome:
    """Return whom a robot has chosen for a slot, or at last for a group, and why."""
    chosen = [one for one in parent.slots if slot in {one.name, one.group} and one.child and one.why]
    text = "\n".join(
        f"{parent.name}.{one.name} commands {one.child.name}: {one.why}" for one in chosen if one.child
    )
    return _did(parent, text)


def _are(names: Sequence[str]) -> str:
    """Return names as the subject of a sentence, with its verb."""
    return f"{', '.join(names)} {'is' if len(names) == 1 else 'are'}"


async def release(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Let a child go."""
    parent, slot = await _place(realm_client, line)
    robot = await realm_client.release(parent, slot)
    text = f"{parent}.{slot} is empty"
    if robot.name == parent and robot.busy:  # it asks a person then, or waits until its time is over
        text += f"; {parent}.{robot.busy} may be using it: `robotree cancel {parent}` ends that"
    return _did(robot, text)


async def delete(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """End a virtual robot."""
    left = await realm_client.delete(line.text("NAME"))
    text = f"{line.text('NAME')} is deleted" + (f", but {left}" if left else "")
    data = {"deleted": line.text("NAME")} | ({"left": left} if left else {})
    return Outcome(data, text, logged=not left)


async def migrate(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Have a virtual robot go on in another host."""
    name, host = line.text("NAME"), line.text("HOST")
    note = await realm_client.migrate(name, host)
    return Outcome({"migrated": name, "host": host}, note)


async def place(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Say how a virtual robot is moved."""
    name, placement = line.text("NAME"), values.placement(line.text("PLACEMENT"))
    note = await realm_client.place(name, placement)
    return Outcome({"placed": name, "placement": placement, "note": note}, note)


async def drain(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Have all robots of a host go on elsewhere; with `--end` the host ends then."""
    host, ends = line.text("HOST"), line.flag("--end")
    process = _process_of(realm_client, host) if ends else 0
    moved = await realm_client.drain(host, lambda text: teller.progress(nan, text))
    text = f"{host} is empty: {', '.join(moved)} moved" if moved else f"{host} had no robots"
    if ends:
        from robotree.tui.processes.programs import end_process

        await end_process(process)
        text += "; it has ended"
    return Outcome({"drained": host, "moved": moved, "ended": ends}, text)


def _process_of(realm_client: RealmClient, host: str) -> int:
    """Return the number of the process that a host is, on this machine."""
    held = realm_client.holding("host", host)
    number = held.partition("process ")[2].partition(" ")[0]
    if not number.isdigit():
        raise ValueRefused("HOST", f"{host} is no process of this machine; end it where it runs")
    return int(number)


async def reload(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Have a virtual robot go on with another page; with `--watch`, again at each save."""
    path, wanted = sources.found(line.text("FILE")) if line.text("FILE") else ("", "")
    name, now = line.text("NAME"), line.flag("--now")
    if line.flag("--watch"):
        page = path or (await realm_client.describe(name)).page
        if not page:
            from robotree.vr.base.errors import NoPage

            raise NoPage(robot=name)
        files = _files_of(path, wanted) if path else _files_of(*values.source(page))
        await _take_over(realm_client, name, files, teller, now=now)
        await _follow_saves(realm_client, name, files, teller, now=now)
    if not now and (busy := (await realm_client.describe(name)).busy):
        teller.warn(f"{name}.{busy} is running: the reload waits for its end, 10 s at most")
    return _reloaded(name, await realm_client.reload(name, path, wanted, now=now))


def _reloaded(name: str, done: Reloaded) -> Outcome:
    lines = [f"{name} goes on with {done.robot.page}", *done.notes]
    return Outcome({"reloaded": name, "page": done.robot.page, "notes": list(done.notes)}, "\n".join(lines))


# -- while an author edits -------------------------------------------------------------------------


def _files_of(path: str, wanted: str) -> PageFiles:
    from robotree.tui.line.sources import PageFiles

    return PageFiles(path, wanted)


async def _follow_saves(
    realm_client: RealmClient, name: str, files: PageFiles, teller: Teller, *, now: bool = False
) -> NoReturn:
    """Have a robot go on with its page at each save, until this is cancelled or the robot is gone."""
    teller.outcome(
        Outcome(None, f"{name} is reloaded each time that {files.path} is saved; Ctrl-C ends this")
    )
    while True:
        await files.saved()
        await _take_over(realm_client, name, files, teller, now=now)


async def _take_over(
    realm_client: RealmClient, name: str, files: PageFiles, teller: Teller, *, now: bool
) -> None:
    """Have a robot go on with the page as it is now, however long its running command takes; print mistakes.

    Raises:
        NoSuchRobot: it is gone.
        NotVirtual: it has no page.
        TransportError: it cannot be reached.
    """
    import asyncio

    from robotree.vr.base.errors import NoSuchRobot, NotVirtual, ReloadWaits, TransportError, VrError

    busy = (await realm_client.describe(name)).busy
    if busy and not now:
        teller.warn(f"{name}.{busy} is running: the page is taken over when it has ended")
    while True:
        try:
            done = await realm_client.reload(name, files.path, files.wanted, now=now)
        except ReloadWaits:
            await asyncio.to_thread(files.read)  # the next attempt takes what is saved by now
            continue
        except (NoSuchRobot, NotVirtual, TransportError):
            raise
        except VrError as error:
            files.mistaken = True
            teller.outcome(_mistake(name, files.path, str(error)))
        else:
            files.mistaken = False
            teller.outcome(_reloaded(name, done))
        return


_MISTAKE = re.compile(r"(?:: (?P<file>[^:,]+), |: )line (?P<line>\d+): ")
"""Where the sentence about a page names the line, and the file if it is one beside the page."""


def _mistake(name: str, path: str, sentence: str) -> Outcome:
    """Return what is wrong with a page that a robot did not take over."""
    where = _MISTAKE.search(sentence)
    file = str(Path(path).parent / where["file"]) if where and where["file"] else path
    line = int(where["line"]) if where else None
    data = {"mistake": sentence, "name": name, "file": file, "line": line}
    return Outcome(data, f"{sentence}; {name} goes on with its old page")


async def set_(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Change settings of a robot."""
    from robotree.vr.base.errors import NoSettings, NoSuchCommand

    name, given = line.text("NAME"), values.assignments(line.many("PARAMETER=VALUE"))
    try:
        await realm_client.call(name, "set", given)
    except NoSuchCommand:
        raise NoSettings(robot=name) from None
    robot = await realm_client.describe(name)
    now = {setting.name: setting.default for setting in wording.settings(robot)}
    return Outcome({"name": name, "settings": now}, wording.columns(wording.setting_rows(robot)))


# -- commanding ------------------------------------------------------------------------------------


async def call(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Have a command carried out and wait for it."""
    robot, command = values.dotted(line.text("ROBOT.COMMAND"), "ROBOT.COMMAND")
    given = await poses.arguments(realm_client, robot, command, line.many("PARAMETER=VALUE"))
    limit = (
        values.duration(line.text("--within"))
        if line.text("--within")
        else await _limit(realm_client, robot, command)
    )
    if line.flag("--detach"):
        await realm_client.tell(robot, command, given, deadline=limit)
        text = f"{robot}.{command} has begun and goes on by itself; `robotree cancel {robot}` ends it"
        return Outcome({"detached": f"{robot}.{command}"}, text)
    fields: list[FieldSpec] = []
    carry_out = partial(
        realm_client.call,
        robot,
        command,
        given,
        deadline=limit,
        on_progress=teller.progress,
        on_fields=fields.extend,
    )
    thing = await _attended(carry_out, robot, command, teller)
    if line.text("--save"):
        return await _saved(thing, Path(line.text("--save")))
    rows = wording.result(fields, thing)
    text = wording.columns([row if row[0] else row[1:] for row in rows])
    return Outcome(plain(thing), text or f"{robot}.{command} is done")


async def _attended(
    carry_out: Callable[..., Awaitable[Any]], robot: str, command: str, teller: Teller
) -> Any:
    """Have a command carried out; where it wants somebody at a key, ask the person who sits here to hold one.

    At a command line it begins with the first key: the person has read by then what to do.

    Raises:
        NobodyAttends: nobody sits here: a session, a log, a pipe.
    """
    from robotree.vr.base.errors import NobodyAttends
    from robotree.vr.exchange.attendance import Attendance

    try:
        return await carry_out()
    except NobodyAttends as refused:
        asked = (refused.data["robot"], refused.data["command"]) == (robot.rpartition(":")[2], command)
        hold: Hold | None = getattr(teller, "hold_key", None)
        attendance = Attendance()
        release = hold(robot, command, attendance) if hold is not None and asked else None
        if release is None:
            raise
    first_key: Callable[[], Awaitable[bool]] | None = getattr(teller, "first_key", None)
    try:
        there = first_key is None or await first_key()
        return await carry_out(attendance=attendance if there else None)
    finally:
        release()


async def absent_robots(realm_client: RealmClient, here: Collection[str]) -> list[KnownAgent]:
    """Return the robots that are away and that directories remember, by name.

    Args:
        realm_client: of the realm.
        here: names of robots that need no memory.
    """
    if not realm_client.orders.directories:
        return []
    present = {address.name for address in realm_client.directory.present("robot")}
    return [
        each
        for each in await realm_client.orders.known(brief=True)
        if each.role == "robot" and not each.deleted and each.name not in present and each.name not in here
    ]


async def absent_states(realm_client: RealmClient, away: Sequence[KnownAgent]) -> dict[str, str]:
    """Return how robots that are away are absent, and whether a stop holds them, by name."""
    import time

    if not away:
        return {}
    now, holds = time.time(), await realm_client.orders.holds()
    return {each.name: absence.with_holds(each, holds, now) for each in away}


async def _saved(thing: Any, path: Path) -> Outcome:
    """Write the picture in a result into a file."""
    import asyncio

    parts = cast("dict[str, Any]", thing).values() if isinstance(thing, dict) else (thing,)
    picture = next((part for part in parts if isinstance(part, bytes)), None)
    if picture is None:
        raise ValueRefused("--save", "there is no picture in the result")
    await asyncio.to_thread(overwrite, path, picture)
    return Outcome({"file": str(path), "bytes": len(picture)}, f"{path}  {wording.value(picture)}")


async def _limit(realm_client: RealmClient, robot: str, command: str) -> float:
    """Return how long a command may take [s] when nobody says: a script leads until it is over."""
    if command == "start" and "Script" in (await realm_client.describe(robot)).kinds:
        return SCRIPT_LIMIT
    return CALL_LIMIT


async def cancel(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """End the commands of a robot."""
    name = line.text("NAME")
    note = await realm_client.cancel(name)
    text = f"{name}: {note}" if note else f"the commands of {name} are cancelled"
    return Outcome({"cancelled": name, "note": note}, text)


async def pause(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Have a robot wait before each step."""
    name = line.text("NAME")
    note = await realm_client.pause(name)
    text = f"{name} is paused" + (f"; {note}" if note else "")
    return Outcome({"paused": name, "note": note}, text, logged=not note)


async def step(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Let one step of a paused robot pass."""
    name = line.text("NAME")
    taken = await realm_client.step(name)
    teller.progress(nan, taken)
    stands = await realm_client.where_held(name, within=STEP_WITHIN)
    return Outcome({"step": taken, "stands": stands}, f"{taken}; now {stands}")


async def continue_(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """End the pause of a robot."""
    name = line.text("NAME")
    note = await realm_client.go_on(name)
    text = f"{name} goes on" + (f"; {note}" if note else "")
    return Outcome({"continued": name, "note": note}, text, logged=not note)


async def decide(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Answer what a script asks, or a command that asks after a crash."""
    name, answer, question = line.text("NAME"), line.text("ANSWER"), line.text("--question")
    robot = await realm_client.describe(name)
    if "question-id" in robot.attributes and not robot.asks:
        given = {"answer": answer, "question": question or robot.attributes["question-id"]}
        await realm_client.call(name, "answer", given, deadline=ANSWER_LIMIT)
        return Outcome({"decided": name, "answer": answer}, f"{name} has its answer: {answer}")
    if question:
        raise ValueRefused("--question", f"{name} asks that no more")
    if answer not in {"done", "again", "abort"}:
        raise ValueRefused("ANSWER", f"{answer!r} is none of: done, again, abort")
    await realm_client.decide(name, cast("Any", answer))
    return Outcome({"decided": name, "answer": answer}, f"{name} has its answer: {answer}")


async def stop(realm_client: RealmClient, line: Line, teller: Teller) -> Outcome:
    """Stop one robot, or all, protectively; those that are away begin nothing that was ordered."""
    import asyncio

    from robotree.vr.base.errors import NoSuchRobot, NotConfirmed, RobotAway

    name = line.text("NAME") or None
    held = asyncio.ensure_future(hold(realm_client, name or "", teller))  # of those that are away, at once
    if name is not None:
        try:
            return stopped(await realm_client.stop(name, on_late=teller.warn))
        except NoSuchRobot as error:
            reason = await asyncio.to_thread(away.explained, realm_client.realm, error)
            if isinstance(reason, RobotAway) or not (await held).by:
                raise reason from None
            return held_away(name)
        except NotConfirmed as error:
            for sentence in away.leave_stop_apart(realm_client.realm, dict(error.data["untold"])):
                teller.warn(sentence)
            raise
        finally:
            await held
    try:
        names = await realm_client.stop(None, on_late=teller.warn)
        await held
    except NotConfirmed as error:
        await held
        for sentence in away.leave_stop(realm_client.realm, error.data["told"], held.result().by):
            teller.warn(sentence)
        raise
    for sentence in away.leave_stop(realm_client.realm, names, held.result().by):
        teller.warn(sentence)
    return stopped(names, held.result().robots)


def held_away(name: str) -> Outcome:
    """Return the result of a stop of a robot that is away."""
    return Outcome({"stopped": [], "held": [name]}, _held_words([name], f"robotree resume {name}"))


def _held_words(names: Sequence[str], ends: str) -> str:
    several = len(names) > 1
    return (
        f"{', '.join(names)} {'are' if several else 'is'} away: {'they begin' if several else 'it begins'}"
        f" nothing that was ordered before `{ends}`"
    )


class HeldOrders(NamedTuple):
    """What a stop found in the directories."""

    by: Sequence[str] = ()
    """Names of the directories that keep robots from beginning what was ordered."""
    robots: Sequence[str] = ()
    """Names of the robots that are away, and held."""


async def hold(realm_client: RealmClient, name: str, teller: Teller) -> HeldOrders:
    """Have the directories keep robots from beginning what was ordered; returns those that do.

    Args:
        realm_client: of the realm.
        name: of the robot; empty: all.
        teller: hears which directories have not confirmed it.
    """
    if not await realm_client.orders.met():
        return HeldOrders()
    holding, silent = await realm_client.orders.hold(name)
    if silent and not name:
        teller.warn(
            f"directory {', '.join(silent)} has not confirmed the stop: a robot that is away may begin what"
            " it finds there; stop again"
        )
    absent = [] if name else await absent_robots(realm_client, ())
    return HeldOrders(holding, [each.name for each in absent] if holding else [])


def stopped(names: Sequence[str], held: Sequence[str] = ()) -> Outcome:
    """Return the result of a stop that these robots have confirmed, and that holds others that are away."""
    text = f"stopped: {', '.join(sorted(names)) or 'there is no robot'}"
    if held:
        return Outcome(
            {"stopped": sorted(names), "held": sorted(held)},
            f"{text}\n{_held_words(sorted(held), 'robotree resume')}",
        )
    return Outcome({"stopped": sorted(names)}, text)


async def resume(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Resume after a protective stop; what was ordered may begin again."""
    from robotree.vr.base.errors import NoSuchRobot

    name = line.text("NAME") or None
    released = await _released(realm_client, line)
    try:
        confirmed = await realm_client.resume(name, given=line.given)
    except NoSuchRobot as error:
        if not (released and await _is_remembered(realm_client, error)):
            raise
        return Outcome(
            {"resumed": [], "released": [name]}, f"{name} is away: what was ordered may begin again"
        )
    away.take_stop_back(realm_client.realm, name or "")
    if not confirmed:
        there = realm_client.directory.present("robot")
        nobody = f"{name or 'no robot'} was {'not ' if name else ''}stopped" if there else "there is no robot"
        return Outcome({"resumed": []}, nobody)
    return Outcome({"resumed": sorted(confirmed)}, f"resumed: {', '.join(sorted(confirmed))}")


async def _is_remembered(realm_client: RealmClient, error: NoSuchRobot) -> bool:
    """Whether a directory or a host's journal knows a robot; a stop of all also holds what never was."""
    import asyncio

    from robotree.vr.base.errors import NoDirectory

    if await asyncio.to_thread(away.explained, realm_client.realm, error) is not error:
        return True
    name = str(error.data["name"])
    try:
        board = await realm_client.orders.board(robot=name)
        known = await realm_client.orders.known(name)
    except NoDirectory:
        return False
    return bool(board.orders) or any(each.role == "robot" for each in known)


async def _released(realm_client: RealmClient, line: Line) -> bool:
    """End the holds of robots that are away; returns whether the robot that is named was held."""
    if not realm_client.orders.directories:
        return False
    import time

    name = line.text("NAME")
    board = await realm_client.orders.board(robot=name)
    ago = 0.0 if line.given is None else max(0.0, time.monotonic() - line.given)
    await realm_client.orders.release(name, ago=ago)
    return any(hold.robot in ("", name) for hold in board.holds)


# -- scripts and roles -------------------------------------------------------------------------------


async def explain(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Tell why a rule of a running script fired, or why it does not; without a rule: its facts and agenda."""
    name, rule = line.text("WHAT"), line.text("RULE")
    robot = await realm_client.describe(name)
    if not {"why", "facts"} <= {command.name for command in robot.commands}:
        raise ValueRefused("WHAT", f"{name} is no script; it is of kind {robot.kind}")
    text = str(await realm_client.call(name, "why" if rule else "facts", {"rule": rule} if rule else {}))
    return Outcome({"script": name, "rule": rule, "explanation": text.splitlines()}, text)


async def role(realm_client: RealmClient, line: Line, _teller: Teller) -> Outcome:
    """Give a robot another role: directly, or through those who command it."""
    name, wanted = line.text("NAME"), line.text("ROLE")
    top, at = await _way_down(realm_client, name)
    given = {"at": at} if at else {}
    if wanted.lower().endswith((".yaml", ".yml")):
        import asyncio

        from robotree.vr.base.errors import BrokenScript
        from robotree.vr.bundle import Bundle

        bundle = await asyncio.to_thread(Bundle.read, wanted)
        try:
            wanted = str(await realm_client.call(top, "learn_role", {"source": bundle.source, **given}))
        except BrokenScript as error:  # the robot knows no name of a file
            raise BrokenScript(**{**error.data, "path": wanted}) from None
    played = str(await realm_client.call(top, "play", {"role": wanted, **given}))
    return Outcome({"name": name, "role": played}, f"{name} plays {played} from its next act on")


async def _way_down(realm_client: RealmClient, name: str) -> tuple[str, str]:
    """Return the robot that gets the order to change a role, and the path of slots from it downwards."""
    from robotree.vr.base.errors import NoRoles

    robot = await realm_client.describe(name)
    if robot.command("play") is None:
        raise NoRoles(robot=name, reason=f"no {robot.kind} plays one")
    path: list[str] = []
    while robot.bond is not None:
        path.insert(0, robot.bond.slot)
        robot = await realm_client.describe(robot.bond.parent.name)
        if robot.command("play") is None:
            reason = f"{robot.name} commands it and passes no role on; a script does, or release it first"
            raise NoRoles(robot=name, reason=reason)
    return robot.name, ".".join(path)


# -- plain data ------------------------------------------------------------------------------------


def plain(thing: Any) -> Any:
    """Return what JSON can say of a value of the agents: a number that is none (NaN) is null there."""
    import msgspec

    return _finite(msgspec.to_builtins(thing, str_keys=True))


def _finite(thing: Any) -> Any:
    match thing:
        case float():
            return thing if isfinite(thing) else None
        case dict():
            return {key: _finite(part) for key, part in cast("dict[str, Any]", thing).items()}
        case list():
            return [_finite(part) for part in cast("Sequence[Any]", thing)]
        case _:
            return thing


def _did(robot: RobotDescription, text: str) -> Outcome:
    return Outcome(plain(robot), text)
