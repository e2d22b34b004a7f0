"""Listing the kinds of robot loads no physics."""

from __future__ import annotations

import subprocess
import sys

ENGINES = "{'mujoco', 'pinocchio', 'ruckig', 'numpy'}"


def test_it_is_cheap_to_ask_what_can_be_simulated() -> None:
    code = "import sys, robotree.sim, robotree.sim.kinds, robotree.sim.errors; "
    code += f"print(sorted({ENGINES} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
