"""The lines of a tree that stand before its names. Pure."""

from __future__ import annotations

from collections.abc import Sequence


def rails(depths: Sequence[int]) -> list[str]:
    """Return what stands before each line of a tree, two cells for each level.

    Args:
        depths: how many lines are above each line in the tree, from the top; roots have 0.
    """
    found: list[str] = []
    following: set[int] = set()
    """Depths at which another line follows, under the same line of the tree."""
    for depth in reversed(depths):
        following = {level for level in following if level <= depth}
        bars = ["│ " if level in following else "  " for level in range(1, depth)]
        elbow = "" if not depth else "├ " if depth in following else "└ "
        found.append("".join(bars) + elbow)
        following.add(depth)
    return found[::-1]
