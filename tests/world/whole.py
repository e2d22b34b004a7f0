"""The stories of a whole realm (`story.py`) over the real network on one machine; for `make soak`."""

from __future__ import annotations

import random
from types import ModuleType
from typing import Any

from tests.world.kernel import SimulatedSocket, Trouble
from tests.world.machine import REALM, ROOT, MachineProcess, MachineWorld, network_is_whole, play_on_machine
from tests.world.story import CALM, LENGTH, Story, Work

ENTERED = 0.5
"""[s] until an operator looks again whether its program has entered the realm."""


class WholeStory(Story):
    """A whole realm on one machine."""

    world: MachineWorld

    def tell(self) -> None:
        """Have the seed take the processor from threads, until the calm, and let it all happen."""
        chance, preemption = random.Random(f"{self.world.seed} whole"), self.world.runner.preemption
        preemption.share = chance.choice([0.0, 0.01, 0.1])
        preemption.starve = chance.choice([0.0, 0.01, 0.1])
        self.world.machine.trouble = Trouble(
            split=chance.choice([0.0, 0.1, 0.5]),
            small=chance.choice([0.0, 0.0, 0.3]),
            late_accept=chance.choice([0.0, 0.01]),
            late_wake=chance.choice([0.0, 0.002]),
            slow_death=chance.choice([0.0, 0.001]),
        )
        self.world.runner.at(CALM, self._calm)
        self.world.runner.at(LENGTH - 0.5, self._look_at_network)
        super().tell()
        for line in self.world.logged:
            self.judge.complain(f"logged: {line}")

    def _calm(self) -> None:
        self.world.runner.preemption.share = 0.0
        self.world.machine.trouble = Trouble()

    def _look_at_network(self) -> None:
        for wrong in network_is_whole(self._machines()):
            self.judge.complain(f"network: {wrong}")

    def _machines(self) -> list[MachineProcess]:
        return [process for process in self.realm.processes.values() if isinstance(process, MachineProcess)]

    def _as_operator(self, when: float, work: Work, what: str = "", *, operator: str = "operator-1") -> None:
        if work != self._keep_whole or operator in self.realm.realm_clients:
            super()._as_operator(when, work, what, operator=operator)
        else:
            later = self.world.runner.now() + ENTERED
            self.world.runner.at(later, lambda: self._as_operator(later, work, what, operator=operator))

    # -- what goes wrong on one machine -----------------------------------------------------------

    def _links(self, names: list[str]) -> list[SimulatedSocket]:
        one, other = (self.realm.processes[name].runner for name in names)
        return self.world.machine.links_between(one, other)

    def _reset(self) -> None:
        names = self._two()
        self.world.note(names[0], f"is reset with {names[1]}")
        for end in self._links(names)[:: self.chance.choice([1, 3])]:
            end.reset()

    def _cut(self) -> None:
        names = self._two()
        self.world.note(names[0], f"is cut off from {names[1]}")
        ends = self._links(names)
        self._stall([end for end in ends if end.system.process.name == names[0]] or ends)

    def _stall(self, ends: list[SimulatedSocket], seconds: float | None = None) -> None:
        for end in ends:
            end.stalled = True
            self._for(self.chance.uniform(0.5, 6.0) if seconds is None else seconds, end.go_on)

    def _weather(self, until: float = 0.0) -> None:
        self.world.note("machine", "bad weather")
        self.world.machine.trouble.jitter = self.chance.uniform(0.0, 0.3)
        self._for(until or self.chance.uniform(2.0, 10.0), self._clear_up)

    def _clear_up(self) -> None:
        self.world.machine.trouble.jitter = 0.0

    def _go_wrong(self) -> None:
        if self.chance.random() < 0.7:
            super()._go_wrong()
            return
        self.faults += 1
        machine, folder = self.world.machine, ROOT / REALM
        match self.chance.randrange(3):
            case 0:
                self.world.note("machine", "the folder is gone")
                machine.lose_folder(folder)
            case 1:
                self.world.note("machine", "the disk is full")
                machine.disk_full = True
                self._for(self.chance.uniform(0.2, 3.0), lambda: setattr(machine, "disk_full", False))
            case _:
                names: dict[str, Any] = machine.folders.get(str(folder), {})
                if names:
                    del names[self.chance.choice(sorted(names))]

    def _a_stop_crosses_a_release(self) -> None:
        self._cross(lambda begin: self.world.runner.at(begin + 0.8001, self._hold_up))

    def _hold_up(self) -> None:
        ends = self._links(["operator-2", "cart-3"])
        self._stall([end for end in ends if end.system.process.name == "cart-3"], 0.7)


def play(seed: int, among: tuple[ModuleType, ...] = ()) -> tuple[str, WholeStory]:
    """Play one seed to its end: see `play_on_machine`."""
    return play_on_machine(WholeStory, seed, among)
