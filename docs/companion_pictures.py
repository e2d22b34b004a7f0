"""Make the pictures of docs/companion.md: the page's own actions, in virtual time, seen by the flat's camera.

python docs/companion_pictures.py
"""

from __future__ import annotations

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))  # so that `tests` can be imported: what follows comes after it

from robotree.sim.companion.visitors import Receive  # noqa: E402
from robotree.sim.companion.world import build  # noqa: E402
from robotree.sim.physics.camera import Renderer, jpeg  # noqa: E402
from robotree.sim.testing import CompanionBench  # noqa: E402
from tests.examples.companion.virtual import companion  # noqa: E402

SIZE = 480, 300
FOLDER = HERE / "companion"


def main() -> None:
    """Play, and take a picture of each moment."""
    world = build(plays=((Receive(),),), start=(-1.55, -1.1, -2.55))
    robot = companion(CompanionBench(world))
    renderer = Renderer(world.cell.model)
    anna = world.flat.visitors[0]
    FOLDER.mkdir(exist_ok=True)

    def take(name: str) -> None:
        world.cell.published = world.cell.snapshot()
        picture = renderer.picture(world.cell.published, "cell", *SIZE)
        (FOLDER / f"{name}.jpg").write_bytes(jpeg(picture, 72))

    take("01-waiting")
    anna.put(-2.35, -1.55, 0.6)
    robot.sleep(0.2)
    robot.right.posture(j1=0.25, j2=0.8, j3=0.5, j4=2.25, j5=0.0, j6=0.0, speed=0.6)
    take("02-anna-comes")
    robot.rest()
    anna.put(0.95, -1.35, 2.2)
    anna.inside = True
    robot.go_to("table")
    robot.look_at("table")
    robot.sleep(0.2)
    robot.stand_before("green cup", 1.0)
    x, y, z = robot.point_of("green cup")
    ahead, aside, _ = robot.in_body(x, y, z)
    robot.left.grip(action="open")
    robot.left.reach(x=ahead - 0.10, y=aside, z=z + 0.02, hand="forward")
    robot.left.reach(x=ahead, y=aside, z=z + 0.01, hand="forward", speed=0.1)
    robot.left.grip(action="close")
    robot.left.reach(x=ahead, y=aside, z=z + 0.12, hand="forward", speed=0.1)
    take("03-takes-a-cup")
    robot.carried["left"] = "green cup"
    robot.step_back(0.35)
    robot.go_to("sofa")
    robot.look_at("sofa")
    robot.look_towards(0.95, -1.35, 1.0)
    robot.sleep(0.3)
    step_back = robot.step_back

    def seen(length: float) -> None:
        take("04-gives")
        step_back(length)

    robot.step_back = seen
    robot.give("anna")


if __name__ == "__main__":
    main()
