"""Claims on the simulated controller: who commands, what keeps a motion alive, who is told."""

from __future__ import annotations

import pytest

from robotree.protocol import Parser, encode
from robotree.protocol.messages import (
    Claim,
    ClaimStatus,
    ClaimWish,
    Goal,
    GoalCancel,
    GoalState,
    Heartbeat,
    MavAutopilot,
    MavCmd,
    MavParamError,
    MavParamType,
    MavResult,
    MavState,
    MavType,
    Mode,
    ModeKind,
    ParamError,
    ParamRequestList,
    ParamSet,
    ParamValue,
    Reason,
    SetMode,
    Setpoint,
    SetpointKind,
    Verb,
    make,
)
from robotree.protocol.services.fence import LAST_EPOCH
from robotree.sim.testing import NAN, Operator, RoverBench

BEAT = Heartbeat(MavType.GCS, MavAutopilot.INVALID, 0, 0, MavState.ACTIVE)
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


def test_under_a_claim_only_the_holders_claim_keeps_a_motion_alive(rover: RoverBench) -> None:
    operator = rover.operator
    claim(operator, 5)
    key = operator.ask(Verb.MOVE, 1.4, 0.0, SLOW)
    for _ in range(10):
        operator.wait(0.4)
        claim(operator, 5)
    assert operator.status_of(key).state == GoalState.ACTIVE
    last = operator.now

    def namesakes_speak() -> bool:
        operator.say(BEAT)
        operator.ask(Verb.STATUS, key=key)
        return GoalState(operator.status_of(key).state).final

    operator.until(namesakes_speak, 4.0)
    assert operator.now - last == pytest.approx(2.0, abs=0.1), "the silence that it bears"
    assert operator.status_of(key).reason == Reason.LINK_SILENT


def test_without_a_claim_a_motion_lives_by_its_senders_voice(rover: RoverBench) -> None:
    key = rover.operator.ask(Verb.MOVE, 0.3, 0.0, SLOW, epoch=0)
    assert rover.operator.end_of(key).state == GoalState.SUCCEEDED


def test_a_second_holder_is_refused_and_both_are_told(rover: RoverBench, other: Operator) -> None:
    operator = rover.operator
    claim(operator, 5)
    key = operator.ask(Verb.MOVE, 1.4, 0.0, SLOW)
    refused = claim(other, 6, epoch=9)
    assert (refused.holder, refused.name, refused.reason) == (5, "robot-5", Reason.NOT_IN_CONTROL)
    goal = other.do(Verb.MOVE, 0.1, 0.0, epoch=9)
    assert (goal.state, goal.reason) == (GoalState.REFUSED, Reason.NOT_IN_CONTROL)
    assert goal.text == "robot-5 holds this robot; end it, or take over."
    other.say(Setpoint(0, 9, 1, (0.3, 0.0, *(NAN,) * 5), 200, 1, 1, SetpointKind.BASE_VELOCITY))
    other.wait(0.1)
    assert operator.status_of(key).state == GoalState.ACTIVE
    assert operator.latest(Mode).epoch == 1, "who is refused fences nobody"
    for _ in range(5):
        claim(other, 6, epoch=9)


def test_who_takes_over_ends_what_the_other_one_moves_and_is_named(
    rover: RoverBench, other: Operator
) -> None:
    operator = rover.operator
    claim(operator, 5)
    key = operator.ask(Verb.MOVE, 1.4, 0.0, SLOW)
    operator.wait(0.3)
    assert claim(other, 6, epoch=1, wish=ClaimWish.TAKE_OVER).reason == Reason.STALE_EPOCH
    assert claim(other, 6, epoch=2, wish=ClaimWish.TAKE_OVER).holder == 6
    ended = operator.end_of(key, within=0.2)
    assert (ended.state, ended.reason) == (GoalState.CANCELLED, Reason.NOT_IN_CONTROL)
    assert ended.text == "robot-6 commands this robot from now on."
    assert operator.latest(ClaimStatus).name == "robot-6"
    assert claim(operator, 5, epoch=3).reason == Reason.NOT_IN_CONTROL


def test_who_takes_over_behind_the_same_router_with_the_same_ids_ends_what_the_other_one_moves(
    rover: RoverBench,
) -> None:
    operator = rover.operator
    claim(operator, 5)
    key = operator.ask(Verb.MOVE, 1.4, 0.0, SLOW)
    operator.wait(0.3)
    assert claim(operator, 6, epoch=2, wish=ClaimWish.TAKE_OVER).holder == 6
    ended = operator.end_of(key, within=0.2)
    assert (ended.state, ended.reason) == (GoalState.CANCELLED, Reason.NOT_IN_CONTROL)


def test_what_somebody_moves_goes_on_when_it_claims_the_controller(rover: RoverBench) -> None:
    key = rover.operator.ask(Verb.MOVE, 0.1, 0.0, SLOW)
    rover.operator.wait(0.3)
    claim(rover.operator, 5, term=9.0)
    assert rover.operator.status_of(key).state == GoalState.ACTIVE


def test_a_holder_that_falls_silent_or_gives_up_makes_room(rover: RoverBench, other: Operator) -> None:
    claim(rover.operator, 5, term=1.0)
    other.wait(1.1)
    assert other.latest(ClaimStatus).holder == 0
    assert claim(other, 6, epoch=2).holder == 6
    claim(other, 6, epoch=2, wish=ClaimWish.RELEASE)
    assert claim(rover.operator, 5, epoch=3).holder == 5


def test_an_epoch_belongs_to_one_holder(rover: RoverBench, other: Operator) -> None:
    claim(rover.operator, 5, epoch=7, term=0.5)
    other.wait(0.6)
    assert claim(other, 6, epoch=7).reason == Reason.STALE_EPOCH
    assert claim(rover.operator, 5, epoch=7).holder == 5, "it is still its own"


def test_stops_and_cancels_by_key_are_everyones_under_a_claim_too(rover: RoverBench, other: Operator) -> None:
    operator = rover.operator
    claim(operator, 5)
    operator.ask(Verb.MOVE, 1.4, 0.0, SLOW)
    operator.wait(0.2)
    other.set_mode(ModeKind.SAFE_STOP, epoch=0)
    other.wait(0.1)
    assert operator.mode()[0] == ModeKind.SAFE_STOP
    other.set_mode(ModeKind.READY, epoch=9)
    other.wait(0.1)
    assert other.mode() == (ModeKind.SAFE_STOP, Reason.NOT_IN_CONTROL), "a release is the holder's"
    operator.set_mode(ModeKind.READY, epoch=1)
    operator.wait(0.1)
    assert operator.mode()[0] == ModeKind.READY


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


def test_who_dials_again_at_once_finds_its_claim_and_nobody_else_gets_it(
    rover: RoverBench, other: Operator
) -> None:
    first = rover.operator.another(component=30, system=255)
    claim(first, 5)
    first.leave()
    other.wait(0.2)
    away = claim(other, 6, epoch=2)
    assert (away.holder, away.holder_system, away.reason) == (5, 0, Reason.NOT_IN_CONTROL)
    back = rover.operator.another(component=30, system=255)
    assert claim(back, 5).holder_system == 255
    back.leave()
    other.wait(0.7)
    assert claim(other, 6, epoch=2).holder == 6


def test_what_was_made_for_another_life_moves_releases_and_ends_nothing(rover: RoverBench) -> None:
    operator, life = rover.operator, 1
    operator.wait(0.1)
    assert operator.latest(Mode).life == life
    args = (0.1, 0.0, *(NAN,) * 5)
    operator.say(Goal(77, 1, 0, args, Verb.MOVE, 1, 1, life + 1))
    operator.until(lambda: 77 in operator._statuses, 1.0)
    assert (operator.status_of(77).state, operator.status_of(77).reason) == (
        GoalState.UNKNOWN,
        Reason.OTHER_LIFE,
    )
    assert claim(operator, 5, life=life + 1).reason == Reason.OTHER_LIFE
    operator.say(Setpoint(0, 1, 1, (0.3, 0.0, *(NAN,) * 5), 200, 1, 1, SetpointKind.BASE_VELOCITY, life + 1))
    operator.wait(0.3)
    assert rover.world.rover.state().position[0] == pytest.approx(0.0, abs=0.002)
    key = operator.ask(Verb.MOVE, 1.4, 0.0, SLOW)
    operator.wait(0.2)
    operator.say(GoalCancel(0, 1, 1, 1, life + 1))
    operator.wait(0.2)
    assert operator.status_of(key).state == GoalState.ACTIVE
    operator.set_mode(ModeKind.SAFE_STOP)
    operator.say(SetMode(1, 1, 1, ModeKind.READY, 0, life + 1))
    operator.wait(0.1)
    assert operator.mode() == (ModeKind.SAFE_STOP, Reason.OTHER_LIFE)


@pytest.mark.parametrize("epoch", [2**32 - 1, LAST_EPOCH + 1])
def test_an_epoch_above_the_last_one_is_refused_in_whatever_it_comes(rover: RoverBench, epoch: int) -> None:
    operator = rover.operator
    operator.say(Setpoint(0, epoch, 1, (0.3, 0.0, *(NAN,) * 5), 200, 1, 1, SetpointKind.BASE_VELOCITY))
    assert operator.do(Verb.MOVE, 0.1, 0.0, epoch=epoch).reason == Reason.BAD_EPOCH
    operator.cancel(0, epoch=epoch)
    operator.set_mode(ModeKind.READY, epoch=epoch)
    operator.wait(0.1)
    assert operator.mode()[1] == Reason.BAD_EPOCH
    assert claim(operator, 5, epoch=epoch).reason == Reason.BAD_EPOCH
    assert operator.latest(Mode).epoch == 0
    assert operator.do(Verb.MOVE, 0.02, 0.0, epoch=1).state == GoalState.SUCCEEDED


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
