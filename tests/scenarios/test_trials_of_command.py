"""Two proxies' sessions against the real firmware: loss, repetition, delay, restarts of either side.

Virtual time, a seed for each trial. The wire may be one link for each proxy, or a router that outlives them.
"""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Sequence
from typing import Any

import pytest

from robotree.protocol.frame import Frame
from robotree.protocol.messages import AnyMessage, Claim, ClaimWish, GoalState, MavType, Verb
from robotree.protocol.services.claim_client import ClaimClient
from robotree.protocol.services.fence import Fence
from robotree.protocol.services.goal_client import GoalEnded
from robotree.protocol.services.peer import Send
from robotree.proxy.motion import Request
from robotree.proxy.session import ControllerSession, Redial
from robotree.sim.firmware import Firmware, Identity
from robotree.sim.firmware.device import Progress, Start
from robotree.sim.firmware.outgoing import Outgoing
from robotree.sim.testing import NAN

STEP = 0.05
SILENCE = 2.0
CLOCK = 1_800_000_000
PROXIES = (0, 1)


class Clockwork:
    """A device that moves for the time in a goal: its arguments are the goal's key and the time [s]."""

    verbs = (Verb.MOVE,)
    setpoint_kinds = parameters = ()
    tuning = None

    def __init__(self, trial: Trial) -> None:
        self.trial, self.end, self.moving = trial, 0.0, False

    def prepare(self, _: int, args: tuple[float, ...]) -> Start:
        def start() -> None:
            self.end, self.moving = self.trial.now + args[1], True
            self.trial.begun[round(args[0])] += 1
            self.trial.heard_at = self.trial.now

        return start

    def progress(self) -> Progress:
        self.moving = self.moving and self.trial.now < self.end
        return Progress(0.5) if self.moving else Progress(1.0, done=True)

    def hold(self) -> None:
        self.moving = False


class Trial:
    """One controller, two proxies, a wire and an opponent."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.now, self.heard_at, self.back_at = 0.0, 0.0, 0.0
        self.loss, self.twice = self.chance.choice([0, 0.1, 0.3]), self.chance.choice([0, 0.2])
        self.late, self.router = self.chance.choice([0.01, 0.3, 1.0]), self.chance.random() < 0.3
        self.begun: Counter[int] = Counter()
        self.ends: dict[int, GoalEnded] = {}
        self.repeatable: dict[int, bool] = {}
        self.wire: list[tuple[float, int, int, str, int, AnyMessage]] = []
        self.count, self.life = 0, 0
        self.kept = (0, 0, "")
        self.links = ["", ""]
        self.proxies = [self._proxy(i, take_over=False) for i in PROXIES]
        self._start()

    def _proxy(self, i: int, *, take_over: bool) -> ControllerSession:
        claim = ClaimClient(1, 1, holder=self.chance.getrandbits(63) + 1, name=f"{i}", take_over=take_over)
        return ControllerSession(component=self.chance.choice([30, 30 + i]), claim=claim)

    def _start(self) -> None:
        self.life, self.began, self.up = self.life + 1, self.now, True
        self.device = Clockwork(self)
        fence = Fence(*self.kept, clock=lambda: CLOCK + self.now, keep=self._keep)
        device: Any = self.device
        self.firmware = Firmware(
            device,
            (),
            system=1,
            mav_type=MavType.GROUND_ROVER,
            silence=SILENCE,
            identity=Identity(life=self.life),
            fence=fence,
        )

    def _keep(self, fence: Fence) -> None:
        self.kept = fence.epoch, fence.holder, fence.name

    @property
    def time(self) -> int:
        """[ms] of the controller."""
        return round(1000 * (self.now - self.began))

    # -- the wire

    def _via(self, i: int) -> str:
        return "router" if self.router else self.links[i]

    def _put(self, i: int, component: int, message: AnyMessage) -> None:
        """Send from a proxy's component, or (0) to the proxy."""
        if not self.links[i] or self.chance.random() < self.loss:
            return
        for _ in range(1 + (self.chance.random() < self.twice)):
            self.count += 1
            due = self.now + self.late * self.chance.random()
            self.wire.append((due, self.count, i, self.links[i], component, message))

    def _do(self, i: int, effects: Sequence[Any]) -> None:
        for effect in effects:
            match effect:
                case Send(message=message):
                    self._put(i, self.proxies[i].component, message)
                case Redial():
                    self._cut(i)
                case GoalEnded(key=key):
                    self.ends[key] = effect
                case _:
                    pass

    def _tell(self, words: Sequence[Outgoing]) -> None:
        for word in words:
            for i in PROXIES:
                if word.via is None or word.via == self._via(i):
                    self._put(i, 0, word.message)

    def _cut(self, i: int) -> None:
        via, self.links[i] = self._via(i), ""
        if via:
            self._do(i, self.proxies[i].closed("it was cut"))
            if self.up and not self.router:
                self._tell(self.firmware.leave(via, self.time))

    def _deliver(self) -> None:
        due = sorted(each[:2] for each in self.wire if each[0] <= self.now)
        arrived = {each[:2]: each for each in self.wire if each[0] <= self.now}
        self.wire = [each for each in self.wire if each[0] > self.now]
        for each in due:
            _, _, i, link, component, message = arrived[each]
            if link != self.links[i]:
                continue
            if not component:
                self._do(i, self.proxies[i].receive(Frame.of(message, system=1, component=1), self.now))
            elif self.up:
                self._hear(i, Frame.of(message, system=255, component=component))

    def _hear(self, i: int, frame: Frame) -> None:
        """Hand a frame to the controller; no client loses the claim to one that has not requested it."""
        rights = self.firmware._rights  # pyright: ignore[reportPrivateUsage]  the wire tells it late
        claims, said = rights.claims, frame.message
        before = claims.holding
        self._tell(self.firmware.receive(frame, self._via(i), self.time))
        after = claims.holding
        if not isinstance(said, Claim) or after is None or after.holder != said.holder:
            return
        self.heard_at = self.now
        if before is not None and before.holder != after.holder and self.time < 1000 * before.until:
            assert said.wish == ClaimWish.TAKE_OVER

    # -- time and the opponent

    def step(self) -> None:
        self.now = round(self.now + STEP, 6)
        for i in PROXIES:
            if not self.links[i] and self.chance.random() < 0.2:
                self.count += 1
                self.links[i] = f"link {self.count}"
                self._do(i, self.proxies[i].opened(self.now))
                self._tell(self.firmware.greet(self._via(i), self.time) if self.up else [])
        self._deliver()
        for i in PROXIES:
            self._do(i, self.proxies[i].tick(self.now))
        if self.up:
            self._tell(self.firmware.tick(self.time))
            assert not self.device.moving or self.now - self.heard_at <= SILENCE + 3 * STEP, "nobody commands"

    def oppose(self) -> None:
        """Do what goes wrong, now and then; and ask for movements."""
        i, event = self.chance.choice(PROXIES), self.chance.random()
        if event < 0.05:
            self.ask(i, self.chance.choice([0.3, 2.0, 9.0]), repeatable=self.chance.random() < 0.3)
        elif event < 0.06 and self.up:
            self.up, self.device.moving = False, False
            self.back_at = self.now + self.chance.choice([0.1, 0.6, 5.0])
            for each in () if self.router else PROXIES:
                self._cut(each)
        elif event < 0.065:
            self._cut(i)
            self.proxies[i] = self._proxy(i, take_over=self.chance.random() < 0.2)
        elif event < 0.08:
            self._cut(i)
        if not self.up and self.now >= self.back_at:
            self._start()

    def ask(self, i: int, seconds: float, *, repeatable: bool = False) -> int:
        """Have a proxy ask for a movement if it believes that it commands; its key, or 0."""
        session = self.proxies[i]
        if not session.online or session.denial:
            return 0
        key = len(self.repeatable) + 1
        self.repeatable[key] = repeatable
        request = Request(Verb.MOVE, (float(key), seconds, *(NAN,) * 5))
        epoch, ttl = self.chance.choice([1, 5, CLOCK + int(self.now)]), self.chance.choice([0.0, 1.0, 20.0])
        goal = session.start(key, request, epoch=epoch, ttl=ttl, now=self.now, repeatable=repeatable)
        self._do(i, goal)
        return key

    def heal(self) -> None:
        self.loss, self.twice, self.late = 0, 0, 0.01
        if not self.up:
            self._start()
        for _ in range(200):
            self.step()


@pytest.mark.parametrize("seeds", [range(n, n + 20) for n in (0, 20, 40)], ids=str)
def test_one_commands_and_nothing_that_adds_up_is_done_twice_or_told_wrongly(seeds: range) -> None:
    for seed in seeds:
        trial = Trial(seed)
        for _ in range(400):
            trial.step()
            trial.oppose()
        trial.heal()
        commanding = [i for i in PROXIES if not trial.proxies[i].denial]
        assert len(commanding) == 1, seed
        assert all(session.online for session in trial.proxies), seed
        last = trial.ask(commanding[0], 0.1)
        for _ in range(20):
            trial.step()
        assert trial.ends[last].state == GoalState.SUCCEEDED, seed
        for key, end in trial.ends.items():
            assert trial.begun[key] or end.state != GoalState.SUCCEEDED, (seed, key, end)
            if not trial.repeatable[key]:
                assert trial.begun[key] <= 1, (seed, key)
                assert not trial.begun[key] or end.state != GoalState.REFUSED, (seed, key, end)
