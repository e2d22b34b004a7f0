"""A realm that users of one machine share: the laws, with the kernel's word put in.

With real users it is played in tests/scenarios/test_shared_realm.py.
"""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from robotree.vr.base import address
from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing
from robotree.vr.base.envelope import Envelope, opened, this_clock
from robotree.vr.base.errors import NotAllowed, RealmUnusable, SeveralUsers
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import Credentials, principal_of
from robotree.vr.base.requests import Describe, Listed, Register, encode
from robotree.vr.exchange.authority import Here, authorise
from robotree.vr.lookup.directory import Directory
from robotree.vr.network.realms import leads_to, owner_of
from robotree.vr.network.rendezvous import Rendezvous
from robotree.vr.network.shared import SharedRealm, sees_sample
from robotree.vr.world.network import MemoryNetwork
from tests.vr.core.conftest import pytest_asyncio_loop_factories

__all__ = ["pytest_asyncio_loop_factories"]

ME, ANNA, BEN, GROUP = os.geteuid(), 70_001, 70_002, 64_001
OF_ANNA, OF_BEN = f"robot/arm-1/0123456789abcdefu{ANNA}", f"robot/arm-1/fedcba9876543210u{BEN}"


class Line:
    """A connection whose far end is who the test says."""

    def __init__(self, user: int, group: int, *groups: int) -> None:
        self._far_end, self._groups = (7, user, group), groups

    def getsockopt(self, _level: int, option: int, _size: int) -> bytes:
        if option == socket.SO_PEERCRED:
            return struct.pack("3i", *self._far_end)
        return struct.pack(f"{len(self._groups)}I", *self._groups)


@pytest.fixture
def unmarked() -> Iterator[None]:
    yield
    address.mark(None)


@pytest.fixture
def apart(place: Path) -> Path:
    """A folder with a short name: sockets lie in it."""
    return place


@pytest.fixture
def folder(apart: Path) -> Path:
    """A realm that this user shares."""
    place = apart / f"robotree-shared-{ME}" / "plant"
    assert owner_of(place) == ME
    return place


def test_a_key_says_whose_agent_it_names() -> None:
    address.mark(ANNA)
    try:
        assert address.user_of(f"caller/{address.unique()}") == ANNA
        assert address.user_of(f"robot/arm-1/{address.unique()}/state") == ANNA
    finally:
        address.mark(None)
    for key in ("robot/arm-1/0123456789abcdef", "robot/u1/2", "caller/u", "robot/arm-1", "", OF_ANNA + "x"):
        assert address.user_of(key) is None
    shared = SharedRealm(Path("/tmp/robotree-shared-1/plant"), 1)  # noqa: S108 # it is not used
    assert shared.may_announce(ANNA, OF_ANNA)
    assert shared.may_announce(1, OF_ANNA), "the owner of the realm may everything"
    assert not shared.may_announce(BEN, OF_ANNA)
    assert not shared.may_announce(BEN, "robot/arm-1/0123456789abcdef"), "of nobody: of the owner's alone"


def test_who_is_not_in_the_group_is_not_admitted(folder: Path) -> None:
    shared = SharedRealm(folder, ME)
    shared.prepare()
    group = folder.stat().st_gid
    assert shared.admits(Line(ANNA, group))
    assert shared.admits(Line(ANNA, 1, 5, group))
    assert shared.admits(Line(ME, 1)), "who shares it"
    assert not shared.admits(Line(ANNA, group + 1, 5))


def test_the_folder_is_for_a_group_and_each_entry_for_its_user_alone(folder: Path, unmarked: None) -> None:
    del unmarked
    place = Rendezvous("plant", folder.parent)
    door = place.register()
    try:
        modes = {path.suffix: path.stat().st_mode & 0o7777 for path in folder.iterdir()}
        assert modes == {".sock": 0o660, ".beat": 0o640, ".held": 0o640}
        assert folder.stat().st_mode & 0o7777 == 0o3770
        assert folder.parent.stat().st_mode & 0o7777 == 0o755
        folder.parent.chmod(0o777)
        place.shared = SharedRealm(folder, ME)
        place.leave()
        place.register().close()
        assert folder.parent.stat().st_mode & 0o7777 == 0o755, "its owner closes it again"
    finally:
        door.close()


def test_a_folder_that_is_not_its_owners_is_no_realm(apart: Path) -> None:
    place = apart / f"robotree-shared-{ME + 1}"
    place.mkdir()
    with pytest.raises(RealmUnusable, match=r"belongs to user|Operation not permitted"):
        Rendezvous("plant", place)


def test_a_link_to_a_socket_of_a_private_realm_leads_nowhere(
    folder: Path, apart: Path, unmarked: None
) -> None:
    del unmarked
    private, shared = Rendezvous("private", apart), Rendezvous("plant", folder.parent)
    doors = [private.register(), shared.register()]
    try:
        forged = f"{os.getpid()}-00000001"
        (folder / f"{forged}.sock").symlink_to(apart / "private" / f"{private.tag}.sock")
        assert forged not in shared.others(), "a link is no entry"
        for tag, honest in ((forged, False), (shared.tag, True)):
            with socket.socket(socket.AF_UNIX) as line:
                line.connect(str(folder / f"{tag}.sock"))
                assert leads_to(line, folder, tag) is honest
    finally:
        for door in doors:
            door.close()


def test_nobody_speaks_for_the_agent_of_another_user() -> None:
    body = msgspec.msgpack.encode(Envelope(Describe(), OF_ANNA, 1.0, 5.0, this_clock(), b"", ""))
    assert opened(body, Credentials(7, ANNA), "arm-1", 1.0, ME).principal.agent == OF_ANNA
    assert opened(body, Credentials(7, BEN), "arm-1", 1.0, None).principal.agent == OF_ANNA, "as in private"
    with pytest.raises(NotAllowed, match="which is no agent of this user"):
        opened(body, Credentials(7, BEN), "arm-1", 1.0, ME)


def test_nobody_lists_the_agent_of_another_user() -> None:
    gate = PolicyGate()
    gate.owner, gate.policy = (
        ME,
        read_policy("realm: plant\nversion: 1\npersons: {'*': a}\nroles: {a: {see: '*'}}"),
    )
    address, here = Address.parse(OF_ANNA), Here("lookup", "lookup-1", gate)
    assert address is not None
    entered = Register(holder="h", term=5.0, listings=(Listing(address=address, kinds=("Arm",)),))
    taken_out = Register(holder="h", term=5.0, withdrawn=((address, 1),))
    for request in (entered, taken_out):
        authorise(principal_of(Credentials(7, ANNA), "", ""), request, None, here)
        with pytest.raises(NotAllowed, match="is no agent of this user"):
            authorise(principal_of(Credentials(7, BEN), "", ""), request, None, here)


def test_live_states_and_news_go_to_who_may_see_them() -> None:
    gate = PolicyGate()
    gate.owner, gate.due = ME + 1, float("inf")
    persons = f"persons: {{'{BEN}': a, '{ANNA}': b}}"
    roles = "roles: {a: {see: arm-1}, b: {see: {kind: Arm}}}"
    gate.policy = read_policy(f"realm: plant\nversion: 1\n{persons}\n{roles}")

    def sees(user: int, key: str, body: bytes = b"") -> bool:
        return sees_sample(gate, lambda: 0.0, user, key, body)

    other = "robot/rover-1/0123456789abcdefu1/state"
    assert [sees(user, f"{OF_ANNA}/state") for user in (BEN, ANNA, ME, ME + 1)] == [True, False, True, True]
    assert not sees(BEN, other)
    gate.kinds_of["arm-1"] = lambda: ("Arm",)
    assert sees(ANNA, f"{OF_ANNA}/log")
    address = Address.parse(OF_ANNA)
    assert address is not None
    news: dict[str, Any] = {
        kind: encode(Listed(listing=Listing(address=Address("robot", "rover-1", "1"), kinds=(kind,))))
        for kind in ("Arm", "Rover")
    }
    lookup = "lookup/lookup-1/0123456789abcdefu1/news"
    assert [sees(ANNA, lookup, news[kind]) for kind in ("Arm", "Rover")] == [True, False]


async def test_of_one_name_of_several_users_the_own_one_is_meant_else_none() -> None:
    network = MemoryNetwork(delay=0.001)
    member = network.join("supervisor")
    directory = Directory(member)
    await directory.start()
    try:
        for key in (OF_ANNA, OF_BEN):
            await network.join(key).announce(key)
        await member.settle(1.0)
        with pytest.raises(SeveralUsers, match=f"arm-1 is there of the users {ANNA} and {BEN}"):
            await directory.resolve("arm-1")
        own = f"robot/arm-1/0000000000000000u{ME}"
        await network.join("own").announce(own)
        await member.settle(1.0)
        assert (await directory.resolve("arm-1")).key == own
    finally:
        await directory.close()
