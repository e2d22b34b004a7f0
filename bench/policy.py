"""What a policy costs a call: of a person's program to a robot in another process, with and without one.

    python bench/policy.py [--rounds N] [--lines N]

Two realms, each with one robot in a process of its own; one realm has a policy of so many lines. The calls
alternate, so that what else the machine does meets both. Then the decision alone: of a request that was asked
before, and of one that was not; and the look at the file, once a second. Times in us: of calls the median and
the middle half, of the rest processor time.
"""

from __future__ import annotations

import asyncio
import os
import statistics
import sys
import time
from collections.abc import Callable

from measuring import apart, be_robot, middle, options, started

from robotree.vr import Robot, command
from robotree.vr.base.address import Address
from robotree.vr.base.envelope import sitting_at
from robotree.vr.base.policy import PolicyGate
from robotree.vr.base.policy_reading import read_policy
from robotree.vr.base.principal import Credentials, principal_of, user_name
from robotree.vr.base.requests import Call
from robotree.vr.exchange.authority import Here, authorise
from robotree.vr.exchange.client import RobotClient
from robotree.vr.network.local import join
from robotree.vr.network.policy_file import PolicyFile, state_of

REALMS = {"open": False, "ruled": True}
TURN = 20
"""Calls in one realm before the other one has its turn."""


class Leaf(Robot):
    """What is called."""

    @command(effect="repeat")
    def step(self, x: float = 0.0) -> float:
        """Return the argument."""
        return x


def written(lines: int) -> str:
    """Return a policy; the line that allows the call is its last."""
    others = "".join(f'      - "robot-{number}-*"\n' for number in range(lines))
    me = user_name(os.geteuid())
    return (
        f"realm: ruled\nversion: 1\npersons: {{'{me}': some}}\nroles:\n  some:\n    administrate: yes\n"
        f"    command:\n{others}      - far.step\n"
    )


async def calls(rounds: int) -> dict[str, list[float]]:
    """Call in turns; returns the times [us]."""
    clients, times = dict[str, RobotClient](), {realm: list[float]() for realm in REALMS}
    transports = [await join(realm) for realm in REALMS]
    for realm, transport in zip(REALMS, transports, strict=True):
        (key,) = transport.presence.keys("robot/far/*")
        clients[realm] = RobotClient(transport, Address("robot", "far", key.rpartition("/")[2]))
    with sitting_at("bench"):
        for number in range(rounds * 2):
            for realm in sorted(REALMS, reverse=bool(number % 2)):
                for _ in range(TURN):
                    began = time.perf_counter()
                    await clients[realm].call("step", {"x": 1.0})
                    times[realm].append((time.perf_counter() - began) * 1e6)
    for transport in transports:
        await transport.close()
    return times


def timed(action: Callable[[int], object], repeats: int = 20_000) -> float:
    """Return how much of a processor something takes [us], the least of five runs."""

    def run() -> float:
        began = time.thread_time()
        for number in range(repeats):
            action(number)
        return (time.thread_time() - began) * 1e6 / repeats

    return min(run() for _ in range(5))


def decisions(lines: int) -> dict[str, float]:
    """Return what a decision takes [us]."""
    call, me = (
        Call(key="k", command="step", deadline=5.0),
        principal_of(Credentials(7, os.geteuid()), "", "pts/1"),
    )
    ruled, none = PolicyGate(), PolicyGate()
    ruled.policy = policy = read_policy(written(lines))
    there, open_ = (Here("robot", "far", gate, lambda: ("Leaf", "Robot")) for gate in (ruled, none))
    file = PolicyFile(state_of("ruled"))
    file.refresh(0.0)
    known = policy._known  # noqa: SLF001 # what it remembers is what is measured

    def anew(_: int) -> None:
        known.clear()
        authorise(me, call, None, there)

    return {
        "decision without a policy": timed(lambda _: authorise(me, call, None, open_)),
        "decision, asked before": timed(lambda _: authorise(me, call, None, there)),
        f"decision, asked for the first time, {lines} lines": timed(anew, 2000),
        "look at the file, once a second": timed(lambda number: file.refresh(float(number)), 2000),
    }


def main() -> None:
    """Print the table."""
    given = options(__doc__, rounds=50, lines=100)
    with apart():
        state = state_of("ruled")
        state.mkdir(parents=True, mode=0o700)
        (state / "policy.yaml").write_text(written(given.lines))
        with started(*((__file__, realm) for realm in REALMS)):
            times = asyncio.run(calls(given.rounds))
            alone = decisions(given.lines)
    for realm, found in times.items():
        which = f"with a policy of {given.lines} lines" if REALMS[realm] else "without a policy"
        print(f"call between two processes, {which}: {middle(found)}, {len(found)} calls")
    ratio = statistics.median(times["ruled"]) / statistics.median(times["open"])
    print(f"ratio of the medians {ratio:.3f}; load {os.getloadavg()[0]:.1f}")
    for name, taken in alone.items():
        print(f"{name}: {taken:.2f}")


if __name__ == "__main__":
    if sys.argv[1:2] and sys.argv[1] in REALMS:
        asyncio.run(be_robot(Leaf("far"), sys.argv[1]))
    else:
        main()
