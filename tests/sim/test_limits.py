"""Limits hold for what the wire can carry."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.sim.errors import BadArgument
from robotree.sim.firmware.device import require


def on_the_wire(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]


@given(limit=st.floats(1e-3, 1e3))
def test_a_limit_itself_is_allowed_though_the_wire_rounds_it(limit: float) -> None:
    require("speed", on_the_wire(limit), limit, 2 * limit, "m/s")
    require("speed", on_the_wire(limit), limit / 2, limit, "m/s")
    with pytest.raises(BadArgument):
        require("speed", on_the_wire(limit), 2 * limit, 3 * limit, "m/s")


@given(limit=st.floats(1e-3, 1e3), beyond=st.floats(1e-5, 1.0))
def test_what_is_beyond_is_refused(limit: float, beyond: float) -> None:
    with pytest.raises(BadArgument):
        require("speed", limit * (1 + beyond), 0.0, limit, "m/s")


def test_nan_is_no_number_within_limits() -> None:
    with pytest.raises(BadArgument):
        require("speed", float("nan"), 0.0, 1.0, "m/s")
