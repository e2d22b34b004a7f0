"""The link for tests: what happens to a frame on it is decided by a seed."""

from __future__ import annotations

import pytest

from robotree.protocol.errors import LinkBroken
from robotree.protocol.links.loopback import Faults, Loopback
from robotree.protocol.testing import RecordingHandler


class Letters:
    """Hears single frames."""

    def __init__(self, network: Loopback | None = None) -> None:
        self.network = network
        self.heard: list[tuple[float, bytes]] = []
        self.reasons: list[Exception] = []

    def received(self, data: bytes) -> None:
        assert self.network is not None
        self.heard.append((self.network.now, data))

    def closed(self, reason: Exception) -> None:
        self.reasons.append(reason)


def _play(faults: Faults, frames: int = 500) -> tuple[Letters, Loopback]:
    letters = Letters()
    network = Loopback(lambda _: Letters(), lambda _: letters, faults)
    letters.network = network
    for i in range(frames):
        network.advance(i * 0.01)
        network.near.send(i.to_bytes(2, "big"))
    network.advance(1000.0)
    return letters, network


def test_the_same_seed_gives_the_same_accidents() -> None:
    faults = Faults(loss=0.1, duplication=0.1, delay=0.05, jitter=0.05, seed=3)
    assert _play(faults)[0].heard == _play(faults)[0].heard
    assert _play(faults)[0].heard != _play(Faults(loss=0.1, seed=4))[0].heard


def test_frames_arrive_when_they_are_due() -> None:
    letters, _ = _play(Faults(delay=0.25), frames=3)
    assert [moment for moment, _ in letters.heard] == pytest.approx([0.25, 0.26, 0.27])


@pytest.mark.parametrize(("loss", "expected"), [(0.0, 500), (1.0, 0)])
def test_loss(loss: float, expected: int) -> None:
    assert len(_play(Faults(loss=loss))[0].heard) == expected


def test_jitter_lets_frames_overtake_each_other_and_loses_none() -> None:
    data = [frame for _, frame in _play(Faults(jitter=0.1))[0].heard]
    assert data != sorted(data)
    assert sorted(data) == [i.to_bytes(2, "big") for i in range(500)]


def test_duplication_brings_some_frames_twice() -> None:
    data = [frame for _, frame in _play(Faults(duplication=0.5))[0].heard]
    assert 700 < len(data) < 800
    assert len(set(data)) == 500


def test_a_cut_breaks_both_ends_and_loses_what_is_under_way() -> None:
    near, far = Letters(), Letters()
    network = Loopback(lambda _: near, lambda _: far, Faults(delay=1.0))
    network.near.send(b"lost")
    network.cut()
    network.advance(10.0)
    assert far.heard == []
    assert [type(reason) for reason in (*near.reasons, *far.reasons)] == [LinkBroken, LinkBroken]
    network.near.send(b"too late")
    assert network.near.statistics.dropped == 1


def test_ends_are_told_apart() -> None:
    network = Loopback(RecordingHandler, RecordingHandler)
    assert network.near.address != network.far.address
    assert not network.near.congested
