"""A host is killed while its page works with the space: the page goes on, and does nothing twice."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from robotree.testing import rehearse
from robotree.vr import VirtualRobot, command
from robotree.vr.base.errors import TransactionOver

MANY = 4


@dataclass(frozen=True)
class Task:
    number: int


@dataclass(frozen=True)
class Done:
    number: int


class Worker(VirtualRobot):
    """Writes tasks, and does them."""

    @command
    def work(self, many: int) -> list[int]:
        """Write tasks, take each, and note that it was done."""
        for number in range(many):
            self.space.write(Task(number))
        for _ in range(many):
            while True:
                try:
                    with self.space.transaction(within=60) as tx:
                        task = tx.take(Task)
                        self.sleep(0.004)
                        tx.write(Done(task.number))
                    break
                except TransactionOver:
                    pass
        return [self.space.take(Done).number for _ in range(many)]


@pytest.mark.parametrize("part", range(3))
def test_a_page_that_works_with_the_space_goes_on_wherever_its_host_is_killed(part: int) -> None:
    """At each second millisecond of its work in turn, from when its call was accepted."""
    for moment in range(5 + 2 * part, 65, 6):
        team = rehearse(Worker)
        space = team.space
        team.crash(after=moment * 0.001)
        assert team.call("work", many=MANY) == list(range(MANY)), moment
        assert space.read_all(Task) == [] == space.read_all(Done), moment
