"""What a policy decides: a person may what a line says, everybody may stop, and nothing else is allowed."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from robotree.tui.line.action import RIGHT_NAMES
from robotree.vr.base.errors import BrokenScript
from robotree.vr.base.policy import (
    BY_NAME,
    REALM,
    RIGHTS,
    STOP,
    Person,
    Policy,
    PolicyGate,
    PolicyTarget,
    fits,
)
from robotree.vr.base.policy_reading import read_policy, schema
from robotree.vr.base.requests import AnyRequest
from robotree.vr.exchange.authority import AGENTS, ANYBODY, MEMBER, NEEDS

GUIDE = (Path(__file__).parents[3] / "docs" / "policy.md").read_text()
EXAMPLE = re.search(r"```yaml\n(.*?)```", GUIDE, re.DOTALL)
assert EXAMPLE

TEXT = """
realm: plant
version: 3
persons:
  anna: administrator
  ben@hall: [operator]
  "*@lab": viewer
roles:
  administrator: {see: "*", command: "*", create: "*", release: "*", resume: "*", administrate: yes}
  viewer: {see: "*"}
  operator:
    see: "*"
    command:
      - "arm-*"
      - rover-1.move
      - {kind: Limb, site: hall, command: [follow, home]}
    create: host-1
"""
BEN = Person("ben@hall", "hall")


def allowed(policy: Policy, person: Person, right: str, **target: Any) -> bool:
    return policy.may(person, right, PolicyTarget(**target)).allowed


@pytest.mark.parametrize(
    ("right", "target", "line"),
    [
        ("command", {"name": "arm-1", "command": "move"}, 14),
        ("command", {"name": "arm-1"}, 14),
        ("command", {"name": "rover-1", "command": "move"}, 15),
        ("command", {"name": "left", "kinds": ("Limb",), "command": "home", "site": "hall"}, 16),
        ("create", {"name": "host-1", "role": "host"}, 17),
        ("see", {"name": "cell", "role": "view"}, 12),
        (STOP, {"name": "rover-1"}, 0),
    ],
)
def test_what_a_line_says_is_allowed_and_that_line_is_named(right: str, target: Any, line: int) -> None:
    found = read_policy(TEXT).may(BEN, right, PolicyTarget(**target))
    assert (found.allowed, found.line) == (True, line)


@pytest.mark.parametrize(
    ("right", "target"),
    [
        ("command", {"name": "arm"}),
        ("command", {"name": "my-arm-1"}),
        ("command", {"name": "Arm-1"}),
        ("command", {"name": "rover-1", "command": "turn"}),
        ("command", {"name": "rover-1"}),  # one command is not the whole robot: nobody enslaves with it
        ("command", {"name": "rover-1", "command": "move_away"}),
        ("command", {"name": "rover-10", "command": "move"}),
        ("command", {"name": "left", "kinds": ("Limb",), "command": "home", "site": "lab"}),
        ("command", {"name": "left", "kinds": ("LimbWithHand",), "command": "home", "site": "hall"}),
        ("command", {"name": "left", "kinds": ("Limb",), "site": "hall"}),
        ("create", {"name": "host-10", "role": "host"}),
        ("create", {"name": "host-1", "role": "robot"}),
        ("release", {"name": "arm-1"}),
        ("resume", {"name": "arm-1"}),
        ("administrate", {"role": REALM}),
    ],
)
def test_what_no_line_says_is_denied(right: str, target: Any) -> None:
    assert not allowed(read_policy(TEXT), BEN, right, **target)


def test_a_refusal_names_the_line_and_whom_to_ask() -> None:
    policy = read_policy(TEXT)
    found = policy.may(BEN, "command", PolicyTarget("rover-1", command="turn"))
    assert found == (
        False, 14,
        "line 14 allows command only of arm-*, rover-1.move, {kind: Limb, site: hall, command: follow home}",
    )  # fmt: skip
    found = policy.may(BEN, "release", PolicyTarget("arm-1"))
    assert found == (False, 6, "line 6 gives the role operator, without any line for release")
    assert policy.ask == "anna"


@pytest.mark.parametrize("name", ["ben", "ben@lab2", "anna@hall", "Anna", "ben@hall@hall", "*", "*@lab", ""])
def test_who_is_named_by_no_line_is_a_guest(name: str) -> None:
    policy = read_policy(TEXT)
    guest = Person(name, name.rpartition("@")[2] if "hall" in name else "")
    assert not any(allowed(policy, guest, right, name="arm-1") for right in ("see", "command", "resume"))
    assert allowed(policy, guest, STOP, name="arm-1")
    assert not policy.names(guest)


def test_everybody_of_a_site_is_named_by_its_line_and_nobody_else() -> None:
    policy = read_policy(TEXT)
    assert allowed(policy, Person("eve@lab", "lab"), "see", name="arm-1")
    assert not allowed(policy, Person("eve@lab", "lab"), "command", name="arm-1")
    assert not allowed(policy, Person("x@lab", "hall"), "see", name="arm-1")  # a user called so, elsewhere


def test_a_role_in_a_key_counts_like_one_in_the_policy() -> None:
    policy = read_policy(TEXT)
    found = policy.may(Person("carl", "", ("viewer", "unknown")), "see", PolicyTarget("arm-1"))
    assert found.allowed
    assert "role viewer" in found.reason
    denied = policy.may(Person("carl", "", ("unknown",)), "see", PolicyTarget("arm-1"))
    assert denied.reason == "its key gives the role unknown, which has no line"


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("realm: x\nversion: 0", "version must be a whole number from 1 on"),
        ("realm: x\nversion: yes", "version must be a whole number from 1 on"),
        ("realm: x", "version: a number that grows with each change is missing"),
        ("version: 1", "realm: the name of the realm is missing"),
        ("realm: x\nversion: 1\npersons: {anna: oprator}\nroles: {operator: {}}", "did you mean 'operator'"),
        ("realm: x\nversion: 1\nroles: {a: {comand: x}}", "did you mean 'command'"),
        ("realm: x\nversion: 1\nroles: {a: {see: arm-1.move}}", "see concerns the whole robot"),
        ("realm: x\nversion: 1\nroles: {a: {see: 'a*b*'}}", "at most one *"),
        ("realm: x\nversion: 1\nroles: {a: {see: 'arm-[12]'}}", "is no pattern"),
        ("realm: x\nversion: 1\nroles: {a: {see: 'arm ?'}}", "is no pattern"),
        ("realm: x\nversion: 1\nroles: {a: {see: {}}}", 'write "\\*" for everything'),
        ("realm: x\nversion: 1\nroles: {a: {command: {name: []}}}", "name is empty"),
        ("realm: x\nversion: 1\nroles: {a: {create: {role: robot}}}", "create concerns host, no robot"),
        ("realm: x\nversion: 1\nroles: {a: {administrate: all}}", "administrate is yes or no"),
        ("realm: x\nversion: 1\npersons: {'an*': a}\nroles: {a: {}}", "names nobody"),
        ("realm: x\nversion: 1\npersons: {'*@*': a}\nroles: {a: {}}", "names nobody"),
        ("realm: x\nversion: 1\nroles: {a: {see: x, see: y}}", "stands here twice"),
        ("realm: x\nversion: 1\npersons: {anna: a, anna: b}\nroles: {a: {}, b: {}}", "stands here twice"),
        ("realm: x\nversion: 1\nassistants: {a/b: {}}", "cannot be the name of an assistant"),
        ("realm: x\nversion: 1\nassistants: {a: {calls: -1}}", "calls is a number from 0"),
        ("realm: x\nversion: 1\nassistants: {a: {gone: fly}}", "gone is one of hold, stop, finish"),
        ("realm: x\nversion: 1\nassistants: {a: nobody}", "there is no role 'nobody'"),
        ("- a", "a policy is written as `name: value`"),
        ("realm: x\nversion: 1\ndeny: {}", "a policy has no 'deny'"),
    ],
)
def test_a_policy_that_cannot_be_used_is_refused_with_its_line(line: str, reason: str) -> None:
    with pytest.raises(BrokenScript, match=reason) as refusal:
        read_policy(line, "plant.yaml")
    assert str(refusal.value).startswith("plant.yaml:")
    assert "\n" not in str(refusal.value)


def test_each_request_needs_a_right_that_there_is() -> None:
    assert set(get_args(AnyRequest)) == set(NEEDS), "a new request has no right: add a line to NEEDS"
    assert set(NEEDS.values()) <= {*BY_NAME, STOP, MEMBER, ANYBODY, AGENTS}


def test_the_guide_names_each_right_and_its_example_can_be_used() -> None:
    table = set(re.findall(r"^\| `(\w+)` \|", GUIDE, re.MULTILINE))
    assert table == set(BY_NAME)
    policy = read_policy(EXAMPLE[1])
    said = policy.may(Person("ben"), "command", PolicyTarget("rover-1", command="turn"))
    assert not said.allowed
    assert f"# ben may not command rover-1.turn: line {said.line} allows command only of" in GUIDE
    assert allowed(policy, Person("eve"), "see", name="arm-1")


def test_the_schema_has_each_right_and_refuses_what_reading_refuses() -> None:
    role = schema()["properties"]["roles"]["additionalProperties"]
    assert set(role["properties"]) == set(BY_NAME)
    assert role["additionalProperties"] is False
    assert set(schema()["properties"]) == {"realm", "version", "ask", "persons", "assistants", "roles"}


def test_a_realm_without_a_policy_is_closed_to_nobody() -> None:
    gate = PolicyGate()
    assert not gate.closed
    assert all(gate.may(Person("eve"), right.name, PolicyTarget("x")).allowed for right in RIGHTS)


# -- properties ------------------------------------------------------------------------------------

NAMES = st.sampled_from(["arm-1", "arm-2", "arm", "rover-1", "x"])
PATTERNS = st.sampled_from(["*", "arm-*", "arm-1", "*-1", "rover-1", "a*1"])
PERSONS = st.sampled_from(["anna", "ben", "ben@hall", "*@hall", "*"])
ASKERS = st.sampled_from(
    [Person("anna"), Person("ben"), Person("ben@hall", "hall"), Person("carl@hall", "hall"), Person("eve")]
)
ROLES = st.dictionaries(
    st.sampled_from(["a", "b"]),
    st.dictionaries(st.sampled_from(["see", "command", "release"]), st.lists(PATTERNS, min_size=1)),
    min_size=1,
)


@st.composite
def policies(draw: st.DrawFn) -> dict[str, Any]:
    roles = draw(ROLES)
    held = st.lists(st.sampled_from(sorted(roles)), max_size=2)
    return {"persons": draw(st.dictionaries(PERSONS, held)), "roles": roles}


def written(content: dict[str, Any], version: int = 1) -> Policy:
    lines = ["realm: plant", f"version: {version}", "persons:"]
    lines += [f'  "{name}": [{", ".join(held)}]' for name, held in content["persons"].items()]
    lines.append("roles:")
    for role, rights in content["roles"].items():
        lines.append(f"  {role}:")
        for right, patterns in rights.items():
            lines.append(f"    {right}:")
            lines += [f'      - "{pattern}"' for pattern in patterns]
    return read_policy("\n".join(lines) + "\n")


def plainly(content: dict[str, Any], person: Person, right: str, name: str) -> bool:
    """What the guide says, written once more in the plainest way."""
    names = {person.name, "*"} | ({f"*@{person.site}"} if person.site else set())
    roles = {role for each, held in content["persons"].items() if each in names for role in held}
    patterns = [one for role in roles for one in content["roles"][role].get(right, [])]
    return any(re.fullmatch(re.escape(one).replace(r"\*", ".*"), name) for one in patterns)


@settings(max_examples=120, deadline=None)
@given(policies(), ASKERS, st.sampled_from(["see", "command", "release", STOP]), NAMES)
def test_it_decides_as_the_guide_says(content: dict[str, Any], person: Person, right: str, name: str) -> None:
    policy = written(content)
    found = policy.may(person, right, PolicyTarget(name))
    assert found.allowed == (right == STOP or plainly(content, person, right, name))
    assert found == policy.may(person, right, PolicyTarget(name))  # the second time it is remembered
    if found.allowed and right != STOP:
        line = policy.text.split("\n")[found.line - 1].strip().removeprefix("- ").strip('"')
        assert fits(line, name), "the line that is named is the one that allows it"
        assert policy.may_anybody_of(person.site or person.name, right, PolicyTarget(name))


def test_the_help_names_all_rights() -> None:
    assert tuple(right.name for right in RIGHTS) == RIGHT_NAMES
