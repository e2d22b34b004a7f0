"""Examinations: everything that the contracts of this room promise, for any implementation of them.

Call them from the tests of a new implementation; a broken promise is an `AssertionError` that says which.
"""

from __future__ import annotations

from robotree.vr.world.examine_lookup import LOOKUP_CHECKS, Open, check_lookup
from robotree.vr.world.examine_space import SPACE_CHECKS, check_space
from robotree.vr.world.examine_transport import TRANSPORT_CHECKS, check_transport
from robotree.vr.world.promises import Join, patience, promise, until
from robotree.vr.world.virtual_loop import in_virtual_time, run_in_virtual_time

__all__ = [
    "LOOKUP_CHECKS",
    "SPACE_CHECKS",
    "TRANSPORT_CHECKS",
    "Join",
    "Open",
    "check_lookup",
    "check_space",
    "check_transport",
    "in_virtual_time",
    "patience",
    "promise",
    "run_in_virtual_time",
    "until",
]
