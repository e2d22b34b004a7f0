"""Who asks, and until when: no request has the rights of another program or robot, or begins too late."""

from __future__ import annotations

import asyncio
import math
from contextlib import nullcontext
from typing import Any, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.vr import Child, Robot, VirtualRobot, command
from robotree.vr.agents.agent import RobotAgent
from robotree.vr.base import envelope
from robotree.vr.base import requests as req
from robotree.vr.base.address import Address
from robotree.vr.base.description import RobotDescription, SlotSpec
from robotree.vr.base.envelope import BEGINS, ENDS, FRESH, on_clock, opened, seal
from robotree.vr.base.errors import (
    CommandCancelled,
    Garbled,
    NoAnswer,
    NotAllowed,
    NotInControl,
    NotItsChild,
    StaleEpoch,
    Unreachable,
    VrError,
)
from robotree.vr.base.principal import ITSELF, SCRIPT, Credentials, Principal, principal_of, this_process
from robotree.vr.base.requests import (
    Call,
    Cancel,
    Describe,
    Detach,
    Done,
    Granted,
    Petition,
    Release,
    Renew,
    Retract,
    SafeStop,
)
from robotree.vr.core import events as on
from robotree.vr.core.bonds import Bond, GrantedLease, HeldLease
from robotree.vr.core.events import CoreEvent
from robotree.vr.exchange.asking import ask
from robotree.vr.exchange.authority import authorise
from robotree.vr.exchange.client import RobotClient
from robotree.vr.network.on_loop import handled
from tests.vr.cores import new_core
from tests.vr.recorder import Recorder


class Rover(Robot):
    """A rover."""

    @command
    def move(self, x: float = 0.0) -> None:
        """Move for x seconds."""
        self.sleep(x)


class Pair(VirtualRobot):
    """Two rovers."""

    left = Child("Rover")

    @command
    def move(self, x: float) -> None:
        """Move the left one."""
        self.left.move(x=x)


async def asked(realm: Any, robot: Any, request: Any, answer: Any, sender: str) -> Any:
    """Ask a robot in the name of somebody."""
    return await ask(realm.operator, robot.address.key, request, answer, timeout=5, sender=sender)


async def test_a_lease_belongs_to_its_holder_and_not_to_who_knows_its_number(realm: Any) -> None:
    pair = await realm.team(Pair("pair"), left=Rover("left"))
    rover, parent = pair.left, pair.address
    thief = RobotClient(realm.operator, rover.address, sender=parent.key)
    moving = asyncio.create_task(realm.client(pair).call("move", {"x": 30}))
    await realm.until(lambda: rover.description().busy == "move")
    epoch, state = rover.description().epoch, rover.description().stops
    key = next(iter(rover.runtime.core.state.calls.live))
    for theft in (
        thief.call("move", {"x": 1}, epoch=epoch),
        thief.cancel(key, epoch=epoch),
        thief.cancel(epoch=epoch),
        thief.resume(epoch=epoch),
        thief.release(parent, epoch),
        asked(realm, rover, Detach(key=key, epoch=epoch), Done, parent.key),
        asked(realm, rover, Renew(parent=parent, epoch=epoch, lineage=("pair",)), Granted, parent.key),
    ):
        with pytest.raises(NotInControl):
            await theft
    assert rover.description().busy == "move"
    assert rover.description().bond.parent == parent
    assert (rover.description().epoch, rover.description().stops) == (epoch, state)
    moving.cancel()


async def test_a_robot_ends_its_own_calls_alone_where_nobody_commands(realm: Any) -> None:
    rover = await realm.start(Rover("rover"))
    live = rover.runtime.core.state.calls.live
    guest = RobotClient(realm.operator, rover.address, sender="robot/guest/1")
    moving = asyncio.create_task(realm.client(rover).call("move", {"x": 30}))
    await realm.until(lambda: rover.description().busy == "move")
    (key,) = live
    detach = asked(realm, rover, Detach(key=key), Done, "robot/guest/1")
    for theft in (guest.cancel(key), guest.cancel(), detach):
        with pytest.raises(NotItsChild, match="guest may not ask rover for the end of a call of others"):
            await theft
    assert rover.description().busy == "move"
    await realm.client(rover).cancel()
    with pytest.raises(CommandCancelled):
        await moving

    own = asyncio.create_task(guest.call("move", {"x": 30}))
    await realm.until(lambda: rover.description().busy == "move")
    await guest.cancel(next(iter(live)))
    with pytest.raises(CommandCancelled):
        await own


def test_who_enslaves_a_robot_ends_what_moves_it_and_not_who_reads() -> None:
    core = new_core("rover")
    for name, reads in (("move", False), ("look", True)):
        call = Call(key=name, command=name, deadline=9.0)
        core.handle(on.Invoke(call=call, arguments={}, deadline_at=9.0, reads=reads), 1.0)
    pair = Address("robot", "pair", "1")
    asked = on.ParentAsked(parent=pair, slot="left", lineage=("pair",), term=5.0, unix=1.0, key="k")
    ended = [effect.key for effect in core.handle(asked, 2.0) if isinstance(effect, on.Interrupt)]
    assert ended == ["move"]


def test_a_key_that_comes_too_late_brings_nothing_back() -> None:
    core = new_core("saw")
    call = Call(key="k", command="turn", deadline=60.0)
    core.handle(on.Invoke(call=call, arguments={}, deadline_at=60.0, attended=True, attended_until=2.0), 1.0)
    core.handle(on.Attended(key="k", at=2.5), 2.5)
    assert core.state.calls.live["k"].attended_until == 2.0


def test_a_stop_of_a_child_whose_parent_is_away_ends_what_the_parent_was_about() -> None:
    child, parent = new_core("rover"), new_core("pair", SlotSpec(name="left", kind="Rover"))
    rover, pair = child.state.address, parent.state.address
    asked = on.ParentAsked(
        parent=pair, slot="left", lineage=("pair",), term=5.0, unix=1.0, key="k", waits=9.0
    )
    epoch = child.handle(asked, 1.0)[0].epoch
    lease = HeldLease.begin(epoch=epoch, term=5.0, sent=1.0, now=1.0)
    description = RobotDescription(address=rover, kinds=("Rover",))
    parent.handle(on.Reserve(slot="left", child=rover), 1.0)
    parent.handle(on.Bind(slot="left", bond=Bond(child=rover, lease=lease, description=description)), 1.0)
    call = Call(key="ann/1", command="move", deadline=9.0)
    parent.handle(on.Invoke(call=call, arguments={}, deadline_at=9.0), 1.0)
    child.handle(on.ParentAway(parent=pair), 2.0)
    child.handle(on.StopAsked(reason="a hand"), 3.0)
    granted = child.handle(on.Prolong(parent=pair, epoch=epoch, lineage=("pair",), unix=4.0), 4.0)[0]
    renewed = on.Renewed(slot="left", child=rover, epoch=epoch, sent=4.0, term=5.0, stopped=granted.stopped)
    (ended,) = parent.handle(renewed, 4.0)
    assert "rover was stopped while pair was away" in str(ended.cause.revive())


def test_a_robot_refuses_no_call_of_others_before_it_has_come() -> None:
    guest, core = Principal("user", 2, "robot/guest/1"), new_core("rover")
    core.handle(on.CancelAsked(key="ben/1", reason="guest wants it", principal=guest), 1.0)
    for asker, begins in ((guest, False), (Principal("user", 3, "robot/ben/1"), True)):
        call = Call(key="ben/1", command="move", deadline=9.0)
        event = on.Invoke(call=call, arguments={}, deadline_at=9.0, principal=asker)
        with nullcontext() if begins else pytest.raises(CommandCancelled):
            core.handle(event, 2.0)
    assert [*core.state.calls.live] == ["ben/1"]


async def test_nobody_goes_on_as_another_incarnation_of_a_parent_that_is_there(realm: Any) -> None:
    pair = await realm.team(Pair("pair"), left=Rover("left"))
    rover, other = pair.left, Address("robot", "pair", "another")
    epoch = rover.description().epoch
    thief = RobotClient(realm.operator, rover.address, sender=other.key)
    with pytest.raises(NotInControl):
        await thief.release(other, epoch)
    renewal = Renew(parent=other, epoch=epoch, lineage=("pair",))
    with pytest.raises(NotInControl):
        await asked(realm, rover, renewal, Granted, other.key)
    assert rover.description().bond.parent == pair.address


@pytest.mark.parametrize("sender", ["", "robot/other/1", "caller/1"])
async def test_a_parent_speaks_for_itself_alone(realm: Any, sender: str) -> None:
    pair, rover = await realm.start(Pair("pair")), await realm.start(Rover("left"))
    petition = Petition(parent=pair.address, slot="left", kind="Rover", lineage=("pair",), term=5.0)
    thief = RobotClient(realm.operator, rover.address, sender=sender)
    with pytest.raises(NotAllowed, match="it speaks for pair and is not pair"):
        await thief.petition(petition)
    assert rover.description().bond is None
    for request in (
        Retract(parent=pair.address, key="k"),
        Release(parent=pair.address, epoch=1),
        Renew(parent=pair.address, epoch=1, lineage=()),
    ):
        with pytest.raises(NotAllowed):
            await ask(realm.operator, rover.address.key, request, Done, timeout=5, sender=sender)


async def test_a_child_in_the_same_process_has_its_robot_as_principal(realm: Any) -> None:
    pair = await realm.team(Pair("pair"), left=Rover("left"))
    await realm.operator.announce("caller/7")
    calling = asyncio.create_task(realm.client(pair, sender="caller/7").call("move", {"x": 5}))
    await realm.until(lambda: pair.left.description().busy == "move")
    (call,) = pair.left.runtime.look(lambda state: [one.principal for one in state.calls.live.values()])
    assert call == pair.runtime.principal == pair.left.runtime.core.state.lease.current.principal
    (own,) = pair.runtime.look(lambda state: [one.principal for one in state.calls.live.values()])
    assert (own.agent, own.process) == ("caller/7", realm.operator.identity.process)
    await calling


async def test_each_event_that_a_request_leads_to_says_who_asked(realm: Any) -> None:
    """An event without a principal has the rights of the robot itself, so none may be forgotten."""
    pair, rover = await realm.start(Pair("pair")), await realm.start(Rover("left"))
    written: dict[str, list[CoreEvent]] = {"pair": [], "left": []}
    for agent in (pair, rover):
        handle = agent.runtime._handle
        agent.runtime._handle = lambda event, now, handle=handle, seen=written[agent.robot.name]: (
            seen.append(event),
            handle(event, now),
        )[1]
    await realm.operator.announce("caller/7")
    operator, child = realm.client(pair, sender="caller/7"), realm.client(rover, sender="caller/7")
    await operator.enslave("left", rover.address)
    await operator.call("move", {"x": 1})
    for epoch in (None, 7):
        for order in (child.cancel(epoch=epoch), child.cancel("k", epoch=epoch), child.resume(epoch=epoch)):
            with pytest.raises(VrError):
                await order
        detach = Detach(key="k", epoch=epoch)
        with pytest.raises(VrError):
            await asked(realm, rover, detach, Done, "caller/7")
    await operator.cancel()
    await operator.safe_stop("a hand")
    await operator.resume()
    await operator.free("left")
    inside = on.Tick | on.Finish | on.Renewed | on.StopAnswered | on.Halted | on.Obeyed
    told = {
        name: [event for event in events if not isinstance(event, inside)] for name, events in written.items()
    }
    assert {type(event) for event in told["left"]} >= {
        on.ParentAsked, on.Invoke, on.CancelAll, on.CancelAsked, on.DetachAsked, on.StopAsked,
        on.ReleaseAsked, on.EndLease,
    }  # fmt: skip
    assert {type(event) for event in told["pair"]} >= {
        on.Reserve, on.Bind, on.Invoke, on.CancelAll, on.StopAsked, on.ReleaseAsked, on.FreeAsked,
    }  # fmt: skip
    nobody = [event for events in told.values() for event in events if event.principal == ITSELF]
    assert nobody == []


def test_a_request_of_another_user_is_refused() -> None:
    mine, other = this_process(), Credentials(process=1, user=4_000_000_000)
    authorise(principal_of(mine, "", "pts/3"), SafeStop(), None)
    for request in (SafeStop(), Cancel(), Describe()):
        with pytest.raises(NotAllowed, match="4000000000@pts/3 may not ask for"):
            authorise(principal_of(other, "", "pts/3"), request, None)


def test_no_request_is_of_the_robot_itself() -> None:
    assert principal_of(Credentials(process=0, user=0), "", "") != ITSELF
    assert principal_of(Credentials(process=0, user=4_000_000_000), "", "") != ITSELF


@pytest.mark.parametrize("terminal", ["pts/3; rm", "a" * 33, "bob@pts/1"])
def test_a_terminal_that_cannot_be_one_is_called_a_script(terminal: str) -> None:
    person = principal_of(this_process(), "", terminal).person
    assert person.endswith(f"@{SCRIPT}")
    assert isinstance(principal_of(this_process(), "", terminal), Principal)


def test_the_next_process_of_a_parent_that_is_away_is_its_heir_and_nobody_else() -> None:
    parent = Address("robot", "pair", "1")
    before, after = (Principal(user="anna", process=number, agent=parent.key) for number in (7, 8))
    lease = GrantedLease.free("left", unix=0.0)
    lease.petition(parent, "left", ("pair",), 5.0, now=1.0, unix=1.0, principal=before)
    lease.promise(10.0)
    epoch = lease.epoch
    others = (
        Principal(user="bob", process=8, agent=parent.key),
        Principal(user="anna", process=8, agent="robot/other/1"),
    )
    for principal in (after, *others):
        with pytest.raises(NotInControl):
            lease.renew(parent, epoch, ("pair",), now=2.0, principal=principal)
    assert lease.wait_for(parent, 2.0)
    for principal in others:
        with pytest.raises(NotInControl):
            lease.renew(parent, epoch, ("pair",), now=9.0, principal=principal)
    # what the process before had asked arrives after its end: its heir is waited for all the same
    late = lease.renew(parent, epoch, ("pair",), now=3.0, principal=before, is_there=False)
    assert late.away
    assert late.expires == 12.0, "and as long as before"
    granted = lease.renew(parent, epoch, ("pair",), now=9.0, unix=9.0, principal=after)
    assert granted.epoch > epoch
    for named in (epoch, granted.epoch):  # what it has sent crosses the grant
        lease.check(named, 9.5, after)
    with pytest.raises(StaleEpoch):  # the process before, should it have been paused only
        lease.check(epoch, 9.5, before)
    with pytest.raises(StaleEpoch):
        lease.renew(parent, epoch, ("pair",), now=9.5, principal=before)


def test_an_heir_that_was_killed_before_it_noted_its_epoch_has_an_heir_itself() -> None:
    parent = Address("robot", "pair", "1")
    first, second, third = (Principal(user="anna", process=number, agent=parent.key) for number in (7, 8, 9))
    lease = GrantedLease.free("left", unix=0.0)
    lease.petition(parent, "left", ("pair",), 5.0, now=1.0, unix=1.0, principal=first)
    lease.promise(10.0)
    epoch = lease.epoch
    assert lease.wait_for(parent, 2.0)
    lost = lease.renew(parent, epoch, ("pair",), now=3.0, unix=3.0, principal=second).epoch
    assert lease.wait_for(parent, 4.0)
    granted = lease.renew(parent, epoch, ("pair",), now=5.0, unix=5.0, principal=third).epoch
    assert epoch < lost < granted
    for process, named in ((first, epoch), (second, epoch), (second, lost), (third, lost)):
        with pytest.raises(StaleEpoch):
            lease.check(named, 5.5, process)
    lease.check(epoch, 5.5, third)


def test_while_its_parent_is_away_a_person_may_end_what_a_robot_does_and_begin_nothing() -> None:
    parent = Address("robot", "pair", "1")
    holder = Principal(user="anna", process=7, agent=parent.key)
    person = Principal(user="anna", process=9, agent="caller/1", terminal="pts/3")
    lease = GrantedLease.free("left", unix=0.0)
    lease.petition(parent, "left", ("pair",), 5.0, now=1.0, unix=1.0, principal=holder)
    lease.promise(10.0)
    epoch = lease.epoch
    for ends in (False, True):
        with pytest.raises(NotInControl):
            lease.check(None, 2.0, person, ends=ends)
    with pytest.raises(NotInControl):
        lease.release(parent, epoch, unix=2.0, principal=person)
    assert lease.wait_for(parent, 2.0)
    with pytest.raises(NotInControl):
        lease.check(None, 2.0, person)
    lease.check(None, 2.0, person, ends=True)
    robot = Principal(user="anna", process=9, agent="robot/other/1")
    with pytest.raises(NotInControl):  # only a person
        lease.release(parent, epoch, unix=2.0, principal=robot)
    assert lease.release(parent, epoch, unix=2.0, principal=person) is not None
    assert lease.current is None
    with pytest.raises(StaleEpoch):  # the parent that comes back does not get it again
        lease.petition(parent, "left", ("pair",), 5.0, now=3.0, unix=3.0, returns=epoch, principal=holder)


# -- the envelope: an expired request does not begin when the process that hung reads its socket ---


ASKS_OR_PROLONGS = {
    req.Describe, req.Detach, req.Petition, req.Renew, req.ReadLog, req.ReadHistory, req.DescribeHost,
    req.Register, req.Query, req.Look, req.DescribeView, req.RenewEntry, req.RenewFence, req.WatchEntries,
    req.DescribeSpace, req.DescribeGateway, req.ReadEvents, req.VerifyEvents, req.ReadOrders, req.MarkSeen,
    req.FetchOrders, req.TellOrders, req.ReadKnown, req.ShareRecords, req.PrepareMove, req.TakeRobot,
    req.AskMove, req.ReadBundle,
}  # fmt: skip
"""Requests that are void when their caller no longer waits."""

ME = this_process()

LEASE = 2.0
"""[s] of silence after which the network lets a member go."""


def test_of_each_request_it_is_decided_how_late_it_may_come() -> None:
    kinds = (set(BEGINS), set(ENDS), ASKS_OR_PROLONGS)
    assert set[Any]().union(*kinds) == set(get_args(req.AnyRequest))
    assert sum(map(len, kinds)) == len(get_args(req.AnyRequest)), "each is of one kind"
    sealed = seal(req.Detach(key="k"), now=100.0, within=5.0)
    assert opened(sealed.body, ME, "a robot", 104.9).request == req.Detach(key="k")
    with pytest.raises(NoAnswer):
        opened(sealed.body, ME, "a robot", 105.1)


async def read(agent: RobotAgent, body: bytes) -> list[req.Reply]:
    """Let an agent find a request in its socket."""
    transport: Any = agent.transport
    answers: list[bytes] = []
    answered = handled(transport.served[agent.address.key], ME)(body, answers.append)
    assert answered is not None
    await answered
    return [req.decode_reply(answer, key="it") for answer in answers]


@pytest.fixture
def asker(realm: Any) -> Recorder:
    return Recorder(realm.operator)


@pytest.mark.parametrize("hung_for", [0.0, 1.0, LEASE - 0.01])
@pytest.mark.parametrize("what", ["call", "tell", "resume", "enslave", "free", "delete"])
async def test_what_was_asked_of_a_process_that_hangs_never_begins_after_its_asker_gave_up(
    realm: Any, asker: Any, what: str, hung_for: float
) -> None:
    robot = await realm.start(Pair("pair") if what in {"enslave", "free", "delete"} else Rover("rover"))
    client = RobotClient(asker, robot.address)
    questions = {
        "call": lambda: client.call("move", {}),
        "tell": lambda: client.tell("move", {}),
        "resume": client.resume,
        "enslave": lambda: client.enslave("left", robot.address),
        "free": lambda: client.free("left"),
        "delete": client.delete,
    }
    await client.safe_stop("so")
    realm.network.freeze(robot.transport)
    await asyncio.sleep(hung_for)
    asker.sent.clear()
    with pytest.raises((Unreachable, NoAnswer)):
        await questions[what]()
    answers = await read(robot, asker.sent[0])
    realm.network.thaw(robot.transport)
    assert [type(answer) for answer in answers] == [req.Raised]
    assert isinstance(answers[0], req.Raised)
    assert isinstance(answers[0].revive(), NoAnswer)
    assert robot.description().stopped
    assert not robot.closed.is_set()


async def test_a_stop_is_obeyed_however_late_it_comes(realm: Any, asker: Any) -> None:
    rover = await realm.start(Rover("rover"))
    realm.network.freeze(rover.transport)
    with pytest.raises(VrError):
        await RobotClient(asker, rover.address).safe_stop("so")
    await asyncio.sleep(60)
    await read(rover, asker.sent[0])
    realm.network.thaw(rover.transport)
    assert rover.description().stopped


async def test_nobody_waits_longer_for_who_has_ended(realm: Any, asker: Any) -> None:
    rover = await realm.start(Rover("rover"))
    realm.kill(rover)
    began = realm.runner.now()
    with pytest.raises(Unreachable):
        await RobotClient(asker, rover.address).call("move", {})
    assert realm.runner.now() - began < 0.1


def sealed_at(asked: float, within: float = 5.0) -> bytes:
    return seal(req.Call(key="k", command="move", deadline=5.0), now=asked, within=within).body


def test_on_another_machine_a_request_is_as_new_as_its_arrival() -> None:
    with on_clock("one machine"):
        body = sealed_at(100.0)
        assert opened(body, ME, "rover", 100.0 + FRESH - 0.1).asked == 100.0
        with pytest.raises(NoAnswer):
            opened(body, ME, "rover", 100.0 + FRESH)
    with on_clock("another machine"):
        assert opened(body, ME, "rover", 7000.0).asked == 7000.0


def test_a_system_that_does_not_name_its_clock_counts_from_the_arrival(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(envelope, "this_clock", lambda: "")
    assert opened(sealed_at(100.0), ME, "rover", 7000.0).asked == 7000.0


@pytest.mark.parametrize("asked", [math.nan, math.inf, 1e300])
def test_a_moment_that_has_not_come_yet_counts_as_now(asked: float) -> None:
    assert opened(sealed_at(asked), ME, "rover", 100.0).asked == 100.0


def test_only_what_ends_something_holds_for_ever() -> None:
    for request in (req.SafeStop(), req.Cancel()):
        assert opened(seal(request, now=0.0, within=1.0).body, ME, "rover", 1e6).request == request
    with pytest.raises(NoAnswer):
        opened(seal(req.Describe(), now=0.0, within=1.0).body, ME, "rover", 1.0)


def test_the_envelope_says_who_asks() -> None:
    body = seal(req.Describe(), now=0.0, within=1.0, sender="robot/parent/1").body
    assert opened(body, ME, "rover", 0.5).principal.agent == "robot/parent/1"


@given(st.binary(max_size=200))
def test_what_is_no_envelope_is_garbled(body: bytes) -> None:
    with pytest.raises((Garbled, NoAnswer)):
        opened(body, ME, "rover", 0.0)


async def test_a_deadline_does_not_grow_by_the_way(realm: Any) -> None:
    """Operator, pair and rover are 0.2 s apart; the rover's command still ends by the operator's clock."""
    rover, pair = await realm.start(Rover("left")), await realm.start(Pair("pair"))
    client = RobotClient(realm.operator, pair.address)
    await client.enslave("left", rover.address)
    realm.network.delay = 0.2
    began = realm.runner.now()
    call = asyncio.create_task(client.call("move", {"x": 60}, deadline=1.5))
    await realm.until(lambda: rover.description().busy == "move")
    deadline_at = rover.runtime.look(lambda state: [call.deadline_at for call in state.calls.live.values()])
    assert deadline_at == [pytest.approx(began + 1.5, abs=0.01)]
    with pytest.raises(VrError, match="deadline"):
        await call
