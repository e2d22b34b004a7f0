"""The policy of a realm: which person may do what with which robot. Pure.

A policy is a YAML file that people write and read:

    realm: plant
    version: 3
    ask: anna, room 12            # whom to ask; without it, those who may administrate
    persons:
      anna: administrator         # on one machine: the system's user; else the member anna
      ben@hall: [operator]        # the system's user ben at site hall
      "*@lab": viewer             # everybody at site lab
    roles:
      administrator: {see: "*", command: "*", create: "*", release: "*", resume: "*", administrate: yes}
      viewer: {see: "*"}
      operator:
        see: "*"
        command:
          - "arm-*"               # all commands of each robot whose name begins with arm-
          - rover-1.move          # one command
          - {kind: Limb, site: hall, command: [follow, home]}

    assistants:                   # language models with a key (`robotree assistant invite claude`)
      claude: {role: helper, calls: 30, metres: 20, seconds: 600, gone: hold}

An assistant never may more than the user whose process serves it, and of the rights only `see`, `command` and
`ask`: what a line of `ask` allows needs a person's yes to each single call (`permit.py`).

What no line allows is denied: there are no lines that deny, so their order does not matter. Everybody may
stop, whatever is written. In a pattern `*` stands for any characters, at most once; a pattern is compared
with the whole name. In a mapping all that is written must fit.

`RIGHTS` is the one list of rights: a right that is added there can be written in a policy, is shown by
`robotree may` and checked by `may`. Which request needs which right says `vr/exchange/authority.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import Final, Literal, NamedTuple

import msgspec

from robotree.vr.base.errors import PermitRefused
from robotree.vr.base.permit import PermittedCall
from robotree.vr.base.principal import Principal

STOP: Final = "stop"
"""What everybody may."""

LONGEST: Final = 1 << 18
"""[bytes] of a policy."""

ABOUT: Final = b"robotree policy 1\0"
"""What is signed begins with it, so that no other signature counts for a policy."""

ASK: Final = "ask"
"""What an assistant may have carried out once a person has said yes to this one call."""

OF_ASSISTANTS: Final = (STOP, "see", "command", ASK)
"""The rights that an assistant can have: it never resumes, shapes the tree or changes the policy."""

ANYBODY: Final = "*"
"""As a person: each member, and each user of the machine; as a pattern: each name."""

REALM: Final = "realm"
"""The role of the target of a right that concerns the realm as a whole."""


class Right(NamedTuple):
    """One right that a policy can give."""

    name: str
    roles: tuple[str, ...]
    """What it concerns: roles of agents, or `REALM`."""
    help: str


RIGHTS: Final = (
    Right("see", ("robot", "view", "space", "host"), "read its description, state, log, history or pictures"),
    Right(
        "command",
        ("robot", "space"),
        "have commands carried out, end them, pause them, and put a robot on top",
    ),
    Right(
        ASK, ("robot",), "of an assistant: have a command carried out after a person's yes to this one call"
    ),
    Right("take", ("robot",), "take control of a robot from the operator who has it"),
    Right("order", ("robot",), "leave commands for when it is here and free, and cancel such orders"),
    Right("create", ("host",), "make virtual robots, or give one another page, on this host"),
    Right("release", ("robot",), "release its children, and delete it"),
    Right("migrate", ("robot",), "have it move to another host"),
    Right("resume", ("robot",), "resume after a protective stop"),
    Right("administrate", (REALM,), "change the policy"),
)
"""The rights, in the order in which they are shown. A new verb joins with one line."""

BY_NAME: Final = {right.name: right for right in RIGHTS}


class Person(NamedTuple):
    """A person, or the system's user whose process asks, as a policy names both."""

    name: str
    """`anna`: on one machine the system's user; in a realm with keys the person with this key. `anna@lab`:
    the system's user anna at site lab."""
    site: str = ""
    """Of a system's user in a realm with keys; else empty."""
    roles: tuple[str, ...] = ()
    """That the authority wrote into the key (`realm invite --may`)."""
    assistant: str = ""
    """The assistant that this user's process serves, and that asks; empty: the person itself asks."""

    def __str__(self) -> str:
        """Return how people are told of it."""
        return f"{self.assistant}, an assistant that {self.name} serves," if self.assistant else self.name


WhenGone = Literal["hold", "stop", "finish"]
"""What becomes of the commands of an assistant that is gone. hold: they end, and the robots hold still. stop:
a protective stop of those robots. finish: they go on to their end."""


class AssistantTerms(NamedTuple):
    """What a policy says of one assistant."""

    roles: tuple[RoleOf, ...] = ()
    calls: int = 60
    """Calls that it may make in a minute."""
    metres: float = 100.0
    """[m] that its commands may move robots in an hour."""
    seconds: float = 1800.0
    """[s] for which its commands may run in an hour."""
    gone: WhenGone = "hold"


class PolicyTarget(NamedTuple):
    """What is asked for."""

    name: str = ""
    """Of the agent; empty: the realm as a whole."""
    role: str = "robot"
    kinds: tuple[str, ...] = ()
    command: str = ""
    """Of the robot; empty: all of its commands."""
    site: str = ""
    """Where it is; empty: the realm has no sites."""

    def __str__(self) -> str:
        """Return how people write it."""
        place = f"{self.site}:" if self.site else ""
        name = self.name if self.role == "robot" else f"{self.role} {self.name}".strip()
        return f"{place}{name}" + (f".{self.command}" if self.command else "")


class Decision(NamedTuple):
    """Whether something is allowed, and why."""

    allowed: bool
    line: int
    """Of the policy: the one that allows it, or the one that comes nearest; 0: there is none."""
    reason: str
    """A clause that names the line."""


class PolicyRule(msgspec.Struct, frozen=True):
    """What one line of a role allows."""

    right: str
    line: int
    text: str
    """As it is written."""
    names: tuple[str, ...] = (ANYBODY,)
    roles: tuple[str, ...] = ()
    """Of agents; empty: those that the right concerns."""
    kinds: tuple[str, ...] = ()
    """Empty: any."""
    commands: tuple[str, ...] = ()
    """Empty: all."""
    sites: tuple[str, ...] = ()
    """Empty: any."""

    def fits(self, target: PolicyTarget) -> bool:
        """Whether it allows this."""
        if target.role not in (self.roles or BY_NAME[self.right].roles):
            return False
        if target.role == REALM:
            return True
        if not any(fits(pattern, target.name) for pattern in self.names):
            return False
        if self.sites and not any(fits(pattern, target.site) for pattern in self.sites):
            return False
        if self.kinds and not any(fits(pattern, kind) for pattern in self.kinds for kind in target.kinds):
            return False
        return not self.commands or any(
            pattern == ANYBODY or (target.command != "" and fits(pattern, target.command))
            for pattern in self.commands
        )


class RoleOf(NamedTuple):
    """A role that a person has, and the line that says so; 0: the person's key does."""

    role: str
    line: int


class Policy:
    """What one file says; made by `policy_reading.read_policy`, and never changed."""

    def __init__(
        self,
        realm: str,
        version: int,
        ask: str,
        persons: Mapping[str, tuple[RoleOf, ...]],
        roles: Mapping[str, tuple[PolicyRule, ...]],
        text: str,
        assistants: Mapping[str, AssistantTerms] | None = None,
    ) -> None:
        """Take what was read."""
        self.realm, self.version, self.text = realm, version, text
        self.persons, self.roles, self.assistants = persons, roles, assistants or {}
        self.ask = ask or self._administrators()
        self._known: dict[tuple[Person, str, PolicyTarget], Decision] = {}

    def roles_of(self, asker: Person) -> list[RoleOf]:
        """Return the roles of a person, and which lines say so."""
        if asker.assistant:
            return list(self.assistants.get(asker.assistant, AssistantTerms()).roles)
        written = [ANYBODY] if "*" in asker.name else [asker.name, ANYBODY]  # nobody is called like a pattern
        if asker.site:
            written.insert(-1, f"{ANYBODY}@{asker.site}")
        found = [role for name in written for role in self.persons.get(name, ())]
        return found + [RoleOf(role, 0) for role in asker.roles]

    def may(self, asker: Person, right: str, target: PolicyTarget) -> Decision:
        """Decide whether somebody may do something.

        Args:
            asker: who asks.
            right: `stop`, or the name of one of `RIGHTS`.
            target: with what.

        Raises:
            KeyError: there is no such right.
        """
        known = self._known.get((asker, right, target))
        if known is None:
            if len(self._known) >= MOST_KNOWN:
                self._known.clear()
            known = self._known[asker, right, target] = self._decide(asker, right, target)
        return known

    def may_anybody_of(self, site: str, right: str, target: PolicyTarget, roles: Sequence[str] = ()) -> bool:
        """Whether any person may do something who asks from a site.

        Args:
            site: its name, or that of a person's machine.
            right: as for `may`.
            target: with what.
            roles: in the key of the site.
        """
        names = {site, ANYBODY, *(name for name in self.persons if name.endswith(f"@{site}"))}
        held = {each.role for name in names for each in self.persons.get(name, ())} | set(roles)
        return right == STOP or any(rule.fits(target) for rule in self._rules(held, right))

    def asks_for_kinds(self, right: str) -> bool:
        """Whether any line for a right is about kinds."""
        return any(rule.kinds for rules in self.roles.values() for rule in rules if rule.right == right)

    def names(self, asker: Person) -> bool:
        """Whether any line concerns somebody; all others are guests."""
        return any(self.roles.get(each.role) for each in self.roles_of(asker))

    def _rules(self, roles: Iterable[str], right: str) -> Iterator[PolicyRule]:
        return (rule for role in roles for rule in self.roles.get(role, ()) if rule.right == right)

    def _decide(self, asker: Person, right: str, target: PolicyTarget) -> Decision:
        if right == STOP:
            return Decision(True, 0, "everybody may stop")
        BY_NAME[right]
        if asker.assistant and (refused := self._beyond(asker, right, target)):
            return refused
        held = self.roles_of(asker)
        others: list[PolicyRule] = []
        for each in held:
            for rule in self._rules((each.role,), right):
                if rule.fits(target):
                    reason = f"line {rule.line} allows {right}: {rule.text} (role {each.role})"
                    return Decision(True, rule.line, reason)
                others.append(rule)
        if others:
            texts = list(dict.fromkeys(rule.text for rule in others))
            more = " and others" if len(texts) > SHOWN else ""
            allowed = ", ".join(texts[:SHOWN]) + more
            return Decision(False, others[0].line, f"line {others[0].line} allows {right} only of {allowed}")
        if not held:
            who = f"assistant {asker.assistant}" if asker.assistant else asker.name
            return Decision(False, 0, f"no line names {who}, and a guest may only stop")
        line = next((each.line for each in held if each.line), 0)
        which = ", ".join(dict.fromkeys(each.role for each in held))
        says = f"line {line} gives the role {which}" if line else f"its key gives the role {which}"
        unknown = not any(self.roles.get(each.role) for each in held)
        return Decision(
            False, line, f"{says}, " + ("which has no line" if unknown else f"without any line for {right}")
        )

    def _beyond(self, asker: Person, right: str, target: PolicyTarget) -> Decision | None:
        """Return why an assistant may not, whatever is written of itself; None: that decides."""
        if right not in OF_ASSISTANTS:
            return Decision(False, 0, f"no assistant may {right}, whatever is written")
        served = self.may(asker._replace(assistant=""), "command" if right == ASK else right, target)
        return (
            None if served.allowed else Decision(False, served.line, f"{asker.name} may not: {served.reason}")
        )

    def _administrators(self) -> str:
        able = {
            role for role, rules in self.roles.items() if any(rule.right == "administrate" for rule in rules)
        }
        found = [name for name, held in self.persons.items() if any(each.role in able for each in held)]
        return ", ".join(found[:3]) or "who made the realm"


MOST_KNOWN: Final = 4096
"""Decisions that a policy remembers."""

SHOWN: Final = 3
"""Patterns that a denial quotes."""


def fits(pattern: str, name: str) -> bool:
    """Whether a pattern, in which `*` stands for any characters, once at most, fits a whole name."""
    begin, star, end = pattern.partition("*")
    if not star:
        return pattern == name
    return len(name) >= len(begin) + len(end) and name.startswith(begin) and name.endswith(end)


class PolicyGate:
    """The policy of a realm as one process knows it now, and how that process is called in it.

    This one is that of a realm without a policy; `PolicyFile` reads one from the disk.
    """

    policy: Policy | None = None
    """None: there is none, and everybody of this system's user may do everything."""
    trouble: str = ""
    """Why the policy that there is cannot be used, as a clause: then everybody may stop, and nothing else."""
    site: str = ""
    """The member of the realm to which this machine belongs; empty: the realm has no keys."""
    person: bool = False
    """Whether that member is a person."""
    roles: tuple[str, ...] = ()
    """In its key."""
    owner: int | None = None
    """Number of the user to whom the realm's folder belongs, if several users share it; None: nobody else
    is in the realm."""
    apart: bool = False
    """Whether this is the process of a robot apart: its host puts permits into the calls for it."""
    due: float = float("inf")
    """[s] on the monotonic clock: when `refresh` has to look again."""

    @cached_property
    def kinds_of(self) -> dict[str, Callable[[], tuple[str, ...]]]:
        """The kinds of the robots of this process, by name: a line may be about them. Of a shared realm."""
        return {}

    data: bytes = b""
    """The file in force, with its signature; empty: there is none."""

    def offer(self, data: bytes) -> bool:
        """Put a file in force that another site has sent; returns whether it is newer, and now in force.

        Raises:
            VrError: it cannot be used.
            OSError: it cannot be kept.
        """
        del data
        return False

    def refresh(self, now: float) -> None:
        """Read the policy anew if that is due and it has changed [now in s]."""

    @property
    def closed(self) -> bool:
        """Whether anything is to be decided at all."""
        return self.policy is not None or self.trouble != ""

    def asker(self, principal: Principal) -> Person:
        """Return who asks, as a policy names persons."""
        return self._served(principal)._replace(assistant=principal.assistant)

    def _served(self, principal: Principal) -> Person:
        if principal.site:
            if principal.member:
                return Person(principal.user, "", principal.roles)
            return Person(f"{principal.user}@{principal.site}", principal.site, principal.roles)
        return self.user(principal.user)

    def user(self, name: str) -> Person:
        """Return a user of this machine, as a policy names persons."""
        if not self.site:
            return Person(name)
        return (
            Person(self.site, "", self.roles)
            if self.person
            else Person(f"{name}@{self.site}", self.site, self.roles)
        )

    def expect_permit(self, asker: Person, call: PermittedCall) -> None:
        """Check that a person has said yes to a call of an assistant, and that it has begun with that yes.

        Raises:
            PermitRefused: nobody has, or it was another call.
        """
        del asker
        raise PermitRefused(permit=call.permit or "none", reason="nobody here knows of permits")

    def may(self, asker: Person, right: str, target: PolicyTarget) -> Decision:
        """Decide whether somebody may do something; see `Policy.may`."""
        if self.policy is not None:
            return self.policy.may(asker, right, target)
        if self.trouble and right != STOP:
            return Decision(False, 0, self.trouble)
        if asker.assistant and right != STOP:
            return Decision(False, 0, "the realm has no policy, and an assistant may only what one allows")
        return Decision(True, 0, "the realm has no policy")

    @property
    def ask(self) -> str:
        """Whom to ask for a right."""
        return self.policy.ask if self.policy is not None else "who made the realm"


OPEN: Final = PolicyGate()
"""Of a realm without a policy."""
