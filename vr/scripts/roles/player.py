"""Robots that play roles: the same acts, carried out in another manner.

    class Companion(RolePlayer):
        limits = {"speed": Limit(upper=0.7), "distance": Limit(lower=0.5)}

        @command
        def say(self, text: str) -> None:
            self.head.speak(self.manner.words(text), voice=self.manner.get("voice", "neutral"))

        @in_role("child", of="wave")
        def _wave_as_child(self) -> None: ...

A role is chosen when an act begins: one that runs is not changed, the next one follows.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from typing import Annotated, Any, ClassVar, TypeVar

import msgspec

from robotree.vr.author.child import ChildCommand
from robotree.vr.author.command import command, commands_of
from robotree.vr.author.fields import state
from robotree.vr.author.virtual_robot import VirtualRobot
from robotree.vr.base.errors import BadArgument, BrokenScript, NoRoles, NoSuchRole, TooWide, VrError
from robotree.vr.base.written import Scalar
from robotree.vr.scripts.roles.profile import Profile, read_profile, resolve, shipped

_F = TypeVar("_F", bound=Callable[..., Any])
_MARK = "__robotree_role__"
NEUTRAL = "neutral"
"""The robot as it is, without a role."""
_OWN = frozenset({"play", "learn_role", "roles"})


class Limit(msgspec.Struct, frozen=True):
    """A safety limit of a robot, in the unit of the argument with the same name."""

    upper: float | None = None
    lower: float | None = None

    def narrower(self, value: float) -> bool:
        """Whether a value is within it."""
        return (self.upper is None or value <= self.upper) and (self.lower is None or value >= self.lower)

    @property
    def bound(self) -> float:
        """The bound itself; a limit has one."""
        return self.upper if self.upper is not None else self.lower or 0.0

    def narrowed(self, value: float) -> Limit:
        """Return the limit with a narrower bound."""
        return Limit(upper=value) if self.upper is not None else Limit(lower=value)


class Manner(msgspec.Struct, frozen=True):
    """How one act is to be carried out: the role that is played, as far as it concerns this act."""

    role: str
    values: dict[str, Scalar]
    phrases: dict[str, str]
    limits: dict[str, Limit]

    def get(self, name: str, default: Any = None) -> Any:
        """Return a value of the role, or the default."""
        return self.values.get(name, default)

    def number(self, name: str, default: float) -> float:
        """Return a number of the role, kept within the limit of this name."""
        value = self.values.get(name, default)
        number = float(value) if isinstance(value, int | float) and not isinstance(value, bool) else default
        limit = self.limits.get(name)
        if limit is None:
            return number
        number = number if limit.upper is None else min(number, limit.upper)
        return number if limit.lower is None else max(number, limit.lower)

    def words(self, text: str) -> str:
        """Return what the role says instead: whole texts first, then the beginnings of a text."""
        if text in self.phrases:
            return self.phrases[text]
        for known in sorted(self.phrases, key=len, reverse=True):
            if text.startswith(known) and not text[len(known)].isalnum():
                return self.phrases[known] + text[len(known) :]
        return text


_manner: ContextVar[Manner] = ContextVar("robotree_manner")


def in_role(role: str, *, of: str) -> Callable[[_F], _F]:
    """Mark a method as the way in which a role carries out a command.

    Args:
        role: its name; roles that inherit from it use it too.
        of: name of the command.
    """

    def mark(function: _F) -> _F:
        setattr(function, _MARK, (role, of))
        return function

    return mark


class RolePlayer(VirtualRobot):
    """A robot that plays roles."""

    limits: ClassVar[Mapping[str, Limit]] = {}
    """Safety limits by the name of the argument that they bound; a role can only narrow them."""
    playing: str = state(NEUTRAL)
    learned: dict[str, str] = state({})
    """Sources of the roles that it has learned, by name."""
    borrowed: dict[str, Profile] = state({})
    """The role of a service that it plays, with those of that service from which it inherits, by name."""
    _ways: ClassVar[dict[tuple[str, str], Callable[..., Any]]] = {}

    def __init_subclass__(cls) -> None:
        """Let each command ask for the role when it begins.

        Raises:
            TypeError: an implementation is for a command that is not there.
        """
        super().__init_subclass__()
        cls._ways = {
            getattr(value, _MARK): value
            for base in reversed(cls.__mro__)
            for value in vars(base).values()
            if hasattr(value, _MARK)
        }
        known = commands_of(cls)
        for role, of in cls._ways:
            if of not in known:
                raise TypeError(f"{cls.__name__}: role {role} has a way to {of}, which is no command")
        del cls.__robotree_commands__  # type: ignore[attr-defined] # collected before they were wrapped
        for name, value in list(vars(cls).items()):
            if name in known and name not in _OWN:
                setattr(cls, name, _in_manner(value))

    def __init__(self, name: str, attributes: Mapping[str, str] | None = None) -> None:
        """Name the robot; it plays no role. See `VirtualRobot`."""
        super().__init__(name, attributes)
        self._shipped = shipped()
        self.lent: dict[str, Profile] = {}
        """The roles of the services that are here, by name. By its agent only."""

    @property
    def attributes(self) -> dict[str, str]:
        """Free pairs, its role and the roles that it knows among them."""
        return {**self._given, "role": self.role, "roles": " ".join([NEUTRAL, *sorted(self._known)])}

    @attributes.setter
    def attributes(self, given: dict[str, str]) -> None:
        self._given = given

    @property
    def role(self) -> str:
        """The role that it plays."""
        return self.playing

    @property
    def _known(self) -> dict[str, Profile]:
        return {**self.lent, **self.borrowed, **self._own}

    @property
    def _own(self) -> dict[str, Profile]:
        """The roles that no service lends it."""
        learned = {name: read_profile(source, "role") for name, source in self.learned.items()}
        return {**self._shipped, **learned}

    @property
    def manner(self) -> Manner:
        """How the running act is to be carried out; outside of an act, how the next one will be."""
        return _manner.get(None) or self.manner_of("")

    def manner_of(self, act: str) -> Manner:
        """Return how an act is carried out from now on."""
        profile, limits = self._played()
        return Manner(profile.name, {**profile.manner, **profile.acts.get(act, {})}, profile.words, limits)

    def way_to(self, act: str) -> Callable[..., Any] | None:
        """Return the method in which the role carries out an act; None: as everybody does."""
        return next(
            (self._ways[role, act] for role in self._played()[0].chain if (role, act) in self._ways), None
        )

    @command(effect="read")
    def play(
        self, role: Annotated[str, "butler, maid, man, woman, child, neutral, or one that it has learned"],
        at: Annotated[str, "path of child slots to the robot that is meant; empty: this one"] = "",
    ) -> str:  # fmt: skip
        """Play a role from the next act on; what runs now goes on as it began."""
        if at:
            return forward(self, role, at)
        known, lent = self._known, self.lent
        borrowed: dict[str, Profile] = {}
        if role != NEUTRAL:
            if role not in known:
                raise NoSuchRole(robot=self.name, role=role, known=", ".join([NEUTRAL, *sorted(known)]))
            profile = resolve(role, known)
            self._narrowed(profile, known)
            borrowed = {name: known[name] for name in profile.chain if known[name] is lent.get(name)}
        self.playing, self.borrowed = role, borrowed
        if self._given_back():  # the service has left meanwhile
            raise NoSuchRole(robot=self.name, role=role, known=", ".join([NEUTRAL, *sorted(self._known)]))
        return role

    @command(effect="read")
    def learn_role(
        self, source: Annotated[str, "a role as YAML"],
        at: Annotated[str, "as in play"] = "",
    ) -> str:  # fmt: skip
        """Learn a role, so that it can be played; returns its name."""
        if at:
            return forward(self, source, at, act="learn_role", argument="source")
        profile = read_profile(source, "role")
        if profile.name == NEUTRAL:
            raise BrokenScript(
                path="role", line=1, column=1, reason=f"{NEUTRAL!r} is the robot without a role"
            )
        if profile.name in self.lent:
            raise profile.mark.error(f"a service lends {profile.name!r}; give the role another name")
        self._must_understand(profile)
        known = {**self._known, profile.name: profile}
        self._narrowed(resolve(profile.name, known), known)
        self.learned = {**self.learned, profile.name: source}
        return profile.name

    @command(effect="read")
    def roles(self) -> str:
        """Tell which role it plays, and which ones it knows."""
        return f"{self.role} of {', '.join([NEUTRAL, *sorted(self._known)])}"

    def lend(self, offered: Mapping[str, Profile]) -> list[str]:
        """Have the roles of the services that are here now, in place of those before. By its agent only.

        Returns:
            What cannot be played, and what it plays no more, as sentences.
        """
        own, said = self._own, list[str]()
        lent: dict[str, Profile] = {}
        known = {**offered, **own}
        for name, profile in offered.items():
            try:
                if name in own:
                    raise profile.mark.error(f"it has a role {name!r} of its own")
                self._must_understand(profile)
                self._narrowed(resolve(name, known), known)
            except VrError as error:
                said.append(f"it does not take the role {name}: {error}")
            else:
                lent[name] = profile
        self.lent, played = lent, self.playing
        if self._given_back():
            said.append(f"the role {played} is gone with its service: {NEUTRAL} from the next act on")
        return said

    def _given_back(self) -> bool:
        """Play no role of a service that is away any more; return whether it did."""
        lent, borrowed, played = self.lent, self.borrowed, self.playing
        there = played == NEUTRAL or played in lent or played in self._own
        if there and all(lent.get(name) == profile for name, profile in borrowed.items()):
            return False
        self.playing, self.borrowed = NEUTRAL, {}
        return True

    def _played(self) -> tuple[Profile, dict[str, Limit]]:
        """Return the role that it plays, and the limits under it."""
        known, role = self._known, self.role
        if role not in known:  # none, or that of a service that has just left
            return Profile(name=NEUTRAL, chain=(NEUTRAL,)), dict(self.limits)
        profile = resolve(role, known)
        return profile, self._narrowed(profile, known)

    def _must_understand(self, profile: Profile) -> None:
        """Refuse a limit that nothing here would keep, and a limited value that is no number.

        Raises:
            BrokenScript: there is one.
        """
        for name in profile.limits:
            if name not in self.limits:
                there = ", ".join(self.limits) or "none"
                raise profile.mark.error(
                    f"role {profile.name} limits {name!r}, and {self.name} has no such limit; it has: {there}"
                )
        for values in (profile.manner, *profile.acts.values()):
            for name, value in values.items():
                if name in self.limits and (isinstance(value, bool) or not isinstance(value, int | float)):
                    raise profile.mark.error(f"role {profile.name}: {name} must be a number, not {value!r}")

    def _narrowed(self, profile: Profile, known: Mapping[str, Profile]) -> dict[str, Limit]:
        """Return the limits under a role, the narrowest of the robot's own and of those in its chain.

        Raises:
            TooWide: it would allow more than the robot does, or than the role that it inherits from.
        """
        limits, whose = dict(self.limits), dict.fromkeys(self.limits, self.name)
        for name in reversed(profile.chain):
            for limit, value in known[name].limits.items() if name in known else ():
                own = limits.get(limit)
                if own is None:
                    continue  # the robot has nothing of that kind
                if not own.narrower(value):
                    raise TooWide(role=name, limit=limit, asked=value, own=own.bound, whose=whose[limit])
                limits[limit], whose[limit] = own.narrowed(value), f"role {name}"
        return limits


def forward(robot: VirtualRobot, role: str, at: str, *, act: str = "play", argument: str = "role") -> str:
    """Pass a role on to a child.

    Args:
        robot: whose child is meant.
        role: its name, or its source.
        at: path of slots, separated by dots.
        act: the child's command.
        argument: what `role` is to it.

    Raises:
        NoRoles: the child cannot change its role.
        SlotEmpty: there is no child.
    """
    slot, _, rest = at.partition(".")
    child = robot.child_slots.require(slot).description
    if child.command(act) is None:
        raise NoRoles(robot=child.name, reason=f"no {child.kind} plays one")
    given = {argument: role, **({"at": rest} if rest else {})}
    return str(ChildCommand(robot, slot, act)(**given))


def _in_manner(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command that looks which role is played when it begins."""
    names = list(inspect.signature(function).parameters)[1:]
    act = function.__name__

    @functools.wraps(function)
    def played(self: RolePlayer, *values: Any, **arguments: Any) -> Any:
        manner, way = self.manner_of(act), self.way_to(act) or function
        for name, value in {**dict(zip(names, values, strict=False)), **arguments}.items():
            limit = manner.limits.get(name)
            if limit is not None and isinstance(value, int | float) and not limit.narrower(value):
                side = "above" if limit.upper is not None else "below"
                reason = f"{value:g} is {side} {limit.bound:g}, the limit of {self.name} as {manner.role}"
                raise BadArgument(command=f"{self.name}.{act}", parameter=name, reason=reason)
        token = _manner.set(manner)
        try:
            return way(self, *values, **arguments)
        finally:
            _manner.reset(token)

    return played
