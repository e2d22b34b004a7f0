"""The steps that make a realm as its file says, each a line that a person could type. Pure.

What is not in the file is left as it is. Where it is in the way, the plan says so; with `prune` it is ended.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, cast

import msgspec

from robotree.tui.line import manual
from robotree.tui.line.grammar import Line, form
from robotree.tui.realm_file.content import (
    CONTROLLER,
    KIND,
    NAMELESS,
    STANDS_BY,
    ProcessEntry,
    RealmFile,
    RobotEntry,
    keys_of,
    placed,
)
from robotree.tui.realm_file.present import Present, Process
from robotree.tui.realm_file.reading import names_in
from robotree.vr.base.arguments import check_arguments
from robotree.vr.base.errors import BadArgument
from robotree.vr.base.written import Word, suggestion

if TYPE_CHECKING:
    from robotree.tui.errors import BadRealmFile
    from robotree.vr.base.description import RobotDescription

Sign = Literal["+", "~", "-"]
"""Something is added, changed or taken away."""


class Step(msgspec.Struct, frozen=True, kw_only=True):
    """One thing to do."""

    id: str
    """The name for steps that need it."""
    sign: Sign
    text: str
    """The line, for people."""
    needs: frozenset[str] = frozenset()
    """Ids of what must be done before; one that is in no plan is so already."""
    line: Line | None = None
    """A verb over the robots."""
    entry: ProcessEntry | None = None
    """A process to start."""
    process: int = 0
    """Id of a process to end."""
    keeper: str = ""
    """Name of a host that is about to start, and may have kept this: then nothing is to be done."""

    @property
    def described(self) -> str:
        """The line with its sign, and in which case it is left out."""
        unless = f"   (unless {self.keeper} brings it back)" if self.keeper else ""
        return f"{self.sign} {self.text}{unless}"


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """All that is to be done."""

    steps: tuple[Step, ...] = ()
    left: tuple[str, ...] = ()
    """The things that the file does not name and that stay as they are, as sentences."""
    against: tuple[str, ...] = ()
    """The differences that are not changed, as sentences: why, and what a person can do."""


class Page(msgspec.Struct, frozen=True):
    """A page as it lies on the disk."""

    path: str
    """Where it lies, and `:Class` if that is named."""
    hash: str
    role: str = ""
    """Name of the role in the file that the entry names as its role; empty: it names no file."""
    role_file: str = ""
    """Where that file lies."""


def plan(wanted: RealmFile, there: Present, pages: Mapping[str, Page], *, prune: bool = False) -> Plan:
    """Return what must be done.

    Args:
        wanted: the file.
        there: what runs.
        pages: of the robots of the file, by name.
        prune: whether what is not in the file is ended.

    Raises:
        BadRealmFile: the file names a robot that is nowhere, or a setting that cannot be.
    """
    return _Planner(wanted, there, pages, prune=prune).plan()


class _Planner:
    def __init__(self, wanted: RealmFile, there: Present, pages: Mapping[str, Page], *, prune: bool) -> None:
        self._wanted, self._there, self._pages, self._prune = wanted, there, pages, prune
        self._steps: list[Step] = []
        self._left: list[str] = []
        self._against: list[str] = []
        self._shapes = manual.shell().shapes
        self._names = names_in(wanted)
        self._free: set[str] = set()
        """Children that a step of this plan releases."""
        self._starting: list[str] = []
        """Hosts that are started, and may have kept their robots."""

    def plan(self) -> Plan:
        self._strangers()
        self._groups()
        for process in self._wanted.processes:
            self._process(process)
        for robot in self._wanted.robots:
            self._robot(robot)
        for robot in self._wanted.robots:
            self._bonds(robot)
        return Plan(steps=tuple(self._steps), left=tuple(self._left), against=tuple(self._against))

    def _verb(self, sign: Sign, name: str, line: Line, needs: Collection[str] = (), keeper: str = "") -> None:
        text = form(line, self._shapes)
        step = Step(id=name, sign=sign, text=text, needs=frozenset(needs), line=line, keeper=keeper)
        self._steps.append(step)

    def _keeper(self, name: str) -> str:
        """Return the host that is about to start and may bring a robot back; empty: there is none."""
        entry = next((robot for robot in self._wanted.robots if robot.name == name), None)
        if entry is None or name in self._there.robots or name in self._there.silent:
            return ""
        homes = [entry.host.text] if entry.host else self._wanted.section("host")
        return next((host for host in homes if host in self._starting), "")

    def _groups(self) -> None:
        """Make the groups of the file; a rule may name one that stands before it."""
        before: set[str] = set()
        for entry in self._wanted.groups:
            meant, known = entry.meant, self._there.groups.get(entry.name)
            if meant != known:
                values: dict[str, str | tuple[str, ...]] = {"GROUP": entry.name}
                values |= {"ROBOT": meant.names} if meant.names else {}
                values |= {"--where": meant.rule} if meant.rule else {}
                self._verb("~" if known else "+", entry.id, Line("group", values), set(before))
                before.add(entry.id)
        wanted = {entry.name for entry in self._wanted.groups}
        for name in self._there.groups.keys() - wanted:
            if self._prune:
                line = Line("group", {"GROUP": name, "--delete": True})
                self._verb("-", f"delete group {name}", line)
            else:
                self._left.append(f"group {name} is not in the file")

    # -- what is not in the file -------------------------------------------------------------------

    def _strangers(self) -> None:
        """Deal with robots and processes that the file does not name: those on top first."""
        virtual = self._there.virtual()
        strange = [name for name in virtual if name not in self._names]
        entries = {process.id for process in self._wanted.processes if process.verb != NAMELESS}
        ending = [process for process in self._there.processes.values() if process.id not in entries]
        controllers = {
            f"controller {name}": one.pid
            for name, one in self._there.controllers.items()
            if name not in self._wanted.section(NAMELESS)
        }
        if not self._prune:
            names = [*strange, *(one.id for one in ending), *controllers]
            self._left += [f"{name} is not in the file" for name in names]
            return
        gone: list[str] = []
        for name in strange:  # in the order of `RealmClient.tree`: parents before their children
            self._verb("-", f"delete {name}", Line("delete", {"NAME": name}), gone)
            gone.append(f"delete {name}")
            self._free |= {slot.child.name for slot in virtual[name].slots if slot.child is not None}
        for name, pid in ({one.id: one.program.pid for one in ending} | controllers).items():
            text, needs = f"end {name} (process {pid})", frozenset(gone)
            self._steps.append(Step(id=f"end {name}", sign="-", text=text, needs=needs, process=pid))

    # -- processes ---------------------------------------------------------------------------------

    def _process(self, entry: ProcessEntry) -> None:
        if entry.verb == NAMELESS:
            if entry.name in self._there.controllers:
                return
        elif entry.id in self._there.processes:
            self._against += self._differences(entry, self._there.processes[entry.id])
            return
        elif self._elsewhere(entry):
            return
        controller = entry.text(CONTROLLER)
        known = self._there.controllers.get(controller)
        address = (
            f"({controller})" if controller and known is None else "" if known is None else known.address
        )
        needs = frozenset({f"{NAMELESS} {controller}"} if controller else ())
        text = " ".join(entry.words(self._wanted.folder, address))
        if entry.verb == "host" and "forget" not in entry.facets and entry.name in self._there.keepers:
            self._starting.append(entry.name)
        self._steps.append(Step(id=entry.id, sign="+", text=text, needs=needs, entry=entry))

    def _elsewhere(self, entry: ProcessEntry) -> bool:
        """Whether an agent has the name of a process and is something else; say so if it is in the way."""
        if entry.verb != "proxy":
            return f"{entry.verb} {entry.name}" in self._there.others
        robot = self._there.robots.get(entry.name)
        if robot is not None and robot.host:
            runs = f"{entry.name} is a virtual robot on {robot.host}, and the file says that it is a proxy"
            self._against.append(_again(runs, f"`robotree delete {entry.name}`"))
        elif robot is None and entry.name in self._there.silent:
            self._mute(entry.name)
            return True
        return robot is not None

    def _mute(self, name: str) -> None:
        where = self._there.silent[name]
        self._against.append(_again(f"{name} runs in {where} and does not answer", "end that"))

    def _differences(self, entry: ProcessEntry, process: Process) -> Iterator[str]:
        """Say in which facets a process that runs is not as the file says."""
        for key in keys_of(entry.verb):
            if key == CONTROLLER or key not in entry.facets:
                continue
            given = process.line.text("KIND") if key == KIND else process.line.values.get(f"--{key}", "")
            said = entry.text(key)
            now = "" if given is True else str(given)
            path = str(process.path(now)) if now else ""
            same = given is True if not said else said == now or placed(said, self._wanted.folder) == path
            if not same:
                runs = f"{entry.id} runs with {key} {now or 'unset'}, and the file says {said or 'yes'}"
                yield _again(runs, f"end process {process.program.pid}")

    # -- robots ------------------------------------------------------------------------------------

    def _robot(self, entry: RobotEntry) -> None:
        robot, page = self._there.robots.get(entry.name), self._pages[entry.name]
        if robot is None and entry.name in self._there.silent:
            self._mute(entry.name)
            return
        if robot is None:
            self._create(entry, page)
        elif not robot.host:
            runs = f"{entry.name} is a proxy, and the file says that it is a virtual robot"
            self._against.append(_again(runs, "end its process"))
            return
        else:
            moves = {f"migrate {entry.name}"}
            if entry.host is not None and entry.host.text not in {robot.host, self._there.home_of(robot)}:
                line = Line("migrate", {"NAME": entry.name, "HOST": entry.host.text})
                self._verb("~", f"migrate {entry.name}", line, {f"host {entry.host.text}"})
            if self._there.pages.get(entry.name) != page.hash:
                self._verb("~", entry.id, Line("reload", {"NAME": entry.name, "FILE": page.path}), moves)
            self._settings(entry, robot)
        role = page.role or ("" if entry.role is None else entry.role.text)
        if role and (robot is None or robot.attributes.get("role") != role):
            bonds = {f"{entry.name}.{slot}" for slot in entry.slots}
            line = Line("role", {"NAME": entry.name, "ROLE": page.role_file or role})
            self._verb("~", f"role {entry.name}", line, {entry.id, *bonds}, self._keeper(entry.name))

    def _create(self, entry: RobotEntry, page: Page) -> None:
        settings = tuple(f"{name}={word.text}" for name, word in entry.settings.items())
        takes = [name for name, host in self._wanted.section("host").items() if not host.text(STANDS_BY)]
        hosts = [entry.host.text] if entry.host else takes
        values: dict[str, str | tuple[str, ...]] = {"FILE": page.path, "NAME": entry.name}
        if entry.host is not None:
            values["HOST"] = entry.host.text
        if settings:
            values["PARAMETER=VALUE"] = settings
        if entry.isolate is not None:
            values["--isolate"] = entry.isolate.text
        needs = {f"host {name}" for name in hosts}
        self._verb("+", entry.id, Line("create", values), needs, self._keeper(entry.name))

    def _settings(self, entry: RobotEntry, robot: RobotDescription) -> None:
        spec = robot.command("set")
        if not entry.settings or spec is None:
            return
        try:
            meant = check_arguments(spec, {name: word.text for name, word in entry.settings.items()})
        except BadArgument as error:
            name = str(error.data["parameter"]).partition("[")[0].partition(".")[0]
            mark = entry.settings[name].mark if name in entry.settings else entry.mark
            raise self._wanted.error(mark, f"{name} of {entry.name}: {error.data['reason']}") from None
        now = {field.name: field.default for field in spec.parameters}
        other = [name for name, value in meant.items() if not _same(value, now[name])]
        if other:
            changes = tuple(f"{name}={entry.settings[name].text}" for name in other)
            line = Line("set", {"NAME": entry.name, "PARAMETER=VALUE": changes})
            self._verb("~", f"set {entry.name}", line, {entry.id})

    # -- bonds -------------------------------------------------------------------------------------

    def _bonds(self, entry: RobotEntry) -> None:
        robot = self._there.robots.get(entry.name)
        bound = {} if robot is None else _bound(robot)
        for slot, words in entry.slots.items():
            held = bound.get(slot, [])
            wanted = {word.text: word for word in words}
            released: list[str] = []
            for place, child in held:
                if child not in wanted:
                    released += self._release(entry.name, place, child)
            coming = self._coming_back(entry.name, slot) if robot else set[str]()
            there = {child for _, child in held} | coming
            if missing := [word for name, word in wanted.items() if name not in there]:
                several = robot is not None and any(child.group == slot for child in robot.slots)
                in_the_way = not several and held and not released
                available = [self._available(word) for word in missing]
                if not in_the_way and all(available):
                    self._bind(entry, slot, missing, released)
        if robot is not None:
            self._others(entry, bound)
        self._watches(entry, robot)

    def _coming_back(self, parent: str, slot: str) -> set[str]:
        """Return the children that say that they are in a slot, also before their parent has them again."""
        bonds = {name: robot.bond for name, robot in self._there.robots.items() if robot.bond}
        return {
            name
            for name, bond in bonds.items()
            if bond.parent.name == parent and bond.slot.partition("[")[0] == slot
        }

    def _watches(self, entry: RobotEntry, robot: RobotDescription | None) -> None:
        """Have the robots watched that the file names; others may command them."""
        held = {slot.name: slot.watched.name for slot in robot.slots if slot.watched} if robot else {}
        for slot, watched in entry.watches.items():
            place, before = f"{entry.name}.{slot}", held.get(slot, "")
            if before == watched.text:
                continue
            if watched.text not in {*self._names, *self._there.robots}:
                raise self._nobody(watched)
            needs = {entry.id, f"proxy {watched.text}", f"robot {watched.text}"}
            if before:
                self._verb("-", f"release {place}", Line("release", {"PARENT.SLOT": place}))
                needs.add(f"release {place}")
            line = Line("enslave", {"PARENT.SLOT": place, "CHILD": (watched.text,)})
            self._verb("+", place, line, needs, self._keeper(entry.name) or self._keeper(watched.text))
        for slot, before in held.items():
            if slot not in entry.watches and self._prune:
                place = f"{entry.name}.{slot}"
                self._verb("-", f"release {place}", Line("release", {"PARENT.SLOT": place}))
            elif slot not in entry.watches:
                self._left.append(f"{before} in {entry.name}.{slot} is not in the file")

    def _bind(self, entry: RobotEntry, slot: str, children: Sequence[Word], released: Sequence[str]) -> None:
        above = [entry.name, *self._above(entry.name)]  # of those one may become a child
        needs = {
            entry.id,
            *released,
            *(f"release {one}" for one in above),
            *(f"delete {one}" for one in above),
        }
        for child in children:
            name = child.text
            needs |= {f"{what} {name}" for what in ("proxy", "robot", "set", "role", "release")}
            needs |= {f"delete {one}" for one in self._above(name)[:1]}
            below = next((robot for robot in self._wanted.robots if robot.name == name), None)
            needs |= {f"{name}.{one}" for one in below.slots} if below else set()
        place, names = f"{entry.name}.{slot}", tuple(child.text for child in children)
        keepers = [self._keeper(name) for name in (entry.name, *names)]
        keeper = next((host for host in keepers if host), "")
        self._verb("+", place, Line("enslave", {"PARENT.SLOT": place, "CHILD": names}), needs, keeper)

    def _above(self, name: str) -> list[str]:
        """Return who commands a robot now, from its parent up to the top."""
        found: list[str] = []
        while (robot := self._there.robots.get(name)) and robot.bond and robot.bond.parent.name not in found:
            name = robot.bond.parent.name
            found.append(name)
        return found

    def _nobody(self, robot: Word) -> BadRealmFile:
        hint = suggestion(robot.text, {*self._names, *self._there.robots})
        where = f"in the file or in realm {self._there.realm!r}"
        return self._wanted.error(robot.mark, f"no robot {where} is called {robot.text!r}{hint}")

    def _available(self, child: Word) -> bool:
        """Whether a child can be bound; another parent lets it go, if the file says what that has."""
        robot = self._there.robots.get(child.text)
        if robot is None:
            if child.text not in self._names:
                raise self._nobody(child)
            return child.text not in self._there.silent
        if robot.bond is None or child.text in self._free:
            return True
        other, slot = robot.bond.parent.name, robot.bond.slot
        if other not in self._names:  # with `prune` it is deleted
            self._against.append(_stays(child.text, f"{other}.{slot}", f"{other} is not in the file"))
            return False
        if not self._keeper(
            other
        ):  # else it waits for its parent, and what is to be done then is planned anew
            self._release(other, slot, child.text)
        return True

    def _release(self, parent: str, slot: str, child: str) -> list[str]:
        """Release a child that the file puts elsewhere; one that it does not name stays, without `prune`."""
        if child in self._free:
            return [f"release {child}"]
        if child not in self._names and not self._prune:
            self._against.append(_stays(child, f"{parent}.{slot}", f"{child} is not in the file"))
            return []
        self._free.add(child)
        self._verb("-", f"release {child}", Line("release", {"PARENT.SLOT": f"{parent}.{slot}"}))
        return [f"release {child}"]

    def _others(self, entry: RobotEntry, bound: Mapping[str, list[tuple[str, str]]]) -> None:
        """Deal with slots that the file does not name."""
        groups = {place for slot in entry.slots for place, _ in bound.get(slot, [])}
        for place, held in bound.items():
            for slot, child in held:
                if place != slot or slot in entry.slots or slot in groups or child in self._free:
                    continue
                if self._prune:
                    self._release(entry.name, slot, child)
                else:
                    self._left.append(f"{child} in {entry.name}.{slot} is not in the file")


def _again(fact: str, remedy: str) -> str:
    """Say what is not as the file says, and what a person does about it."""
    return f"{fact}: {remedy}, then apply the file again"


def _stays(child: str, place: str, reason: str) -> str:
    return f"{child} stays in {place}, for {reason}: `robotree release {place}` or --prune lets it go"


def _bound(robot: RobotDescription) -> dict[str, list[tuple[str, str]]]:
    """Return slots with what is in them, also by the names of their groups: slot and child."""
    found: dict[str, list[tuple[str, str]]] = {}
    for slot in robot.slots:
        if slot.child is not None:
            for name in {slot.name, slot.group} - {""}:
                found.setdefault(name, []).append((slot.name, slot.child.name))
    return found


def _same(one: Any, other: Any) -> bool:
    """Whether two plain values mean the same: a number of a conversion is not the one that was typed."""
    if isinstance(one, float | int) and isinstance(other, float | int) and not isinstance(one, bool):
        return math.isclose(one, other, rel_tol=1e-9, abs_tol=1e-12)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        parts, others = cast("Sequence[Any]", one), cast("Sequence[Any]", other)
        return len(parts) == len(others) and all(map(_same, parts, others))
    return bool(one == other)
