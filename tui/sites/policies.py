"""The verbs about the policy of a realm: `robotree policy show`, `check` and `set`."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from robotree.files import replace
from robotree.files.opening import text as text_of
from robotree.tui import exit_codes
from robotree.tui.line.grammar import Line
from robotree.tui.processes.state_files import needed_file
from robotree.tui.terminal import answer
from robotree.vr.base.errors import Denied, PolicyUnusable
from robotree.vr.base.policy import BY_NAME, LONGEST, REALM, Policy, PolicyTarget, fits
from robotree.vr.base.policy_reading import read_policy, schema
from robotree.vr.base.principal import user_name
from robotree.vr.network.policy_file import KEYS, POLICY, SIGNED, PolicyFile, member_of
from robotree.vr.network.realms import present_in, realm_folder
from robotree.vr.network.shared import FILE, policy_of


def gate_of(realm: str) -> PolicyFile:
    """Return the policy in force on this machine."""
    gate = policy_of(realm)
    gate.refresh(time.monotonic())
    return gate


def expect_to_administrate(realm: str) -> None:
    """Refuse a user of this machine who may not administrate the realm; without a policy its user may.

    Raises:
        Denied: the policy does not allow it.
    """
    gate = gate_of(realm)
    asker, target = gate.user(user_name(os.geteuid())), PolicyTarget("", REALM)
    found = gate.may(asker, "administrate", target)
    if gate.policy is not None and not found.allowed:
        raise Denied(
            who=asker.name, right="administrate", target=f"realm {realm}", reason=found.reason, ask=gate.ask
        )


def show(line: Line, realm: str) -> int:
    """Print the policy of a realm."""
    if line.flag("--schema"):
        import json

        answer(json.dumps(schema(), indent=2), schema)
        return exit_codes.DONE
    gate = gate_of(realm)
    if gate.trouble:
        raise PolicyUnusable(path=str(gate.path), reason=gate.trouble)
    if gate.policy is None:
        text = f"realm {realm} has no policy: everybody of this system's user may do everything in it"
        answer(text, lambda: {"realm": realm, "version": 0})
        return exit_codes.DONE
    policy, me = gate.policy, gate.user(user_name(os.geteuid()))
    roles = ", ".join(dict.fromkeys(each.role for each in policy.roles_of(me))) or "guest: it may only stop"
    about = f"# {gate.path}\n# you are {me.name} ({roles})\n"
    answer(
        about + policy.text.rstrip(),
        lambda: {"realm": realm, "version": policy.version, "path": str(gate.path), "text": policy.text},
    )
    return exit_codes.DONE


def check(line: Line, realm: str) -> int:
    """Check a policy, and print whom each line means now."""
    path = line.text("FILE")
    policy = _read(path)
    rows = list(_rows(policy, present_in(realm_folder(realm))))
    text = [f"{path}: version {policy.version} of realm {policy.realm} can be used; ask {policy.ask}"]
    text += [
        f"line {row['line']}: {row['role']}: {row['right']} {row['text']}"
        + (f"  (now: {', '.join(row['now']) or 'nobody'})" if row["now"] is not None else "")
        for row in rows
    ]
    text += [f"note: {each}" for each in _doubtful(policy)]
    answer("\n".join(text), lambda: {"version": policy.version, "lines": rows, "notes": _doubtful(policy)})
    return exit_codes.DONE


def _rows(policy: Policy, there: Mapping[str, Sequence[str]]) -> Any:
    """Say of each line whom it means now; what is present has no kinds, so of a line about them nobody can.

    Args:
        policy: whose lines.
        there: names of the agents that are present, by role.
    """
    for role, rules in policy.roles.items():
        for rule in rules:
            names = [name for each in rule.roles or BY_NAME[rule.right].roles for name in there.get(each, ())]
            now = None
            if not rule.kinds and rule.right != "administrate":
                now = [name for name in dict.fromkeys(names) if any(fits(each, name) for each in rule.names)]
            yield {"line": rule.line, "role": role, "right": rule.right, "text": rule.text, "now": now}


def _doubtful(policy: Policy) -> list[str]:
    """Return what the writer may not have meant, as sentences."""
    held = {each.role for roles in policy.persons.values() for each in roles}
    found = [
        f"nobody in persons has the role {role}; keys can have it (`realm invite --may`)"
        for role in policy.roles
        if role not in held
    ]
    able = {
        role for role, rules in policy.roles.items() if any(rule.right == "administrate" for rule in rules)
    }
    if not able & held:
        found.append("nobody may administrate: the next policy can be set only by who removes this file")
    return found


def _read(path: str) -> Policy:
    """Read a policy that a person has written; the signature of an earlier one is left out.

    Raises:
        PolicyUnusable: the file cannot be read.
        BrokenScript: it cannot be understood.
    """
    try:
        given = text_of(Path(path), LONGEST)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is no UTF-8 text"
        raise PolicyUnusable(path=path, reason=str(reason)) from None
    return read_policy(given.rpartition(SIGNED)[0] or given, path)


def set_(line: Line, realm: str) -> int:
    """Put a policy in force."""
    path, policy, gate = line.text("FILE"), _read(line.text("FILE")), gate_of(realm)
    if policy.realm != realm:
        raise PolicyUnusable(path=path, reason=f"it is that of realm {policy.realm}, and this one is {realm}")
    if gate.policy is not None and policy.version <= gate.policy.version:
        reason = f"its version {policy.version} is not higher than {gate.policy.version}, which is in force"
        raise PolicyUnusable(path=path, reason=reason)
    expect_to_administrate(realm)
    me = gate.user(user_name(os.geteuid()))
    if not policy.may(me, "administrate", PolicyTarget("", REALM)).allowed:
        reason = f"with it {me.name} could not set another one; give yourself administrate"
        raise PolicyUnusable(path=path, reason=reason)
    place = needed_file(realm, POLICY)
    text = policy.text if policy.text.endswith("\n") else f"{policy.text}\n"
    data = _signed(place.parent, text).encode()
    replace(place, data, 0o600)
    if gate.kept != gate.path.parent:  # shared with other users
        replace(gate.path, data, FILE)
    answer(
        f"version {policy.version} is in force within a second, in each process of this realm",
        lambda: {"realm": realm, "version": policy.version, "path": str(place)},
    )
    return exit_codes.DONE


def _signed(folder: Path, text: str) -> str:
    """Return a policy with the signature of the authority; in a realm without keys it needs none."""
    if member_of(folder / KEYS) is None:
        return text
    from robotree.vr.sites.keys import RealmKeys

    return f"{text}{SIGNED}{RealmKeys(folder / KEYS).sign_policy(text.encode()).hex()}\n"
