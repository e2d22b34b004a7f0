"""The three stores of a space keep the same promises."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from robotree.vr.world.examine_space import OpenStore, TimedStore
from robotree.vr.world.testing import SPACE_CHECKS


@pytest.mark.parametrize("check", SPACE_CHECKS, ids=lambda check: check.__name__)
def test_a_store_keeps_its_promises(check: Callable[[TimedStore], None], open_store: OpenStore) -> None:
    timed = open_store()
    try:
        check(timed)
    finally:
        timed.store.close()
