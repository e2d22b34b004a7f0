"""The judge of what comes from a robot in a process of its own. Pure.

The robot may be code that nobody here has read. It speaks for itself alone: under its own name, with its own
key, to robots, lookup services and spaces, and with none of the requests by which people shape a realm.
Whatever else it tries is no mistake of an author, so it ends the process.

It commands its children alone: those that somebody has put under it, or that a slot of its page chooses. What
it may call of other robots the permissions of its page say, if it has any; without, nothing. Of those it may
end its own calls, and neither those of others nor pause them. A child it commands under its lease: once it is
released, the robot that is asked refuses.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from robotree.vr.base import requests as req
from robotree.vr.base.address import Address
from robotree.vr.base.envelope import read_envelope
from robotree.vr.base.errors import NotAllowed, NotItsChild, VrError
from robotree.vr.base.newest import keep_newest
from robotree.vr.base.order import ORDER_NEWS
from robotree.vr.base.permissions import Permissions
from robotree.vr.lookup.service import NEWS_PATTERN

OF_PARENTS = (req.Petition, req.Retract, req.Renew, req.Release)
OF_CALLS = (req.Attend, req.Detach, req.Cancel)
"""Requests about a call, by its key."""
OF_CHILDREN = (req.Call, *OF_CALLS, req.Pause, req.TakeStep, req.Continue, req.Resume)
"""Requests to the children of the robot."""
OF_MOVES = (req.PrepareMove, req.TakeRobot, req.AskMove)
"""Requests by which it moves to another host: its own host makes them anew."""
ALLOWED: dict[str, tuple[type[req.AnyRequest], ...]] = {
    "robot": (req.Describe, req.SafeStop, *OF_PARENTS, *OF_CHILDREN),
    "lookup": (req.Register, req.Query),
    "directory": (req.Register, req.Query, req.RobotDeleted, req.FetchOrders, req.TakeOrder, req.TellOrders),
    "host": OF_MOVES,
    "space": (
        *(req.WriteEntry, req.FindEntries, req.GiveUp, req.RenewEntry),
        *(req.OpenTransaction, req.CloseTransaction, req.RollBack),
        *(req.AcquireFence, req.RenewFence, req.WatchEntries, req.DescribeSpace),
    ),
}
"""What a robot may ask, by the role of whom it asks."""

MOST_CALLED = 1024
"""Calls of robots that are no children, of which a judge knows: the newest."""
NAMELESS = (req.Describe, req.Register, req.Query)
"""Requests that may come without a sender."""


_HEARD = (ORDER_NEWS, NEWS_PATTERN)
"""News beside those of robots: of its orders, and of who is listed, which it may ask for, too."""
_NOTED = (req.Enslave.__name__.encode(), req.Resume.__name__.encode())


class Misbehaved(Exception):
    """A robot tried what no robot does; the text is a clause for people."""


class Judge:
    """Judges the frames of one robot."""

    def __init__(
        self,
        name: str,
        permissions: Permissions | None = None,
        *,
        chooses: Mapping[str, str] | None = MappingProxyType({}),
        children: Iterable[str] = (),
    ) -> None:
        """Begin with a robot whose address is not known yet.

        Args:
            name: of the robot.
            permissions: of its page; None: it has none, and commands its children alone.
            chooses: kinds of the slots for which it chooses children itself, by name; None: of any.
            children: names of the robots that were put under it before.
        """
        self.name = name
        self.children = set(children)
        """Names of the robots that it may command."""
        self.chooses = chooses
        """Kinds of the slots for which its page chooses children, by name; None: of any."""
        self.chosen: set[str] = set()
        """Slots for which somebody has asked it to choose a child."""
        self.resumes: dict[int, req.Resume] = {}
        """Those that it was asked for and has not answered yet, by their numbers: these it may hand down."""
        self.permissions: tuple[Permissions | None, ...] = (permissions,)
        """Those of its page; while that is being changed, those of both."""
        self._called: dict[str, str] = {}
        """Robots that are no children and that it has called, by the keys of the calls."""
        self.identity = ""
        """For life, as it describes itself first."""
        self.key = ""
        """Of its address: the first one under which it answers."""

    def expect_own(self, key: str) -> None:
        """Refuse a key under which another one answers or is present.

        Raises:
            Misbehaved: it is not this robot's.
        """
        address = Address.parse(key)
        if address is None or address.role != "robot" or address.name != self.name:
            raise Misbehaved(f"it wanted to be {_shown(key)}")
        if self.key not in ("", key):
            raise Misbehaved(f"it wanted to be {_shown(key)} beside itself")
        self.key = key

    def note_asked(self, body: bytes, number: int = 0) -> bool:
        """Take note of a request to the robot: whom it is to enslave it may command.

        Args:
            body: an envelope.
            number: of the request, for `note_answered`.

        Returns:
            Whether there is one more whom it may command.
        """
        if not any(name in body for name in _NOTED):  # nearly all are something else
            return False
        try:
            request = read_envelope(body).request
        except VrError:
            return False
        if isinstance(request, req.Resume):
            self.resumes[number] = request
        if not isinstance(request, req.Enslave):
            return False
        if request.child is None:
            self.chosen.add(request.slot)
            return False
        return self._take(request.child.name)

    def note_answered(self, number: int) -> None:
        """Take note that the robot has answered a request."""
        self.resumes.pop(number, None)

    def _take(self, name: str) -> bool:
        new = name not in self.children
        self.children.add(name)
        return new

    def expect_child(self, key: str, body: bytes) -> bool:
        """Refuse to command a robot that is no child of this one; for what `expect_asked` has let pass.

        Args:
            key: of whom it asks.
            body: an envelope.

        Returns:
            Whether there is one more whom it may command.

        Raises:
            NotItsChild: it may not.
            NotAllowed: it would end a stop, and nobody has asked it to.
        """
        request, address = read_envelope(body).request, Address.parse(key)
        if address is None or address.role != "robot":
            return False
        own = address.name in self.children and getattr(request, "epoch", 0) is not None
        if isinstance(request, req.Resume) and own:
            self._expect_handed_down(request)
        if own:
            return False
        if isinstance(request, req.Petition):
            if self._may_choose(request):
                return self._take(address.name)
        elif not isinstance(request, OF_CHILDREN):
            return False
        elif isinstance(request, req.Call) and any(one is not None for one in self.permissions):
            self._note_called(request.key, address.name)
            return False  # of whom has permissions, the robot that is asked looks at them
        elif isinstance(request, OF_CALLS) and self._called.get(request.key) == address.name:
            return False
        raise NotItsChild(robot=self.name, child=address.name, what=type(request).__name__)

    def _note_called(self, key: str, name: str) -> None:
        """Take note of a call of a robot that is no child: that one it may end, and nothing else of it."""
        if not key:
            return  # in a cancel that means all of its calls
        self._called.pop(key, None)
        keep_newest(self._called, key, name, MOST_CALLED)

    def _expect_handed_down(self, request: req.Resume) -> None:
        """Refuse a resume that is no part of what the robot was asked for: people end stops, not pages."""
        asked = (request.seen, request.given, request.clock)
        if not any((one.seen, one.given, one.clock) == asked for one in self.resumes.values()):
            raise NotAllowed(who=self.name, what=req.Resume.__name__, reason="nobody has asked it to resume")

    def _may_choose(self, petition: req.Petition) -> bool:
        if self.chooses is None:
            return True
        slot = petition.slot.partition("[")[0]
        return slot in self.chosen or self.chooses.get(slot) == petition.kind

    def expect_asked(self, key: str, body: bytes) -> None:
        """Refuse a request that no robot makes.

        Args:
            key: of whom it asks.
            body: an envelope.

        Raises:
            Misbehaved: it is one.
        """
        try:
            envelope = read_envelope(body)
        except VrError as error:
            raise Misbehaved(f"it asked {_shown(key)} in a way that cannot be read: {error}") from None
        request, what = envelope.request, type(envelope.request).__name__
        role = key.partition("/")[0]
        operators = isinstance(request, req.Resume) and request.epoch is None
        if operators or not isinstance(request, ALLOWED.get(role, ())):
            raise Misbehaved(f"it asked {_shown(key)} for {what}, which no robot does")
        if isinstance(request, OF_MOVES):
            if envelope.terminal or envelope.proof or request.robot.key != self.key:
                raise Misbehaved(f"it asked {_shown(key)} for {what} of another robot")
            return
        nameless = not envelope.sender and isinstance(request, NAMELESS)
        if envelope.terminal or envelope.proof or (envelope.sender != self.key and not nameless):
            raise Misbehaved(f"it asked {_shown(key)} for {what} in the name of somebody else")
        # what binds, renews and ends is not limited by permissions, and its sender leaves them out
        limited = isinstance(request, req.Call) or envelope.may is not None
        if limited and envelope.may not in self.permissions and role == "robot" and not nameless:
            raise Misbehaved(f"it asked {_shown(key)} for {what} with other permissions than its page has")
        if isinstance(request, OF_PARENTS) and request.parent.key != self.key:
            raise Misbehaved(f"it asked {_shown(key)} for {what} as {_shown(request.parent.key)}")
        self._expect_own_orders(request)
        if isinstance(request, req.Register) and any(one.address.key != self.key for one in request.listings):
            raise Misbehaved("it wanted to list another robot")
        if isinstance(request, req.Register) and any(one.key != self.key for one, _ in request.withdrawn):
            raise Misbehaved("it wanted to take another robot out of the lookup")

    def _expect_own_orders(self, request: req.AnyRequest) -> None:
        address = Address.parse(self.key)
        own = {self.identity or f"name:{self.name}", "" if address is None else address.incarnation}
        if isinstance(request, req.RobotDeleted) and request.identity not in own:
            raise Misbehaved("it wanted another robot to be forgotten")
        if isinstance(request, req.FetchOrders | req.TakeOrder) and request.identity not in own:
            raise Misbehaved("it wanted the orders of another robot")
        if isinstance(request, req.TellOrders) and any(one.identity not in own for one in request.orders):
            raise Misbehaved("it told of the orders of another robot")

    def expect_published(self, key: str) -> None:
        """Refuse a sample under another one's key.

        Raises:
            Misbehaved: it is.
        """
        if not self.key or not key.startswith(f"{self.key}/"):
            raise Misbehaved(f"it published as {_shown(key)}")

    def expect_subscribed(self, pattern: str) -> None:
        """Refuse to hand on what is no robot's.

        Raises:
            Misbehaved: it wants to hear somebody else.
        """
        if not pattern.startswith(("robot/", "space/")) and pattern not in _HEARD:
            raise Misbehaved(f"it wanted to hear {_shown(pattern)}")


def _shown(key: str) -> str:
    return repr(key if len(key) < 100 else f"{key[:97]}...")
