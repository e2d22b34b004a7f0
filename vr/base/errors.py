"""Everything that can go wrong between agents, on one page.

Every error is one sentence that says whose fault it is and what to do next, and carries its data, so
that a caller on the far side of the network catches the same class with the same fields.

    VrError
      AddressError    BadName · DuplicateName · NameInSilence · Hanging · SeveralSites · SeveralUsers
                      NoSuchSite · SiteAway · NoSuchRobot · NoSuchHost · NoHost · HostReserved · NotIsolated
                      NotApart · CannotMove · NotDrained · NoSuchView · BadGroup · NoSuchGroup · GroupEmpty
      CommandError    NoSuchCommand · NoSettings · BadArgument · CommandFailed (Failed) · CommandCancelled
                      ChildCancelled · ChildTimeout · DeadlineExceeded (NotBegun) · Busy
                      UnderWay · CommandInDoubt (EndedInDoubt)
                      Stopped · StillRunning · KeyReused
      LeaseError      LeaseDenied · NotFree · StaleEpoch · Retracted · CycleOfBonds · NotInControl
                      NotAllowed · Denied
      BondError       NoSuchSlot · SlotOccupied · SlotHeld · SlotEmpty · GroupFull · WrongKind · DoesNotFit
                      NobodyFits · StillBonded · NotVirtual
      TransportError  Unreachable · OnItsWay · NoAnswer · NotConfirmed · TransportClosed · Garbled
                      RealmUnusable · EmptyRealm · NetworkUnusable
      BundleError     NoSuchFile · BrokenSource · OtherKind · NoPage · ReloadWaits
                      NoVirtualRobot · SeveralVirtualRobots · BrokenScript · RequirementUnreadable
                      BadBundle · NotSigned · UnknownSigner · RevokedSigner · ExcessPermission
                      OtherPython · MissingRequirement · NoSuchBundle · BadTrustFile · BadPanel · NoSigningKey
      JournalError    JournalInUse · DamagedJournal · OtherJournal · Deposed · JournalCutOff · StandsBy
      HistoryError    NoHistory · HistoryChanged · HistoryUnusable
      RoleError       NoSuchRole · NoRoles · TooWide
      SpaceError      NoSpace · SeveralSpaces · SpaceLost · SpaceFull · SpaceUnusable · SpaceDamaged
                      BadEntry · EntryUnfit · KeyTaken · NoSuchEntry · TransactionOver · FenceHeld · FenceLost
      RealmError      NotAMember · InvitationRefused · NoKeys · NoAuthority · KeysExist · NoSuchMember
                      SiteSilent · PolicyUnusable
      PermitError     PermitNeeded · PermitRefused · NoSuchPermit · BudgetSpent · AssistantUnknown
      OrderError      NoDirectory · NotOrdered · BadEnd · NoSuchOrder · SeveralOrders · OrderOver
                      NothingToConfirm · SeveralRobots · NotRemembered · DirectoryUnusable
                      DirectoryDamaged · LedgerUnusable · LedgerDamaged
"""

from __future__ import annotations

import re
import string
from typing import TYPE_CHECKING, Any, ClassVar

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robotree.vr.base.own_class import OwnClass


class VrError(Exception):
    """The root: a sentence with data, which survives the way over the network."""

    sentence: ClassVar[str] = "{detail}"
    """Format string; its placeholders are the names of the data that the error carries."""

    registry: ClassVar[dict[str, type[VrError]]] = {}
    entered: bool = False
    """Whether it ended a command that its robot had accepted: then the robot's log has it."""
    trace: tuple[str, ...] = ()
    """The lines of the authors' pages through which it came, the outermost first, and what caused it: for
    people."""
    own_class: OwnClass | None = None
    """The class of its page's own as which it was raised; None: it is one of ours."""

    def __init_subclass__(cls) -> None:
        """Enter the class in the registry by which a far side finds it again; not an author's own."""
        super().__init_subclass__()
        if cls.__module__.startswith("robotree."):
            VrError.registry[cls.__name__] = cls

    def __init__(self, **data: Any) -> None:
        """Take exactly the data that the sentence names.

        Args:
            **data: one plain value (str, number, bool, None, list of these) for each placeholder.

        Raises:
            TypeError: a placeholder has no value, or a value has no placeholder.
        """
        names = self.names()
        if set(names) != set(data):
            msg = f"{type(self).__name__} takes {sorted(names)}, not {sorted(data)}"
            raise TypeError(msg)
        self.data = data
        super().__init__(self.sentence.format(**self.words(data)))

    def __str__(self) -> str:
        """Return the sentence; where it does not name the page's own class, that follows."""
        text, own = super().__str__(), self.own_class
        if own is None or own.name == type(self).__qualname__ or own.name in text:
            return text
        return f"{text} ({own.name})"

    @classmethod
    def registered(cls, kind: type[BaseException], other: type[VrError] | None = None) -> type[VrError]:
        """Return the class as which an error of a class travels: the nearest that a far side knows.

        Args:
            kind: of the error.
            other: what it is if it is no `VrError`; None: `VrError`.
        """
        bases = (base for base in kind.__mro__ if cls.registry.get(base.__name__) is base)
        return next(bases, other or VrError)

    @classmethod
    def names(cls) -> list[str]:
        """Return the names of its data, in the order of the sentence."""
        return [name for _, name, _, _ in string.Formatter().parse(cls.sentence) if name]

    @classmethod
    def words(cls, data: dict[str, Any]) -> dict[str, Any]:
        """Return what stands in the sentence for each of the data: lists are joined here, and only here."""
        return data

    @classmethod
    def revive(cls, name: str, data: dict[str, Any]) -> VrError:
        """Make the error again that another process raised.

        Args:
            name: class name as sent.
            data: its data as sent.

        Returns:
            An instance of that class, or of `VrError` when this side does not know it or its data.
        """
        try:
            return cls.registry[name].of_data(data)
        except (KeyError, TypeError, ValueError):  # ValueError: data that does not fit into the sentence
            return VrError(detail=f"{name}: {data.get('detail', data)}")

    @classmethod
    def of_data(cls, data: dict[str, Any]) -> VrError:
        """Make one that carries this data."""
        return cls(**data)


# -- addresses -------------------------------------------------------------------------------------


class AddressError(VrError):
    """A name that leads nowhere or cannot be used."""


class BadName(AddressError):
    """The name cannot be part of an address."""

    sentence = (
        "{name!r} cannot be a name: use 1 to 64 letters, digits, '-' or '_', beginning with a letter or digit"
    )


class DuplicateName(AddressError):
    """A running agent has this name already."""

    sentence = "a {role} named {name!r} is already running; choose another name or end that one first"


class NameInSilence(AddressError):
    """An agent that runs and cannot be reached has this name; if it continues, there would be two."""

    sentence = "a {role} named {name!r} is in {where}; choose another name, or: {remedy}"


class Hanging(AddressError):
    """The agent of this name is in a process that does not answer."""

    sentence = "the {role} {name!r} is in {where} and does not answer; {remedy}"


class SeveralSites(AddressError):
    """Agents of several other sites have the same name, and none of this machine has it."""

    sentence = "{role} {name} is at {sites}, and none was asked; write {examples}"


class SeveralUsers(AddressError):
    """Agents of several other users of the machine have the same name, and none of this user has it."""

    sentence = "{role} {name} is there of the users {users}, and none was asked; one takes another name"


class NoSuchSite(AddressError):
    """A name names a site that is none of the realm."""

    sentence = "no site of this realm is called {site!r}; {known}"

    @classmethod
    def among(cls, site: str, sites: Sequence[str]) -> NoSuchSite:
        """Return the error for a site that is none of those that are known here."""
        known = f"the others are {', '.join(sites)}" if sites else "no gateway on this machine knows others"
        return cls(site=site, known=known)


class SiteAway(AddressError):
    """An agent was named of a site that is not heard: nobody here knows who is there now."""

    sentence = (
        "site {site} is not heard, so nobody here knows {role} {name} now, and nothing was asked; "
        "`robotree doctor` says why"
    )


class NoSuchRobot(AddressError):
    """No running robot has this name."""

    sentence = "no robot named {name!r} is running; `robotree ls` shows those that are"


class RobotAway(NoSuchRobot):
    """Its host keeps it, and is away."""

    sentence = (
        "{name} is away with its host {host}, which wrote last {since} ago, so nothing was done; "
        "`robotree host {host}` brings it back{goes_on}"
    )


class RobotAbsent(NoSuchRobot):
    """It is not here, and a directory remembers it."""

    sentence = "{name} is {how}, so nothing was done; {advice}"


class NoSuchHost(AddressError):
    """No running host has this name."""

    sentence = "no host named {name!r} is running; start one with `robotree host {name}`"


class NoHost(AddressError):
    """No host runs at all."""

    sentence = "no host is running; start one with `robotree host NAME`"


class GivenUp(AddressError):
    """The process of a robot has ended so often that its host starts no other one."""

    sentence = (
        "{robot} is given up: its page has ended its process {times} times ({how}). Mend the page; then"
        " `robotree delete {robot}` and create it again, or start host {host} again: it goes on from there"
    )


class CannotMove(AddressError):
    """A robot stays where it is."""

    sentence = "{robot} does not move to {host}: {reason}"


class NoHostBeside(AddressError):
    """There is no host where a robot is."""

    sentence = "no host is beside {robot}: {reason}; start one there (`robotree host NAME`)"


class NotDrained(AddressError):
    """Not all robots of a host have moved."""

    sentence = "{host} still has robots: {reasons}"


class HostReserved(AddressError):
    """The host runs one robot alone, and another one was to be made there."""

    sentence = "host {host!r} runs {robot} alone; start another with `robotree host NAME`, or: --own-host"


class HostFull(AddressError):
    """The host has as many robots as it may have."""

    sentence = "host {host!r} is full: it runs {most} robots at most (`robotree host --most`)"


class NotIsolated(AddressError):
    """The host makes no processes for robots."""

    sentence = (
        "host {host!r} cannot keep a robot apart here ({level}{lack}); leave out --isolate, or trust the"
        " signer of its page with a lower --isolation"
    )


class NotApart(AddressError):
    """The page may run only where its robot does not live."""

    sentence = (
        "this page runs only where its code is kept apart ({level}), and {name} would live where it is not;"
        " create the robot anew with this page"
    )


class NoSuchView(AddressError):
    """No running view has this name."""

    sentence = "no view named {name!r} is running; `robotree ls --views` shows those that are"


# -- commands --------------------------------------------------------------------------------------


class CommandError(VrError):
    """A command that was not carried out.

    An author's code raises it with what its sentence says, in that order, and leaves out the robot and the
    command: `raise CommandFailed("the shelf is empty")`, `raise BadArgument("x", "is too far")`. They are
    filled in when the command ends.
    """

    def __init__(self, *values: Any, **data: Any) -> None:
        """Take the data of the sentence by name; or all but `robot` and `command`, in their order there.

        Raises:
            TypeError: some are missing, too many, or given twice.
        """
        names = self.names()
        rest = [name for name in names if name not in _PLACE]
        if len(values) > len(rest) or set(rest[: len(values)]) & set(data):
            raise TypeError(f"{type(self).__name__} takes {', '.join(rest) or 'nothing'}")
        place = {name: "" for name in _PLACE if name in names}
        super().__init__(**{**place, **dict(zip(rest, values, strict=False)), **data})
        self._say()

    def fill_in(self, robot: str, command: str) -> None:
        """Say which command it was, if its author has not."""
        place = {"robot": robot, "command": command if "robot" in self.data else f"{robot}.{command}"}
        for name, value in place.items():
            if self.data.get(name) == "":
                self.data[name] = value
        self._say()

    def _say(self) -> None:
        self.args = (self.sentence.format(**self.words(self.data)).lstrip(". :"),)


_PLACE = ("robot", "command")
"""The data that the command itself adds to an error that its author raises."""


class NoSuchCommand(CommandError):
    """The robot does not have, or does not expose, this command."""

    sentence = "{robot} has no command {command!r}; it has: {known}"


class NoSettings(CommandError):
    """The robot has no settings."""

    sentence = (
        "{robot} has no settings; in its page a setting is a typed attribute with a default, as in "
        "speed: float = 0.1"
    )


class BadArgument(CommandError):
    """An argument was refused before anything moved."""

    sentence = "{command}: {parameter}: {reason}"


class CommandFailed(CommandError):
    """The command began and did not succeed."""

    sentence = "{robot}.{command} failed: {detail}"


class Failed(CommandFailed):
    """An author's code reports why its command cannot succeed: `raise Failed("the shelf is empty", shelf=3)`.

    Who catches it finds the reason as `detail`, and what else was given under its name: `error.shelf`.
    """

    sentence = "{robot}.{command} failed: {detail}{values}"

    def __init__(self, detail: str = "no reason was given", /, **values: Any) -> None:
        """Say why.

        Args:
            detail: a clause: `the shelf is empty`.
            **values: plain values (numbers, text, lists, records) for a program that catches it.
        """
        super().__init__(detail=detail, values=values)

    @classmethod
    def words(cls, data: dict[str, Any]) -> dict[str, Any]:
        given = ", ".join(f"{name}={value}" for name, value in data["values"].items())
        return data | {"values": f" ({given})" if given else ""}

    @classmethod
    def of_data(cls, data: dict[str, Any]) -> VrError:
        error = cls(data["detail"], **data["values"])
        error.fill_in(data["robot"], data["command"])
        return error

    def __getattr__(self, name: str) -> Any:
        data: dict[str, Any] = self.__dict__.get("data", {})
        known = {"detail": data.get("detail"), **data.get("values", {})}
        try:
            return known[name]
        except KeyError:
            raise AttributeError(f"this failure has no {name!r}; it has: {', '.join(known)}") from None


class CommandInDoubt(CommandError):
    """Nobody knows whether the command was carried out, in part or whole; a person has to look."""

    sentence = "{robot}.{command} may have been carried out or not: {detail}"


class EndedInDoubt(CommandInDoubt):
    """A person has looked, and has ended the command that made this one: nobody asks again."""


class NothingAsked(CommandError):
    """A person answers a question that no command has asked."""

    sentence = "no command of {robot} waits for an answer"


class NotPaused(CommandError):
    """A robot is to take one step, and nobody has paused it."""

    sentence = "{robot} is not paused; pause it first: `robotree pause {robot}`"


class NoDrill(CommandError):
    """A drill cannot be with this robot, or not asked for from there."""

    sentence = "{robot} takes no part in this drill: {reason}"


class NothingHeld(CommandError):
    """A paused robot is to take one step, and nothing of it waits before one."""

    sentence = "nothing of {robot} waits before a step: {reason}"


class Diverged(CommandError):
    """A command that was interrupted takes another step now than it took before."""

    sentence = (
        "{robot}.{command} cannot go on where it was interrupted: step {step} was {before}, and now it is "
        "{now}; nothing more was done"
    )


class NotPermitted(CommandError):
    """A page asks for something that its bundle does not permit, or its signer may not grant."""

    sentence = "{robot} may not {what}: the manifest of its page does not permit it"


class NotItsChild(CommandError):
    """A robot in a process of its own asks a robot that nobody has put under it."""

    sentence = (
        "{robot} may not ask {child} for {what}: nobody has put {child} under it;"
        " `robotree enslave {robot}.SLOT {child}` does, or its page says in its head what else it may call"
    )


class CommandCancelled(CommandError):
    """The command was ended on request."""

    sentence = "{robot}.{command} was cancelled: {reason}"


class ChildCancelled(CommandError):
    """A call of a child was cancelled alone: the command that made it was not asked to end."""

    sentence = "{robot}.{command} was cancelled alone, not the command that called it: {reason}"


class ChildTimeout(CommandError):
    """A call of a child was not done within the time that its caller gave this call; it was cancelled."""

    sentence = (
        "{robot}.{command} was not done within the {limit} that its caller gave it, and was cancelled; allow "
        "it more time or look at what blocks it"
    )


class DeadlineExceeded(CommandError):
    """The time that the caller gave was over first."""

    sentence = (
        "{robot}.{command} was not done within its deadline; allow it more time or look at what blocks it"
    )


class NotBegun(DeadlineExceeded):
    """The time that the caller gave was over before its turn came."""

    sentence = (
        "{robot}.{command} did not begin within {limit:g} s: {other} was under way; allow it more time, or "
        "end that with `robotree cancel {robot}`"
    )


class Busy(CommandError):
    """The queue of commands is full."""

    sentence = (
        "{robot} takes no more commands: {waiting} {how} already; wait, or cancel them with "
        "`robotree cancel {robot}`"
    )


class UnderWay(CommandError):
    """The command runs once at a time, and it runs or waits for its turn already."""

    sentence = (
        "{robot}.{command} already runs or waits for its turn, called by {caller}; end it first with "
        "`robotree cancel {robot}`"
    )


class NobodyAttends(CommandError):
    """The command goes on only while somebody holds a key, and nobody does."""

    sentence = (
        "{robot}.{command} goes on only while somebody holds a key, and {who} holds none: call it on the full"
        " screen, or with `robotree call` at a terminal"
    )


class NotAttended(CommandError):
    """A program wants to attend a command that does not end when nobody attends it."""

    sentence = (
        "{robot}.{command} would go on without a key: its page does not say `@command(attended=True)`; call"
        " it as other commands"
    )


class Stopped(CommandError):
    """A protective stop holds the robot."""

    sentence = "{robot} is stopped ({reason}); when it is safe, go on with `robotree resume {commander}`"


class StillRunning(CommandError):
    """Code of a command that was ended runs on; nothing that moves may begin beside it."""

    sentence = (
        "{robot} takes no command that moves: its {command} was ended but still runs{where}; wait until that "
        "has ended, or restart {home}"
    )


class KeyReused(CommandError):
    """Two different calls came under one key."""

    sentence = "{robot} has seen the key {key!r} with another call of {command}; a key is for one call only"


# -- leases ----------------------------------------------------------------------------------------


class LeaseError(VrError):
    """The caller does not have the right to command this robot."""


class LeaseDenied(LeaseError):
    """Another parent commands the robot."""

    sentence = (
        "{robot} is already enslaved by {holder}; release it there first: `robotree release {holder}.{slot}`"
    )


class NotFree(LeaseError):
    """A parent has chosen the robot as one that has nothing to do, and it has something to do by now."""

    sentence = "{robot} is not free to be chosen: {reason}; choose again"


class StaleEpoch(LeaseError):
    """The caller's lease is over; a newer one was granted or the old one ended."""

    sentence = "{robot} no longer obeys epoch {epoch}, it is at {current}: the lease ended; enslave it again"


class OldParent(LeaseError):
    """The parent comes back with an older state than it has left."""

    sentence = (
        "{robot} was commanded by start {known} of the host of {parent}, and this is start {life}: an old "
        "folder was put back, or copied; bring the newest one back, or begin without its robots: "
        "`robotree host NAME --forget`"
    )


class Retracted(LeaseError):
    """The petition came after its parent had stopped waiting for the answer and had withdrawn it."""

    sentence = "{parent} has taken back its petition for {robot}, because no answer came; enslave it again"


class CycleOfBonds(LeaseError):
    """The parent would become its own descendant."""

    sentence = "{parent} cannot enslave {child}: {child} already commands {parent} ({lineage})"


class NotInControl(LeaseError):
    """The robot is enslaved, and the caller is not its parent."""

    sentence = (
        "{robot} is commanded by {holder}; command {holder}, or release the "
        "bond: `robotree release {holder}.{slot}`"
    )


class HeldByOperator(LeaseError):
    """A person has control of the robot, and somebody else asks."""

    sentence = "{holder} has control of {robot}; ask for it with `robotree control ask {robot}`"


class ControlRefused(LeaseError):
    """Control of a robot cannot change hands in this way now."""

    sentence = "control of {robot} stays as it is: {reason}"


class NotAllowed(LeaseError):
    """The asker may not ask for this."""

    sentence = "{who} may not ask for {what}: {reason}"


class Denied(LeaseError):
    """The policy of the realm does not allow it."""

    sentence = "{who} may not {right} {target}: {reason}; ask {ask}"


# -- assistants ------------------------------------------------------------------------------------


class PermitError(VrError):
    """A call of an assistant that may not begin, or not yet."""


class PermitNeeded(PermitError):
    """The policy wants a person's yes to this call."""

    sentence = (
        "{robot}.{command} needs a person's yes: permit {permit} waits (`robotree permit allow {permit}`)"
    )


class PermitRefused(PermitError):
    """A permit that does not allow this call, or no longer."""

    sentence = "permit {permit} does not allow this: {reason}"


class NoSuchPermit(PermitError):
    """There is no such permit."""

    sentence = "there is no permit {permit}; `robotree permits` lists those that wait"


class BudgetSpent(PermitError):
    """An assistant has done as much as the policy allows in this time."""

    sentence = (
        "{assistant} has used its {what}: {used} of {limit} {per}; it has more again in {seconds:.0f} s"
    )


class AssistantUnknown(PermitError):
    """A key that is nobody's, or was taken back."""

    sentence = "{detail}; a person makes a key with `robotree assistant invite NAME`"


# -- bonds -----------------------------------------------------------------------------------------


class BondError(VrError):
    """A child slot that cannot be used as asked."""


class NoSuchSlot(BondError):
    """The robot has no slot of this name."""

    sentence = "{robot} has no child slot {slot!r}; it has: {known}"


class SlotOccupied(BondError):
    """The slot already holds a child."""

    sentence = "{robot}.{slot} already holds {child}; release it first: `robotree release {robot}.{slot}`"


class SlotHeld(BondError):
    """The page to be loaded lacks a slot that holds a child; the old page goes on."""

    sentence = (
        "{robot}.{slot} holds {child}, and the new page has no such slot for the kind {kind}; keep the "
        "slot, or release the child first: `robotree release {robot}.{slot}`"
    )


class SlotEmpty(BondError):
    """The slot holds no child (any more)."""

    sentence = (
        "{robot}.{slot} is empty ({reason}); enslave a robot of kind {kind}: "
        "`robotree enslave {robot}.{slot} NAME`"
    )


class GroupFull(BondError):
    """All slots of a group hold a child."""

    sentence = "{robot}.{slot} already holds {most}, as many as it takes; release one first"


class WrongKind(BondError):
    """The child is not of the kind that the slot requires."""

    sentence = "{robot}.{slot} takes a robot of kind {wanted}; {child} is of kind {kind}"


class NobodyFits(BondError):
    """Nobody was chosen for a slot."""

    sentence = "{robot}.{slot} stays empty: {reason}"


class BadGroup(AddressError):
    """A group that cannot be one, or that cannot be read."""

    sentence = "group {group}: {reason}"


class NoSuchGroup(AddressError):
    """There is no group of this name."""

    sentence = "there is no group {group}; known: {known}; make one: `robotree group {group} ROBOT …`"


class GroupEmpty(AddressError):
    """A group of which nobody is there."""

    sentence = "nobody of group {group} is there ({about}); see `robotree group {group}`"


class DoesNotFit(BondError):
    """The child has the kind that the slot requires, but lacks commands that robots of this kind have."""

    sentence = "{robot}.{slot} takes a robot of kind {wanted}; {child} has this kind, but {reason}"


class NotThisKind(BondError):
    """A program asked for a robot of one kind, and the robot is of another one."""

    sentence = "{robot} is no {kind}: {reason}; `robotree show {robot}` lists its kinds and commands"


class StillBonded(BondError):
    """An enslaved robot cannot be deleted."""

    sentence = "{robot} is enslaved by {holder}; delete {holder} or release {holder}.{slot} first"


class NotVirtual(BondError):
    """Only a virtual robot has children and can be deleted."""

    sentence = "{robot} is no virtual robot: it cannot {what}"


# -- transport -------------------------------------------------------------------------------------


class TransportError(VrError):
    """The way to the other agent failed."""


class Unreachable(TransportError):
    """Nobody answers at this address, or the answerer died before it acknowledged."""

    sentence = "nobody answers at {key}; it has ended or cannot be reached"


class OnItsWay(TransportError):
    """A robot is moving to another host at the moment."""

    sentence = "{robot} is on its way to another host; ask again in a moment"


class NoAnswer(TransportError):
    """No answer came in the time allowed."""

    sentence = "{key} did not answer within {seconds:.3g} s; it hangs or the network is cut"


class NotConfirmed(TransportError):
    """Not all robots that received an urgent order have confirmed it.

    Its data: `order`, the names `told`, pairs (name, reason) `untold`, and the steps of the `advice`.
    """

    sentence = "{order} is confirmed by {told} but NOT by {untold}; {advice}"

    @classmethod
    def words(cls, data: dict[str, Any]) -> dict[str, Any]:
        return {
            "order": data["order"],
            "told": ", ".join(data["told"]) or "nobody",
            "untold": "; ".join(f"{name} ({reason})" for name, reason in data["untold"]),
            "advice": ", then: ".join(data["advice"]),
        }


class TransportClosed(TransportError):
    """This side has closed its transport."""

    sentence = "the connection to the realm is closed ({key})"


class Garbled(TransportError):
    """A message cannot be read."""

    sentence = (
        "{key} sent a message that this version cannot read: {detail}; start both with the same version of "
        "robotree"
    )


class RealmUnusable(TransportError):
    """The meeting place of the realm's processes cannot be made, trusted or entered."""

    sentence = "realm {realm!r} cannot be entered: {reason}"


class EmptyRealm(TransportError):
    """Nobody is in a realm: its name may be mistyped."""

    sentence = "nobody is in realm {realm!r}{hint}"


class TooManyKeys(TransportError):
    """The other processes take no more keys of this one, or no key as long as this."""

    sentence = (
        "{key} cannot be announced: a process may announce {most} keys, of at most {longest} bytes each; "
        "start another host for more robots"
    )


class NetworkUnusable(TransportError):
    """The network between machines cannot be used."""

    sentence = "cannot connect to other machines at {where}: {reason}"


# -- the journal of a host -------------------------------------------------------------------------


class JournalError(VrError):
    """The journal of a host cannot be used."""


class JournalInUse(JournalError):
    """A process keeps its robots there; it may hang."""

    sentence = "{folder} is in use by another process of host {host}, which may hang; end that one first"


class Deposed(JournalError):
    """Another host has taken over while this one was not heard."""

    sentence = "{host} has taken over the robots of {log}, because this host was not heard; it ends"


class JournalCutOff(JournalError):
    """The database in which it is kept cannot be reached any more."""

    sentence = (
        "{where} was not reached for {seconds:.0f} s ({reason}): nobody knows if another host has the robots "
        "by now, so this one ends; its robots come back when it is started again"
    )


class StandsBy(JournalError):
    """The host has no robots: it waits until another one is away."""

    sentence = "host {host} stands by for {owner} and takes no robots; create them there"


class DamagedJournal(JournalError):
    """Something in it is not what was written."""

    sentence = (
        "{path} is damaged at byte {at} ({detail}): none of its robots is started; move the folder away, or "
        "begin without them: `robotree host NAME --forget`"
    )


class LostJournal(JournalError):
    """Something in it that was written is not there any more."""

    sentence = (
        "{missing} from {folder}, where a host keeps its robots: somebody has removed or shortened it, so "
        "none of them is started; bring it back, or begin without them: `robotree host NAME --forget`"
    )


class CopiedJournal(JournalError):
    """It is the journal of a host of another name."""

    sentence = (
        "{folder} is a copy of what host {other} keeps, and no robot can live twice: start host {other}, or "
        "begin without its robots: `robotree host NAME --forget`"
    )


class JournalUnusable(JournalError):
    """It cannot be opened, read or written."""

    sentence = (
        "{path} cannot be used ({reason}), so no robots can be kept: {remedy}, or begin without those that "
        "were kept: `robotree host NAME --forget`"
    )


class OtherJournal(JournalError):
    """Another version of robotree has written it."""

    sentence = (
        "{path} was written by another version of robotree (format {version}): start that one, or begin "
        "without its robots: `robotree host NAME --forget`"
    )


class HistoryError(VrError):
    """The history of robots cannot be read."""


class NoHistory(HistoryError):
    """Nothing is kept of what was asked for, as far as the hosts that answer know."""

    sentence = "nothing is kept of {name}{detail}"


class HistoryChanged(HistoryError):
    """The kept history is not as it was written."""

    sentence = "{detail}; what stands before it is as it was written"


class HistoryUnusable(HistoryError):
    """The file with what robots did cannot be read."""

    sentence = (
        "{path} cannot be used ({detail}); the robots run on; if it is damaged, move it away, and a new one "
        "begins"
    )


# -- bundles ---------------------------------------------------------------------------------------


class BundleError(VrError):
    """Source of a virtual robot that cannot be used."""


class NoSuchFile(BundleError):
    """The file is not there."""

    sentence = "cannot read {path}: {reason}"


class BrokenSource(BundleError):
    """The source does not compile, or raises or hangs while it is loaded."""

    sentence = "{path} cannot be loaded: {reason}"


class OtherKind(BundleError):
    """The page to be loaded defines another kind of robot; the old page goes on."""

    sentence = (
        "{path} defines the kind {given}, and {robot} is of kind {kind}; "
        "keep the name of the class, or create a new robot"
    )


class NoPage(BundleError):
    """It is not known where the page of a robot is kept."""

    sentence = "it is not known where the page of {robot} is kept; name it: `robotree reload {robot} FILE`"


class ReloadWaits(BundleError):
    """A running command did not end in time; the old page goes on."""

    sentence = (
        "{robot}.{command} has not ended within {seconds:g} s, so the old page goes on; reload again, or "
        "cancel the command: `robotree reload {robot} --now`"
    )


class NoVirtualRobot(BundleError):
    """The source defines no (such) virtual robot."""

    sentence = "{path} defines no virtual robot{wanted}; it needs a class that derives from VirtualRobot"


class SeveralVirtualRobots(BundleError):
    """The source defines several virtual robots and none was named."""

    sentence = "{path} defines several virtual robots ({known}); name one: {path}:CLASS"


class BrokenScript(BundleError):
    """A script, role or table of facts that cannot be used, and where."""

    sentence = "{path}:{line}:{column}: {reason}"


class RequirementUnreadable(BundleError):
    """What a robot must be to be chosen cannot be read."""

    sentence = "where {text!r}: {reason}; write it as: battery > 30 and near hall"


class BadBundle(BundleError):
    """A bundle that breaks a rule of its form, or that is not as it was signed."""

    sentence = "the bundle {path} is refused: {reason}"


class NotSigned(BundleError):
    """A page of somebody else that nobody has signed."""

    sentence = (
        "{path} comes from {sender} and is not signed, so {host} does not run it; there: "
        "`robotree bundle build {path}`, and here create the robot from the bundle"
    )


class UnknownSigner(BundleError):
    """A page that was signed by somebody whom this host does not trust."""

    sentence = (
        "{path} is signed by {signer}, whom {host} does not trust; "
        "if you know this key: `robotree bundle trust {signer} --name WHO`"
    )


class RevokedSigner(BundleError):
    """A page whose signer was trusted once."""

    sentence = "{path} is signed by {signer}, and that is not accepted any more: {reason}"


class ExcessPermission(BundleError):
    """A page that wants more than its signer may grant."""

    sentence = (
        "{path} wants {permissions}, which its signer {signer} may not grant here; "
        "`robotree bundle trust` lists who may grant what; to allow it: `robotree bundle trust {again}`"
    )


class OtherPython(BundleError):
    """A page that does not run on the Python of this host."""

    sentence = "{path} needs Python {needed}, and this host has {found}"


class MissingRequirement(BundleError):
    """A page that needs a package which this host does not have, or does not allow; nothing is installed."""

    sentence = "{path} needs {requirement}, and {reason}"


class NoSuchBundle(BundleError):
    """A bundle that nobody has who could be asked."""

    sentence = "nobody here has the bundle {hash}; create the robot from its file"


class BadTrustFile(BundleError):
    """The file that says whom a host trusts cannot be used: then nobody is trusted."""

    sentence = "{path}{line} cannot be used, so nobody is trusted: {reason}"


class BadPanel(BundleError):
    """A panel that breaks a rule of its form, or does not fit its robot: the generated form is shown."""

    sentence = "the panel {path} is not shown: {reason}"


class NoSigningKey(BundleError):
    """A key with which to sign that cannot be used."""

    sentence = "there is no key to sign with: {reason}"


# -- roles -----------------------------------------------------------------------------------------


class RoleError(VrError):
    """A role that cannot be played."""


class NoSuchRole(RoleError):
    """The robot knows no role of this name."""

    sentence = "{robot} knows no role {role!r}; it knows: {known}"


class NoRoles(RoleError):
    """The robot, or who commands it, has no roles."""

    sentence = "{robot} cannot change its role: {reason}"


class TooWide(RoleError):
    """A role would allow more than the robot's own safety limit, or than the role that it inherits from."""

    sentence = (
        "role {role}: {limit} {asked:g} is wider than the {own:g} of {whose}; a role can only narrow a limit"
    )


# -- the space -------------------------------------------------------------------------------------


class SpaceError(VrError):
    """A space that cannot do what was asked."""


class NoSpace(SpaceError):
    """No space runs in the realm, or none of this name."""

    sentence = "no space {name}runs in this realm; start one: `robotree space serve {example}`"


class SeveralSpaces(SpaceError):
    """Several spaces run in the realm, and none was named."""

    sentence = "several spaces run in this realm ({known}); say which: self.space[{example!r}]"


class SpaceLost(SpaceError):
    """The space ended, or hangs, before it answered."""

    sentence = (
        "space {space} has ended or hangs and has not answered {request}: nobody knows if that was done; "
        "look with `robotree space ls` when the space is back, then ask again"
    )


class SpaceFull(SpaceError):
    """There is no room for what was asked; nothing of it was done."""

    sentence = "space {space} has no room: {reason}; nothing was changed"


class SpaceUnusable(SpaceError):
    """The store of a space cannot be used."""

    sentence = "the space at {where} cannot be used: {reason}"


class SpaceDamaged(SpaceError):
    """The entries in the store of a space cannot be read; it is left as it is."""

    sentence = (
        "the space at {where} is damaged ({reason}); nothing of it was changed: put a copy back, or move it "
        "away, and the space begins empty"
    )


class BadEntry(SpaceError):
    """The value of a program is no entry, or no template."""

    sentence = "{kind} cannot be an entry of a space, or ask for one: {reason}"


class EntryUnfit(SpaceError):
    """An entry does not fit into the class of the program that asked; it is still in the space."""

    sentence = (
        "an entry of kind {kind} does not fit into this program's class: {reason}; who wrote it has another "
        "version of the class; the entry is still in the space"
    )


class KeyTaken(SpaceError):
    """An entry with this key is there."""

    sentence = (
        "space {space} has an entry with the key {key!r}; take that one first, or write under another key"
    )


class NoSuchEntry(SpaceError):
    """The entry is there no longer."""

    sentence = "entry {id} is in space {space} no longer: it was taken or cancelled, or its lease has ended"


class TransactionOver(SpaceError):
    """The transaction has ended; nothing of it has changed the space."""

    sentence = (
        "the transaction in space {space} has ended, and all of it was taken back: {reason}; begin it anew, "
        "with more time if it needs it: self.space.transaction(within=…)"
    )


class FenceHeld(SpaceError):
    """Somebody else holds the fence."""

    sentence = "{name} is held by {holder} for {seconds:.3g} s more; wait longer for it, or end {holder}"


class FenceLost(SpaceError):
    """The fence was let go, ran out, or was acquired by somebody else."""

    sentence = "epoch {epoch} of {name} is over, it is at {current}: its time has ended; acquire it again"


# -- in words --------------------------------------------------------------------------------------

PRIVATE_MODULE, PRIVATE_FOLDER = "robotree_bundle_", "robotree-page-"
"""The prefixes of the names of pages' modules, and of the folders of the files beside them."""
_PRIVATE = re.compile(rf"{PRIVATE_MODULE}\w+\.|[^\s'\"(]*/{PRIVATE_FOLDER}\w+/")


def words_of(error: BaseException) -> str:
    """Return kind and text of an error; if its text cannot be written, only its kind.

    Names of private modules and folders are left out: an author knows `helper`, and `map.json` beside it.
    """
    kind = type(error).__name__
    try:
        text = str(error)
    except Exception:  # noqa: BLE001 # the author's own __str__
        return kind
    return f"{kind}: {_PRIVATE.sub('', text)}" if text else kind


# -- a realm of several machines -------------------------------------------------------------------


class RealmError(VrError):
    """A realm of several machines does not admit somebody, or cannot be changed here."""


class NotAMember(RealmError):
    """Somebody does not belong to the realm, or not any more."""

    sentence = "{who} is not admitted: {reason}"


class InvitationRefused(RealmError):
    """An invitation cannot be used."""

    sentence = "the invitation cannot be used: {reason}"


class NoKeys(RealmError):
    """This machine has no key of a realm."""

    sentence = (
        "this machine has no key of realm {realm}; join it with a token (`robotree realm join TOKEN`), or "
        "make it here: `robotree realm create {realm}`"
    )


class NoAuthority(RealmError):
    """The realm was made on another machine."""

    sentence = "the authority of realm {realm} is on another machine: ask there, where the realm was made"


class KeysExist(RealmError):
    """This machine has keys of a realm of that name already."""

    sentence = "{folder} has keys of a realm {realm} already; choose another name, or move the folder away"


class NoSuchMember(RealmError):
    """Nobody of that name belongs to the realm."""

    sentence = "no member of realm {realm} is called {name}; `robotree realm members` lists them"


class SiteSilent(RealmError):
    """A site is not heard; it goes on by itself."""

    sentence = (
        "site {site} has been silent for {seconds:.1f} s ({reason}); what was asked has not begun, and its "
        "robots go on by themselves"
    )


class PolicyUnusable(RealmError):
    """A policy cannot be used, or cannot take the place of the one in force."""

    sentence = "{path} is not used as the policy: {reason}"


# -- orders ----------------------------------------------------------------------------------------


class OrderError(VrError):
    """An order that was not left, or not changed."""


class NoDirectory(OrderError):
    """No directory runs that could keep it."""

    sentence = "no directory answers{detail}; start one with `robotree directory NAME`"


class NotRemembered(OrderError):
    """No directory knows the robot."""

    sentence = (
        "no robot named {name!r} is running, and no directory remembers one; orders can be left for a robot "
        "that has been seen once: `robotree ls`"
    )


class SeveralRobots(OrderError):
    """Several robots that are remembered have this name."""

    sentence = (
        "{count} robots named {name!r} are remembered, none of them is here: {known}; name one: {example}"
    )


class NotOrdered(OrderError):
    """The command cannot be left as an order."""

    sentence = "{robot}.{command} cannot be left as an order: {reason}"


class BadEnd(OrderError):
    """An order needs an end."""

    sentence = (
        "an order must begin within 1 s to 30 days from now, and not within {seconds:.0f} s; give it --until"
    )


class NoSuchOrder(OrderError):
    """No directory has an order of this key."""

    sentence = "no directory that answers has an order {key}; `robotree orders` lists them"


class ShortTicket(OrderError):
    """So few letters could be those of an order that nobody meant."""

    sentence = "{key!r} is too short for a ticket: write at least {least} letters, as `robotree orders` shows"


class SeveralOrders(OrderError):
    """Several keys begin like this."""

    sentence = "{count} orders begin with {key}: {keys}; write more of it"


class OrderOver(OrderError):
    """The order cannot be changed any more."""

    sentence = "order {key} for {robot} is {state}; {advice}"


class NothingToConfirm(OrderError):
    """The robot asks nothing about this order."""

    sentence = "{robot} asks nothing about order {key}, which is {state}"


class NotInDoubt(OrderError):
    """A person settles an order whose end is known."""

    sentence = "order {key} for {robot} is {state}, not in doubt: there is nothing to settle"


class DirectoryUnusable(OrderError):
    """The file of a directory cannot be used."""

    sentence = "the memory of the directory, {where}, cannot be used: {reason}"


class DirectoryDamaged(OrderError):
    """The file of a directory is not as it was written."""

    sentence = (
        "the memory of the directory, {where}, is damaged ({reason}); move it away: the other directories "
        "give a new one what they have"
    )


class LedgerUnusable(OrderError):
    """What a host remembers of its robots' orders cannot be read or kept."""

    sentence = "what the host remembers of its robots' orders, {where}, cannot be used: {reason}"


class LedgerDamaged(LedgerUnusable):
    """What a host remembers of its robots' orders is not as it was written."""

    sentence = (
        "what the host remembers of its robots' orders, {where}, is damaged ({reason}); move it away: orders "
        "that may have begun are in doubt then, and none is repeated"
    )
