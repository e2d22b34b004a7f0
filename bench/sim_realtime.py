"""How much faster than real time the simulated cells are, and what pictures cost.

    python bench/sim_realtime.py

The real-time factor is that of physics and control alone, in processor time of one thread and by the wall
clock; the bound is 10. The cells take turns, and the best of several repetitions counts: a busy machine only
ever makes it slower.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from robotree.protocol.messages import Verb
from robotree.sim.arm.world import BLOCK
from robotree.sim.physics.camera import Renderer, jpeg
from robotree.sim.physics.cell import Cell
from robotree.sim.testing import ArmBench, RoverBench

BOUND = 10.0
REPETITIONS = 5
SECONDS = 1.0
SIZES = ((160, 90), (640, 360))


def compared(cells: dict[str, Cell]) -> dict[str, dict[str, float]]:
    """Simulated seconds per second, of each."""
    processor: dict[str, list[float]] = {name: [] for name in cells}
    wall: dict[str, list[float]] = {name: [] for name in cells}
    for _ in range(REPETITIONS):
        for name, cell in cells.items():
            began, began_wall = time.thread_time(), time.perf_counter()
            cell.advance(round(1000 * SECONDS))
            processor[name].append(time.thread_time() - began)
            wall[name].append(time.perf_counter() - began_wall)
    return {
        name: {"factor": SECONDS / min(processor[name]), "wall_factor": SECONDS / min(wall[name])}
        for name in cells
    }


def at_rest() -> Cell:
    """The arm holds."""
    return ArmBench().world.cell


def moving() -> Cell:
    """The arm is on its way as slowly as it can be."""
    bench = ArmBench()
    bench.operator.ask(Verb.GO_TO, 0.4, -0.2, 0.3, 1.0, 0.02)
    bench.operator.wait(0.5)
    return bench.world.cell


def gripping() -> Cell:
    """The arm holds the lever's handle: contacts."""
    bench = ArmBench()
    bench.operator.succeed(Verb.GRIP, 0.07)
    bench.operator.succeed(Verb.GO_TO, 0.279, 0.10, 0.321, math.pi / 2)
    bench.operator.succeed(Verb.GO_TO, 0.279, 0.10, 0.221, math.pi / 2, 0.05)
    bench.operator.succeed(Verb.GRIP, 0.0)
    return bench.world.cell


def carrying() -> Cell:
    """The arm holds the block above the table."""
    bench = ArmBench()
    x, y, _ = BLOCK.foot
    bench.operator.succeed(Verb.GO_TO, x, y, 0.15, 0.0)
    bench.operator.succeed(Verb.GO_TO, x, y, 0.03, 0.0)
    bench.operator.succeed(Verb.GRIP, 0.0)
    bench.operator.succeed(Verb.GO_TO, x, y, 0.15, 0.0)
    return bench.world.cell


def driving() -> Cell:
    """The rover drives."""
    bench = RoverBench()
    bench.operator.ask(Verb.MOVE, 1.4, 0.5, 0.01)
    bench.operator.wait(0.5)
    return bench.world.cell


def fastest(work: Callable[[], object]) -> float:
    """Least processor time of several calls [ms]."""
    costs = []
    for _ in range(REPETITIONS):
        began = time.thread_time()
        work()
        costs.append(time.thread_time() - began)
    return 1e3 * min(costs)


def main() -> None:
    """Measure and print."""
    cells = {
        "arm at rest": at_rest(),
        "arm moving": moving(),
        "arm gripping": gripping(),
        "arm carrying": carrying(),
        "rover driving": driving(),
    }
    factors = compared(cells)
    resting = cells["arm at rest"]
    pictures = {}
    for width, height in SIZES:
        studio = Renderer(resting.model)
        pictures[f"{width}x{height}"] = fastest(
            lambda studio=studio, w=width, h=height: jpeg(studio.picture(resting.published, "cell", w, h), 75)
        )
    for name, values in factors.items():
        verdict = "" if values["factor"] >= BOUND else f", below the bound of {BOUND:g}"
        print(f"{name:14} {values['factor']:6.1f} x real time, {values['wall_factor']:.1f} by wall{verdict}")
    for size, cost in pictures.items():
        print(f"picture {size:>8} {cost:6.1f} ms")


if __name__ == "__main__":
    main()
