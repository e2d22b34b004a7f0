"""All agents of one realm by name: what a supervisor needs, in one place.

Every method takes names as people type them, finds the agents, asks them, and raises nothing but `VrError`.
Of those that do not answer it says which process holds them, if that lives (`Hanging`).
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from math import isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

import msgspec

from robotree.vr.base.address import ROLES, Address, Role, check_name, everyone, parted, unique
from robotree.vr.base.description import Listing, Placement, RobotDescription, Template
from robotree.vr.base.envelope import asking_assistant, asks_for_a_person
from robotree.vr.base.errors import (
    Denied,
    DuplicateName,
    HostReserved,
    NoAnswer,
    NoHost,
    NoPage,
    NoSuchRobot,
    NotVirtual,
    StandsBy,
    Unreachable,
    VrError,
)
from robotree.vr.base.permissions import Isolation
from robotree.vr.base.policy import BY_NAME, REALM, Decision, Person, PolicyGate, PolicyTarget
from robotree.vr.base.presence import Held
from robotree.vr.base.principal import user_name
from robotree.vr.base.requests import (
    ANSWER_WITHIN,
    Call,
    DescribeGateway,
    DescribeSpace,
    EventsRead,
    EventsVerified,
    GatewayDescribed,
    HostDescribed,
    LoggedLine,
    LogLines,
    Picture,
    ReadEvents,
    Reloaded,
    Remembered,
    SpaceDescribed,
    State,
    StreamSample,
    VerifyEvents,
    ViewDescribed,
    decode_event,
)
from robotree.vr.base.transport import Registration, Transport
from robotree.vr.exchange.asking import ask, fresh_key
from robotree.vr.exchange.attendance import Attendance
from robotree.vr.exchange.calling import CallOutcome, OnFields, OnProgress, call_and_wait
from robotree.vr.exchange.client import (
    DEFAULT_DEADLINE,
    RELOADING,
    HostClient,
    RobotClient,
    ViewClient,
    read_history,
)
from robotree.vr.lookup.chronicle import merged, site_told
from robotree.vr.lookup.directory import Directory
from robotree.vr.network.group_file import GroupFiles, groups_beside
from robotree.vr.network.lean_stop import REASON
from robotree.vr.supervision.operators import Operators
from robotree.vr.supervision.orders import OrderDesk
from robotree.vr.supervision.showing import shown_agent, shown_held, shown_robot
from robotree.vr.supervision.stop import EVERYWHERE, OnLate, Releases, StopOrder, StopScope

CALLER = "operator"
"""How a supervisor names itself to robots."""

GLANCE = 1.5
"""[s] to wait for each agent when many are asked at once: one that hangs must not hide the others."""

EXAMINATION = 120.0
"""[s] for a host to examine all events that it has kept."""

LOOK_AGAIN = 0.05
"""[s] between two looks at where a paused robot stands."""
if TYPE_CHECKING:  # `ls` shows no panel
    from robotree.vr.bundle.admission import Gate
    from robotree.vr.supervision.panels import JudgedPanel

BY_HASH = "sha256:"
"""Begins what names a page by its hash."""
PORTION = 25
"""Agents that are asked in one go."""
PAUSE = 0.004
"""[s] between two portions: the event loop deals with everything else meanwhile."""

_REMEMBERING: tuple[Role, ...] = ("lookup", "host")
OnState = Callable[[str, State], None]
_R = TypeVar("_R")
_E = TypeVar("_E", State, LogLines, StreamSample)
_K = TypeVar("_K", EventsRead, EventsVerified)


class Elsewhere(NamedTuple):
    """Where an agent of another site is."""

    site: str
    age: float
    """[s] that what is shown of it is old, at least; NaN: the gateway did not say."""
    silent: bool
    """Whether its site is not heard now: it may do anything there."""

    @property
    def words(self) -> str:
        """The same for people: `hall, 0.2 s ago`."""
        silent = ", silent" if self.silent else ""
        return f"{self.site}{silent}" if isnan(self.age) else f"{self.site}{silent}, {self.age:.1f} s ago"


class RealmClient:
    """Sees and commands all agents of a realm.

    A name is that of an agent of this machine, else of the only one, or `SITE:NAME`. Where several sites have
    agents of one name, all are shown with their sites.
    """

    def __init__(self, transport: Transport, realm: str = "") -> None:
        """Prepare; `start` looks around.

        Args:
            transport: the way to the agents.
            realm: name of their realm; empty: it has none that other processes could join.
        """
        self.realm = realm
        self.directory = Directory(transport)
        self.places = self.directory.places
        self._transport = transport
        self._releases = Releases(self.directory, transport)
        self._caller = _Caller(transport)
        self.orders = OrderDesk(transport, self._caller.key)
        """What is left for robots that are away, and what is remembered of them."""
        self.operators = Operators(transport, self._caller.key)
        """The other operators of the realm."""

    async def start(self) -> None:
        """Begin to look; returns when the lookup services that are there have sent their lists."""
        await self.directory.start()

    async def close(self) -> None:
        """Look no more. The transport stays open: it is the caller's."""
        await self.operators.close()
        await self._caller.close()
        await self.directory.close()

    @property
    def groups(self) -> GroupFiles:
        """The groups of the realm, as this machine keeps them."""
        return groups_beside(self._transport.gate)

    # -- who may what -----------------------------------------------------------------------------

    @property
    def gate(self) -> PolicyGate:
        """The policy of the realm, as it is now."""
        gate = self._transport.gate
        now = asyncio.get_running_loop().time()
        if now >= gate.due:
            gate.refresh(now)
        return gate

    @property
    def asker(self) -> Person | None:
        """Who asks here, as a policy names persons; None: nobody who is limited by a policy."""
        gate, assistant = self.gate, asking_assistant()
        if not (assistant or (gate.closed and asks_for_a_person())):
            return None
        return gate.user(user_name(os.geteuid()))._replace(assistant=assistant)

    def denial(self, right: str, target: PolicyTarget) -> Decision | None:
        """Return why the policy denies something to who asks here; None: it does not."""
        asker = self.asker
        found = None if asker is None else self.gate.may(asker, right, target)
        return None if found is None or found.allowed else found

    def refused(self, right: str, name: str, kinds: Sequence[str], command: str = "") -> Denied | None:
        """Return why the policy denies something with a robot to who asks here; None: it does not."""
        site, _, plain = name.rpartition(":")
        target = PolicyTarget(plain, "robot", tuple(kinds), command, site or self.gate.site)
        found, asker = self.denial(right, target), self.asker
        if found is None or asker is None:
            return None
        return Denied(who=str(asker), right=right, target=str(target), reason=found.reason, ask=self.gate.ask)

    def hides(self, address: Address | None, kinds: Sequence[str] = ()) -> bool:
        """Whether who asks here may not see an agent. What is in the way of a stop is named nevertheless."""
        if address is None or address.role not in BY_NAME["see"].roles:
            return False
        site = self.places.site_of(address.key) or self.gate.site
        kinds = tuple(kinds) or self._kinds(address)
        target = PolicyTarget(address.plain_name, address.role, kinds, "", site)
        return self.denial("see", target) is not None

    def _kinds(self, address: Address) -> tuple[str, ...]:
        """Return the kinds of an agent, as far as a lookup service knows them."""
        found = self.directory.find(Template())
        return next((tuple(one.kinds) for one in found if one.address == address), ())

    def _shown(self, held: Sequence[Held]) -> list[Held]:
        """Leave out what may not be seen, and show the rest as people are shown it."""
        if self.gate.closed:
            held = [one for one in held if not one.key or not self.hides(Address.parse(one.key))]
        return [shown_held(one, self.places.shown) for one in held]

    async def target(self, right: str, words: str) -> PolicyTarget:
        """Return what somebody means by `ROBOT`, `ROBOT.COMMAND`, `SITE:ROBOT` or the name of a host.

        Args:
            right: that is asked about.
            words: as typed.
        """
        site, _, path = words.rpartition(":")
        name, _, command = path.partition(".")
        roles = BY_NAME[right].roles if right in BY_NAME else ("robot",)
        if roles == (REALM,):
            return PolicyTarget("", REALM)
        meant = f"{site}:{name}" if site else name
        there = (role for role in ROLES if role in roles and self.directory.present(role, meant))
        role = next(there, roles[0])
        kinds: tuple[str, ...] = ("View",) if role == "view" else ()
        if role == "robot":
            kinds = next((one.kinds for one in self.robots() if one.name == meant), ())
            if not kinds and self.directory.present("robot", meant):
                with contextlib.suppress(VrError):
                    kinds = (await self.describe(meant)).kinds
        return PolicyTarget(name, role, tuple(kinds), command, site or self.gate.site)

    # -- who is there -----------------------------------------------------------------------------

    @property
    def services(self) -> Sequence[str]:
        """Names of the lookup services that live."""
        return self.directory.services

    @property
    def stale(self) -> bool:
        """Whether no lookup service runs, so that the lists may be old."""
        return self.directory.stale

    def robots(self) -> Sequence[Listing]:
        """Return the robots that are listed: an enslaved one is not."""
        return self._listed("robot")

    def views(self) -> Sequence[Listing]:
        """Return the views."""
        return self._listed("view")

    def _listed(self, role: Literal["robot", "view"]) -> Sequence[Listing]:
        found: Sequence[Listing] = self.directory.find(Template(role=role))
        if self.asker is not None:
            found = [one for one in found if not self.hides(one.address, one.kinds)]
        return [shown_agent(one, self.places.shown) for one in found]

    def present(self, role: Role) -> Sequence[Address]:
        """Return all agents of a role that are seen alive, listed or not, as people are shown them."""
        return [self.places.shown(address) for address in self.directory.present(role)]

    def inhabited(self) -> bool:
        """Whether any agent runs on this machine, by the machine's own record. Needs no `start`."""
        return bool(self._transport.presence.held("*/*/*"))

    async def hosts(self) -> Sequence[HostDescribed]:
        """Ask all hosts what they run, by name. One that does not answer is left out."""
        hosts = (HostClient(self._transport, address) for address in self.directory.present("host"))
        described = await _all_that_answer(host.describe(timeout=GLANCE) for host in hosts)
        return [shown_agent(one, self.places.shown) for one in described]

    async def arrival(self, role: Role, name: str, *, within: float) -> None:
        """Wait until an agent is present.

        Args:
            role: of the agent.
            name: of it.
            within: [s] to wait at most.

        Raises:
            NoSuchRobot: or NoSuchHost, NoSuchView: it has not come.
        """
        pattern = everyone(role, parted(name)[1])
        if not await self._transport.presence.until(pattern, there=True, within=within):
            await self.directory.resolve(name, role)

    async def spaces(self) -> Sequence[SpaceDescribed]:
        """Ask all spaces how they are. One that does not answer is left out."""
        keys = [address.key for address in self.directory.present("space")]
        described = await _all_that_answer(
            ask(self._transport, key, DescribeSpace(), SpaceDescribed, timeout=GLANCE) for key in keys
        )
        return [shown_agent(one, self.places.shown) for one in described]

    async def look_into_space(self, name: str, kind: str = "", *, most: int) -> SpaceDescribed:
        """Ask a space for its oldest entries.

        Args:
            name: of the space.
            kind: of the entries; empty: any.
            most: entries.

        Raises:
            BadName: it cannot be a name.
            NoSpace: no living space has it.
            TransportError: it does not answer.
        """
        address = await self.directory.resolve(name, "space")
        request = DescribeSpace(kind=kind, most=most)
        return await ask(self._transport, address.key, request, SpaceDescribed, timeout=ANSWER_WITHIN)

    async def gateway(self) -> GatewayDescribed | None:
        """Ask the gateway of this machine how the other sites are; None: none runs here.

        Raises:
            Hanging: it does not answer.
            TransportError: it has just ended, or does not answer in time.
        """
        presence, pattern = self._transport.presence, everyone("gateway")
        keys = presence.keys(pattern)
        if not keys:
            if presence.held(pattern):
                await self.directory.expect_awake(pattern)
            return None
        return await ask(self._transport, keys[0], DescribeGateway(), GatewayDescribed, timeout=GLANCE)

    async def elsewhere(self) -> Mapping[str, Elsewhere]:
        """Return where each robot and view of another site is, and how old what is shown of it is.

        By name as it is shown. It costs one question to the gateway of this machine; without one, none.
        """
        if not self.places.own:
            return {}
        try:
            described = await self.gateway()
        except VrError:
            described = None
        sites = {} if described is None else {site.name: site for site in described.sites}
        found: dict[str, Elsewhere] = {}
        for role in ("robot", "view"):
            for address in self.directory.present(role):
                if site := self.places.site_of(address.key):
                    age = sites[site].age if site in sites else nan
                    found[self.places.shown(address).name] = Elsewhere(site, age, self.places.silent(site))
        return found

    def held(self) -> Sequence[Held]:
        """Return which process holds each agent, as far as this machine knows it."""
        return self._shown([one for one in self._transport.presence.held("*/*/*") if one.key])

    def unnamed(self) -> Sequence[Held]:
        """Return the frozen processes of which nobody here knows what they hold; without a key."""
        return [one for one in self._transport.presence.held("*/*/*") if one.asleep and not one.key]

    def left(self, address: Address) -> bool:
        """Whether an agent has taken its leave (`Presence.left`)."""
        return self._transport.presence.left(address.key)

    def hang(self) -> Sequence[Held]:
        """Return the agents whose processes certainly hang by now (`Presence.hangs`)."""
        return self._shown(self._transport.presence.hangs("*/*/*"))

    def late(self) -> Sequence[Held]:
        """Return the agents whose processes are late with their sign of life (`Presence.late`)."""
        return self._shown(self._transport.presence.late("*/*/*"))

    async def hanging(self) -> Sequence[Held]:
        """Return the agents whose processes hang, as soon as that is certain of all."""
        return self._shown(await self._transport.presence.hanging("*/*/*"))

    def on_change(self, callback: Callable[[], None]) -> Callable[[], None]:
        """Call back after each change of the lists; returns how to end that."""
        return self.directory.on_change(lambda _: callback())

    async def watch_state(self, name: str | None, callback: OnState = lambda _, __: None) -> Registration:
        """Receive the states of one robot, whenever it runs, or of all.

        While all are heard, `resume` knows which stops had been told here before it was asked for.

        Args:
            name: of the robot; None: all.
            callback: takes the name of a robot and how it is now.

        Raises:
            BadName: that cannot be a name.
        """

        def take(address: Address, state: State) -> None:
            self._releases.count(address.key, state.stops)
            callback(self.places.shown(address).name, state)

        registration = await self._subscribe(name, "state", State, take)
        return registration if name is not None else _Watch(registration, self._releases)

    async def watch_log(
        self, name: str | None, callback: Callable[[str, Sequence[LoggedLine]], None]
    ) -> Registration:
        """Receive the output of one robot's code, whenever the robot runs, or of all.

        Args:
            name: of the robot; None: all.
            callback: takes the name of a robot and new lines of its log.

        Raises:
            BadName: that cannot be a name.
        """
        return await self._subscribe(
            name,
            "log",
            LogLines,
            lambda address, heard: callback(self.places.shown(address).name, heard.lines),
        )

    async def watch_stream(self, name: str, stream: str, callback: Callable[[Any], None]) -> Registration:
        """Receive what one robot sends in a stream, whenever it runs: while nobody does, nothing is sent.

        Args:
            name: of the robot.
            stream: its name.
            callback: takes each value, as plain data.

        Raises:
            BadName: that cannot be a name.
        """
        return await self._subscribe(
            name, f"stream/{stream}", StreamSample, lambda _, sample: callback(sample.value)
        )

    async def _subscribe(
        self, name: str | None, what: str, kind: type[_E], take: Callable[[Address, _E], None]
    ) -> Registration:
        """Take what one robot, or all, publish under their key + `/what`."""

        def hear(key: str, body: bytes) -> None:
            address = Address.parse("/".join(key.split("/", 3)[:3]))
            try:
                event = decode_event(body, key=key)
            except VrError:
                return  # a robot of another version
            if (
                address is not None
                and isinstance(event, kind)
                and (name is None or self._means(name, address))
            ):
                take(address, event)

        pattern = everyone("robot", "*" if name is None else parted(name)[1])
        return await self._transport.subscribe(f"{pattern}/{what}", hear)

    def _means(self, name: str, robot: Address) -> bool:
        """Whether a name, with or without a site, means this robot: see the class."""
        site, own = parted(name)[0], self.places.own
        there = self.places.site_of(robot.key) if own else ""
        if site:
            return site == (there or own)
        return not there or not self.places.at("robot", own, robot.name)

    async def read_log(self, name: str) -> Sequence[LoggedLine]:
        """Return the log of a robot, the oldest line first."""
        return await self._ask(name, lambda robot: robot.read_log())

    async def read_history(self, name: str = "") -> Sequence[Remembered]:
        """Return who came and went, and what robots that have ended had logged, the oldest line first.

        Lookup services remember the one, hosts the other. What several services saw is one line.

        Args:
            name: of the only agent whose lines are wanted, with a site or without; empty: of all. Then what
                another site remembers of a robot of its own has the name with the site.
        """
        site, plain = parted(name) if name else ("", "")
        agents = [one for role in _REMEMBERING for one in self.directory.present(role)]

        async def answer(agent: Address) -> list[Remembered]:
            lines = (await read_history(self._transport, agent, timeout=GLANCE)).lines
            there = self.places.site_of(agent.key)
            kept = list[Remembered]()
            for one in lines:
                at = site_told(one.line) or there or self.places.own
                if name and (one.name != plain or site not in {"", at}):
                    continue
                afar = not name and agent.role == "host" and there
                kept.append(Remembered(f"{there}:{one.name}", one.line) if afar else one)
            return kept

        return merged(line for lines in await _all_that_answer(map(answer, agents)) for line in lines)

    async def read_events(self, request: ReadEvents) -> Mapping[str, EventsRead]:
        """Ask all who live and keep events for those of a robot or a command.

        That are the hosts, and robots of other sites that have no host: proxies. Proxies of this machine are
        not asked: they keep files, which are read without them. One that does not answer is left out. Of a
        robot only those of its site are asked, where it is known, unless the events of a command are wanted.

        Returns:
            By who has kept it, in words: `host h1`, `robot hall:arm-1`.
        """
        site, plain = self.whereabouts(request.robot) if request.robot else ("", "")
        only = "" if request.key else site
        plainly = msgspec.structs.replace(request, robot=plain)
        found = await self._of_keepers(plainly, EventsRead, GLANCE, only, plain)
        return dict(found)

    async def verify_events(self, robot: str = "") -> Mapping[str, EventsVerified]:
        """Have those who keep events examine what they have kept; returns what they found, by who it is.

        Args:
            robot: of whom it is; only the proxy of this name is asked, beside the hosts.
        """
        site, plain = self.whereabouts(robot) if robot else ("", "")
        return dict(await self._of_keepers(VerifyEvents(), EventsVerified, EXAMINATION, site, plain))

    def whereabouts(self, name: str) -> tuple[str, str]:
        """Return the site and the plain name of a robot; the site is empty if there is one, or nobody knows.

        Raises:
            BadName: it cannot be a name.
        """
        site, plain = parted(name)
        own = self.places.own
        if not site and own and (found := self.directory.present("robot", plain)):
            site = self.places.site_of(self.directory.nearest(found, "robot", plain)[0].key) or own
        return site, plain

    async def _of_keepers(
        self, request: ReadEvents | VerifyEvents, kind: type[_K], timeout: float, site: str, robot: str
    ) -> Sequence[tuple[str, _K]]:
        """Ask the hosts of a site, and its robots of this name if it is another one; empty: of all."""
        places, present = self.places, self.directory.present
        keepers = list(present("host", f"{site}:*" if site else "*"))
        if places.own:
            keepers += [
                one
                for one in present("robot", robot or "*")
                if (at := places.site_of(one.key)) and site in {"", at}
            ]

        async def answer(keeper: Address) -> tuple[str, _K]:
            said = await ask(self._transport, keeper.key, request, kind, timeout=timeout)
            afar = places.site_of(keeper.key)
            return f"{keeper.role} {keeper.shown(afar).name if afar else keeper.name}", said

        return await _all_that_answer(map(answer, keepers))

    # -- what they are ----------------------------------------------------------------------------

    async def describe(self, name: str) -> RobotDescription:
        """Ask a robot for its description, enslaved or not."""
        found = await self._ask(name, lambda robot: robot.describe())
        return shown_robot(self._count(found), self.places.shown)

    async def describe_view(self, name: str) -> ViewDescribed:
        """Ask a view for its cameras and readings."""
        return await self._ask_view(name, lambda view: view.describe())

    async def tree(self) -> Sequence[RobotDescription]:
        """Describe all robots: the free ones by name, then their children, and so on down.

        A robot that vanishes or hangs meanwhile is left out; its children are not.
        """
        return from_the_top(shown_robot(robot, self.places.shown) for robot in await self._describe_all())

    async def _describe_all(self) -> Sequence[RobotDescription]:
        robots = (
            RobotClient(self._transport, address, patience=GLANCE)
            for address in self.directory.present("robot")
        )
        return list(map(self._count, await _all_that_answer(robot.describe() for robot in robots)))

    async def look(
        self, view: str, *, camera: str = "", width: int = 320, height: int = 180, quality: int = 75
    ) -> Picture:
        """Fetch one picture."""
        return await self._ask_view(
            view, lambda client: client.look(camera, width=width, height=height, quality=quality)
        )

    # -- what they do -----------------------------------------------------------------------------

    async def call(
        self,
        name: str,
        command: str,
        arguments: Mapping[str, Any],
        *,
        deadline: float = DEFAULT_DEADLINE,
        on_progress: OnProgress | None = None,
        on_fields: OnFields | None = None,
        attendance: Attendance | None = None,
    ) -> Any:
        """Have a command carried out and return its result. It ends when this process does, however it ends.

        Args:
            name: of the robot.
            command: its name.
            arguments: numbers in the declared units, or text with units.
            deadline: [s] within which it must be done.
            on_progress: takes how far it is.
            on_fields: takes what the result is, when it comes.
            attendance: of a person who holds a key, for a command that wants that; None: nobody does.
        """
        caller = await self.caller()
        call = Call(
            key=fresh_key(),
            command=command,
            arguments=dict(arguments),
            caller=CALLER,
            deadline=deadline,
            describe_result=on_fields is not None,
            attended=0.0 if attendance is None else attendance.until,
        )

        def carry_out(robot: RobotClient) -> Awaitable[Any]:
            if attendance is not None:
                attending = RobotClient(self._transport, robot.address, sender=caller)
                attendance.follow(lambda: attending.press(call.key))
            return robot.carry_out(call, sender=caller, on_progress=on_progress, on_fields=on_fields)

        return await self._ask(name, carry_out)

    async def carry_out(self, robot: Address, call: Call, *, on_progress: OnProgress | None = None) -> Any:
        """Have a call carried out as it is, and return its result; it ends when this process does.

        Args:
            robot: in the life that is meant.
            call: with a fresh key.
            on_progress: takes how far it is.

        Raises:
            VrError: as `call`.
        """
        client = RobotClient(self._transport, robot, sender=await self.caller())
        return await self._awake(client.carry_out(call, on_progress=on_progress))

    async def caller(self) -> str:
        """Return the key under which this program is present: its calls end when that goes."""
        return await self._caller.key()

    def call_from_thread(
        self,
        robot: Address,
        command: str,
        arguments: Mapping[str, Any],
        *,
        deadline: float,
        caller: str,
    ) -> Any:
        """Do as `call`, from a thread that waits itself: not that of the event loop.

        Args:
            robot: which incarnation; see `find`.
            command: its name.
            arguments: numbers in the declared units, or text with units.
            deadline: [s] within which it must be done.
            caller: see the method of this name.
        """
        call = Call(
            key=fresh_key(), command=command, arguments=dict(arguments), caller=CALLER, deadline=deadline
        )
        return call_and_wait(self._transport, CallOutcome(call, robot), sender=caller)

    def find(self, name: str) -> Address | None:
        """Return the one robot of a name that is present; None: look closer. From any thread."""
        found = self.directory.present("robot", name)
        return found[0] if len(found) == 1 else None

    async def expect_awake(self, error: NoAnswer | Unreachable) -> None:
        """Check that no process hangs which a failed request has named.

        Raises:
            Hanging: it does.
        """
        await self.directory.expect_awake(str(error.data["key"]))

    async def tell(
        self, name: str, command: str, arguments: Mapping[str, Any], *, deadline: float = DEFAULT_DEADLINE
    ) -> None:
        """Have a command carried out, whatever becomes of this process; returns when it is accepted.

        Args:
            name: of the robot.
            command: its name.
            arguments: numbers in the declared units, or text with units.
            deadline: [s] within which it must be done.
        """
        await self._ask(name, lambda robot: robot.tell(command, arguments, deadline=deadline, caller=CALLER))

    async def cancel(self, name: str) -> str:
        """End all commands of a robot; see `RobotClient.cancel`."""
        return await self._ask(name, lambda robot: robot.cancel(reason="the operator ended it"))

    async def pause(self, name: str) -> str:
        """Have a virtual robot, and those below it, wait before each step; see `RobotClient.pause`."""
        return await self._ask(name, lambda robot: robot.pause())

    async def disturb(
        self,
        name: str,
        fault: Literal["", "cut", "delay", "freeze", "kill"],
        *,
        seconds: float = 0.0,
        delay: float = 0.0,
    ) -> str:
        """Have a robot suffer a fault for a drill; see `RobotClient.disturb`."""
        caller = await self.caller()
        return await self._ask(name, lambda robot: robot.disturb(fault, seconds=seconds, delay=delay), caller)

    async def place(self, name: str, placement: Placement) -> str:
        """Say how a virtual robot may be moved; returns a note for people. See `RobotClient.place`."""
        return await self._ask(name, lambda robot: robot.place(placement))

    async def step(self, name: str) -> str:
        """Let one step of a paused robot pass; see `RobotClient.step`."""
        return await self._ask(name, lambda robot: robot.step())

    async def where_held(self, name: str, *, within: float) -> str:
        """Wait until a robot, or one below it, waits before a step of its pause, or carries nothing out.

        Args:
            name: of the robot.
            within: [s]

        Returns:
            Where it stands, as a sentence.
        """
        now = asyncio.get_running_loop().time
        end = now() + within
        while True:
            robot = await self.describe(name)
            if place := await self._held_in(robot):
                return place
            if not robot.busy:
                return f"{name} carries nothing out"
            if now() >= end:
                return f"the step of {name} is under way"
            await asyncio.sleep(LOOK_AGAIN)

    async def _held_in(self, robot: RobotDescription) -> str:
        """Return before which step a robot waits, or one below it; empty: before none."""
        if robot.held:
            return f"{robot.name} is before {robot.held}"
        for slot in robot.slots:
            if slot.child is not None:
                below = await self.describe(slot.child.name)
                if below.paused and (place := await self._held_in(below)):
                    return place
        return ""

    async def go_on(self, name: str) -> str:
        """End the pause of a robot; see `RobotClient.go_on`."""
        return await self._ask(name, lambda robot: robot.go_on())

    async def control(
        self,
        name: str,
        what: Literal["get", "ask", "offer", "take", "leave"],
        *,
        person: str = "",
        within: float = 0.0,
        seen: int = -1,
    ) -> str:
        """Get, ask for, offer, take or leave control of a robot; see `vr/core/control.py`.

        Args:
            name: of the robot.
            what: is wanted.
            person: of an offer: to whom; empty: to who asks.
            within: [s] for which control is wanted; 0: as long as this program is present.
            seen: of a take: `RobotDescription.hands` when the person decided; -1: whichever.

        Returns:
            The person who has control then; empty: nobody.

        Raises:
            HeldByOperator: somebody else has it.
            ControlRefused: it cannot change hands in this way.
            Denied: the policy does not allow it.
        """
        caller = await self.caller()
        return await self._ask(
            name, lambda robot: robot.control(what, person=person, within=within, seen=seen), caller
        )

    async def decide(self, name: str, answer: Literal["done", "again", "abort"]) -> None:
        """Answer what a command of a robot asks after a crash; see `RobotClient.decide`."""
        await self._ask(name, lambda robot: robot.decide(answer))

    async def stop(
        self,
        name: str | None,
        *,
        on_late: OnLate = lambda _: None,
        order: str = "",
        scope: StopScope = EVERYWHERE,
    ) -> Sequence[str]:
        """Protective stop of one robot or of all, at once, down to the hardware.

        It can be given before `start`: then it concerns the robots of this machine.

        Args:
            name: of the robot; None: all.
            on_late: called, half a second later at most, with the robots that have not answered yet.
            order: id of the order, if it has been sent already; empty: it is new.
            scope: which sites it concerns.

        Returns:
            The names of those that have confirmed it.

        Raises:
            NoSuchRobot: there is none of this name.
            NotConfirmed: a robot that lives has not confirmed it, or may have been missed. All others were
                asked before this is raised; it names both, and the processes.
        """
        stop = StopOrder(
            self.directory,
            self._transport,
            name,
            reason=REASON,
            on_late=on_late,
            counted=self._releases.count,
            order=order,
            scope=scope,
        )
        return await stop.carry_out()

    async def resume(self, name: str | None, *, given: float | None = None) -> Sequence[str]:
        """Release the protective stop of one robot, or of all; parents pass it on to their children.

        It ends the stops that are in force and known here now (see `watch_state`): one that comes later
        stays, however late this is heard.

        Args:
            name: of the robot; None: all.
            given: [s] on the event loop's clock, when the person gave it: a stop that came later stays, too.
                None: now.

        Returns:
            The names of the robots that have confirmed it, without those that were in no stop.

        Raises:
            NoSuchRobot: there is none of this name.
            NotConfirmed: one has not confirmed it, or has been stopped again; see `stop`.
        """
        return await self._releases.resume(name, given)

    # -- parents and children ----------------------------------------------------------------------

    async def create(
        self,
        path: str | Path,
        name: str,
        host: str = "",
        wanted: str = "",
        settings: Mapping[str, Any] | None = None,
        isolate: Isolation | Literal[""] = "",
    ) -> RobotDescription:
        """Make a virtual robot from a source file.

        Args:
            path: of the file, on this machine; or `sha256:` and the hash of a page that a host has.
            name: of the robot.
            host: on which it shall live; empty: the first that takes it.
            wanted: name of the class; empty: the only one in the file.
            settings: values that are not the defaults: numbers in the declared units, or text with units.
            isolate: where it runs; empty: as the host has it.

        Raises:
            BadArgument: a setting cannot have its value, or there is none of this name.
            BundleError: the file cannot be used.
            NoSuchHost: there is no such host.
            NoHost: there is none at all.
            NotIsolated: the host makes no processes for robots.
            HostReserved: this host, or each that there is, runs another robot alone.
            StandsBy: or has no robots until another host is away.
            AddressError: the name cannot be one, or is taken, here or at a site that is linked: later, sites
                may turn out to have one name, but nobody chooses that.
        """
        check_name(name)
        if self.directory.present("robot", name) or self.directory.present("view", name):
            raise DuplicateName(role="robot", name=name)
        from robotree.vr.bundle import Bundle  # `ls` needs no source

        path = str(path)
        digest = path.removeprefix(BY_HASH) if path.startswith(BY_HASH) else ""
        bundle = None if digest else await asyncio.to_thread(Bundle.read, path, wanted)
        refusal: VrError = NoHost()
        for address in await self._hosts(host):
            client = HostClient(self._transport, address)
            try:
                if bundle is None:
                    return await self._awake(client.create_known(digest, name, settings))
                return await self._awake(client.create(bundle, name, settings, isolate))
            except (HostReserved, StandsBy) as reserved:
                refusal = reserved
        raise refusal

    async def reload(
        self, name: str, path: str = "", wanted: str = "", *, now: bool = False, within: float = RELOADING
    ) -> Reloaded:
        """Have a virtual robot go on with a page, at the next boundary between its commands.

        Args:
            name: of the robot.
            path: of the page, on this machine; empty: the file that it was made of.
            wanted: name of the class; empty: the only one in the file.
            now: whether the running command is cancelled.
            within: [s] for the running command to end.

        Raises:
            NoPage: no file is named, and none is known.
            BundleError: the page cannot be used, or the running command did not end in time; the old page
                goes on.
            SlotHeld: the page lacks a slot that holds a child; the old page goes on.
        """
        robot = await self.describe(name)
        if not robot.host:
            raise NotVirtual(robot=name, what="be reloaded; start the process of its proxy again")
        if not path:
            if not robot.page:
                raise NoPage(robot=name)
            path, colon, wanted = robot.page.rpartition(":")
            path, wanted = (path, wanted) if colon and wanted.isidentifier() else (robot.page, "")
        from robotree.vr.bundle import Bundle

        bundle = await asyncio.to_thread(Bundle.read, path, wanted)
        client = HostClient(self._transport, await self._host_of(robot))
        return await self._awake(client.reload(bundle, name, now=now, within=within))

    async def migrate(self, name: str, host: str) -> str:
        """Have a virtual robot go on in another host; returns what the hosts say, as a sentence.

        Args:
            name: of the robot.
            host: name of the other host.

        Raises:
            CannotMove: it stays where it is; the error says why.
            NoSuchHost: there is no such host.
        """
        robot = await self.describe(name)
        if not robot.host:
            raise NotVirtual(robot=name, what="move; a proxy stays where its controller is")
        places = self.places
        there = places.site_of((await self.directory.resolve(host, "host")).key)
        here = places.site_of(robot.address.key)
        plain = parted(host)[1]
        site = "" if there == here else there or places.own
        client = HostClient(self._transport, await self._host_of(robot))
        return await self._awake(client.migrate(parted(name)[1], f"{site}:{plain}" if site else plain))

    async def drain(self, host: str, on_move: Callable[[str], object] = lambda _: None) -> list[str]:
        """Have all robots of a host go on in others; returns their names.

        Args:
            host: its name.
            on_move: told of each robot that has moved, as a sentence.

        Raises:
            NotDrained: some have not moved; the error says why.
        """
        client = HostClient(self._transport, await self.directory.resolve(host, "host"))
        return await self._awake(client.drain(on_move))

    def holding(self, role: Role, name: str) -> str:
        """Return which process has an agent, in words: `process 4711`; empty: none is known."""
        held = self._transport.presence.held(everyone(role, name))
        return held[0].where if held else ""

    async def panel(self, robot: RobotDescription, gate: Gate) -> JudgedPanel:
        """Return the panel that a robot brings, as this machine judges it; it is read anew each time.

        Args:
            robot: as it describes itself.
            gate: decides whom this machine trusts.
        """
        from robotree.vr.supervision.panels import JudgedPanel, panel_of

        if not robot.host:
            return JudgedPanel()
        try:
            host = await self._host_of(robot)
        except VrError as error:
            return JudgedPanel(reason=str(error))
        return await panel_of(self._transport, robot, host.key, gate)

    async def source(self, name: str) -> str:
        """Return the source of the page that a robot runs, to be read; empty: it has none.

        Raises:
            VrError: it or its host does not answer.
        """
        from robotree.vr.supervision.panels import source_of

        robot = await self.describe(name)
        if not robot.host:
            return ""
        return await source_of(self._transport, robot, (await self._host_of(robot)).key)

    async def enslave(self, parent: str, slot: str, child: str) -> RobotDescription:
        """Bind a child to a slot; returns the parent's description."""
        address = await self.directory.resolve(child)
        bound = await self._ask(parent, lambda robot: robot.enslave(slot, address))
        return shown_robot(bound, self.places.shown)

    async def choose(self, parent: str, slot: str, where: str) -> RobotDescription:
        """Let a robot choose a child for its slot; returns its description, with the reason in the slot.

        Args:
            parent: name of the robot.
            slot: of it, or a group.
            where: what the child must be; empty: what the slot asks for.
        """
        return await self._ask(parent, lambda robot: robot.choose(slot, where))

    async def release(self, parent: str, slot: str) -> RobotDescription:
        """Release the child in a slot; returns the description of the parent, or of the child if it waits.

        Raises:
            NoSuchRobot: the parent is not there, and no child waits for it in this slot.
        """
        try:
            freed = await self._ask(parent, lambda robot: robot.free(slot))
            return shown_robot(freed, self.places.shown)
        except NoSuchRobot:
            for robot in await self._describe_all():
                bond, meant = robot.bond, (parted(parent)[1], slot)
                if bond is not None and bond.away and (bond.parent.name, bond.slot) == meant:
                    child = RobotClient(self._transport, robot.address)
                    await child.release(bond.parent, bond.epoch)
                    return shown_robot(await child.describe(), self.places.shown)
            raise

    async def delete(self, name: str) -> str:
        """End a virtual robot; its children are released.

        Returns:
            What is left of it, as a sentence: code that cannot be ended. Empty: nothing.
        """
        return await self._ask(name, lambda robot: robot.delete())

    # -- inside -----------------------------------------------------------------------------------

    async def _ask(self, name: str, question: Callable[[RobotClient], Awaitable[_R]], sender: str = "") -> _R:
        robot = RobotClient(self._transport, await self.directory.resolve(name), sender=sender)
        return await self._awake(question(robot))

    def _count(self, robot: RobotDescription) -> RobotDescription:
        self._releases.count(robot.address.key, robot.stops)
        return robot

    async def _ask_view(self, name: str, question: Callable[[ViewClient], Awaitable[_R]]) -> _R:
        view = ViewClient(self._transport, await self.directory.resolve(name, "view"))
        return await self._awake(question(view))

    async def _awake(self, answer: Awaitable[_R]) -> _R:
        """Wait for an answer; if there is none because a process hangs, name the process in the error."""
        try:
            return await answer
        except (NoAnswer, Unreachable) as error:  # of the one that was asked, or of one that it asked
            await self.expect_awake(error)
            raise

    async def _host_of(self, robot: RobotDescription) -> Address:
        """Return the host of a virtual robot, which may be at another site."""
        site = self.places.site_of(robot.address.key)
        return await self.directory.resolve(f"{site}:{robot.host}" if site else robot.host, "host")

    async def _hosts(self, name: str) -> Sequence[Address]:
        """Return the host of a name; without a name all of them, those of this machine first."""
        if name:
            return [await self.directory.resolve(name, "host")]
        return sorted(self.directory.present("host"), key=lambda one: (self.places.site_of(one.key), one))


class _Caller:
    """The presence of an operator's program: while it lasts, robots know that the program waits."""

    def __init__(self, transport: Transport) -> None:
        self._transport = transport
        self._key = f"caller/{unique()}"
        self._announcing: asyncio.Task[Registration] | None = None

    async def key(self) -> str:
        """Be present, from the first call on; return the key."""
        if self._announcing is None:
            self._announcing = asyncio.ensure_future(self._transport.announce(self._key))
        await asyncio.shield(self._announcing)
        return self._key

    async def close(self) -> None:
        """Be present no more: what still goes on ends. Twice is once."""
        announcing, self._announcing = self._announcing, None
        if announcing is not None:
            await (await announcing).close()


class _Watch:
    """A watch of all states."""

    def __init__(self, registration: Registration, releases: Releases) -> None:
        self._registration, self._releases = registration, releases
        self._open = True
        releases.watches += 1

    async def close(self) -> None:
        """Hear no more. Twice is once."""
        self._releases.watches -= self._open
        self._open = False
        await self._registration.close()


def from_the_top(robots: Iterable[RobotDescription]) -> list[RobotDescription]:
    """Put robots in order: those that nobody commands by name, their children by slot, and so on down."""
    left = {robot.address: robot for robot in sorted(robots, key=lambda robot: robot.address)}
    ordered = [robot for robot in left.values() if robot.bond is None or robot.bond.parent not in left]
    for robot in ordered:
        del left[robot.address]
    for robot in ordered:  # it grows while it is walked through
        below = [slot.child for slot in robot.slots if slot.child is not None and slot.child in left]
        ordered.extend(left.pop(child) for child in below)
    return [*ordered, *left.values()]


async def _all_that_answer(questions: Iterable[Awaitable[_R]]) -> list[_R]:
    """Ask all, a portion at a time: a thousand answers at once would hold the event loop for 50 ms."""
    asked: list[asyncio.Future[_R]] = []
    try:
        for number, question in enumerate(questions, 1):
            asked.append(asyncio.ensure_future(question))
            if number % PORTION == 0:
                await asyncio.sleep(PAUSE)
        results = await asyncio.gather(*asked, return_exceptions=True)
    finally:
        for one in asked:
            one.cancel()
    answers: list[_R] = []
    for result in results:
        if isinstance(result, BaseException):
            if not isinstance(result, VrError):
                raise result
        else:
            answers.append(result)
    return answers
