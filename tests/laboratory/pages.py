"""Robots of the laboratory: leaves that write down what they do, and trees over them."""

from __future__ import annotations

import os
import time

from robotree.vr import Child, VirtualRobot, command


class Leaf(VirtualRobot):
    """Does things, and writes each of them down."""

    @command
    def work(self, n: int) -> int:
        """Do one thing."""
        with open(os.environ["EFFECTS"], "a", encoding="ascii") as file:  # noqa: PTH123 # one line of a page
            file.write(f"{self.name} {n} {time.time():.6f}\n")
        return n


class Cell(VirtualRobot):
    """Has a leaf work again and again."""

    leaf = Child("Robot")

    @command
    def tour(self, first: int, steps: int, pause: float = 0.05) -> int:
        """Do some things."""
        for n in range(first, first + steps):
            self.leaf.work(n=n)
            self.sleep(pause)
        return steps
