"""Profiles: what a role says, how it moves, and which limits it keeps. Pure.

role: child
inherits: person
doc: A child that helps.
manner: {voice: child-1, pitch: 1.3}      # of every act
acts:
  wave: {times: 4}                        # of one act
words:
  Welcome: Hi                             # said instead
limits: {speed: 0.3 }                     # may only be narrower than the robot's own
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.resources import files

import msgspec

from robotree.vr.author.virtual_robot import expect_lendable
from robotree.vr.base.written import Entries, Mark, Scalar, Word, entries, read, value_of, word

KEYS = ("role", "inherits", "doc", "manner", "acts", "words", "limits")
LONGEST_CHAIN = 8
"""Roles that inherit one from another."""


class Profile(msgspec.Struct, frozen=True, kw_only=True):
    """One role."""

    name: str
    inherits: str = ""
    doc: str = ""
    manner: dict[str, Scalar] = {}
    acts: dict[str, dict[str, Scalar]] = {}
    words: dict[str, str] = {}
    limits: dict[str, float] = {}
    chain: tuple[str, ...] = ()
    """The role itself and those that it inherits from, when it has been resolved."""
    mark: Mark = Mark()


def read_profile(source: str, path: str) -> Profile:
    """Read one role.

    Raises:
        BrokenScript: it cannot be used, and where.
    """
    root = read(source, path)
    if not isinstance(root, Entries):
        raise root.mark.error("a role is written as `name: value`, and begins with `role: NAME`")
    root.expect(KEYS, "a role")
    name = root.get("role")
    if name is not None and not isinstance(name, Word):
        raise name.mark.error("a role has one name: two roles cannot be played at once")
    inherits = root.get("inherits")
    if inherits is not None and not isinstance(inherits, Word):
        raise inherits.mark.error("a role inherits from one role")
    acts, limits = entries(root.get("acts"), "acts", root.mark), dict[str, float]()
    for key, given in entries(root.get("limits"), "limits", root.mark):
        number = value_of(word(given, "a limit", key.mark))
        if isinstance(number, bool) or not isinstance(number, int | float):
            raise given.mark.error(f"limit {key.text} must be a number")
        limits[key.text] = float(number)
    return Profile(
        name=word(name, "`role: NAME`", root.mark).text,
        inherits="" if inherits is None else inherits.text,
        doc=root.text("doc"),
        manner=root.named_values("manner", "a value"),
        acts={
            key.text: {
                name.text: value_of(word(one, "a value", name.mark))
                for name, one in entries(given, "an act", key.mark)
            }
            for key, given in acts
        },
        words=root.named_texts("words", "a text"),
        limits=limits,
        mark=root.mark,
    )


def resolve(name: str, known: Mapping[str, Profile]) -> Profile:
    """Return a role with all that it inherits; what it says itself counts.

    Of two values of a limit the caller takes the narrower one: see `RolePlayer`.

    Raises:
        BrokenScript: a role that it inherits from is not known, or they inherit in a circle.
        KeyError: the role itself is not known.
    """
    chain: list[Profile] = [known[name]]
    while chain[-1].inherits:
        last = chain[-1]
        if last.inherits not in known:
            there = ", ".join(sorted(known))
            raise last.mark.error(
                f"role {last.name} inherits from {last.inherits!r}, which is not known; known: {there}"
            )
        if any(one.name == last.inherits for one in chain) or len(chain) >= LONGEST_CHAIN:
            circle = " → ".join([*(one.name for one in chain), last.inherits])
            raise last.mark.error(f"these roles inherit in a circle: {circle}")
        chain.append(known[last.inherits])
    acts: dict[str, dict[str, Scalar]] = {}
    for one in reversed(chain):
        for act, values in one.acts.items():
            acts[act] = {**acts.get(act, {}), **values}
    return msgspec.structs.replace(
        chain[0],
        manner={key: value for one in reversed(chain) for key, value in one.manner.items()},
        acts=acts,
        words={key: value for one in reversed(chain) for key, value in one.words.items()},
        chain=tuple(one.name for one in chain),
    )


def lent_by(service: str, roles: Mapping[str, str]) -> dict[str, Profile]:
    """Return the roles that a service lends under the names by which robots know them: `SERVICE-ROLE`.

    Args:
        service: its name.
        roles: texts by their names in its page; one may inherit from another of them by that name.

    Raises:
        BrokenScript: one cannot be used, or calls itself otherwise.
        TypeError: they cannot be lent; see `expect_lendable`.
    """
    found: dict[str, Profile] = {}
    for name, text in expect_lendable(f"{service}.lends", roles).items():
        profile, known = read_profile(text, f"{service}-{name}"), f"{service}-{name}"
        if profile.name != name:
            raise profile.mark.error(f"it is called {profile.name!r} here, and {name!r} by the service")
        inherits = profile.inherits
        inherits = f"{service}-{inherits}" if inherits in roles else inherits
        found[known] = msgspec.structs.replace(profile, name=known, inherits=inherits)
    return found


def shipped() -> dict[str, Profile]:
    """Return the roles that come with robotree: butler, maid, man, woman, child."""
    folder = files("robotree.vr.scripts.roles").joinpath("profiles")
    found = (
        read_profile(one.read_text(), one.name) for one in folder.iterdir() if one.name.endswith(".yaml")
    )
    return {one.name: one for one in sorted(found, key=lambda one: one.name)}
