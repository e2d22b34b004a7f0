"""Two runs are the same to the last bit, in this process and in another one."""

from __future__ import annotations

import hashlib
import inspect
import os
import subprocess
import sys

from robotree.protocol.messages import Verb
from robotree.sim.testing import ArmBench


def played() -> str:
    arm = ArmBench()
    arm.operator.do(Verb.GO_TO, 0.279, 0.10, 0.321, 1.57)
    arm.operator.do(Verb.GO_TO, 0.279, 0.10, 0.221, 1.57, 0.05)
    arm.operator.do(Verb.GRIP, 0.0)
    arm.operator.do(Verb.GO_TO, 0.35, 0.10, 0.25, 1.57)
    return hashlib.sha256(arm.world.cell.published.tobytes()).hexdigest()


def test_runs_in_two_processes_are_the_same_to_the_last_bit() -> None:
    """With another seed of hashes, other threads of numpy, and a world that was here before."""
    ArmBench().operator.do(Verb.GRIP, 0.0)
    source = f"{inspect.getsource(sys.modules[__name__])}\nprint(played())"
    environment = {**os.environ, "PYTHONHASHSEED": "1", "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-c", source], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == played()
