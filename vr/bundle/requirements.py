"""What a page needs of the Python where it runs: declared at its head (PEP 723), checked, never installed.

# /// script
# requires-python = ">=3.12"
# dependencies = ["numpy>=2"]
# [tool.robotree.permissions]
# commands = ["Arm.*"]
# ///
"""

from __future__ import annotations

import platform
import re
import tomllib
from collections.abc import Collection, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Literal

import msgspec
from packaging.requirements import InvalidRequirement, Requirement
from packaging.specifiers import InvalidSpecifier, SpecifierSet
from packaging.utils import canonicalize_name

from robotree.vr.base.errors import BrokenSource, MissingRequirement, OtherPython
from robotree.vr.base.permissions import Permissions

RequirementPolicy = Literal["refuse", "allowlist", "locked"]
"""What a host does with a page of somebody else that needs packages. refuse: it does not run. allowlist: it
runs if they are installed and their names are on the host's list. locked: it runs if each is named with one
version (`numpy==2.1.0`) and that one is installed."""

_BLOCK = re.compile(r"(?m)^# /// script$\s(?P<content>(^#(| .*)$\s)+)^# ///$")
"""PEP 723's own pattern, for the one type of block that is meant."""


class Declared(msgspec.Struct, frozen=True):
    """What the head of a page declares."""

    python: str = ""
    requires: tuple[str, ...] = ()
    permissions: Permissions | None = None
    """None: it says nothing of them."""


def declared(source: str, path: str) -> Declared:
    """Read the head of a page.

    Raises:
        BrokenSource: it is there and cannot be read.
    """
    blocks = [block["content"] for block in _BLOCK.finditer(source)]
    try:
        return _read_head(blocks)
    except (ValueError, TypeError, AttributeError, msgspec.MsgspecError) as error:
        raise BrokenSource(path=path, reason=f"its head `# /// script`: {error}") from None


def _read_head(blocks: Sequence[str]) -> Declared:
    """Read the one head that there may be.

    Raises:
        ValueError: it cannot be read, or there are several; and what its libraries raise.
    """
    if not blocks:
        return Declared()
    if len(blocks) > 1:
        raise ValueError("there are several")
    lines = (line.removeprefix("#").removeprefix(" ") for line in blocks[0].splitlines())
    head = tomllib.loads("\n".join(lines))
    said = head.get("tool", {}).get("robotree", {}).get("permissions")
    permissions = msgspec.convert(said, Permissions | None)
    if permissions is not None:
        permissions.expect_sane()
    python = str(SpecifierSet(str(head.get("requires-python", ""))))
    return Declared(python, tuple(str(Requirement(one)) for one in head.get("dependencies", ())), permissions)


def expect_python(needed: str, path: str) -> None:
    """Refuse a page that does not run on this Python.

    Raises:
        OtherPython: it does not, or what it needs cannot be read.
    """
    found = platform.python_version()
    try:
        fits = SpecifierSet(needed).contains(found, prereleases=True)
    except InvalidSpecifier:
        fits = False
    if not fits:
        raise OtherPython(path=path, needed=needed, found=found)


def expect_installed(
    requires: Collection[str], path: str, policy: RequirementPolicy | None, allowed: Collection[str] = ()
) -> None:
    """Refuse a page that needs packages which are not here, or not allowed.

    Args:
        requires: that it needs.
        path: of the page, for messages.
        policy: of the host for pages of somebody else; None: the page is this user's own.
        allowed: names of packages, for `allowlist`.

    Raises:
        MissingRequirement: says which, and why.
    """
    names = {canonicalize_name(one) for one in allowed}
    for text in requires:
        reason = _refusal(text, policy, names)
        if reason:
            raise MissingRequirement(path=path, requirement=text, reason=reason)


def _refusal(text: str, policy: RequirementPolicy | None, names: Collection[str]) -> str:
    """Return why a requirement is refused; empty: it is met."""
    try:
        wanted = Requirement(text)
    except InvalidRequirement:
        return "that is no requirement (PEP 508)"
    if wanted.marker is not None and not wanted.marker.evaluate({"extra": ""}):
        return ""
    return _not_allowed(wanted, policy, names) or _not_there(wanted)


def _not_allowed(wanted: Requirement, policy: RequirementPolicy | None, names: Collection[str]) -> str:
    if wanted.url:
        return "an address is never followed; name a version"
    if policy == "refuse":
        return "this host takes no page of others that needs packages; `--requirements allowlist` takes some"
    if policy == "allowlist" and canonicalize_name(wanted.name) not in names:
        return f"the package is not on the list of this host; `--allow-packages {wanted.name}` puts it there"
    exact = any(one.operator in {"==", "==="} and not one.version.endswith(".*") for one in wanted.specifier)
    if policy == "locked" and not exact:
        return f"this host takes exact versions alone; build the bundle with {wanted.name}==VERSION"
    return ""


def _not_there(wanted: Requirement) -> str:
    try:
        found = version(wanted.name)
    except PackageNotFoundError:
        return "it is not installed here, and nothing is ever installed for a page"
    if not wanted.specifier.contains(found, prereleases=True):
        return f"version {found} is installed here, and nothing is ever installed for a page"
    return ""
