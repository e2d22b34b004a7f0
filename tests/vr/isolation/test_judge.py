"""What a robot in a process of its own may ask for, say and hear: of everything else its judge says no."""

from __future__ import annotations

import ast
import contextlib
from pathlib import Path

import msgspec
import pytest

import robotree.vr
from robotree.vr.base import requests as req
from robotree.vr.base.address import Address
from robotree.vr.base.description import Listing
from robotree.vr.base.envelope import seal, sitting_at
from robotree.vr.base.errors import NotAllowed, NotItsChild
from robotree.vr.base.order import Order
from robotree.vr.base.permissions import Permissions
from robotree.vr.isolation.judge import ALLOWED, Judge, Misbehaved
from robotree.vr.lookup.service import NEWS_PATTERN

OWN = Address("robot", "guest", "1")
OTHER = Address("robot", "arm", "2")
CALL = req.Call(key="guest/1", command="move", deadline=1.0)
UNDER_LEASE = req.Call(key="guest/1", command="move", deadline=1.0, epoch=3)


def judge_of(permissions: Permissions | None = None) -> Judge:
    judge = Judge("guest", permissions)
    judge.expect_own(OWN.key)
    return judge


@pytest.fixture
def judge() -> Judge:
    return judge_of()


def body(request: req.AnyRequest, sender: str = OWN.key) -> bytes:
    return seal(request, now=1.0, within=1.0, sender=sender).body


def petition(parent: Address) -> req.Petition:
    return req.Petition(parent=parent, slot="arm", kind="Arm", key="k", lineage=(), term=5.0)


def test_a_robot_speaks_for_itself(judge: Judge) -> None:
    judge.expect_asked(OTHER.key, body(CALL))
    judge.expect_asked(OTHER.key, body(petition(OWN)))
    judge.expect_asked(OTHER.key, body(req.SafeStop(reason="it slips")))
    judge.expect_asked(OTHER.key, body(req.Describe(), sender=""))
    judge.expect_asked("lookup/l/1", body(req.Query(), sender=""))
    judge.expect_published(f"{OWN.key}/state")
    judge.expect_subscribed(f"{OTHER.key}/state")
    judge.expect_subscribed(NEWS_PATTERN)
    assert judge.key == OWN.key


@pytest.mark.parametrize(
    ("key", "request_", "sender"),
    [
        pytest.param(OTHER.key, CALL, OTHER.key, id="another robot's name"),
        pytest.param(OTHER.key, CALL, "", id="nobody's name"),
        pytest.param(OTHER.key, CALL, "session/anna/1", id="a program's name"),
        pytest.param(OTHER.key, petition(OTHER), OWN.key, id="another parent"),
        pytest.param(OTHER.key, req.Release(parent=OTHER, epoch=1), OWN.key, id="another one's lease"),
        pytest.param(OTHER.key, req.Delete(), OWN.key, id="the end of another one"),
        pytest.param(OTHER.key, req.Resume(), OWN.key, id="the end of a stop"),
        pytest.param(OTHER.key, req.Enslave(slot="arm", child=OWN), OWN.key, id="another one's slot"),
        pytest.param("host/h1/1", req.Create(name="x", path="x.py", source=""), OWN.key, id="a new robot"),
        pytest.param("host/h1/1", req.DescribeHost(), OWN.key, id="a host"),
        pytest.param("site/lab/1", CALL, OWN.key, id="a gateway"),
    ],
)
def test_whatever_else_it_asks_for_is_refused(
    judge: Judge, key: str, request_: req.AnyRequest, sender: str
) -> None:
    with pytest.raises(Misbehaved):
        judge.expect_asked(key, body(request_, sender))


def test_it_has_the_permissions_of_its_page_and_no_others() -> None:
    limited = Permissions(commands=("Arm.move",))
    judge = judge_of(limited)
    judge.expect_asked(OTHER.key, seal(CALL, now=1.0, within=1.0, sender=OWN.key, may=limited).body)
    for forged in (None, Permissions(commands=("*.*",))):
        with pytest.raises(Misbehaved):
            judge.expect_asked(OTHER.key, seal(CALL, now=1.0, within=1.0, sender=OWN.key, may=forged).body)


def test_what_binds_and_ends_needs_no_permissions() -> None:
    judge = judge_of(Permissions(commands=("Arm.move",)))
    for request in (petition(OWN), req.Release(parent=OWN, epoch=1)):
        judge.expect_asked(OTHER.key, body(request))
    with pytest.raises(Misbehaved, match="other permissions"):
        judge.expect_asked(OTHER.key, body(CALL))


def test_it_says_of_itself_alone_that_it_is_deleted(judge: Judge) -> None:
    judge.identity = "mine"
    judge.expect_asked("directory/d/1", body(req.RobotDeleted(identity="mine")))
    for identity in ("yours", "", "name:guest"):
        with pytest.raises(Misbehaved):
            judge.expect_asked("directory/d/1", body(req.RobotDeleted(identity=identity)))
    judge.identity = ""  # it takes no orders, and is remembered by its name
    judge.expect_asked("directory/d/1", body(req.RobotDeleted(identity="name:guest")))


def test_it_takes_and_tells_of_its_own_orders_alone(judge: Judge) -> None:
    judge.identity = "mine"
    for identity in ("mine", "yours"):
        order = Order(key="k", robot="guest", identity=identity, command="move")
        for request in (
            req.FetchOrders(identity=identity),
            req.TakeOrder(key="k", identity=identity),
            req.TellOrders(orders=(order,), now=1.0),
        ):
            with contextlib.nullcontext() if identity == "mine" else pytest.raises(Misbehaved):
                judge.expect_asked("directory/d/1", body(request))


def test_it_is_no_person(judge: Judge) -> None:
    with sitting_at("pts/3"):
        forged = seal(CALL, now=1.0, within=1.0, sender=OWN.key.replace("robot/", "program/")).body
    with pytest.raises(Misbehaved):
        judge.expect_asked(OTHER.key, forged)


def test_what_cannot_be_read_is_refused(judge: Judge) -> None:
    with pytest.raises(Misbehaved):
        judge.expect_asked(OTHER.key, b"\xff\x00")


def test_it_lists_itself_alone(judge: Judge) -> None:
    listings = [Listing(address=address, kinds=("Guest",)) for address in (OWN, OTHER)]
    judge.expect_asked("lookup/l/1", body(req.Register(holder="h", term=1.0, listings=(listings[0],)), ""))
    for register in (
        req.Register(holder="h", term=1.0, listings=(listings[1],)),
        req.Register(holder="h", term=1.0, withdrawn=((OTHER, 1),)),
    ):
        with pytest.raises(Misbehaved):
            judge.expect_asked("lookup/l/1", body(register, ""))


@pytest.mark.parametrize("key", [OTHER.key, "host/guest/1", "robot/guest/2", "robot/guest", "nonsense"])
def test_it_is_nobody_else(judge: Judge, key: str) -> None:
    with pytest.raises(Misbehaved):
        judge.expect_own(key)


@pytest.mark.parametrize("key", [f"{OTHER.key}/state", f"{OWN.key}2/state", OWN.key, "robot/**"])
def test_it_publishes_under_its_own_key_alone(judge: Judge, key: str) -> None:
    with pytest.raises(Misbehaved):
        judge.expect_published(key)


def test_it_hears_no_site_and_no_host(judge: Judge) -> None:
    for pattern in ("**", "host/*/*/log", "site/lab/1/out"):
        with pytest.raises(Misbehaved):
            judge.expect_subscribed(pattern)


def test_it_commands_its_children_alone(judge: Judge) -> None:
    with pytest.raises(NotItsChild, match="nobody has put arm under it"):
        judge.expect_child(OTHER.key, body(CALL))
    with pytest.raises(NotItsChild):
        judge.expect_child(OTHER.key, body(petition(OWN)))
    assert not judge.expect_child(OTHER.key, body(req.SafeStop(reason="it slips")))
    assert not judge.note_asked(body(CALL))
    assert judge.note_asked(body(req.Enslave(slot="arm", child=OTHER)))
    for request in (petition(OWN), UNDER_LEASE):
        judge.expect_child(OTHER.key, body(request))
    judge.expect_child(Address("robot", "arm", "3").key, body(UNDER_LEASE))  # its next incarnation
    with pytest.raises(NotItsChild):  # it may be released: the robot that is asked knows the lease
        judge.expect_child(OTHER.key, body(CALL))
    assert judge.children == {"arm"}


@pytest.mark.parametrize("permissions", [None, Permissions(), Permissions(commands=("Arm.move",))])
def test_of_robots_that_are_no_children_it_ends_its_own_calls_and_pauses_nothing(
    permissions: Permissions | None,
) -> None:
    judge = judge_of(permissions)
    others = (req.Cancel(), req.Cancel(key="ben/1"), req.Detach(key="ben/1"), req.Attend(key="ben/1"))
    for request in (*others, req.Cancel(key=CALL.key), req.Pause(), req.TakeStep(), req.Continue()):
        with pytest.raises(NotItsChild):
            judge.expect_child(OTHER.key, body(request))
    if permissions is not None:
        judge.expect_child(OTHER.key, body(CALL))
        for request in (req.Attend(key=CALL.key), req.Detach(key=CALL.key), req.Cancel(key=CALL.key)):
            judge.expect_child(OTHER.key, body(request))
            with pytest.raises(NotItsChild):
                judge.expect_child(Address("robot", "rover", "3").key, body(request))
    for request in (*others, req.Pause()):
        with pytest.raises(NotItsChild):
            judge.expect_child(OTHER.key, body(request))
    if permissions is not None:  # in a cancel no key means all
        judge.expect_child(OTHER.key, body(req.Call(key="", command="move", deadline=1.0)))
        with pytest.raises(NotItsChild):
            judge.expect_child(OTHER.key, body(req.Cancel()))
    judge.note_asked(body(req.Enslave(slot="arm", child=OTHER)))
    leased = (msgspec.structs.replace(request, epoch=3) for request in (*others, req.TakeStep()))
    for request in (*leased, req.Pause(), req.Continue()):
        judge.expect_child(OTHER.key, body(request))


def test_it_hands_a_resume_down_to_its_children_and_ends_no_stop_by_itself() -> None:
    for judge in (judge_of(), judge_of(Permissions(commands=("Arm.move",)))):
        asked = req.Resume(seen={OTHER.key: 1}, given=7.0, clock="c")
        down = body(msgspec.structs.replace(asked, epoch=3, within=0.5))
        judge.note_asked(body(asked), 1)
        judge.expect_asked(OTHER.key, down)
        with pytest.raises(NotItsChild):
            judge.expect_child(OTHER.key, down)
        judge.note_asked(body(req.Enslave(slot="arm", child=OTHER)))
        judge.expect_child(OTHER.key, down)
        for other in (req.Resume(epoch=3), req.Resume(epoch=3, seen={OTHER.key: 2}, given=7.0, clock="c")):
            with pytest.raises(NotAllowed, match="nobody has asked it to resume"):
                judge.expect_child(OTHER.key, body(other))
        judge.note_answered(1)
        with pytest.raises(NotAllowed):
            judge.expect_child(OTHER.key, down)


HOSTS_ONLY = {
    *("bundles", "host", "moving", "placing", "run", "shared", "standby", "unfit", "view", "ways"),
    *("inside", "zygote"),
}
"""Modules of `vr/agents` that ask as a host, or ask nobody."""


def test_the_judge_knows_each_request_that_the_code_of_robots_sends() -> None:
    """Read from the sources: requests that are made there, and methods of `RobotClient` that are called."""
    known = {name for name, each in vars(req).items() if each in getattr(req.AnyRequest, "__args__", ())}
    vr = Path(next(iter(robotree.vr.__path__)))

    def calls(tree: ast.AST) -> list[ast.expr]:
        return [node.func for node in ast.walk(tree) if isinstance(node, ast.Call)]

    def made(tree: ast.AST) -> set[str]:
        return {func.id for func in calls(tree) if isinstance(func, ast.Name)} & known

    client = ast.parse((vr / "exchange" / "client.py").read_text(encoding="utf-8"))
    methods = {
        method.name: made(method)
        for each in client.body
        if isinstance(each, ast.ClassDef) and each.name == "RobotClient"
        for method in each.body
        if isinstance(method, ast.AsyncFunctionDef | ast.FunctionDef)
    }
    sent: set[str] = set()
    modules = [each for each in (vr / "agents").glob("*.py") if each.stem not in HOSTS_ONLY]
    for module in (*modules, *(vr / "running").glob("*.py")):
        tree = ast.parse(module.read_text(encoding="utf-8"))
        sent |= made(tree)
        for func in calls(tree):
            if isinstance(func, ast.Attribute) and "client" in ast.unparse(func.value).lower():
                sent |= methods.get(func.attr, set())
    assert {"Call", "Cancel", "Resume", "SafeStop", "TakeStep", "Renew", "Release", "TakeOrder"} <= sent
    assert sent <= {each.__name__ for allowed in ALLOWED.values() for each in allowed}


def test_a_slot_that_chooses_takes_its_kind_and_no_other(judge: Judge) -> None:
    judge.chooses = {"arm": "Rover"}
    with pytest.raises(NotItsChild):
        judge.expect_child(OTHER.key, body(petition(OWN)))
    judge.chooses = {"arm": "Arm"}
    assert judge.expect_child(OTHER.key, body(petition(OWN)))
    judge.expect_child(OTHER.key, body(UNDER_LEASE))


def test_what_a_slot_is_asked_to_choose_and_what_a_manifest_permits_it_may() -> None:
    judge = Judge("guest")
    judge.note_asked(body(req.Enslave(slot="arm")))
    assert judge.expect_child(OTHER.key, body(petition(OWN)))
    limited = Judge("guest", Permissions(commands=("Arm.move",)))
    limited.expect_child(OTHER.key, body(CALL))  # the arm looks at what it is
    with pytest.raises(NotItsChild):
        limited.expect_child(OTHER.key, body(petition(OWN)))
