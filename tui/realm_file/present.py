"""The running realm: its robots as they describe themselves, its processes as the kernel knows them.

The simulated controllers that `apply` has started are in no realm, so nobody else knows them: they are kept
in a file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from robotree import files
from robotree.tui.errors import SupervisorError
from robotree.tui.line import manual
from robotree.tui.line.grammar import Line
from robotree.tui.processes.programs import Program, program_of, programs
from robotree.tui.processes.state_files import kept_hosts, state_file
from robotree.tui.realm_file.content import NAMELESS, SECTIONS
from robotree.vr.base.errors import VrError
from robotree.vr.base.group import RobotGroup
from robotree.vr.network.realms import state_home

if TYPE_CHECKING:
    from robotree.vr.base.address import Role
    from robotree.vr.base.description import RobotDescription
    from robotree.vr.supervision.realm_client import RealmClient


# -- simulated controllers -------------------------------------------------------------------------

CONTROLLERS_FILE = "controllers.json"
"""In `$XDG_STATE_HOME/robotree/REALM`."""
LARGEST = 1_000_000
"""[bytes] of that file that are read."""


class Controller(msgspec.Struct, frozen=True):
    """One of them."""

    pid: int
    address: str
    """Where it listens."""


def controllers(realm: str) -> dict[str, Controller]:
    """Return those of a realm that live, by their names in its file."""
    return {name: one for name, one in _kept(state_home() / realm / CONTROLLERS_FILE).items() if _lives(one)}


def keep_controller(realm: str, name: str, controller: Controller | None) -> None:
    """Remember that one was started, or that it was ended (None)."""
    path = state_file(realm, CONTROLLERS_FILE)
    if path is None:
        return
    known = controllers(realm)
    known.pop(name, None)
    if controller is not None:
        known[name] = controller
    files.overwrite(path, msgspec.json.encode(known))


def _kept(path: Path) -> dict[str, Controller]:
    try:
        return msgspec.json.decode(files.read(path, LARGEST), type=dict[str, Controller])
    except (OSError, msgspec.DecodeError):
        return {}


def _lives(controller: Controller) -> bool:
    program = program_of(controller.pid)
    return program is not None and program.words[:1] == (NAMELESS,)


ROLES: Mapping[str, Role] = {
    "proxy": "robot",
    "view": "view",
    "host": "host",
    "lookup": "lookup",
    "directory": "directory",
    "space serve": "space",
}
"""Role of the agent of a process, by its verb."""


class Process(msgspec.Struct, frozen=True):
    """A process of the realm that was started by a line of robotree."""

    line: Line
    program: Program

    @property
    def id(self) -> str:
        """The name for steps and entries: `proxy arm-1`."""
        return f"{self.line.verb} {self.line.text('NAME')}"

    def path(self, given: str) -> Path:
        """Return where a path on its command line leads."""
        return Path(os.path.normpath(self.program.folder / Path(given).expanduser()))


class Present(msgspec.Struct, frozen=True, kw_only=True):
    """The running realm."""

    realm: str
    processes: dict[str, Process] = {}
    """By id."""
    robots: dict[str, RobotDescription] = {}
    """All that answer, by name; those of proxies are among them."""
    pages: dict[str, str] = {}
    """Hashes of the pages of virtual robots, by name."""
    instead: dict[str, str] = {}
    """The hosts that have taken over, and the names of those whose robots they have."""
    others: dict[str, str] = {}
    """Agents that were not started by a line of robotree: where they are, by role and name: `host h1`."""
    silent: dict[str, str] = {}
    """Robots that do not answer: where they are, by name."""
    controllers: Mapping[str, Controller] = {}
    """Simulated ones that live, by their names in the file."""
    groups: Mapping[str, RobotGroup] = msgspec.field(default_factory=dict[str, RobotGroup])
    """Of the realm, by name."""
    keepers: frozenset[str] = frozenset()
    """Names of hosts that bring robots back when they are started."""

    def home_of(self, robot: RobotDescription) -> str:
        """Return the host on which a robot should live: another one may have taken over."""
        return self.instead.get(robot.host, robot.host)

    def virtual(self) -> dict[str, RobotDescription]:
        """Return the robots that live on hosts, by name."""
        return {name: robot for name, robot in self.robots.items() if robot.host}


async def present(realm_client: RealmClient, known: Mapping[str, Controller]) -> Present:
    """Look at a realm; `known` are the simulated controllers that live."""
    hosts = await realm_client.hosts()
    robots = {robot.name: robot for robot in await realm_client.tree()}
    processes: dict[str, Process] = {}
    others: dict[str, str] = {}
    silent: dict[str, str] = {}
    for address, program in programs(realm_client.realm).items():
        where = f"process {program.pid}"
        if address.role == "robot" and address.name not in robots:
            silent[address.name] = where
        line = line_of(program)
        if line is not None and ROLES.get(line.verb) == address.role:
            process = Process(line, program)
            processes[process.id] = process
        elif line is None and address.role in ROLES.values():
            others[f"{address.role} {address.name}"] = where
    return Present(
        realm=realm_client.realm,
        processes=processes,
        robots=robots,
        pages={name: digest for host in hosts for name, digest in host.pages.items()},
        instead={host.address.name: host.instead_of for host in hosts if host.instead_of},
        others=others,
        silent=silent,
        controllers=known,
        groups=realm_client.groups.all(),
        keepers=kept_hosts(realm_client.realm),
    )


def line_of(program: Program) -> Line | None:
    """Return the line with which a process was started; None: it is no process that a file can say."""
    with suppress(SupervisorError, VrError):
        line = manual.shell().parse(program.words)
        return line if line.verb in SECTIONS.values() else None
    return None
