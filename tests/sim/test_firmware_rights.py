"""Who commands a controller: claims and operator control, what keeps a motion alive, who is told."""

from __future__ import annotations

import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.messages import (
    Claim,
    ClaimStatus,
    ClaimWish,
    ControlStatus,
    GoalState,
    MavCmd,
    MavParamError,
    MavParamType,
    MavResult,
    Mode,
    ModeKind,
    ParamError,
    ParamRequestList,
    ParamSet,
    ParamValue,
    Reason,
    Setpoint,
    SetpointKind,
    Verb,
    make,
)
from robotree.sim.testing import NAN, Operator, RoverBench

SLOW = 0.05


@pytest.fixture
def other(rover: RoverBench) -> Operator:
    return rover.operator.another(component=31, system=255)


def claim(
    operator: Operator,
    holder: int,
    *,
    epoch: int = 1,
    wish: ClaimWish = ClaimWish.KEEP,
    term: float = 3.0,
    life: int = 0,
) -> ClaimStatus:
    """Claim the controller; its answer."""
    before = len(operator.all(ClaimStatus))
    operator.say(Claim(holder, epoch, round(1000 * term), life, 1, 1, wish, f"robot-{holder}"))

    def answers() -> list[ClaimStatus]:
        return [each for each in operator.all(ClaimStatus)[before:] if each.target_system]

    operator.until(lambda: bool(answers()), 1.0)
    return answers()[-1]


def test_what_somebody_moves_goes_on_when_it_claims_the_controller(rover: RoverBench) -> None:
    key = rover.operator.ask(Verb.MOVE, 0.1, 0.0, SLOW)
    rover.operator.wait(0.3)
    claim(rover.operator, 5, term=9.0)
    assert rover.operator.status_of(key).state == GoalState.ACTIVE


def test_a_ground_station_in_control_goes_before_the_claim(rover: RoverBench) -> None:
    station = rover.operator.another(component=190, system=254)
    claim(rover.operator, 5, term=9.0)
    refused = station.command(MavCmd.ROBOTREE_MOVE, 0.1, 0.0)
    assert refused.result == MavResult.TEMPORARILY_REJECTED
    station.say(ParamSet(1, 1, "LINK_SILENCE", 3.0, MavParamType.REAL32))
    station.wait(0.1)
    assert station.latest(Mode).silence_ms == 2000, "parameters are the holder's, too"
    assert station.command(MavCmd.REQUEST_OPERATOR_CONTROL, 1).result == MavResult.ACCEPTED
    station.say(ParamSet(1, 1, "LINK_SILENCE", 3.0, MavParamType.REAL32))
    station.wait(0.1)
    assert station.latest(Mode).silence_ms == 3000
    assert station.command(MavCmd.ROBOTREE_MOVE, 0.1, 0.0).result == MavResult.ACCEPTED
    assert rover.operator.do(Verb.MOVE, 0.1, 0.0).reason == Reason.NOT_IN_CONTROL
    assert station.command(MavCmd.REQUEST_OPERATOR_CONTROL, 0).result == MavResult.ACCEPTED
    claim(rover.operator, 5)
    assert rover.operator.do(Verb.MOVE, -0.1, 0.0).state == GoalState.SUCCEEDED


def test_a_claim_protects_each_parameter_in_each_form(rover: RoverBench, other: Operator) -> None:
    claim(rover.operator, 5, term=9.0)
    other.say(ParamRequestList(1, 1))
    other.wait(1.0)
    values = {each.param_id: each for each in other.all(ParamValue)}
    assert "LINK_SILENCE" in values
    for name, told in values.items():
        other.say(ParamSet(1, 1, name, told.param_value * 1.01, MavParamType.REAL32))
        fields = {"param_id": name, "param_value": "1.5", "param_type": 9}
        other.say(make("PARAM_EXT_SET", target_system=1, target_component=1, **fields))
        other.wait(0.05)
        assert other.latest(ParamError).error == MavParamError.PERMISSION_DENIED
        assert other.latest(ParamValue).param_value == told.param_value
    rover.operator.say(ParamSet(1, 1, "LINK_SILENCE", 3.0, MavParamType.REAL32))
    rover.operator.wait(0.1)
    assert other.latest(Mode).silence_ms == 3000, "the holder sets it"


@pytest.mark.parametrize("how", ["released", "silent", "link"])
def test_a_claim_that_has_ended_leaves_no_lease_behind(rover: RoverBench, how: str) -> None:
    """MAVSDK and MAVProxy get in again after a proxy that has gone."""
    station, proxy = rover.operator.another(component=190, system=254), rover.operator
    claim(proxy, 5, epoch=1_700_000_000, term=9.0)
    assert proxy.do(Verb.MOVE, 0.1, 0.0, epoch=1_700_000_000).state == GoalState.SUCCEEDED
    claim(proxy, 5, epoch=1_700_000_000, term=0.3)
    assert station.command(MavCmd.ROBOTREE_MOVE, 0.1, 0.0).result == MavResult.TEMPORARILY_REJECTED
    if how == "released":
        claim(proxy, 5, epoch=1_700_000_000, wish=ClaimWish.RELEASE)
    elif how == "link":
        proxy.leave()
    station.wait(0.7)
    assert station.latest(ClaimStatus).holder == 0
    for step in (0.1, -0.1):
        assert station.command(MavCmd.ROBOTREE_MOVE, step, 0.0).result == MavResult.ACCEPTED
    stale = station.do(Verb.MOVE, 0.1, 0.0, epoch=1_699_999_999)
    assert stale.reason == Reason.STALE_EPOCH, "the lease before stays over"


def test_a_name_that_is_no_text_mutes_nobody(rover: RoverBench, other: Operator) -> None:
    """24 bytes that are no UTF-8, as a hostile client sends them."""
    name = b"\xff" * 24
    wish = Claim(5, 1, 9000, 0, 1, 1, ClaimWish.KEEP, name)  # type: ignore[arg-type]
    (heard,) = Parser().feed(encode(wish, sequence=0, system=255, component=31))
    assert isinstance(heard.message, Claim)
    assert heard.message.name == "?" * 24
    rover.operator.say(heard.message)
    other.wait(1.2)
    status = other.latest(ClaimStatus)
    assert (status.holder, status.name) == (5, "?" * 24)
    assert Parser().feed(encode(status, sequence=0, system=1, component=1)), "it can be sent"


def test_an_extended_parameter_that_is_no_text_is_answered(rover: RoverBench) -> None:
    fields = {"param_id": b"\xff" * 16, "param_value": b"\xfe" * 128, "param_type": 9}
    rover.operator.say(make("PARAM_EXT_SET", target_system=1, target_component=1, **fields))
    rover.operator.wait(0.05)
    names = [message.codec.definition.name for _, message in rover.operator.heard]
    assert names.count("PARAM_EXT_ACK") == 1


@pytest.fixture
def watcher(rover: RoverBench) -> Operator:
    return rover.operator.another(system=77)


def take(operator: Operator, *, takeover: bool = False) -> None:
    ack = operator.command(MavCmd.REQUEST_OPERATOR_CONTROL, 1, float(takeover))
    assert ack.result == MavResult.ACCEPTED
    operator.wait(0.02)


def test_goals_of_others_are_refused_and_may_be_asked_again_later(
    rover: RoverBench, watcher: Operator
) -> None:
    take(rover.operator)
    refused = watcher.do(Verb.MOVE, 0.1, 0.0, epoch=9)
    assert (refused.state, refused.reason) == (GoalState.REFUSED, Reason.NOT_IN_CONTROL)
    assert "255" in refused.text
    assert rover.operator.latest(Mode).epoch == 0, "who may not command fences nobody"
    rover.operator.succeed(Verb.MOVE, 0.1, 0.0)
    rover.operator.command(MavCmd.REQUEST_OPERATOR_CONTROL, 0)
    watcher.ask(Verb.MOVE, 0.1, 0.0, epoch=9, key=refused.key)
    watcher.wait(0.05)
    assert watcher.status_of(refused.key).state == GoalState.ACTIVE


def test_commands_and_set_points_of_others_do_nothing(rover: RoverBench, watcher: Operator) -> None:
    take(rover.operator)
    assert watcher.command(MavCmd.ROBOTREE_MOVE, 0.1, 0.0).result == MavResult.TEMPORARILY_REJECTED
    for number in range(1, 20):
        watcher.say(Setpoint(0, 0, number, (0.3, 0.0, *(NAN,) * 5), 200, 1, 1, SetpointKind.BASE_VELOCITY))
        watcher.wait(0.05)
    assert rover.world.rover.state().position[0] == pytest.approx(0.0, abs=0.002)


def test_who_takes_control_ends_what_others_move(rover: RoverBench, watcher: Operator) -> None:
    running = watcher.ask(Verb.MOVE, 1.0, 0.0, epoch=3)
    watcher.wait(0.3)
    take(rover.operator)
    ended = watcher.end_of(running, within=0.1)
    assert (ended.state, ended.reason) == (GoalState.CANCELLED, Reason.NOT_IN_CONTROL)


def test_a_stop_is_everyones_and_its_release_is_not(rover: RoverBench, watcher: Operator) -> None:
    take(rover.operator)
    watcher.set_mode(ModeKind.SAFE_STOP, epoch=0)
    watcher.wait(0.05)
    assert watcher.mode()[0] == ModeKind.SAFE_STOP
    watcher.set_mode(ModeKind.READY, epoch=99)
    watcher.wait(0.05)
    assert Reason.NOT_IN_CONTROL in {mode.reason for mode in watcher.all(Mode)}
    assert watcher.mode()[0] == ModeKind.SAFE_STOP
    rover.operator.set_mode(ModeKind.READY)
    rover.operator.wait(0.05)
    assert watcher.mode()[0] == ModeKind.READY


@pytest.mark.parametrize("verb", [Verb.STATUS, Verb.MOVE])
def test_a_namesake_without_control_does_not_hide_that_the_owner_has_died(
    rover: RoverBench, verb: Verb
) -> None:
    namesake = rover.operator.another(component=190, system=255)
    take(rover.operator)
    running = rover.operator.ask(Verb.MOVE, 1.0, 0.0, 0.02)
    namesake.wait(0.1)
    namesake.ask(verb, 1.0, 0.0, 0.02, key=running)
    rover.operator.silent = True
    namesake.wait(3.2)
    assert namesake.mode() == (ModeKind.HOLD, Reason.LINK_SILENT)
    assert namesake.latest(ControlStatus).gcs_main == 0
    namesake.ask(Verb.STATUS, key=running)
    namesake.wait(0.1)
    assert namesake.status_of(running).reason == Reason.LINK_SILENT
