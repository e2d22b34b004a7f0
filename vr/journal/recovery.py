"""What a log says: the robots that a host had, and their states after all that has happened. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence

import msgspec

from robotree.vr.base.errors import DamagedJournal, OtherJournal, VrError
from robotree.vr.base.principal import ITSELF, Principal
from robotree.vr.core import events as on
from robotree.vr.core.machine import RobotCore, RobotState, shift
from robotree.vr.journal.records import (
    VERSION,
    Began,
    CameApart,
    CameHere,
    Deleted,
    Happened,
    KeptPage,
    LogRecord,
    Made,
    MovedBack,
    MovedOut,
    NeverTaken,
    PageOffered,
    StateKept,
    Transfers,
    Whole,
    decoder,
)


class KeptRobot:
    """One robot, as the log tells it."""

    def __init__(self, made: Made) -> None:
        """Begin with what it was made of."""
        self.key, self.name, self.page = made.key, made.name, made.page
        self.offered: KeptPage | None = None
        self.out: MovedOut | None = None
        """Set: it is on its way to another host, and it is not known here whether it has arrived."""
        self.machine: RobotCore | None = None
        """None: its state does not stand in the log yet."""

    @property
    def state(self) -> RobotState:
        """Its state after all that has happened."""
        assert self.machine is not None  # noqa: S101 # `Recovered.robots` has only those
        return self.machine.state


class Recovered:
    """Reads records, the oldest first."""

    def __init__(self, machine_of: Callable[[RobotState], RobotCore] = RobotCore) -> None:
        """Begin with nothing.

        Args:
            machine_of: makes the machine of a robot, from its state.
        """
        self._machine_of = machine_of
        self._robots: dict[str, KeptRobot] = {}
        """By key of their addresses."""
        self._keys: dict[int, str] = {}
        """By the numbers of the present segment."""
        self.taken: dict[str, None] = {}
        """The transfers under which robots have come, the oldest first; so is the next."""
        self.never: dict[str, None] = {}
        """Those under which none ever comes."""
        self.began: Began | None = None
        """The beginning of the newest segment; None: there is none."""
        self.records = 0
        self.latest = -math.inf
        """[s] when the last event happened, or the segment was begun, on the monotonic clock of then."""

    @property
    def robots(self) -> list[KeptRobot]:
        """Those whose state is known, in the order in which they were made."""
        return [robot for robot in self._robots.values() if robot.machine is not None]

    def read(self, frames: Iterable[bytes], path: str) -> None:
        """Read all frames of a log.

        Args:
            frames: as `Segments.frames` returns them.
            path: of the log, for messages.

        Raises:
            DamagedJournal: a frame cannot be read though its checksum fits.
            OtherJournal: another version of robotree has written it.
        """
        for frame in frames:
            try:
                records = decoder.decode(frame)
            except msgspec.DecodeError as error:
                self._expect_version(frame, path)
                raise DamagedJournal(path=path, at=0, detail=str(error)) from None
            for record in records:
                self.take(record, path)

    def take(self, record: LogRecord, path: str = "") -> None:
        """Read one record."""
        self.records += 1
        match record:
            case Happened(robot=number, now=now):
                self.latest = max(self.latest, now)
                robot = self._robot(number)
                if robot is not None and robot.machine is not None:  # else its snapshot follows
                    self._handle(robot, robot.machine, record, path)
            case Began() | Made() | Whole():
                self._take_segment(record, path)
            case MovedOut() | MovedBack() | CameHere() | CameApart() | NeverTaken() | Transfers():
                self._take_move(record)
            case Deleted(robot=number):
                self._robots.pop(self._keys.pop(number, ""), None)
            case StateKept(robot=number, state=state):
                if robot := self._robot(number):
                    robot.machine = self._machine_of(state)
            case PageOffered(robot=number, page=page):
                if robot := self._robot(number):
                    robot.offered = page

    def _take_move(
        self, record: MovedOut | MovedBack | CameHere | CameApart | NeverTaken | Transfers
    ) -> None:
        """Take what is written when robots move between hosts."""
        match record:
            case MovedOut(robot=number) | MovedBack(robot=number):
                if (robot := self._robot(number)) is not None:
                    robot.out = record if isinstance(record, MovedOut) else None
            case CameHere(
                robot=number, key=key, name=name, page=page, state=state, transfer=transfer, now=now
            ):
                self.latest = max(self.latest, now)
                self._keys[number] = key
                robot = self._robots[key] = KeptRobot(Made(number, key, name, page))
                robot.machine = self._machine_of(state)
                self.taken[transfer] = None
            case CameApart(transfer=transfer):
                self.taken[transfer] = None
            case NeverTaken(transfer=transfer):
                self.never[transfer] = None
            case Transfers(taken=taken, never=never):
                self.taken, self.never = dict.fromkeys(taken), dict.fromkeys(never)

    def _take_segment(self, record: Began | Made | Whole, path: str) -> None:
        """Take what a segment begins with: which robots there are."""
        match record:
            case Began(version=version):
                if version != VERSION:
                    raise OtherJournal(path=path, version=version)
                self.began, self._keys = record, {}
                self.latest = max(self.latest, record.now)  # nothing may have happened since
            case Made(robot=number, key=key):
                self._keys[number] = key
                if key in self._robots:
                    self._robots[key].page = record.page
                else:
                    self._robots[key] = KeptRobot(record)
            case Whole():
                here = set(self._keys.values())
                self._robots = {key: robot for key, robot in self._robots.items() if key in here}

    def _robot(self, number: int) -> KeptRobot | None:
        return self._robots.get(self._keys.get(number, ""))

    def _handle(self, robot: KeptRobot, core: RobotCore, happened: Happened, path: str) -> None:
        event = happened.event
        try:
            core.handle(event, happened.now)
        except VrError as error:
            detail = f"{robot.name} took {type(event).__name__} and now refuses it: {error}"
            raise DamagedJournal(path=path, at=0, detail=detail) from None
        if isinstance(event, on.PageReloaded) and robot.offered is not None:
            robot.page, robot.offered = robot.offered, None

    def _expect_version(self, frame: bytes, path: str) -> None:
        """Name another version rather than damage, where the first record says so."""
        with_version = msgspec.msgpack.Decoder(list[list[object]])
        try:
            first = with_version.decode(frame)[0]
        except (msgspec.DecodeError, IndexError):
            return
        if first[:1] == [Began.__name__] and first[1:2] != [VERSION]:
            raise OtherJournal(path=path, version=first[1] if len(first) > 1 else "?")


def rebase(states: Sequence[RobotState], by: float, now: float) -> None:
    """Make states that were kept fit the present moment.

    Between robots of one host no time has passed while it was away: their bonds hold. A child elsewhere is
    asked at once to prolong its lease.

    Args:
        states: of the robots of one host.
        by: [s] by which moments are later on the present clock.
        now: [s] on that clock.
    """
    here = {state.address for state in states}
    for state in states:
        shift(state, by)
        _forget_questions(state)
        lease = state.lease
        if lease.current is not None and lease.current.parent in here:
            expires = now + lease.term_granted  # and the next process of the parent is its heir
            lease.current = msgspec.structs.replace(lease.current, expires=expires, away=True)
        elif lease.current is not None and lease.current.waits:  # nobody knows what its parent did meanwhile
            expires = now + lease.current.waits
            lease.current = msgspec.structs.replace(lease.current, expires=expires, away=True)
        for bond in state.slots.bonds().values():
            held = bond.lease
            held.confirmed = held.last_asked = now if bond.child in here else now - held.term / 2
            if bond.returns and bond.child not in here:  # its host may be starting, too
                held.confirmed = now + bond.returns - held.term


def welcome(state: RobotState, by: float, now: float, term: float, margin: float = 0.0) -> None:
    """Make the state of a robot that comes from another host fit the present moment.

    No time has passed for its bonds: who commands it renews its lease here, and its children are asked at
    once. The time that the way took counts against the deadlines of its commands.

    Args:
        state: of the robot.
        by: [s] by which moments are later on the present clock.
        now: [s] on that clock.
        term: [s] for its parent to be heard, if that is more than the term of the lease.
        margin: [s] for which another process may still grant its lease.
    """
    shift(state, by)
    _forget_questions(state)
    lease = state.lease
    if lease.current is not None:
        expires = max(lease.current.expires, now + max(lease.term_granted, term) + margin)
        lease.current = msgspec.structs.replace(lease.current, expires=expires)
    for bond in state.slots.bonds().values():
        bond.lease.confirmed = bond.lease.last_asked = now - bond.lease.term / 2


def see_from(state: RobotState, sender: Principal, here: str) -> None:
    """Name the principals in the state of a robot that comes from another site as this one sees them.

    Who was at that site is at another one now, and who was at this one is near.

    Args:
        state: of the robot.
        sender: the host that has sent it.
        here: name of this site.
    """

    def seen(principal: Principal) -> Principal:
        if principal == ITSELF:
            return principal
        if not principal.site:
            user = sender.user if sender.member else principal.user
            return msgspec.structs.replace(
                principal, user=user, site=sender.site, member=sender.member, roles=sender.roles
            )
        if principal.site == here:
            return msgspec.structs.replace(principal, site="", member=False, roles=())
        return principal

    lease = state.lease
    if lease.current is not None:
        lease.current = msgspec.structs.replace(lease.current, principal=seen(lease.current.principal))
    if lease.silent is not None:
        lease.silent = msgspec.structs.replace(lease.silent, principal=seen(lease.silent.principal))
    for call in state.calls.live.values():
        call.principal = seen(call.principal)


def _forget_questions(state: RobotState) -> None:
    """Have no slot wait for a child that was asked by a process which has ended: nobody hears the answer."""
    for slot in state.slots.by_name.values():
        slot.asked = None
