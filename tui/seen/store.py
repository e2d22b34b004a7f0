"""The supervisor's knowledge of its realm: robots, views, states, events. No screen in here.

Callbacks of the realm client feed it, `now` in hand; widgets look at it a few times a second.
It remembers what it heard last and when, so that silence can be told from calm.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, isnan
from typing import TYPE_CHECKING, Literal

from robotree.tui.seen import instruments, status, wording
from robotree.tui.seen.asked import questions_of
from robotree.tui.seen.status import Status
from robotree.tui.seen.stopping import StopRound
from robotree.tui.seen.watched import WatchedReadings
from robotree.tui.terminal import one_line
from robotree.vr.base.address import Address, shown_address
from robotree.vr.base.description import Lack, Listing, RobotDescription
from robotree.vr.base.presence import Held
from robotree.vr.base.principal import is_person
from robotree.vr.base.readable import apart
from robotree.vr.base.requests import STOPPED, HostDescribed, Level, LoggedLine, State

if TYPE_CHECKING:  # help must not wait for the agents
    from robotree.tui.seen.status import Condition
    from robotree.tui.seen.watched import Alarm
    from robotree.vr.base.permit import Permit
    from robotree.vr.supervision.realm_client import Elsewhere

SILENCE = 4.0
"""[s] without a state after which a robot counts as silent: states come at least once a second."""

FORCES = 600
"""Forces of the selected robot that are remembered: a minute at ten states a second."""

FLASH = 2.5
"""[s] that an arrival stays highlighted."""

MEMORY = 500
"""Events that are kept."""

LEFT = "has left"
"""How a robot is that has taken its leave; a page about it may still be open."""

PROGRESS = "progress"
"""The reading that says how far the running command is."""

OLD: frozenset[Status] = frozenset({"hangs", "gone", "late", "silent", "offline", "away"})
"""Statuses in which readings are old."""

Weight = Literal["good", "plain", "warning", "error"]

WEIGHTS: Mapping[Level, Weight] = {
    "debug": "plain",
    "info": "plain",
    "warning": "warning",
    "error": "error",
    "asked": "plain",
    "done": "good",
    "cancelled": "warning",
    "failed": "error",
}
"""How a line of a robot's log is shown, by its level."""

SENTENCES: frozenset[Level] = frozenset({"cancelled", "failed"})
"""Levels of lines that name their robot themselves."""


@dataclass(frozen=True, slots=True)
class LogEntry:
    """Something that happened."""

    at: float
    """[s] on the store's clock."""
    weight: Weight
    text: str
    robot: str = ""
    """The robot that it concerns; empty: none, or several."""
    line: LoggedLine | None = None
    """The line of the robot's log that says it; None: it was seen from here."""
    operators: bool = False
    """Whether it is for operators alone."""


@dataclass(frozen=True, slots=True)
class Absent:
    """A robot that is seen no more and did not log off: it stays in the list until it is dismissed."""

    address: Address
    kind: str
    host: str
    since: float
    """[s] on the store's clock, since when that is known."""
    pid: str = ""
    """The process that holds it and hangs; empty: its process has gone."""
    remedy: str = ""
    """The remedy for a person."""
    attributes: Mapping[str, str] = field(default_factory=dict[str, str])
    """As it described itself last."""

    @property
    def name(self) -> str:
        """The robot's name."""
        return self.address.name

    @property
    def hangs(self) -> bool:
        """Whether its process runs: the robot may still move."""
        return bool(self.pid)


@dataclass(frozen=True, slots=True)
class Away:
    """A robot that is not here and that a directory remembers."""

    robot: RobotDescription
    readings: Mapping[str, float]
    words: str
    """How it is absent: `away since 14:05 (12 min)`."""


@dataclass(frozen=True, slots=True)
class SeenGroup:
    """A group of robots: a line of its own in the list."""

    about: str
    """Whom it has, in words."""
    members: tuple[str, ...] = ()
    """Their names, as far as somebody knows."""


@dataclass(frozen=True, slots=True)
class Missed:
    """An agent that is on no list any more; why must be found out."""

    who: Listing | RobotDescription
    listed: bool
    """It has been on a list of a lookup service."""


@dataclass(slots=True)
class LatestState:
    """The newest state of a robot, and when it came."""

    state: State
    at: float
    since: float
    """[s] since when it has been carrying out the same command."""
    stopped: float = 0.0
    """[s] since when it has been in protective stop, if it is; not before it was first heard."""
    whole: bool = False
    """It was seen to begin that stop."""


@dataclass(slots=True)
class Store:
    """The supervisor's memory."""

    denies: Callable[[str, Sequence[str], str], str] = lambda _robot, _kinds, _command: ""
    """Says why the policy denies a command of a robot of these kinds to who sits here; empty: it does not."""
    me: str = ""
    """The person who sits here, `anna@pts/3`."""
    restarter: str = ""
    """The program that starts crashed processes again, for people; empty: a person does."""
    restarts: Callable[[str], bool] = field(default=lambda _: True)
    """Returns of the name of a host, or of a robot without one, whether that program starts it again."""
    robots: dict[str, Listing] = field(default_factory=dict[str, Listing])
    """Free robots by name: those that are listed, or that are known while no lookup service lists any."""
    views: dict[str, Listing] = field(default_factory=dict[str, Listing])
    descriptions: dict[str, RobotDescription] = field(default_factory=dict[str, RobotDescription])
    """All robots that answered at the last look, enslaved ones too."""
    services: tuple[str, ...] = ()
    hosts: tuple[str, ...] = ()
    taking_hosts: tuple[str, ...] = ()
    """Those of them to which robots can move."""
    servers: frozenset[Address] | None = None
    """Hosts and lookup services that live, hanging ones too; None: nobody has looked yet."""
    processes: dict[str, str] = field(default_factory=dict[str, str])
    """By robot: the process that holds it, where this machine knows it: `process 4711`."""
    stale: bool = False
    """No lookup service runs: the lists are as old as that."""
    joined: bool = False
    """The realm has been joined; before that emptiness means nothing."""
    entries: deque[LogEntry] = field(default_factory=lambda: deque[LogEntry](maxlen=MEMORY))
    shape: int = 0
    """Grows when the tree should be asked for again."""
    family: int = 0
    """Grows when other robots are known, or others command them."""
    missed: dict[Address, Missed] = field(default_factory=dict[Address, Missed])
    """Agents that are on no list any more: they hang, have gone or were enslaved, as must be found out."""
    absent: dict[str, Absent] = field(default_factory=dict[str, Absent])
    """Robots by name that hang or have gone, until they are dismissed or back."""
    elsewhere: Mapping[str, Elsewhere] = field(default_factory=dict[str, "Elsewhere"])
    """Where robots of other sites are, by name."""
    elsewhere_at: float = 0.0
    """[s] when that was known."""
    away: dict[str, Away] = field(default_factory=dict[str, Away])
    """Robots by name that are not here and that directories remember."""
    groups: dict[str, SeenGroup] = field(default_factory=dict[str, SeenGroup])
    """Groups by name, as this machine keeps them; a robot that is known comes before a group of its name."""
    results: int = 0
    """How many results of this person's orders wait."""
    watched: WatchedReadings = field(default_factory=WatchedReadings)
    """Readings over time, and alarms."""
    permits: tuple[Permit, ...] = ()
    """Calls of assistants that wait for a person's yes, the oldest first."""
    late: frozenset[str] = frozenset()
    """Robots whose process is late with its sign of life: it may hang, or be slow for a moment."""
    remembered: dict[str, RobotDescription] = field(default_factory=dict[str, RobotDescription])
    """How those described themselves who do not answer now."""
    _heard: dict[str, LatestState] = field(default_factory=dict[str, LatestState])
    _were_listed: bool = True
    """A lookup service said so of the robots and views that are known; else they were only seen."""
    _came: dict[str, float] = field(default_factory=dict[str, float])
    stop: StopRound | None = None
    """The stop that was asked for here last, until it is resumed."""
    described_at: float = 0.0
    """[s] when the descriptions came."""
    lost: dict[tuple[str, str], str] = field(default_factory=dict[tuple[str, str], str])
    """Children by parent and slot that were lost, until the slot is filled or a person declines."""
    attended: str = ""
    """The robot whose forces are remembered: the selected one."""
    forces: deque[tuple[float, float]] = field(
        default_factory=lambda: deque[tuple[float, float]](maxlen=FORCES)
    )
    """When and how large the force of that robot was [s], [N], the oldest first."""
    _attended: frozenset[str] = frozenset()
    """It and those below it, whose readings are its."""
    _offered: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    """Places of `lost` that were offered to be filled again."""
    _hanging: set[Address] = field(default_factory=set[Address])
    """Robots whose process hangs, as the log shows."""

    # -- what is told ------------------------------------------------------------------------------

    def tell(
        self,
        text: str,
        weight: Weight,
        now: float,
        robot: str = "",
        line: LoggedLine | None = None,
        *,
        operators: bool = False,
    ) -> LogEntry:
        """Enter something that happened.

        Args:
            text: what.
            weight: how it looks.
            now: [s] on the store's clock.
            robot: that it concerns; empty: none.
            line: of the robot's log, that says so.
            operators: whether it is for operators alone.
        """
        entry = LogEntry(now, weight, one_line(text), robot, line, operators)
        self.entries.append(entry)
        return entry

    def take_lists(self, robots: Iterable[Listing], views: Iterable[Listing], now: float) -> None:
        """Take the lists of the lookup services, or what is known without one; log who came.

        Who is on them no more is missed: why must be found out (`found`, `departed`, `take_silent`).

        Args:
            robots: that are free.
            views: all.
            now: [s] on the store's clock.
        """
        first, were_listed = not self.joined, self._were_listed
        self.joined, self._were_listed = True, not self.stale
        before = {**self.robots, **self.views}
        self.robots = {robot.name: robot for robot in robots}
        self.views = {view.name: view for view in views}
        after = {**self.robots, **self.views}
        for name, listing in after.items():
            known = before.get(name)
            if (known is None or known.address != listing.address) and not first:
                self._came[name] = now
                where = "has come, but no lookup service lists it" if self.stale else "is listed"
                if self.stale or not self._tells_who_created_it(listing):
                    self.tell(f"{name} {_inserted(listing)} {where}", "good", now, name)
        for name, listing in before.items():
            if name not in after:
                self._came.pop(name, None)
                self.missed.setdefault(listing.address, Missed(listing, were_listed))
        if before != after:
            self.family += 1
        self.shape += 1

    def _tells_who_created_it(self, listing: Listing) -> bool:
        """Whether a robot's own log says that it has come: a host writes there who created it."""
        known = self.descriptions.get(listing.name)
        return bool(listing.host) and (known is None or known.address != listing.address)

    def _tell_departure(self, who: Listing | RobotDescription | Absent, now: float) -> None:
        self.tell(f"{who.name} {_inserted(who)} left the list", "plain", now, who.name)

    def found(self, address: Address, now: float) -> None:
        """Note that a missing agent runs: it is on no list only because it has a parent."""
        missed, robot = self.missed.pop(address, None), self.descriptions.get(address.name)
        self.family += 1
        if missed and robot and robot.bond:
            parent = f"{robot.bond.parent.name}.{robot.bond.slot}"
            self.tell(
                f"{robot.name} {_inserted(robot)} is commanded by {parent} now",
                "plain",
                now,
            )
        elif missed and missed.listed and address.name not in self.robots:
            self._tell_departure(missed.who, now)

    def departed(self, address: Address, now: float, *, left: bool) -> None:
        """Note that a missing agent, or one whose process hung, runs nowhere any more.

        Args:
            address: of the agent.
            now: [s]
            left: it has taken its leave, as it said itself; else its process has died.
        """
        self._hanging.discard(address)
        missed, absent = self.missed.pop(address, None), self.absent.get(address.name)
        who = missed.who if missed else absent if absent and absent.address == address else None
        if who is None:
            return
        if left:
            self._tell_departure(who, now)
            self.absent.pop(address.name, None)
            self._forget(address.name)
        else:
            self._lose(address, who, now)

    def take_silent(self, silent: Iterable[Held], now: float) -> None:
        """Take the agents in processes that hang: log each once, and keep robots among them in the list."""
        for one in silent:
            address = shown_address(one.key)
            if address is None:
                continue
            missed = self.missed.pop(address, None)
            if address not in self._hanging:
                self._hanging.add(address)
                who = missed.who if missed else self.robots.get(address.name) or self.described(address.name)
                self._lose(address, who, now, one)

    def take_late(self, late: Iterable[Held]) -> None:
        """Take the agents whose processes are late with their sign of life."""
        self.late = frozenset(address.name for agent in late if (address := shown_address(agent.key)))

    def take_elsewhere(self, elsewhere: Mapping[str, Elsewhere], now: float) -> None:
        """Take where robots of other sites are, and how old what is known of them is."""
        self.elsewhere, self.elsewhere_at = elsewhere, now

    def place(self, name: str, now: float) -> str:
        """Return site and age of a robot of another site: `hall 0.5 s`; empty: it is of this machine."""
        where = self.elsewhere.get(name)
        if where is None:
            return ""
        way, heard = 0.0 if isnan(where.age) else where.age, self.age(name, now)
        since = now - self.elsewhere_at if heard is None or where.silent else heard
        return f"{where.site} {ceil(2 * (way + since)) / 2:g} s"  # steps of half a second do not flicker

    @property
    def hanging(self) -> frozenset[Address]:
        """Robots whose process hangs, as far as the log shows it."""
        return frozenset(self._hanging)

    def _lose(
        self,
        address: Address,
        who: Listing | RobotDescription | Absent | None,
        now: float,
        hangs: Held | None = None,
    ) -> None:
        """Keep a robot in the list that hangs or has gone, and log it."""
        kind, attributes = (who.kind, who.attributes) if who else ("", {})
        what = f"{address.name} {wording.inserted(kind or address.role, attributes)}"
        pid = hangs.where.removeprefix("process ") if hangs else ""
        if hangs:
            self.tell(
                f"{what}: its process hangs and does not answer; {hangs.remedy}", "error", now, address.name
            )
        else:
            self.tell(f"{what}: its process has gone", "error", now, address.name)
        if address.role == "robot":
            host = who.host if who else ""
            if self.restarter and self.restarts(host or address.name):
                again = f"{self.restarter} starts it again"
            else:
                again = f"`robotree host {host}` brings it back" if host else "start it again"
            remedy = hangs.remedy if hangs else f"its process has gone: {again}"
            self.absent[address.name] = Absent(address, kind, host, now, pid, remedy, attributes)
            self.family += 1

    def dismiss(self, name: str) -> Absent | None:
        """Take a robot that hangs or has gone off the list; it is back as soon as it answers."""
        gone = self.absent.pop(name, None)
        if gone:
            if self.stop:
                self.stop.dismiss(name)
            self._forget(name)
        return gone

    def _forget(self, name: str) -> None:
        self.remembered.pop(name, None)
        self._heard.pop(name, None)
        self.family += 1

    def _welcome(self, addresses: Iterable[Address], now: float) -> None:
        """Note who is there again, or there under the name of one that has gone."""
        for address in addresses:
            gone = self.absent.pop(address.name, None)
            if gone:
                self.family += 1
                if gone.address == address:
                    what = wording.inserted(gone.kind or address.role, gone.attributes)
                    self.tell(f"{gone.name} {what} answers again", "good", now, gone.name)
                if self.stop:
                    self.stop.wake(gone.name)
            self._hanging.discard(address)

    def take_services(self, services: Sequence[str], now: float, *, stale: bool) -> None:
        """Take which lookup services live."""
        if stale and self.services:
            self.tell("no lookup service is left: the lists may be old", "error", now)
        if self.orphaned and not stale:
            self.tell("a lookup service is back", "good", now)
        self.services, self.stale = tuple(sorted(services)), stale

    def take_servers(
        self, present: Collection[Address], now: float, *, left: Callable[[Address], bool]
    ) -> None:
        """Take which hosts and lookup services are present; log who comes, leaves or dies.

        Args:
            present: those that are present and do not hang.
            now: [s] on the store's clock.
            left: returns whether one has taken its leave.
        """
        before, awake = self.servers, self._hanging.intersection(present)
        self._hanging -= awake
        self.servers = frozenset({*present, *self._hanging.intersection(before or ())})
        for address in sorted(awake):
            self.tell(f"{address.name} ({address.role}) answers again", "good", now)
        if before is None:
            return
        for address in sorted(self.servers - before):
            self.tell(f"{address.name} ({address.role}) has come", "good", now)
        for address in sorted(before - self.servers):
            if left(address):
                self.tell(f"{address.name} ({address.role}) has left", "plain", now)
            else:
                self.tell(f"{address.name} ({address.role}) has died: its process has gone", "error", now)

    def take_processes(self, held: Iterable[Held]) -> None:
        """Take which process holds each robot."""
        found = ((shown_address(one.key), one.where) for one in held)
        self.processes = {one.name: where for one, where in found if one and one.role == "robot"}

    def take_away(self, away: Mapping[str, Away]) -> None:
        """Take which robots are away, as directories remember them."""
        here = self.descriptions.keys() | self.robots.keys() | self.absent.keys()
        found = {name: one for name, one in away.items() if name not in here}
        if found.keys() != self.away.keys():
            self.family += 1
        self.away = found

    def take_groups(self, groups: Mapping[str, SeenGroup]) -> None:
        """Take the groups of the realm, and who is in each now."""
        if groups.keys() != self.groups.keys():
            self.family += 1
        self.groups = dict(groups)

    def take_results(self, count: int, now: float, how: str) -> None:
        """Take how many results wait for this person, and tell of new ones; `how` they are shown."""
        if count > self.results:
            what = "the result of an order waits" if count == 1 else f"{count} results of orders wait"
            self.tell(f"{what}: {how}", "good", now)
        self.results = count

    def take_permits(self, waiting: Iterable[Permit], now: float, how: str) -> None:
        """Take which calls of assistants wait for a person, and tell of new ones; `how` they are answered."""
        found, known = tuple(waiting), {one.id for one in self.permits}
        for one in found:
            if one.id not in known:
                self.tell(
                    f"{one.assistant} asks for {one.call}: {how}", "warning", now, one.robot, operators=True
                )
        self.permits = found

    def take_alarms(self, alarms: Iterable[Alarm], now: float, how: str) -> None:
        """Take the alarms as they are kept, and tell what is new; `how` one is acknowledged."""
        raised, acknowledged = self.watched.take_alarms(alarms)
        for alarm in raised:
            value, limit = apart(alarm.value, alarm.limit, alarm.unit)
            text = f"ALARM: {alarm.name} was {value}, {alarm.sign} {limit}; {how}"
            self.tell(text, "error", now, alarm.robot, operators=True)
        for alarm in acknowledged:
            if alarm.acknowledged_by == self.me:  # the answer to the verb has said it
                continue
            text = f"the alarm of {alarm.name} was acknowledged by {alarm.acknowledged_by}"
            self.tell(text, "good", now, alarm.robot, operators=True)

    def source_of(self, name: str, reading: str) -> str:
        """Return the robot whose own reading it is: the robot, or one below it; empty: none has it."""
        for below in self._downwards(name):
            state = self.state(below)
            if state is not None and reading in state.readings:
                return below
        return ""

    def take_hosts(self, hosts: Iterable[HostDescribed]) -> None:
        """Take which hosts live; one that stands by is none yet."""
        working = sorted((host for host in hosts if not host.stands_by), key=lambda host: host.address.name)
        self.hosts = tuple(host.address.name for host in working)
        self.taking_hosts = tuple(host.address.name for host in working if host.takes_robots)

    def take_state(self, name: str, state: State, now: float) -> None:
        """Take a state that a robot published. Called ten thousand times a second where there are many."""
        self.watched.take(name, state.readings, now)
        before = self._heard.get(name)
        if before is None:
            self._heard[name] = LatestState(state, now, now, now)
            self.shape += 1
            if state.stopped and self.stop:
                self.stop.confirm(name, now)
            return
        old = before.state
        before.at = now
        if old == state:
            return
        before.state = state
        if name in self._attended and (force := instruments.size(state.readings)) is not None:
            self.forces.append((now, force))
        if old.bond != state.bond or old.epoch != state.epoch or old.online != state.online:
            self.shape += 1
        if state.stopped and not old.stopped:
            before.stopped, before.whole = now, True
        if (old.busy, old.caller) != (state.busy, state.caller):
            before.since = now
        if state.stopped and self.stop and name in self.stop.open:
            self.stop.confirm(name, now)
        self._tell_control(name, old, state, now)
        if old.online != state.online or old.stopped != state.stopped:
            self._tell_change(name, old, state, now)

    def begin_stop(self, name: str, now: float) -> None:
        """Note that a robot, the members of a group, or all (empty), are asked to stop."""
        group = self.group(name)
        self.stop = StopRound.begin(group.members if group else [name] if name else self.known, now)

    def end_stop(self, told: Iterable[str], untold: Mapping[str, str], now: float) -> None:
        """Note what came of that (`StopRound.end`)."""
        if self.stop:
            self.stop.end(told, untold, now)

    def settle_stop(self) -> list[str]:
        """A person resumes: return the robots of the stop's banner that were not stopped and answer again."""
        return self.stop.settle() if self.stop else []

    def take_line(self, name: str, line: LoggedLine, now: float) -> None:
        """Take a line of a robot's log: what its code says, and what became of the commands of people.

        What its parent asks is part of the parent's command.
        """
        if line.command and not is_person(line.caller):
            return
        if line.text.startswith(STOPPED):  # its state says so, which no flood of lines holds back
            return
        if self.me and line.text.startswith((f"{self.me} has control ", f"{self.me} has no control ")):
            return  # `_tell_control` does
        text = line.text if line.level in SENTENCES else f"{name}: {line.text}"
        self.tell(text, WEIGHTS[line.level], now, name, line)

    def _tell_control(self, name: str, before: State, after: State, now: float) -> None:
        """Tell of a change of hands, and who sits here of what only that person can answer."""
        if after.operator != before.operator:
            had, has = before.operator, after.operator
            whose = f"you have control of {name}" if has == self.me else f"{has} has control of {name}"
            text = whose if has else f"nobody has control of {name}: {had} gave it up, or is gone"
            if self.me in {had, has}:  # else the log of the robot says it
                self.tell(text, "warning", now, name)
        if after.wanted_by != before.wanted_by and after.wanted_by and after.operator == self.me:
            self.tell(
                f"{after.wanted_by} asks for control of {name}: `control offer {name}`", "warning", now, name
            )
        if before.wanted_by == self.me and not after.wanted_by and after.operator != self.me:
            self.tell(
                f"{after.operator or 'nobody'} did not give you control of {name}", "warning", now, name
            )
        if after.offered_to != before.offered_to and after.offered_to == self.me:
            self.tell(
                f"{after.operator} offers you control of {name}: `control get {name}`", "warning", now, name
            )

    def _tell_change(self, name: str, before: State, after: State, now: float) -> None:
        if before.online and not after.online:
            self.tell(f"{name} lost its controller: its readings are stale", "error", now, name)
        if after.online and not before.online:
            self.tell(f"{name} has its controller back", "good", now, name)
        if after.stopped and not before.stopped:
            reason = after.stop_reason
            if not reason.endswith("protective stop"):  # else it says whose: `anna@pts/3's protective stop`
                reason = f"protective stop: {reason}" if reason else "protective stop"
            self.tell(f"{name} is in {reason}", "error", now, name)
        if before.stopped and not after.stopped:
            self.tell(f"{name} was resumed: its stop has ended", "good", now, name)

    def take_descriptions(self, descriptions: Iterable[RobotDescription], now: float = 0.0) -> None:
        """Take how all robots describe themselves; who is not among them does not answer."""
        enslaved, before = self.enslaved, self.descriptions
        self.descriptions = {description.name: description for description in descriptions}
        self.described_at = now
        self._welcome([description.address for description in self.descriptions.values()], now)
        for one in enslaved:
            if one.name not in self.descriptions:
                self.missed.setdefault(one.address, Missed(one, listed=False))
        for name, one in {**self.remembered, **before}.items():
            if name in self.descriptions or not (name in self.absent or one.address in self.missed):
                self.remembered.pop(name, None)
            else:
                self.remembered[name] = one
        living = self.descriptions.keys() | self.robots.keys() | self.absent.keys() | self.remembered.keys()
        self._heard = {name: heard for name, heard in self._heard.items() if name in living}
        self._take_losses(before, now)
        self._take_questions(before, now)
        if before.keys() != self.descriptions.keys() or any(
            (one.slots, one.kinds, one.bond and one.bond.parent)
            != ((old := before[name]).slots, old.kinds, old.bond and old.bond.parent)
            for name, one in self.descriptions.items()
        ):
            self.family += 1

    def _take_questions(self, before: Mapping[str, RobotDescription], now: float) -> None:
        """Tell what robots have just begun to ask people."""
        for robot in self.descriptions.values():
            old = before.get(robot.name)
            known = () if old is None else tuple(question.id for question in questions_of(old))
            for question in questions_of(robot):
                if question.id not in known:
                    text = f"{robot.name} asks: {question.text} `decide {robot.name} {question.how}` answers"
                    self.tell(text, "warning", now, robot.name)

    def _take_losses(self, before: Mapping[str, RobotDescription], now: float) -> None:
        """Remember who was in a slot whose child was lost; offer to bind it again as soon as it is back."""
        for robot in self.descriptions.values():
            old = before.get(robot.name)
            for slot in robot.slots:
                place, held = (robot.name, slot.name), old.slot(slot.name) if old else None
                if slot.child:
                    self.lost.pop(place, None)
                elif slot.lost and held and held.child:
                    self.lost[place] = held.child.name
        for place, child in self.lost.items():
            if child in self.robots and place not in self._offered:
                self._offered.add(place)
                parent = place[0]
                self.tell(
                    f"re-bond {'.'.join(place)} to {child}? ⏎ on either of them", "warning", now, parent
                )
        self._offered &= self.lost.keys()

    # -- what is asked -----------------------------------------------------------------------------

    @property
    def known(self) -> set[str]:
        """Names of all robots that are there, or were and were not dismissed."""
        here = {*self.descriptions, *self.robots, *self.absent, *self.remembered, *self._unexplained}
        return here.union(self.away)

    @property
    def _unexplained(self) -> set[str]:
        """Names of robots that are on no list any more and do not answer; why is to be found out."""
        here = (self.descriptions, self.robots, self.absent)  # asked for each row that is drawn
        return {
            address.name
            for address in self.missed
            if address.role == "robot" and not any(address.name in one for one in here)
        }

    def count(self, now: float) -> list[tuple[Status, int]]:
        """Return how many robots have each status at this moment [s], the worst status first."""
        found = Counter(self.status(name, now) for name in self.known)
        return [(each, found[each]) for each in status.STATUSES if found[each]]

    @property
    def orphaned(self) -> bool:
        """Whether there are agents, but no lookup service that lists them."""
        return self.stale and bool(self.robots or self.views or self.descriptions)

    @property
    def drills(self) -> dict[str, str]:
        """What robots suffer for a drill, and who has asked for that, by their names."""
        heard = sorted(self._heard.items())
        return {name: one.state.drill for name, one in heard if one.state.drill}

    @property
    def stopped(self) -> tuple[str, ...]:
        """Names of the robots in protective stop."""
        return tuple(sorted(name for name, heard in self._heard.items() if heard.state.stopped))

    @property
    def enslaved(self) -> list[RobotDescription]:
        """Robots under a parent, as far as they reported it: they are on no list that they could leave."""
        return [
            robot
            for name, robot in self.descriptions.items()
            if name not in self.robots
            and (condition := self._condition_of(name))
            and condition.bond is not None
        ]

    def state(self, name: str) -> State | None:
        """Return the newest state of a robot."""
        heard = self._heard.get(name)
        return heard.state if heard else None

    def age(self, name: str, now: float) -> float | None:
        """Return [s] since a robot published its state; None: never."""
        heard = self._heard.get(name)
        return now - heard.at if heard else None

    def stopped_since(self, name: str) -> tuple[float, bool] | None:
        """Return since when [s] a robot has been in protective stop, and whether its beginning was seen."""
        heard = self._heard.get(name)
        return (heard.stopped, heard.whole) if heard and heard.state.stopped else None

    def described(self, name: str) -> RobotDescription | None:
        """Return how a robot describes itself, or did before it ceased to answer."""
        known = self.descriptions.get(name) or self.remembered.get(name)
        return known or (self.away[name].robot if name in self.away else None)

    def known_of(self, name: str) -> RobotDescription | Listing | Absent | None:
        """Return what says most of a robot: how it describes itself, its listing, or what is kept of it."""
        return self.described(name) or self.robots.get(name) or self.absent.get(name)

    def is_away(self, name: str) -> bool:
        """Whether a robot is not here, and a directory remembers it."""
        here = (self.descriptions, self.robots, self.absent, self.remembered)
        return name in self.away and not any(name in one for one in here)

    def _away(self, name: str, now: float) -> tuple[Status, str] | None:  # one for each
        """Return why a robot is not as it said last, in one word and in words; None: it is."""
        if absent := self.absent.get(name):
            gone = f"GONE {status.span(now - absent.since)}"
            return ("hangs", f"HANGS (pid {absent.pid})") if absent.hangs else ("gone", gone)
        if self.is_away(name):
            return "away", self.away[name].words
        if name in self.late:
            return "late", "late"
        if silent := self._silent_words(name, now):
            return "silent", silent
        if self._condition_of(name) is None and name not in self.robots:
            return "gone", LEFT
        return None

    def group(self, name: str) -> SeenGroup | None:
        """Return the group of this name; None: there is none, or a robot has this name."""
        found = self.groups.get(name)
        if found is None:  # asked for each row that is drawn: with no group this costs nothing
            return None
        return None if name in self.known else found

    def _of_members(self, group: SeenGroup, now: float) -> list[tuple[Status, int]]:
        """Return how many members of a group have each status, the worst status first."""
        known = self.known
        found = Counter(self.status(one, now) if one in known else "gone" for one in group.members)
        return [(each, found[each]) for each in status.STATUSES if found[each]]

    def status(self, name: str, now: float) -> Status:
        """Return how a robot is, in one word; of a group, how the worst of its members is.

        All pages ask this, or `doing`, and nothing else.
        """
        if group := self.group(name):
            of_members = self._of_members(group, now)
            return of_members[0][0] if of_members else "free"
        if away := self._away(name, now):
            return away[0]
        condition = self._condition_of(name)
        return status.status_of(condition, self.lacks(name)) if condition else "free"

    def is_explained(self, name: str, now: float) -> bool:
        """Whether how a robot is has been heard, or why it is not; before that it seems free."""
        return self._condition_of(name) is not None or self._away(name, now) is not None

    def answers(self, name: str, now: float) -> bool:
        """Whether a robot is there to be commanded: it neither hangs nor has gone; of a group, if one is."""
        if group := self.group(name):
            return any(self.answers(one, now) for one in group.members)
        return self.status(name, now) not in {"hangs", "gone", "away"}

    def doing(self, name: str, now: float) -> str:
        """Return how a robot is, in words; of one of another site with the place, and how old that is."""
        place, words = self.place(name, now), self._doing(name, now)
        return f"{words} · {place}" if place else words

    def _doing(self, name: str, now: float) -> str:
        if group := self.group(name):
            counted = [f"{count} {each}" for each, count in self._of_members(group, now)]
            return ", ".join(counted) or "nobody is in it now"
        if away := self._away(name, now):
            return away[1]
        condition, heard = self._condition_of(name), self._heard.get(name)
        if condition is None:
            return "free"
        calm = status.status_of(condition, self.lacks(name))
        if condition.bond is not None and calm == "enslaved":
            return f"under {self.by(name)}"
        if condition.operator and calm == "free" and not condition.advised:
            mine = condition.operator == self.me
            return "you have control" if mine else f"{condition.operator} has control"
        seconds, note = (now - heard.since, heard.state.note) if heard else (0.0, "")
        return status.doing(
            condition, self.progress(name), lacks=self.lacks(name), seconds=seconds, note=note
        )

    def denied(self, name: str) -> str:
        """Return why the policy denies all commands of a robot to who sits here; empty: not all of them."""
        robot = self.described(name)
        if robot is None:
            return ""
        reason = ""
        for command in robot.commands:
            if not (reason := self.denies(name, robot.kinds, command.name)):
                return ""
        return reason

    def by(self, name: str) -> str:
        """Return who commands a robot: its parent, or who asked for the command that runs; empty: nobody."""
        state, robot, absent = self.state(name), self.described(name), self.absent.get(name)
        if absent and not absent.hangs:
            return ""
        if state and state.operator and not state.bond:
            wish = state.wanted_by or state.offered_to
            return f"{state.operator} → {wish}" if wish else state.operator
        if state:
            return state.bond.name if state.bond else state.caller if state.busy else ""
        return robot.bond.parent.name if robot and robot.bond else ""

    def waiters(self, name: str) -> tuple[str, ...]:
        """Return who asked for the commands that wait at a robot, the next one first."""
        state = self.state(name)
        return state.waiters if state and not self.absent.get(name) else ()

    def rebond(self, name: str) -> tuple[str, str, str] | None:
        """Return parent, slot and child of a bond of this robot that was lost and can be made again."""
        places = ((*place, child) for place, child in self.lost.items() if child in self.robots)
        return next((one for one in places if name in {one[0], one[2]}), None)

    def old(self, name: str, now: float) -> bool:
        """Whether the readings of a robot are old: it is offline, silent, hangs or has gone."""
        return self.status(name, now) in OLD

    def lacks(self, name: str) -> list[Lack]:
        """Return the children that a robot must have before it can be used; see `status.lacks_of`."""
        robot = self.described(name)
        if robot is None or not robot.slots:
            return []
        return status.lacks_of(robot, self.described, {one.name for one in self._hanging})

    def attend(self, name: str) -> None:
        """Remember the forces of this robot from now on."""
        if name != self.attended:
            self.attended = name
            self.forces.clear()
        self._attended = frozenset(self._downwards(name))

    def _silent_words(self, name: str, now: float) -> str:
        """Return how a robot is that is not heard; empty: it is."""
        where = self.elsewhere.get(name)
        if where is not None and where.silent:
            return f"site {where.site} is silent"
        if self._silent(name, now):
            return f"silent {status.span(self.age(name, now) or 0.0)}"
        return "does not answer" if name in self._unexplained else ""

    def _silent(self, name: str, now: float) -> bool:
        age = self.age(name, now)
        return age is not None and age > SILENCE

    def _condition_of(self, name: str) -> Condition | None:
        """Return what a robot reports of itself: its newest state; before the first one its description."""
        return self.state(name) or self.described(name)

    def readings(self, name: str) -> dict[str, float]:
        """Return the readings of a robot, over those of the child that its exposed commands lead to."""
        found: dict[str, float] = {}
        for name_below in self._downwards(name):
            state = self.state(name_below)
            if state is not None:
                found = {**state.readings, **found}
            elif self.is_away(name_below):
                found = {**self.away[name_below].readings, **found}
        found.pop(PROGRESS, None)
        return found

    def units(self, name: str) -> dict[str, str]:
        """Return the units of those readings, by name."""
        found: dict[str, str] = {}
        for name_below in self._downwards(name):
            robot, state = self.described(name_below), self.state(name_below)
            readings = state.readings if state else robot.units if robot else {}
            own = robot.units if robot else {}
            found = {**{key: own.get(key, "") for key in readings}, **found}
        return found

    def _downwards(self, name: str) -> Iterable[str]:
        seen: set[str] = set()
        while name and name not in seen:
            seen.add(name)
            yield name
            name = self._beneath(name)

    def progress(self, name: str) -> float | None:
        """Return how far the running command of a robot is, 0 to 1; None: it does not say."""
        state = self.state(name)
        return state.readings.get(PROGRESS) if state else None

    def _beneath(self, name: str) -> str:
        """Return the child that a robot's exposed commands lead to, or its only child."""
        robot = self.described(name)
        if robot is None:
            return ""
        children = {slot.name: slot.child.name for slot in robot.slots if slot.child}
        through = [command.through.partition(".")[0] for command in robot.commands if command.through]
        wanted = next((slot for slot in through if slot in children), next(iter(children), ""))
        return children.get(wanted, "")

    def speaks_of(self, name: str) -> str:
        """Return what a robot says of itself and its commands, for those who look for words."""
        robot, listing = self.described(name), self.robots.get(name)
        if robot is None:
            return f"{' '.join(listing.kinds)} {listing.doc}" if listing else ""
        return " ".join(
            [*robot.kinds, robot.doc, *(f"{command.name} {command.doc}" for command in robot.commands)]
        )

    def came(self, name: str, now: float) -> bool:
        """Whether a robot has just come."""
        return now - self._came.get(name, -FLASH) < FLASH

    def candidates(self, parent: str, kind: str, commands: Collection[str] = ()) -> list[Listing]:
        """Return the free robots that a slot takes, without the parent and those above it.

        Args:
            parent: whose slot it is.
            kind: that it takes.
            commands: names of those that a robot must have for it.
        """
        above = self.lineage(parent)
        return [
            one
            for name, one in sorted(self.robots.items())
            if kind in one.kinds and name not in above and set(commands) <= self._commands(one)
        ]

    def _commands(self, listed: Listing) -> set[str]:
        """Return the commands of a robot, also those that need a robot in an empty slot."""
        robot = self.descriptions.get(listed.name)
        return {command.name for command in robot.commands} if robot else set(listed.commands)

    def lineage(self, name: str) -> tuple[str, ...]:
        """Return a robot and all that command it, upwards."""
        line: list[str] = []
        while name and name not in line:
            line.append(name)
            robot = self.described(name)
            name = robot.bond.parent.name if robot and robot.bond else ""
        return tuple(line)


def _inserted(who: Listing | RobotDescription | Absent) -> str:
    """Return the kind of an agent, and whether it is real or simulated: `(Arm, sim)`."""
    return wording.inserted(who.kind, who.attributes)
