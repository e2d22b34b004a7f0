"""Examinations: everything that the contracts of this room promise, for any implementation of them.

Call them from the tests of a new implementation; a broken promise is an `AssertionError` that says which.
"""

from __future__ import annotations

from robotree.vr.host.examine import TRANSPORT_CHECKS, Join, check_transport, promise, until

__all__ = ["TRANSPORT_CHECKS", "Join", "check_transport", "promise", "until"]
