"""A realm that users of this machine share: `realm create NAME --group GROUP`, `realm join NAME@USER`."""

from __future__ import annotations

import grp
import os
import pwd

from robotree.files import replace
from robotree.tui import exit_codes
from robotree.tui.errors import ValueRefused
from robotree.tui.line.grammar import Line
from robotree.tui.processes.state_files import needed_file
from robotree.tui.terminal import answer
from robotree.vr.base.address import check_name
from robotree.vr.base.errors import RealmUnusable
from robotree.vr.base.principal import user_name
from robotree.vr.network.policy_file import POLICY
from robotree.vr.network.realms import SHARED_BY, inhabited, runtime_directory, shares_of
from robotree.vr.network.shared import GROUP, SharedRealm

FIRST_POLICY = """\
# Who may do what in realm {realm}, which {user} shares with the group {group}. What no line allows is denied;
# everybody may stop. `robotree policy set FILE --realm {realm}` puts the next version in force.
realm: {realm}
version: 1
persons:
  "{user}": administrator
  "*": viewer                       # everybody else of the group
roles:
  administrator:
    {{see: "*", command: "*", order: "*", create: "*", release: "*", migrate: "*", resume: "*",
     administrate: yes}}
  viewer: {{see: "*"}}
"""


def create(line: Line, realm: str) -> int:
    """Make a realm of several machines, or of several users of this one: `realm create`."""
    if line.text("--group"):
        return _share(line.text("NAME"), line.text("--group"))
    from robotree.tui.sites.realms import create_keys

    return create_keys(line, realm)


def join(line: Line, realm: str) -> int:
    """Join a realm, with a token or as another user shares it: `realm join`."""
    if "@" in line.text("TOKEN"):
        return _meet(line.text("TOKEN"))
    from robotree.tui.sites.realms import join_by_token

    return join_by_token(line, realm)


def _share(realm: str, group: str) -> int:
    """Share a realm of this user with a group of the machine, and return the exit code.

    Raises:
        ValueRefused: there is no such group, or this user is not in it.
        RealmUnusable: its folder cannot be made, or processes are in it that do not share it.
    """
    number = _number_of(group)
    if number not in {os.getegid(), *os.getgroups()} and os.geteuid() != 0:
        raise ValueRefused("GROUP", f"you are not in {group!r}")
    check_name(realm)
    shared = SharedRealm(shares_of(os.geteuid()) / realm, os.geteuid())
    _expect_empty(realm)
    place = needed_file(realm, POLICY)
    if not place.exists():
        text = FIRST_POLICY.format(realm=realm, user=user_name(os.geteuid()), group=group)
        replace(place, text.encode(), 0o600)
    replace(needed_file(realm, GROUP), f"{number}\n".encode())
    try:
        shared.prepare(number)
    except OSError as error:
        raise RealmUnusable(realm=realm, reason=f"{error}") from None
    replace(needed_file(realm, SHARED_BY), f"{os.geteuid()}\n".encode())
    me = user_name(os.geteuid())
    answer(
        f"realm {realm} is shared with the group {group}, in {shared.directory}; the others say once\n"
        f"  robotree realm join {realm}@{me}\n"
        f"they may see and stop; `robotree policy show --realm {realm}` prints what else you can give them",
        lambda: {"realm": realm, "group": group, "owner": me, "folder": str(shared.directory)},
    )
    return exit_codes.DONE


def _meet(words: str) -> int:
    """Meet in a realm that another user shares, from now on, and return the exit code.

    Args:
        words: NAME@USER.

    Raises:
        ValueRefused: there is no such user.
        RealmUnusable: the user shares no such realm, or not with this one.
    """
    realm, _, user = words.partition("@")
    owner = _user_of(user)
    check_name(realm)
    shared = SharedRealm(shares_of(owner) / realm, owner)
    ask = f"ask {user} for `robotree realm create {realm} --group GROUP`, with a group of yours"
    try:
        shared.directory.stat()
        shared.prepare()
        next(shared.directory.iterdir(), None)
    except FileNotFoundError:
        raise RealmUnusable(realm=realm, reason=f"{user} shares no such realm; {ask}") from None
    except OSError as error:
        raise RealmUnusable(realm=realm, reason=f"{error}; {ask}") from None
    _expect_empty(realm)
    replace(needed_file(realm, SHARED_BY), f"{owner}\n".encode())
    answer(
        f"--realm {realm} is that of {user} now, in {shared.directory}: your robots there keep to the policy "
        f"of {user}; `robotree policy show --realm {realm}` prints it",
        lambda: {"realm": realm, "owner": user, "folder": str(shared.directory)},
    )
    return exit_codes.DONE


def _expect_empty(realm: str) -> None:
    """See that no process is in the private realm of this name: it would stay there.

    Raises:
        RealmUnusable: one is.
    """
    own = runtime_directory() / realm
    if inhabited(own):
        raise RealmUnusable(realm=realm, reason=f"processes are in {own}; end them first, they stay there")


def _number_of(group: str) -> int:
    try:
        return int(group) if group.isdecimal() else grp.getgrnam(group).gr_gid
    except KeyError:
        raise ValueRefused("GROUP", f"there is no group {group!r} on this machine") from None


def _user_of(name: str) -> int:
    try:
        return int(name) if name.isdecimal() else pwd.getpwnam(name).pw_uid
    except KeyError:
        raise ValueRefused("TOKEN", f"there is no user {name!r} on this machine") from None
