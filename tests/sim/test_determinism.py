"""Two runs are the same to the last bit, in one process and in two."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys

from robotree.protocol.messages import Verb
from robotree.sim.testing import ArmBench

STORY = """
from robotree.protocol.messages import Verb
from robotree.sim.testing import ArmBench
import hashlib
arm = ArmBench()
arm.operator.do(Verb.GO_TO, 0.279, 0.10, 0.321, 1.57)
arm.operator.do(Verb.GO_TO, 0.279, 0.10, 0.221, 1.57, 0.05)
arm.operator.do(Verb.GRIP, 0.0)
arm.operator.do(Verb.GO_TO, 0.35, 0.10, 0.25, 1.57)
print(hashlib.sha256(arm.world.cell.published.tobytes()).hexdigest())
"""


def told(hash_seed: str) -> str:
    environment = {**os.environ, "PYTHONHASHSEED": hash_seed, "OMP_NUM_THREADS": hash_seed}
    done = subprocess.run(
        [sys.executable, "-c", STORY], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def played() -> str:
    arm = ArmBench()
    arm.operator.do(Verb.GO_TO, 0.279, 0.10, 0.321, 1.57)
    arm.operator.do(Verb.GO_TO, 0.279, 0.10, 0.221, 1.57, 0.05)
    arm.operator.do(Verb.GRIP, 0.0)
    arm.operator.do(Verb.GO_TO, 0.35, 0.10, 0.25, 1.57)
    return hashlib.sha256(arm.world.cell.published.tobytes()).hexdigest()


def test_two_runs_in_one_process_are_the_same_to_the_last_bit() -> None:
    assert played() == played()


def test_runs_in_other_processes_are_the_same_to_the_last_bit() -> None:
    assert told("1") == told("2")
