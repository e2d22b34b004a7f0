"""The examination of spaces: everything that the contract promises."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from robotree.vr.space.contract import Space


async def check_space(open_space: Callable[[], Awaitable[Space]], *, durable: bool) -> None:
    """Examine a space.

    Args:
        open_space: opens one and the same space each time.
        durable: whether what was added must be there when it is opened again.

    Raises:
        AssertionError: a promise is broken.
    """
    space = await open_space()
    _expect(await space.read(""), {}, "a new space is empty")
    space.add("calls/arm-1/grip")
    space.add("calls/arm-1/grip", 2)
    space.add("calls/arm-1/go_to")
    space.add("calls/arm-10/go_to", 7)
    grip_and_go = {"calls/arm-1/grip": 3, "calls/arm-1/go_to": 1}
    _expect(await space.read("calls/arm-1/"), grip_and_go, "a prefix chooses, and earlier adds are seen")
    space.add("calls/arm-1/grip", -3)
    _expect(await space.read("calls/arm-1/grip"), {"calls/arm-1/grip": 0}, "amounts may be negative")
    _expect(await space.read("%"), {}, "a prefix is no pattern")
    for _ in range(1000):
        space.add("many")
    _expect(await space.read("many"), {"many": 1000}, "no add is lost")
    space.add("last")
    await space.close()
    await space.close()
    if durable:
        again = await open_space()
        _expect(await again.read("last"), {"last": 1}, "what was added before closing is there again")
        await again.close()


def _expect(found: dict[str, int], expected: dict[str, int], sentence: str) -> None:
    if found != expected:
        raise AssertionError(f"broken: {sentence}: {found} instead of {expected}")
