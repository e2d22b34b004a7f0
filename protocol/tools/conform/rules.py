"""The rules of docs/bring-your-own-robot.md, each with the trial that shows whether a controller keeps it.

One registry: `robotree wire conform`, the tests of the example controllers and the guide use it. A rule that
moves the robot does so slowly, between two places, and ends the movement.
"""

from __future__ import annotations

import asyncio
import math
import random
from enum import StrEnum
from itertools import pairwise
from typing import TYPE_CHECKING

import msgspec

from robotree.protocol.frame import encode
from robotree.protocol.messages import (
    ClaimStatus,
    ClaimWish,
    Goal,
    GoalState,
    GoalStatus,
    Heartbeat,
    Message,
    Mode,
    ModeKind,
    Reason,
    SetMode,
    Verb,
)
from robotree.protocol.services.fence import CLOCK_UNTIL, LAST_EPOCH
from robotree.protocol.tools.conform.trial import (
    BEAT,
    FIRST,
    NO_ARGS,
    SECOND,
    NotTried,
    RuleBroken,
    Trial,
    expect_status,
    require,
)

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    Check = Callable[[Trial], Awaitable[None]]

UNKNOWN_VERB = 777
OBSERVED = 3.2
"""[s] for which the messages that a controller sends by itself are counted."""
LATE_EPOCHS = (2**32 - 1, LAST_EPOCH + 1, CLOCK_UNTIL + 10 * 86_400)
"""Epochs that no honest clock explains: not before 2100."""
KEPT = 256


class Level(StrEnum):
    """How much a rule matters."""

    MUST = "MUST"
    """Without it something moves twice, or for somebody who may not move it, or a proxy cannot work."""
    SHOULD = "SHOULD"
    """Without it people see less, or some clients are not served."""


class Rule(msgspec.Struct, frozen=True):
    """One rule of the guide."""

    id: str
    level: Level
    text: str
    """The behaviour of a controller, as one sentence without a subject."""
    check: Check


RULES: dict[str, Rule] = {}
"""All rules by their id, in the order in which they are tried."""


def _rule(id_: str, level: Level, text: str) -> Callable[[Check], Check]:
    def register(check: Check) -> Check:
        RULES[id_] = Rule(id_, level, text, check)
        return check

    return register


MUST, SHOULD = Level.MUST, Level.SHOULD


# -- what it sends by itself


async def _rate(t: Trial, kind: type[Message], highest: float, name: str) -> None:
    """Listen for a while, and check that a message came at least every `highest` seconds."""
    heard_for = t.now() - t.line.received[0].at if t.line.received else 0.0
    await asyncio.sleep(max(OBSERVED - heard_for, 0.0))
    times = [each.at for each in t.line.received if isinstance(each.message, kind)]
    require(len(times) > 1, f"{name} came {len(times)} times in {OBSERVED:g} s")
    gap = max(after - before for before, after in pairwise(times))
    require(gap <= highest / t.pace, f"between two {name} passed {gap:.2f} s")


@_rule("introduction", MUST, "sends HEARTBEAT and MODE as soon as a link is opened")
async def _introduction(t: Trial) -> None:
    greeting: tuple[tuple[type[Message], float], ...] = ((Heartbeat, 0.6), (Mode, 0.3))
    for kind, within in greeting:
        await t.line.expect(kind)  # the next one is not due for a while, so another one is the greeting
        await t.restart()
        await t.line.expect(kind, within=within)


@_rule("heartbeat", MUST, "sends HEARTBEAT every second")
async def _heartbeat(t: Trial) -> None:
    await _rate(t, Heartbeat, 1.7, "HEARTBEAT")


@_rule("mode", MUST, "sends MODE twice a second, with the silence that it bears")
async def _mode(t: Trial) -> None:
    await _rate(t, Mode, 1.0, "MODE")
    require(t.mode is not None and t.mode.silence_ms > 0, "silence_ms is 0 in MODE")


@_rule("telemetry", MUST, "sends its telemetry at least five times a second")
async def _telemetry(t: Trial) -> None:
    await _rate(t, t.motions.telemetry, 0.5, t.motions.telemetry.codec.definition.name)


@_rule("life", SHOULD, "sends a life, another one after each start, so that it can be claimed")
async def _life(t: Trial) -> None:
    require(t.life, "life is 0 in MODE")


@_rule("claim-status", MUST, "sends CLAIM_STATUS every second, if it sends a life")
async def _claim_status(t: Trial) -> None:
    t.needs_claims()
    await _rate(t, ClaimStatus, 1.7, "CLAIM_STATUS")


@_rule("several-clients", SHOULD, "serves several clients at a time")
async def _several_clients(t: Trial) -> None:
    try:
        async with t.second_line():
            for _ in range(2):  # the first may have been sent before
                await t.line.expect(Mode)
    except NotTried as error:
        raise RuleBroken(str(error)) from None


# -- one goal


@_rule("reaches", MUST, "moves to a goal, and reports SUCCEEDED with progress 1")
async def _reaches(t: Trial) -> None:
    before = await t.place()
    goal = t.goal(*await t.far(quick=True))
    expect_status(await t.ask(goal), GoalState.ACTIVE, GoalState.ACCEPTED)
    while True:
        status = await t.status(goal.key, within=30.0)
        if status.state in {GoalState.ACTIVE, GoalState.ACCEPTED}:
            t.line.say(BEAT)
            continue
        break
    expect_status(status, GoalState.SUCCEEDED)
    require(status.progress == 1.0, f"progress is {status.progress:g} at the end")
    require(math.dist(before, await t.place()) > t.motions.still, "the robot is where it was before")


@_rule("progress", SHOULD, "reports GOAL_STATUS while a goal runs, each with a larger sequence")
async def _progress(t: Trial) -> None:
    goal, numbers = await t.begin(), list[int]()
    while len(numbers) < 3:
        status = await t.status(goal.key, within=1.0)
        numbers.append(status.sequence)
    require(numbers == sorted(set(numbers)), f"the sequences are {numbers}")


@_rule("cancel", MUST, "holds when a goal is cancelled, and reports CANCELLED")
async def _cancel(t: Trial) -> None:
    here = await t.place()
    goal = await t.begin()
    await t.moved(here, 5.0)
    await _cancelled(t, goal)
    await t.stands()


async def _cancelled(t: Trial, goal: Goal, **options: int) -> None:
    """Cancel the running goal, and check that it ends so."""
    t.line.say(t.cancel(goal.key, **options))
    await _ended(t, goal, Reason.OPERATOR)


async def _ended(t: Trial, goal: Goal, reason: Reason) -> None:
    """Check that a goal ends as cancelled."""
    expect_status(await t.status(goal.key, FIRST, *FINAL), GoalState.CANCELLED, reason=reason)


async def _held(t: Trial, epoch: int | None = None) -> Goal:
    """Have a goal reached that moves nothing."""
    hold = t.goal(Verb.HOLD, epoch=epoch)
    t.line.say(hold)
    await t.status(hold.key, FIRST, GoalState.SUCCEEDED)
    return hold


@_rule("hold", MUST, "takes HOLD as a goal that ends the running one and is reached at once")
async def _hold(t: Trial) -> None:
    goal, hold = await t.begin(), t.goal(Verb.HOLD)
    t.line.say(hold)
    await _ended(t, goal, Reason.SUPERSEDED)
    await t.status(hold.key, FIRST, GoalState.SUCCEEDED)


@_rule("newest", MUST, "ends the running goal as CANCELLED, SUPERSEDED when a newer one begins")
async def _newest(t: Trial) -> None:
    first = await t.begin()
    second = await t.movement()
    t.line.say(second)
    await _ended(t, first, Reason.SUPERSEDED)
    expect_status(await t.ask(msgspec.structs.replace(second, verb=Verb.STATUS)), GoalState.ACTIVE)


@_rule("unknown-verb", MUST, "refuses a verb that it does not know, and goes on with the running goal")
async def _unknown_verb(t: Trial) -> None:
    goal = await t.begin()
    expect_status(await t.ask(t.goal(UNKNOWN_VERB)), GoalState.REFUSED, reason=Reason.UNKNOWN_VERB)
    expect_status(await t.ask(_question(goal)), GoalState.ACTIVE)


@_rule("bad-argument", MUST, "refuses an infinite argument, and goes on with the running goal")
async def _bad_argument(t: Trial) -> None:
    goal = await t.begin()
    verb, args = await t.far()
    for wrong in ((math.inf, *args[1:]), (-math.inf, *args[1:])):
        expect_status(await t.ask(t.goal(verb, wrong)), GoalState.REFUSED)
    expect_status(await t.ask(_question(goal)), GoalState.ACTIVE)


@_rule("sentence", SHOULD, "gives a sentence with each refusal")
async def _sentence(t: Trial) -> None:
    require((await t.ask(t.goal(UNKNOWN_VERB))).text.endswith("."), "text is empty or no sentence")


@_rule("time-to-live", MUST, "holds and reports EXPIRED when ttl_ms is over")
async def _time_to_live(t: Trial) -> None:
    goal = await t.begin(ttl=400)
    expect_status(await t.status(goal.key, FIRST, *FINAL, within=3.0), GoalState.EXPIRED)
    began = next(each.at for each in t.spoken if each.message is goal)
    require(t.now() - began > 0.3, f"it has ended after {t.now() - began:.2f} s of 0.4 s")
    await t.stands()


FINAL = tuple(state for state in GoalState if state.final)


def _stays(mode: Mode, reason: Reason, release: str) -> None:
    """Check that a release is refused for a reason."""
    right = (mode.mode, mode.reason) == (ModeKind.SAFE_STOP, reason)
    require(right, f"{release} is answered by mode {mode.mode}, reason {mode.reason}")


def _question(goal: Goal) -> Goal:
    return msgspec.structs.replace(goal, verb=Verb.STATUS, args=NO_ARGS)


# -- keys


@_rule(
    "key-repeat",
    MUST,
    "repeats the status of a key that comes again with the same content, and does not move",
)
async def _key_repeat(t: Trial) -> None:
    goal = await t.begin(ttl=400)
    await t.status(goal.key, FIRST, *FINAL, within=3.0)
    again = msgspec.structs.replace(goal, ttl_ms=60_000)
    expect_status(await t.ask(again), GoalState.EXPIRED)
    await t.stands()


@_rule("key-nan", MUST, "compares the content bit by bit, so that NaN equals NaN")
async def _key_nan(t: Trial) -> None:
    hold = await _held(t)
    expect_status(await t.ask(hold), GoalState.SUCCEEDED)


@_rule("key-larger-epoch", SHOULD, "obeys the larger epoch of a repeated goal")
async def _key_larger_epoch(t: Trial) -> None:
    hold = await _held(t)
    epoch = t.epoch + 2
    obeyed_epoch = (await t.ask(msgspec.structs.replace(hold, epoch=epoch))).epoch
    require(obeyed_epoch == epoch, f"epoch {epoch} came with a repeated goal, and it obeys {obeyed_epoch}")


@_rule(
    "key-reused", MUST, "refuses a known key with other content as KEY_REUSED, and goes on with its movement"
)
async def _key_reused(t: Trial) -> None:
    goal = await t.begin()
    other = msgspec.structs.replace(goal, verb=Verb.HOLD, args=NO_ARGS)
    t.line.say(other)
    status = await t.line.expect(GoalStatus, lambda it: it.key == goal.key and it.state != GoalState.ACTIVE)
    expect_status(status, GoalState.REFUSED, reason=Reason.KEY_REUSED)
    expect_status(await t.ask(_question(goal)), GoalState.ACTIVE)


@_rule("key-question", MUST, "takes verb STATUS as a question: UNKNOWN for a new key, and nothing begins")
async def _key_question(t: Trial) -> None:
    goal = t.goal(Verb.STATUS)
    expect_status(await t.ask(goal), GoalState.UNKNOWN)
    verb, args = await t.far()
    began = msgspec.structs.replace(goal, verb=verb, args=args)
    expect_status(await t.ask(began), GoalState.ACTIVE, GoalState.ACCEPTED)


@_rule(
    "key-cancelled",
    MUST,
    "answers UNKNOWN to a cancel of a new key, and does not begin its goal when it comes",
)
async def _key_cancelled(t: Trial) -> None:
    goal = await t.movement()
    expect_status(await t.ask(t.cancel(goal.key)), GoalState.UNKNOWN)
    expect_status(await t.ask(goal), GoalState.UNKNOWN)
    await t.stands()


@_rule("key-of-sender", MUST, "knows a goal by its sender and its key: another sender has keys of its own")
async def _key_of_sender(t: Trial) -> None:
    goal = await t.begin()
    expect_status(await t.ask(_question(goal), SECOND), GoalState.UNKNOWN)
    await t.begin(SECOND, key=goal.key)


@_rule("key-zero", MUST, "refuses key 0 as BAD_ARGUMENT")
async def _key_zero(t: Trial) -> None:
    expect_status(await t.ask(await t.movement(key=0)), GoalState.REFUSED, reason=Reason.BAD_ARGUMENT)


@_rule("keys-kept", MUST, f"keeps the last {KEPT} keys, also those of refused goals")
async def _keys_kept(t: Trial) -> None:
    first = last = await _held(t)
    for number in range(1, KEPT):
        last = t.goal(UNKNOWN_VERB)
        t.line.say(last)
        if number % 16 == 0 or number == KEPT - 1:  # no more at once than its buffer takes
            await t.status(last.key)
    expect_status(await t.ask(first), GoalState.SUCCEEDED)
    expect_status(await t.ask(_question(last)), GoalState.REFUSED, reason=Reason.UNKNOWN_VERB)


# -- epochs


@_rule(
    "epoch-stale", MUST, "refuses a new goal with a smaller epoch as STALE_EPOCH, and does not keep its key"
)
async def _epoch_stale(t: Trial) -> None:
    await _raise_epoch(t)
    stale = await t.movement(epoch=t.epoch - 1)
    expect_status(await t.ask(stale), GoalState.REFUSED, reason=Reason.STALE_EPOCH)
    await t.stands()
    fresh = msgspec.structs.replace(stale, epoch=t.epoch)
    expect_status(await t.ask(fresh), GoalState.ACTIVE, GoalState.ACCEPTED)


@_rule("epoch-late", MUST, "refuses an epoch that no honest clock explains as BAD_EPOCH, in every message")
async def _epoch_late(t: Trial) -> None:
    before = t.epoch
    for epoch in LATE_EPOCHS:
        for message in (await t.movement(epoch=epoch), t.cancel(0, epoch)):
            expect_status(await t.ask(message), GoalState.REFUSED, reason=Reason.BAD_EPOCH)
        await t.set_mode(ModeKind.SAFE_STOP)
        mode = await t.set_mode(ModeKind.READY, epoch=epoch)
        _stays(mode, Reason.BAD_EPOCH, f"a release with epoch {epoch}")
        require(mode.epoch == before, f"it obeys epoch {mode.epoch} after a release with {epoch}")
        await t.set_mode(ModeKind.READY)
        if t.life:
            status = await t.request(5, epoch=epoch)
            require(
                status.reason == Reason.BAD_EPOCH,
                f"a claim with epoch {epoch} is answered with reason {status.reason}",
            )
    await t.stands()


@_rule("epoch-of-cancel", MUST, "obeys a cancel by key with any epoch, and answers a repeated goal with any")
async def _epoch_of_cancel(t: Trial) -> None:
    await _raise_epoch(t)
    goal = await t.begin()
    expect_status(await t.ask(msgspec.structs.replace(goal, epoch=0)), GoalState.ACTIVE)
    await _cancelled(t, goal, epoch=0)


@_rule("epoch-of-cancel-0", MUST, "cancels the running goal (key 0) only with an epoch that is not stale")
async def _epoch_of_cancel_0(t: Trial) -> None:
    await _raise_epoch(t)
    goal = await t.begin()
    t.line.say(t.cancel(0, t.epoch - 1))
    await asyncio.sleep(0.2)
    expect_status(await t.ask(_question(goal)), GoalState.ACTIVE)
    t.line.say(t.cancel(0))
    await _ended(t, goal, Reason.OPERATOR)


@_rule("epoch-told", MUST, "gives the highest epoch obeyed in MODE and in each status")
async def _epoch_told(t: Trial) -> None:
    epoch = await _raise_epoch(t)
    mode = await t.line.expect(Mode)
    require(mode.epoch == epoch, f"MODE has epoch {mode.epoch}, and {epoch} was obeyed")
    status = await t.ask(t.goal(Verb.STATUS, epoch=0))
    require(status.epoch == epoch, f"the status has epoch {status.epoch}, and {epoch} was obeyed")


async def _raise_epoch(t: Trial) -> int:
    """Have a larger epoch obeyed."""
    epoch = t.epoch + 2
    await _held(t, epoch=epoch)
    return epoch


# -- the safe stop


@_rule(
    "stop",
    MUST,
    "obeys SAFE_STOP from every sender with any epoch: the goal is CANCELLED, STOPPED, the robot holds",
)
async def _stop(t: Trial) -> None:
    await _raise_epoch(t)
    goal = await t.begin()
    t.line.say(SetMode(0, *t.controller, ModeKind.SAFE_STOP), SECOND)
    await t.line.expect(Mode, lambda it: it.mode == ModeKind.SAFE_STOP, what="MODE SAFE_STOP")
    expect_status(await t.ask(_question(goal)), GoalState.CANCELLED, reason=Reason.STOPPED)
    await t.stands()


@_rule("stop-broadcast", MUST, "obeys SAFE_STOP that is for everybody (target_system 0)")
async def _stop_broadcast(t: Trial) -> None:
    t.line.say(SetMode(0, 0, 0, ModeKind.SAFE_STOP))
    await t.line.expect(Mode, lambda it: it.mode == ModeKind.SAFE_STOP, what="MODE SAFE_STOP")


@_rule(
    "stop-goals",
    MUST,
    "refuses each new goal as STOPPED until the release, and moves nothing by itself after it",
)
async def _stop_goals(t: Trial) -> None:
    await t.begin()
    await t.set_mode(ModeKind.SAFE_STOP)
    expect_status(await t.ask(await t.movement()), GoalState.REFUSED, reason=Reason.STOPPED)
    mode = await t.set_mode(ModeKind.READY)
    require(mode.mode == ModeKind.READY, f"a release with epoch {t.epoch} is answered with mode {mode.mode}")
    await t.stands()


@_rule("stop-release", MUST, "answers a release with a stale epoch by SAFE_STOP and STALE_EPOCH")
async def _stop_release(t: Trial) -> None:
    await _raise_epoch(t)
    await t.set_mode(ModeKind.SAFE_STOP)
    mode = await t.set_mode(ModeKind.READY, epoch=t.epoch - 1)
    _stays(mode, Reason.STALE_EPOCH, "it")


@_rule(
    "stop-other-mode",
    MUST,
    "takes no other SET_MODE than SAFE_STOP and READY: BAD_ARGUMENT, and a stop stays",
)
async def _stop_other_mode(t: Trial) -> None:
    await t.set_mode(ModeKind.SAFE_STOP)
    for other in (ModeKind.ACTIVE, ModeKind.FAULT, ModeKind.HOLD):
        wish = SetMode(t.epoch, *t.controller, other)
        t.line.say(wish)
        mode = await t.line.expect(
            Mode,
            lambda it: it.mode != ModeKind.SAFE_STOP or it.reason == Reason.BAD_ARGUMENT,
            what=f"MODE with BAD_ARGUMENT after SET_MODE {other.name}",
        )
        require(mode.mode == ModeKind.SAFE_STOP, f"SET_MODE {other.name} has ended the stop")


@_rule("stops-counted", SHOULD, "counts the stops in MODE: 1 at the start, one more with each that begins")
async def _stops_counted(t: Trial) -> None:
    before = t.mode.stops if t.mode is not None else 0
    require(before, "stops is 0 in MODE")
    for _ in range(2):
        mode = await t.set_mode(ModeKind.SAFE_STOP)
        require(mode.stops == before + 1, f"stops was {before}, and is {mode.stops} after one stop")


@_rule("stop-later", MUST, "answers a release that names an earlier stop with STOPPED, if it counts stops")
async def _stop_later(t: Trial) -> None:
    if t.mode is None or not t.mode.stops:
        raise NotTried("it counts no stops")
    seen = (await t.set_mode(ModeKind.SAFE_STOP)).stops
    await t.set_mode(ModeKind.READY, stops=seen)
    await t.set_mode(ModeKind.SAFE_STOP)
    mode = await t.set_mode(ModeKind.READY, stops=seen)
    _stays(mode, Reason.STOPPED, "a release that names the earlier stop")


# -- silence and the end of a link


def _silence(t: Trial) -> float:
    """[s] of our time for which the controller bears silence."""
    return _silence_ms(t) / 1000 / t.pace


def _needs_tcp(t: Trial) -> None:
    if not t.url.startswith("tcp:"):
        raise NotTried("only over TCP does a controller see the end of a link at once")


def _silence_ms(t: Trial) -> int:
    return t.mode.silence_ms if t.mode is not None else 2000


@_rule("silence", MUST, "holds when the commander of a goal is silent for silence_ms, though others speak")
async def _silent(t: Trial) -> None:
    goal = await t.begin()
    took = await _abandoned(t, goal, lambda: t.line.say(BEAT, SECOND))
    require(
        took > 0.7 * _silence(t), f"it has ended after {took:.1f} s, and silence_ms says {_silence(t):g} s"
    )
    await t.line.until(lambda: t.mode is not None and t.mode.mode == ModeKind.HOLD, 1.0, "MODE HOLD")
    await t.stands()


async def _abandoned(t: Trial, goal: Goal, speak: Callable[[], None]) -> float:
    """Speak as somebody who does not keep the goal alive; check that it ends by silence.

    Returns:
        How long that took, [s] of our time.
    """
    began, limit = t.now(), t.clock() + _silence_ms(t) / 1000 + 2.0
    latest = began + 5 * (_silence_ms(t) / 1000 + 2.0)  # where its time stands still
    while _state_of(t, goal) == GoalState.ACTIVE and t.clock() < limit and t.now() < latest:
        speak()
        await asyncio.sleep(0.1)
    took = t.now() - began
    state = _state_of(t, goal)
    require(state.final, f"{took:.1f} s after the last message that counts the goal is {state.name}")
    expect_status(await t.ask(_question(goal)), GoalState.CANCELLED, reason=Reason.LINK_SILENT)
    return took


def _state_of(t: Trial, goal: Goal) -> GoalState:
    """Return the state of a goal as the controller reported it last; send nothing."""
    found = GoalState.ACTIVE
    for each in t.line.received:
        if isinstance(each.message, GoalStatus) and each.message.key == goal.key:
            found = GoalState(each.message.state)
    return found


@_rule("silence-ended", MUST, "leaves HOLD with the next goal")
async def _silence_ended(t: Trial) -> None:
    await t.begin()
    await t.line.expect(
        Mode, lambda it: it.mode == ModeKind.HOLD, _silence_ms(t) / 1000 + 3.0, "MODE HOLD after the silence"
    )
    goal = await t.begin()
    await t.line.expect(Mode, lambda it: it.mode == ModeKind.ACTIVE, what="MODE ACTIVE")
    await _cancelled(t, goal)
    mode = await t.line.expect(Mode, lambda it: it.mode != ModeKind.ACTIVE, what="MODE after the goal")
    require(mode.mode == ModeKind.READY, f"its mode is {mode.mode} after the next goal")


@_rule(
    "silence-heard",
    MUST,
    "takes every message of the goal's sender as a sign of life, if no claim is in force",
)
async def _silence_heard(t: Trial) -> None:
    goal, began = await t.begin(), t.now()
    while t.now() - began < _silence(t) + 0.5:
        t.line.say(BEAT)
        await asyncio.sleep(_silence(t) / 8)
    expect_status(await t.ask(_question(goal)), GoalState.ACTIVE)


@_rule("silence-idle", MUST, "stays READY while nothing moves, however silent all are")
async def _silence_idle(t: Trial) -> None:
    began = t.now()
    await asyncio.sleep(_silence(t) + 0.5)
    modes = [each.message for each in t.line.received if each.at > began and isinstance(each.message, Mode)]
    require(
        {mode.mode for mode in modes} == {ModeKind.READY}, f"its modes are {[mode.mode for mode in modes]}"
    )


@_rule("link-end", MUST, "holds at once when the link over which a movement was commanded ends (over TCP)")
async def _link_end(t: Trial) -> None:
    _needs_tcp(t)
    goal = await t.begin()
    await t.restart()
    began = t.now()
    await t.line.expect(Mode, lambda it: it.mode == ModeKind.HOLD, _silence_ms(t) / 2000, "MODE HOLD at once")
    expect_status(await t.ask(_question(goal)), GoalState.CANCELLED, reason=Reason.LINK_SILENT)
    require(t.now() - began < 0.7 * _silence(t), "it has waited for the silence")


@_rule("link-other", MUST, "goes on with a movement when the link of somebody else ends")
async def _link_other(t: Trial) -> None:
    goal = await t.begin()
    async with t.second_line():
        pass
    await asyncio.sleep(0.3)
    expect_status(await t.ask(_question(goal)), GoalState.ACTIVE)


@_rule(
    "link-namesake",
    MUST,
    "takes the same ids on another link for another sender, until it asks there for its goal",
)
async def _link_namesake(t: Trial) -> None:
    async with t.second_line() as line:
        await _abandoned(t, await t.begin(), lambda: line.say(BEAT))
        goal = await t.begin(line=line)
        expect_status(await t.ask(_question(goal)), GoalState.ACTIVE)
    await asyncio.sleep(0.3)
    expect_status(await t.ask(_question(goal)), GoalState.ACTIVE)


# -- lives


def _other_life(t: Trial) -> int:
    t.needs_claims()
    return t.life % 0xFFFF + 1


@_rule("life-of-goal", MUST, "answers a goal for another life with UNKNOWN, OTHER_LIFE, and does not keep it")
async def _life_of_goal(t: Trial) -> None:
    other = _other_life(t)
    goal = await t.movement(life=other)
    expect_status(await t.ask(goal), GoalState.UNKNOWN, reason=Reason.OTHER_LIFE)
    await t.stands()
    expect_status(
        await t.ask(msgspec.structs.replace(goal, life=t.life)), GoalState.ACTIVE, GoalState.ACCEPTED
    )


@_rule(
    "life-of-release", MUST, "refuses a release, a claim and a cancel of key 0 for another life as OTHER_LIFE"
)
async def _life_of_release(t: Trial) -> None:
    other = _other_life(t)
    await t.set_mode(ModeKind.SAFE_STOP)
    mode = await t.set_mode(ModeKind.READY, life=other)
    _stays(mode, Reason.OTHER_LIFE, "the release")
    reason = (await t.request(5, life=other)).reason
    require(reason == Reason.OTHER_LIFE, f"the claim is answered with reason {reason}")
    status = await t.ask(t.cancel(0, life=other))
    expect_status(status, GoalState.REFUSED, reason=Reason.OTHER_LIFE)


@_rule("life-of-cancel", MUST, "obeys a cancel by key whatever life it names")
async def _life_of_cancel(t: Trial) -> None:
    other, goal = _other_life(t), await t.begin()
    await _cancelled(t, goal, life=other)


# -- the claim


async def _claimed(t: Trial, *, epoch: int | None = None, term: int = 9000) -> ClaimStatus:
    """Claim it for the first sender."""
    t.needs_claims()
    status = await t.request(5, epoch=epoch, term=term)
    right = (status.holder, status.reason) == (5, Reason.NONE)
    require(right, f"the claim is answered with holder {status.holder:#x}, reason {status.reason}")
    return status


@_rule("claim", MUST, "grants a claim with a larger epoch if nobody holds one, and answers with CLAIM_STATUS")
async def _claim(t: Trial) -> None:
    epoch = t.epoch + 1
    status = await _claimed(t, epoch=epoch)
    require(status.epoch == epoch, f"the claim has epoch {epoch}, and it obeys {status.epoch}")
    ids = status.holder_system, status.holder_component
    require(
        ids == FIRST, f"it names {ids[0]}/{ids[1]} as the holder's ids, and they are {FIRST[0]}/{FIRST[1]}"
    )
    require((await t.request(5, epoch=epoch)).reason == Reason.NONE, "the holder cannot keep its own epoch")


@_rule("claim-second", MUST, "refuses the claim of a second holder as NOT_IN_CONTROL, and names the first")
async def _claim_second(t: Trial) -> None:
    await _claimed(t)
    status = await t.request(6, sender=SECOND)
    right = (status.holder, status.reason) == (5, Reason.NOT_IN_CONTROL)
    require(right, f"it is answered with holder {status.holder:#x}, reason {status.reason}")


@_rule(
    "claim-goals",
    MUST,
    "refuses goals and releases of others as NOT_IN_CONTROL; their epochs count for nothing",
)
async def _claim_goals(t: Trial) -> None:
    await _claimed(t)
    epoch = t.epoch
    status = await t.ask(await t.movement(epoch=epoch + 5), SECOND)
    expect_status(status, GoalState.REFUSED, reason=Reason.NOT_IN_CONTROL)
    await t.set_mode(ModeKind.SAFE_STOP)
    mode = await t.set_mode(ModeKind.READY, epoch=epoch + 5, sender=SECOND)
    _stays(mode, Reason.NOT_IN_CONTROL, "a release of another sender")
    require(mode.epoch == epoch, f"it obeys epoch {mode.epoch} of a sender that holds no claim")


@_rule("claim-stop", MUST, "obeys a stop of everybody, also under a claim")
async def _claim_stop(t: Trial) -> None:
    await _claimed(t)
    await t.begin()
    mode = await t.set_mode(ModeKind.SAFE_STOP, epoch=0, sender=SECOND)
    require(mode.mode == ModeKind.SAFE_STOP, f"its mode is {mode.mode}")


@_rule("claim-epoch", MUST, "refuses a claim of another holder with the epoch of the last one as STALE_EPOCH")
async def _claim_epoch(t: Trial) -> None:
    await _claimed(t)
    await t.request(5, ClaimWish.RELEASE, epoch=t.epoch)
    status = await t.request(6, epoch=t.epoch, sender=SECOND)
    require(status.reason == Reason.STALE_EPOCH, f"it is answered with reason {status.reason}")


@_rule(
    "claim-take-over",
    MUST,
    "grants TAKE_OVER from another holder, whose movement ends as CANCELLED, NOT_IN_CONTROL",
)
async def _claim_take_over(t: Trial) -> None:
    await _claimed(t)
    goal = await t.begin()
    reason = (await t.request(6, ClaimWish.TAKE_OVER, epoch=t.epoch, sender=SECOND)).reason
    require(reason == Reason.STALE_EPOCH, f"with the epoch of the holder it is answered with reason {reason}")
    status = await t.request(6, ClaimWish.TAKE_OVER, sender=SECOND)
    require(status.holder == 6, f"it is answered with holder {status.holder:#x}, reason {status.reason}")
    expect_status(await t.ask(_question(goal)), GoalState.CANCELLED, reason=Reason.NOT_IN_CONTROL)


@_rule("claim-release", MUST, "ends the claim and the movement under it with RELEASE")
async def _claim_release(t: Trial) -> None:
    await _claimed(t)
    goal = await t.begin()
    status = await t.request(5, ClaimWish.RELEASE, epoch=t.epoch)
    require(not status.holder, f"it is still held by {status.holder:#x}")
    expect_status(await t.ask(_question(goal)), GoalState.CANCELLED)


@_rule("claim-term", MUST, "ends the claim and the movement under it when its term is over")
async def _claim_term(t: Trial) -> None:
    await _claimed(t, term=800)
    goal = await t.begin()
    await t.line.expect(ClaimStatus, lambda it: not it.holder, 3.0, "the end of a claim of 0.8 s")
    expect_status(await t.ask(_question(goal)), GoalState.CANCELLED)


@_rule(
    "claim-heard", MUST, "counts only the holder's CLAIM as a sign of life under a claim, no other message"
)
async def _claim_heard(t: Trial) -> None:
    await _claimed(t)
    epoch, goal, began = t.epoch, await t.begin(), t.now()
    while t.now() - began < _silence(t) + 0.5:  # first it is kept alive, and must go on
        await t.request(5, epoch=epoch)
        await asyncio.sleep(_silence(t) / 8)
    expect_status(await t.ask(_question(goal)), GoalState.ACTIVE)
    await _abandoned(t, goal, lambda: t.line.say(BEAT))


@_rule("claim-malformed", MUST, "refuses a claim of holder 0, or with an unknown wish, as BAD_ARGUMENT")
async def _claim_malformed(t: Trial) -> None:
    t.needs_claims()
    for holder, wish in ((0, ClaimWish.KEEP), (5, 99)):
        reason = (await t.request(holder, wish)).reason
        require(
            reason == Reason.BAD_ARGUMENT,
            f"holder {holder}, wish {int(wish)} is answered with reason {reason}",
        )


@_rule(
    "claim-link",
    MUST,
    "waits half a second for the holder to come back when its link has ended, then frees the claim",
)
async def _claim_link(t: Trial) -> None:
    t.needs_claims()
    _needs_tcp(t)
    async with t.second_line() as line:
        await t.request(5, line=line)
    await asyncio.sleep(0.1)
    early = await t.request(6, sender=SECOND)
    require(
        early.reason == Reason.NOT_IN_CONTROL,
        "the claim is free at once, and its holder may only have reconnected",
    )
    await t.line.expect(ClaimStatus, lambda it: not it.holder, 3.0, "the end of the claim")


# -- the rest


@_rule("target", MUST, "ignores messages for another system")
async def _target(t: Trial) -> None:
    other = t.controller[0] + 1
    goal = await t.movement()
    t.line.say(msgspec.structs.replace(goal, target_system=other))
    t.line.say(SetMode(0, other, t.controller[1], ModeKind.SAFE_STOP))
    await asyncio.sleep(0.3)
    require(t.mode is not None and t.mode.mode != ModeKind.SAFE_STOP, "it obeys a stop of another system")
    expect_status(await t.ask(_question(goal)), GoalState.UNKNOWN)


@_rule("noise", MUST, "is not confused by random bytes and torn frames")
async def _noise(t: Trial) -> None:
    chance = random.Random(1)
    goal = await t.movement()
    frame = encode(goal, sequence=0, system=FIRST[0], component=FIRST[1])
    for _ in range(40):
        torn = bytearray(frame[: chance.randint(1, len(frame))])
        torn[-1] ^= chance.randrange(1, 256)
        t.line.link.send(chance.randbytes(200) + bytes(torn))
    ends_a_false_start = b"\0" * 300  # whatever length a byte within noise has claimed as a frame's
    t.line.link.send(ends_a_false_start)
    for place in range(len(frame) - 38, len(frame)):  # each with one wrong byte
        t.line.link.send(frame[:place] + bytes((frame[place] ^ 1,)) + frame[place + 1 :])
    t.line.link.send(ends_a_false_start)
    await asyncio.sleep(0.2)
    mode = await t.line.expect(Mode)
    require(mode.mode == ModeKind.READY, f"after frames with one wrong byte its mode is {mode.mode}")
    expect_status(await t.ask(_question(goal)), GoalState.UNKNOWN)
    expect_status(await t.ask(goal), GoalState.ACTIVE, GoalState.ACCEPTED)
