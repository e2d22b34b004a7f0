"""Users of one machine in one realm: real processes of real users, and what an attacker among them can do."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from robotree.tui.exit_codes import DONE, NOBODY, REFUSED
from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing
from robotree.vr.base.envelope import seal, sitting_at
from robotree.vr.base.errors import VrError
from robotree.vr.base.requests import AnyRequest, Call, Raised, Register, Release, SafeStop, decode_reply
from robotree.vr.network.link import (
    VERSION,
    Channel,
    Hello,
    LinkFrame,
    News,
    Sample,
    Topic,
    pack,
)
from robotree.vr.network.local import join
from robotree.vr.network.realms import dial, members, realm_folder
from tests.users import MachineUser, Running, machine_of_users, only_root
from tests.waiting import until, wait_until

pytestmark = [pytest.mark.e2e, pytest.mark.timeout(400), only_root]

PAGE = '''
from robotree.vr import VirtualRobot, command

class Lamp(VirtualRobot):
    """A lamp."""
    @command
    def on(self) -> None:
        """Shine."""
'''
GROUP = 64_000 + os.getpid() % 1000
ANNA, BEN, EVE, CARL = (70_000 + 10 * (os.getpid() % 10_000) + number for number in range(4))
"""Anna shares; Ben and Eve are in the group, Carl is not."""


@pytest.fixture
def user() -> Iterator[Callable[..., MachineUser]]:
    """Users with homes where everybody can go: another user cannot enter what pytest makes for root."""
    place = Path(tempfile.mkdtemp(prefix="users-"))
    place.chmod(0o755)
    try:
        with machine_of_users(place) as made:
            yield made
    finally:
        shutil.rmtree(place)
        shutil.rmtree(f"/tmp/robotree-shared-{ANNA}", ignore_errors=True)  # noqa: S108 # as the product has it


@pytest.fixture
def anna(user: Callable[..., MachineUser]) -> MachineUser:
    return user(ANNA, GROUP)


@pytest.fixture
def realm(anna: MachineUser) -> str:
    """A realm that Anna shares, with a lookup service and a host of hers."""
    name = f"shared-{os.getpid()}"
    assert anna.say("realm", "create", name, "--group", str(GROUP))[0] == DONE
    (anna.home / "lamp.py").write_text(PAGE)
    (anna.home / "policy.yaml").write_text(f"""
realm: {name}
version: 2
persons: {{"{ANNA}": administrator, "{BEN}": worker, "{EVE}": looker}}
roles:
  administrator: {{see: "*", command: "*", create: "*", release: "*", resume: "*", administrate: yes}}
  worker: {{see: [lamp-b, host-b], create: host-b, command: lamp-b}}
  looker: {{see: lamp-b}}
""")
    assert anna.say("policy", "set", "policy.yaml", "--realm", name)[0] == DONE
    for words in (("lookup", "lookup-1"), ("host", "host-a")):
        up(anna, *words, "--realm", name)
    assert anna.say("create", "lamp.py", "as", "lamp-a", "on", "host-a", "--realm", name)[0] == DONE
    return name


def up(user: MachineUser, *words: str) -> Running:
    running = user.start(*words)
    wait_until(lambda: "ready " in running.said, f"{words} is up")
    return running


def test_users_of_a_group_meet_and_each_may_what_the_policy_says(
    anna: MachineUser, realm: str, user: Callable[..., MachineUser]
) -> None:
    ben, carl = user(BEN, GROUP), user(CARL)
    for who in (ben, carl):
        assert who.say("ls", "--realm", realm)[0] != DONE, "nobody is led into a realm of others"
    code, said = carl.say("realm", "join", f"{realm}@{ANNA}")
    assert code == NOBODY
    assert "Permission denied" in said
    assert "with a group of yours" in said
    for who in (anna, ben):
        code, said = who.say("realm", "join", f"{realm}x@{ANNA}")
        assert code == NOBODY
        assert f"{ANNA} shares no such realm; ask {ANNA} for" in said
    assert ben.say("realm", "join", f"{realm}@{ANNA}")[0] == DONE
    (ben.home / "lamp.py").write_text(PAGE)
    up(ben, "host", "host-b", "--realm", realm)

    def say(who: MachineUser, *words: str) -> tuple[int, str]:
        return who.say(*words, "--realm", realm)

    assert say(ben, "create", "lamp.py", "as", "lamp-b", "on", "host-b")[0] == DONE
    code, said = say(ben, "create", "lamp.py", "as", "lamp-c", "on", "host-a")
    assert code == REFUSED
    assert f"{BEN} may not create host host-a: line 7 allows create only of host-b" in said
    for who, lamps in ((anna, ["lamp-a", "lamp-b"]), (ben, ["lamp-b"])):
        listed = json.loads(say(who, "ls", "--json")[1])
        assert [one["address"]["name"] for one in listed] == lamps
    assert say(anna, "call", "lamp-b.on")[0] == DONE
    assert say(ben, "call", "lamp-b.on")[0] == DONE
    code, said = say(ben, "call", "lamp-a.on")
    assert (code, said) == (
        REFUSED,
        f"robotree: {BEN} may not command lamp-a.on: line 7 allows command only of lamp-b; ask {ANNA}\n",
    )
    code, said = say(ben, "doctor")
    assert f"is shared by {ANNA} with the group {GROUP}" in said
    assert say(ben, "stop") == (DONE, "stopped: lamp-a, lamp-b\n")
    code, said = say(ben, "resume", "lamp-a")
    assert f"NOT by lamp-a ({BEN} may not" in said
    assert code != DONE
    assert say(anna, "resume")[0] == DONE
    eve = user(EVE, GROUP)
    assert eve.say("realm", "join", f"{realm}@{ANNA}")[0] == DONE
    assert say(eve, "stop") == (DONE, "stopped: lamp-a, lamp-b\n"), "of all users, by who may nothing else"
    shutil.rmtree(f"/tmp/robotree-shared-{ANNA}")  # noqa: S108 # as the product has it
    wait_until(lambda: say(ben, "call", "lamp-b.on")[0] == REFUSED, "Anna's processes make it again")
    assert say(eve, "stop") == (DONE, "stopped: lamp-a, lamp-b\n")


# -- an attacker in the group ----------------------------------------------------------------------


def test_a_member_of_the_group_takes_nothing_from_the_others(
    anna: MachineUser, realm: str, user: Callable[..., MachineUser]
) -> None:
    eve = user(EVE, GROUP)
    up(anna, "lookup", "private-1")  # in a realm that she shares with nobody
    assert anna.say("create", "lamp.py", "as", "lamp-b", "on", "host-a", "--realm", realm)[0] == DONE
    assert eve.say("realm", "join", f"{realm}@{ANNA}")[0] == DONE
    code, said = eve.say(realm, str(anna.home), does=f"{__name__}:attack")
    assert code == 0, said
    told = json.loads(said.splitlines()[-1])
    assert told == {
        "remove a socket": "Operation not permitted",
        "exchange a socket": "Operation not permitted",
        "write the policy": "Permission denied",
        "put a file beside the policy": "Permission denied",
        "read what anna keeps": "Permission denied",
        "see private realms": "Permission denied",
        "hold her key": "disconnected",
        "serve her key": "disconnected",
        "publish as her robot": "disconnected",
        "be her process": "disconnected",
        "speak for her robot": "NotAllowed",
        "list her robot anew": "NotAllowed",
        "command": "Denied",
        "speak for a site": "NotAllowed",
        "stop": "Accepted",
        "heard of her robot": 0,
        "heard of what Eve may see": True,
    }
    listed = json.loads(anna.say("ls", "--json", "--realm", realm)[1])
    assert [one["address"]["name"] for one in listed] == ["lamp-a", "lamp-b"]
    assert anna.say("call", "lamp-a.on", "--realm", realm)[0] == REFUSED, "Eve may stop, as everybody"
    assert anna.say("resume", "lamp-a", "--realm", realm)[0] == DONE
    assert anna.say("call", "lamp-a.on", "--realm", realm)[0] == DONE
    code, said = anna.say("doctor")
    assert "1 of 1 live" in said, "what Eve left in the shared folder led nobody into a private realm"


def attack(words: list[str]) -> int:
    """What Eve tries."""
    print(json.dumps(asyncio.run(_attack(words[0], Path(words[1])))))  # noqa: T201 # the test reads it
    return 0


async def _attack(realm: str, home: Path) -> dict[str, Any]:
    folder, told = realm_folder(realm), dict[str, Any]()
    transport = await join(realm)
    try:
        key = next(key for key in transport.presence.keys("robot/lamp-a/*"))
        host = next(key for key in transport.presence.keys("host/*/*"))
        heard: list[str] = []
        await transport.subscribe("robot/**", lambda key, _: heard.append(key))
        for name, deed in _deeds_with_files(folder, home).items():
            told[name] = _tried(deed)
        theirs = _of_owner(folder)
        own = f"{os.getpid()}-0badc0de"
        for name, tag, said in (
            ("hold her key", own, [News(Topic.HOLDS, key, there=True)]),
            ("serve her key", own, [News(Topic.SERVES, key, there=True, rank=9)]),
            ("publish as her robot", own, [Sample(f"{key}/state", b"x")]),
            ("be her process", theirs, []),
        ):
            told[name] = await asyncio.to_thread(_spoken, folder, theirs, tag, said)
        lookup = next(iter(transport.presence.keys("lookup/lookup-1/*")))
        forged = Listing(address=Address.parse(key), kinds=("Forged",), revision=1 << 40)
        with sitting_at("script"):
            for name, whom, request, sender in (
                ("speak for her robot", key, Release(parent=Address.parse(host), epoch=1), host),
                ("list her robot anew", lookup, Register(holder="eve", term=5.0, listings=(forged,)), ""),
                ("command", key, Call(key="k", command="on", deadline=5.0), ""),
            ):
                told[name] = await _answer(transport, whom, request, sender)
            told["speak for a site"] = await _answer(transport, key, SafeStop(), "", proof=True)
            told["stop"] = await _answer(transport, key, SafeStop(), "")
        seen = "robot/lamp-b/"
        await until(lambda: sum(one.startswith(seen) for one in heard) >= 4, "the other one's are heard")
        told["heard of her robot"] = sum(one.startswith(key) for one in heard)
        told["heard of what Eve may see"] = any(one.startswith(seen) for one in heard)
        await asyncio.to_thread(_mislead, folder, theirs, home)
        return told
    finally:
        await transport.close()


def _deeds_with_files(folder: Path, home: Path) -> dict[str, Callable[[], object]]:
    theirs = folder / f"{_of_owner(folder)}.sock"
    state = folder.parent / f".{folder.name}.state"
    return {
        "remove a socket": theirs.unlink,
        "exchange a socket": lambda: theirs.rename(folder / "away"),
        "write the policy": lambda: (state / "policy.yaml").write_text("realm: x"),
        "put a file beside the policy": (state / ".policy.yaml.new").touch,
        "read what anna keeps": lambda: list((home / "s").iterdir()),
        "see private realms": lambda: list((home / "r" / "robotree" / "default").iterdir()),
    }


def _of_owner(folder: Path) -> str:
    """Return the tag of a process of who shares the realm."""
    owner = folder.stat().st_uid
    return next(tag for tag in members(folder) if (folder / f"{tag}.sock").stat().st_uid == owner)


def _mislead(folder: Path, tag: str, home: Path) -> None:
    """Have Anna's processes dial, through a link, a socket of hers in a realm that she shares with nobody."""
    private = home / "r" / "robotree" / "default"
    for number, name in enumerate((".sock", ".beat", ".held")):
        (folder / f"{tag.partition('-')[0]}-0000000{number}{name}").symlink_to(private / f"{tag}{name}")


def _tried(deed: Callable[[], object]) -> str:
    try:
        deed()
    except OSError as error:
        return str(error.strerror)
    return "done"


def _spoken(folder: Path, to: str, tag: str, frames: list[LinkFrame]) -> str:
    """Speak the frames of a process by hand; returns whether the other one listened to the end."""
    with dial(folder, to, 5.0) as line:
        line.sendall(pack(Hello(VERSION, tag, Channel.URGENT, {})))
        with contextlib.suppress(OSError):
            for frame in frames:
                line.sendall(pack(frame))
        latest = time.monotonic() + 20.0
        while time.monotonic() < latest:
            line.settimeout(1.0)
            try:
                if not line.recv(1 << 16):
                    return "disconnected"
            except TimeoutError:
                continue
            except OSError:
                return "disconnected"
    return "heard"


async def _answer(transport: Any, key: str, request: AnyRequest, sender: str, *, proof: bool = False) -> str:
    import msgspec

    from robotree.vr.base.principal import Voucher

    sealed = seal(request, now=asyncio.get_running_loop().time(), within=5.0, sender=sender)
    body = sealed.body
    if proof:
        given = msgspec.msgpack.decode(body)
        given[5] = msgspec.msgpack.encode(Voucher("hall", "anna", 1))
        body = msgspec.msgpack.encode(given)
    async for reply in transport.request(key, body, timeout=5.0):
        try:
            found = decode_reply(reply, key=key)
        except VrError as error:
            return type(error).__name__
        return type(found.revive()).__name__ if isinstance(found, Raised) else type(found).__name__
    return "no answer"
