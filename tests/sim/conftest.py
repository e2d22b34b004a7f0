"""Worlds and operators for the tests of the simulated robots, all in virtual time."""

from __future__ import annotations

import pytest

from robotree.sim.testing import ArmBench, RoverBench


@pytest.fixture
def arm() -> ArmBench:
    return ArmBench()


@pytest.fixture
def rover() -> RoverBench:
    return RoverBench()
