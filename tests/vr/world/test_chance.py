"""Keys and addresses come from the operating system, or in the World from the seed."""

from __future__ import annotations

import random

from robotree.vr.base import chance
from robotree.vr.exchange.asking import fresh_key
from robotree.vr.exchange.claim import new_address


def test_nobody_draws_the_same_key_twice() -> None:
    assert len({fresh_key() for _ in range(1000)}) == 1000


def test_the_same_seed_gives_the_same_keys_and_addresses() -> None:
    def draw() -> tuple[str, str]:
        with chance.drawn_from(random.Random(7).getrandbits):
            return fresh_key(), new_address("robot", "arm").key

    assert draw() == draw()
    assert fresh_key() not in draw()
