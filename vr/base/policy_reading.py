"""Reading the policy of a realm from the YAML that people write; what it means says `policy.py`. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, get_args

from robotree.vr.base.policy import (
    ANYBODY,
    ASK,
    BY_NAME,
    LONGEST,
    REALM,
    RIGHTS,
    AssistantTerms,
    Policy,
    PolicyRule,
    Right,
    RoleOf,
    WhenGone,
)
from robotree.vr.base.written import (
    Entries,
    Mark,
    Word,
    Written,
    entries,
    items,
    read,
    suggestion,
    value_of,
    word,
)

_NAME = re.compile(r"[A-Za-z0-9_-]*\*?[A-Za-z0-9_-]*")
_ROLE = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,63}")
_ASSISTANT = re.compile(r"[A-Za-z0-9_-]{1,24}")
_TOP = ("realm", "version", "ask", "persons", "assistants", "roles")
_TERMS = ("role", "calls", "metres", "seconds", "gone")
OF_COMMANDS = frozenset({"command", "order", ASK})
"""Rights that may be given for single commands."""
LARGEST = 1_000_000
"""Of a limit of an assistant."""
_PARTS = ("name", "kind", "command", "site", "role")


def read_policy(text: str, path: str = "policy.yaml") -> Policy:
    """Read a policy.

    Args:
        text: of the file.
        path: where it lies, for messages.

    Raises:
        BrokenScript: it cannot be used; says where and why, in one sentence.
    """
    if len(text.encode(errors="replace")) > LONGEST:
        raise Mark(path, 1, 1).error(f"a policy has {LONGEST} bytes at most")
    top = read(text, path)
    start = Mark(path, 1, 1)
    if not isinstance(top, Entries):
        raise start.error("a policy is written as `name: value`")
    top.expect(_TOP, "a policy")
    realm = word(top.get("realm"), "realm: the name of the realm", start)
    number = word(top.get("version"), "version: a number that grows with each change", start)
    version = value_of(number)
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise number.mark.error("version must be a whole number from 1 on")
    roles = {
        _role(name): tuple(_rules_of(entries(rights, f"role {name.text}", name.mark)))
        for name, rights in entries(top.get("roles"), "roles", start)
    }
    persons = {
        _person(name): tuple(RoleOf(_known(each, roles), name.mark.line) for each in _words(held, name.mark))
        for name, held in entries(top.get("persons"), "persons", start)
    }
    assistants = {
        _assistant(name): _terms(told, name.mark, roles)
        for name, told in entries(top.get("assistants"), "assistants", start)
    }
    ask = "" if top.get("ask") is None else word(top.get("ask"), "ask", start).text
    return Policy(realm.text, version, ask, persons, roles, text, assistants)


def _assistant(name: Word) -> str:
    if not _ASSISTANT.fullmatch(name.text):
        raise name.mark.error(
            f"{name.text!r} cannot be the name of an assistant: use up to 24 letters, digits, - and _"
        )
    return name.text


def _terms(told: Written, where: Mark, roles: Mapping[str, object]) -> AssistantTerms:
    """Read what is said of one assistant: its roles, or a mapping with its limits, too."""
    if not isinstance(told, Entries):
        return AssistantTerms(tuple(RoleOf(_known(each, roles), where.line) for each in _words(told, where)))
    told.expect(_TERMS, "an assistant")
    held = told.get("role")
    named = (
        () if held is None else tuple(RoleOf(_known(each, roles), where.line) for each in _words(held, where))
    )
    limits: dict[str, Any] = {}
    for name in ("calls", "metres", "seconds"):
        if (given := told.get(name)) is not None:
            limit = word(given, name, where)
            number = value_of(limit)
            if isinstance(number, bool) or not isinstance(number, int | float) or not 0 <= number < LARGEST:
                raise limit.mark.error(f"{name} is a number from 0 to {LARGEST}")
            limits[name] = int(number) if name == "calls" else float(number)
    if (given := told.get("gone")) is not None:
        choice = word(given, "gone", where)
        if choice.text not in get_args(WhenGone):
            raise choice.mark.error(f"gone is one of {', '.join(get_args(WhenGone))}")
        limits["gone"] = choice.text
    return AssistantTerms(named, **limits)


def _role(name: Word) -> str:
    if not _ROLE.fullmatch(name.text):
        raise name.mark.error(f"{name.text!r} cannot be the name of a role: use letters, digits, - and _")
    return name.text


def _known(role: Word, roles: Mapping[str, object]) -> str:
    if role.text not in roles:
        raise role.mark.error(f"there is no role {role.text!r}{suggestion(role.text, roles)} in this policy")
    return role.text


def _person(name: Word) -> str:
    user, _, site = name.text.rpartition("@") if "@" in name.text else (name.text, "", "")
    if not user or "*" in site or ("*" in user and user != ANYBODY) or name.text.endswith("@"):
        raise name.mark.error(
            f"{name.text!r} names nobody: write a person, user@site, '*@site' (all of a site) or '*' (all)"
        )
    return name.text


def _rules_of(rights: Entries) -> Iterator[PolicyRule]:
    rights.expect(tuple(BY_NAME), "a role")
    for name, what in rights:
        right = BY_NAME[name.text]
        if right.roles == (REALM,):
            given = value_of(word(what, right.name, name.mark))
            if not isinstance(given, bool):
                raise name.mark.error(f"{right.name} is yes or no")
            if given:
                yield PolicyRule(right.name, name.mark.line, "yes")
            continue
        for each in items(what, name.mark).items:
            yield _rule(right, each)


def _rule(right: Right, thing: Written) -> PolicyRule:
    if isinstance(thing, Entries):
        return _rule_of_parts(right, thing)
    pattern = word(thing, right.name, thing.mark)
    site, colon, rest = pattern.text.rpartition(":")
    name, dot, command = rest.partition(".")
    if dot and right.name not in OF_COMMANDS:
        raise pattern.mark.error(
            f"only command, order and ask take ROBOT.COMMAND; {right.name} concerns the whole robot"
        )
    for part, there in ((site, colon), (name, "."), (command, dot)):
        if there:
            _check(part, pattern)
    return PolicyRule(
        right.name,
        pattern.mark.line,
        pattern.text,
        names=(name,),
        commands=(command,) if dot else (),
        sites=(site,) if colon else (),
    )


def _rule_of_parts(right: Right, parts: Entries) -> PolicyRule:
    parts.expect(_PARTS, f"a line of {right.name}")
    found: dict[str, tuple[str, ...]] = {}
    for name, value in parts:
        words = _words(value, name.mark)
        if not words:
            raise name.mark.error(f"{name.text} is empty: write a pattern, or leave it out")
        for each in words:
            _check(each.text, each)
        found[name.text] = tuple(each.text for each in words)
    if not found:
        raise parts.mark.error('{} allows nothing: write "*" for everything')
    if "command" in found and right.name not in OF_COMMANDS:
        raise parts.mark.error(
            f"only command, order and ask are about commands; {right.name} concerns the whole robot"
        )
    for role in found.get("role", ()):
        if role not in right.roles:
            raise parts.mark.error(f"{right.name} concerns {', '.join(right.roles)}, no {role}")
    text = ", ".join(f"{name}: {' '.join(words)}" for name, words in found.items())
    return PolicyRule(
        right.name,
        parts.mark.line,
        f"{{{text}}}",
        names=found.get("name", (ANYBODY,)),
        roles=found.get("role", ()),
        kinds=found.get("kind", ()),
        commands=found.get("command", ()),
        sites=found.get("site", ()),
    )


def _check(part: str, where: Word) -> None:
    if not part or not _NAME.fullmatch(part):
        raise where.mark.error(
            f"{where.text!r} is no pattern: a name with letters, digits, - and _, and at most one *"
        )


def _words(thing: Written, where: Mark) -> list[Word]:
    return [word(each, "this", where) for each in items(thing, where).items]


def schema() -> dict[str, Any]:
    """Return the JSON schema of a policy (draft 2020-12), for editors."""
    name = {"type": "string", "pattern": r"^[A-Za-z0-9_-]*\*?[A-Za-z0-9_-]*$", "minLength": 1}
    names = {"oneOf": [name, {"type": "array", "items": name, "minItems": 1}]}
    role = {"type": "string", "pattern": f"^{_ROLE.pattern}$"}

    def of(right: Right) -> dict[str, Any]:
        if right.roles == (REALM,):
            return {"type": "boolean", "description": right.help}
        parts = [part for part in _PARTS if part != "command" or right.name in OF_COMMANDS]
        mapping = {
            "type": "object",
            "properties": dict.fromkeys(parts, names),
            "additionalProperties": False,
            "minProperties": 1,
        }
        one = {"oneOf": [{"type": "string", "minLength": 1}, mapping]}
        return {"description": right.help, "oneOf": [*one["oneOf"], {"type": "array", "items": one}]}

    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "Policy of a robotree realm",
        "type": "object",
        "required": ["realm", "version"],
        "additionalProperties": False,
        "properties": {
            "realm": {"type": "string"},
            "version": {"type": "integer", "minimum": 1},
            "ask": {"type": "string", "description": "whom to ask for a right"},
            "persons": {
                "type": "object",
                "additionalProperties": {"oneOf": [role, {"type": "array", "items": role}]},
            },
            "assistants": {
                "type": "object",
                "additionalProperties": {
                    "oneOf": [role, {"type": "array", "items": role}, _schema_of_terms(role)],
                },
            },
            "roles": {
                "type": "object",
                "propertyNames": role,
                "additionalProperties": {
                    "type": "object",
                    "properties": {right.name: of(right) for right in RIGHTS},
                    "additionalProperties": False,
                },
            },
        },
    }


def _schema_of_terms(role: dict[str, Any]) -> dict[str, Any]:
    number = {"type": "number", "minimum": 0, "exclusiveMaximum": LARGEST}
    return {
        "type": "object",
        "additionalProperties": False,
        "properties": {
            "role": {"oneOf": [role, {"type": "array", "items": role}]},
            "calls": {**number, "description": "calls a minute"},
            "metres": {**number, "description": "[m] that its commands move robots in an hour"},
            "seconds": {**number, "description": "[s] for which its commands run in an hour"},
            "gone": {"enum": list(get_args(WhenGone)), "description": "what its commands do when it is gone"},
        },
    }
