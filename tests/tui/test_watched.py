"""Readings over time and alarms: what is ticked is remembered, thresholds are told until acknowledged."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robotree.tui.errors import AlarmsUnusable
from robotree.tui.processes.alarm_file import AlarmFile
from robotree.tui.seen import plotting
from robotree.tui.seen.instruments import bars
from robotree.tui.seen.plotting import Canvas, Curve, Frame
from robotree.tui.seen.series import Series, Ticked
from robotree.tui.seen.store import Store
from robotree.tui.seen.watched import Alarm, acknowledged, judged
from robotree.vr.base.readable import figure, finest
from robotree.vr.base.requests import State

FORCE = Alarm(robot="arm-1", reading="fz", sign=">", limit=20.0, unit="N", by="anna@pts/3")


def test_only_what_is_ticked_is_remembered_and_no_more_of_it_than_there_is_room_for() -> None:
    ticked = Ticked()
    ticked.tick(("arm-1", "fz"))
    for at in range(10):
        ticked.take("arm-1", {"fz": float(at), "fx": 0.0}, float(at))
        ticked.take("arm-2", {"fz": 7.0}, float(at))
    assert ticked.names() == ["arm-1.fz"]
    series = ticked.series["arm-1", "fz"]
    assert series.between(3.5, 6.5) == ([3.0, 4.0, 5.0, 6.0], [3.0, 4.0, 5.0, 6.0]), "with the one before"
    ticked.untick(("arm-1", "fz"))
    ticked.take("arm-1", {"fz": 1.0}, 11.0)
    assert ticked.series == {}
    assert ticked.robots == {}
    short = Series(kept=3)
    for at in range(5):
        short.add(float(at), math.nan if at == 4 else float(at))
    assert (len(short), short.count, short.latest, short.began) == (3, 4, 3.0, 1.0)


def test_an_alarm_stays_until_it_is_over_and_a_person_has_seen_it_in_either_order() -> None:
    raised = judged(FORCE, 21.0, 10.0)
    assert (raised.state, raised.raised, raised.value) == ("raised", 10.0, 21.0)
    assert judged(raised, 19.9, 11.0).state == "raised", "noise at the threshold is no end"
    over = judged(raised, 15.0, 12.0)
    assert (over.state, over.open) == ("over", True)
    assert acknowledged(over, "bob@pts/4", 13.0).state == "calm"
    seen = acknowledged(raised, "bob@pts/4", 11.0)
    assert (seen.state, seen.open, seen.acknowledged_by) == ("acknowledged", False, "bob@pts/4")
    assert judged(seen, 15.0, 12.0).state == "calm"
    again = judged(judged(seen, 15.0, 12.0), 30.0, 14.0)
    assert (again.state, again.acknowledged_by) == ("raised", ""), "the next one must be seen anew"
    below = Alarm(robot="rover-1", reading="battery", sign="<", limit=30.0)
    assert judged(below, 29.0, 1.0).state == "raised"
    assert acknowledged(FORCE, "bob@pts/4", 1.0) is FORCE


@given(values=st.lists(st.floats(-100, 100), max_size=30), seen=st.sets(st.integers(0, 29)))
def test_no_passing_of_a_threshold_goes_by_unseen(values: list[float], seen: set[int]) -> None:
    alarm, unseen = FORCE, False
    for at, value in enumerate(values):
        before = alarm
        alarm = judged(alarm, value, at + 1.0)
        unseen |= alarm.active and not before.active
        if at in seen:
            alarm = acknowledged(alarm, "anna@pts/3", at + 1.5)
            unseen = False
        assert alarm.open == unseen


def test_a_store_tells_of_an_alarm_once_and_of_its_acknowledgement() -> None:
    store, kept = Store(), {FORCE.name: FORCE}
    store.take_alarms(kept.values(), 0.0, "press a")
    for at in (1.0, 2.0):
        store.take_state("arm-1", State(readings={"fz": 20.0 + at}), at)
    (passed,) = store.watched.passed
    assert (passed.name, passed.value) == ("arm-1.fz", 21.0)
    kept[FORCE.name] = judged(FORCE, passed.value, 1001.0)
    store.take_alarms(kept.values(), 2.0, "press a")
    assert [(one.text, one.robot) for one in store.entries] == [
        ("ALARM: arm-1.fz was 21.0 N, > 20 N; press a", "arm-1")
    ]
    assert (store.watched.rung, [one.name for one in store.watched.open("arm-1")]) == (1, ["arm-1.fz"])
    kept[FORCE.name] = acknowledged(kept[FORCE.name], "bob@pts/4", 1002.0)
    store.take_alarms(kept.values(), 3.0, "press a")
    assert store.entries[-1].text == "the alarm of arm-1.fz was acknowledged by bob@pts/4"
    assert (store.watched.rung, store.watched.open()) == (1, [])


def test_an_alarm_says_how_far_its_threshold_was_passed_and_your_own_acknowledgement_is_no_news() -> None:
    store = Store()
    store.me = "anna@pts/3"
    slight = judged(FORCE, 20.0004, 1001.0)
    store.take_alarms([slight], 1.0, "press a")
    assert store.entries[-1].text == "ALARM: arm-1.fz was 20.0004 N, > 20 N; press a"
    store.take_alarms([acknowledged(slight, "anna@pts/3", 1002.0)], 2.0, "press a")
    assert len(store.entries) == 1


def test_alarms_outlive_who_watches_them_and_two_may_change_them(tmp_path: Path) -> None:
    path = tmp_path / "realm" / "alarms.json"
    one, other = AlarmFile(path), AlarmFile(path)
    one.change(lambda alarms: alarms.update({FORCE.name: FORCE}))
    assert other.all() == (FORCE,)
    assert other.all() is other.all(), "it is read again only when it has changed"
    other.change(lambda alarms: alarms.update({FORCE.name: judged(FORCE, 30.0, 5.0)}))
    assert one.all()[0].state == "raised"
    assert AlarmFile(path).all()[0].state == "raised"
    path.write_text("[{]")
    with pytest.raises(AlarmsUnusable, match=r"alarms\.json cannot be used .*: mend it, or delete it"):
        one.all()


def drawn(canvas: Canvas) -> list[str]:
    return ["".join(text for text, _ in line) for line in canvas.lines()]


def test_a_ramp_is_drawn_from_below_to_above_and_a_short_peak_is_never_lost() -> None:
    canvas = Canvas(8, 2)
    ramp = Curve([float(at) for at in range(16)], [float(at) for at in range(16)])
    plotting.over_time(canvas, ramp, Frame(0.0, 16.0, 0.0, 15.0))
    above, below = drawn(canvas)
    assert above[:4].isspace()
    assert above[7] != " "
    assert below[0] != " "
    many = Curve([at / 1000 for at in range(16000)], [float(at == 7000) for at in range(16000)])
    canvas = Canvas(8, 2)
    plotting.over_time(canvas, many, Frame(0.0, 16.0, 0.0, 1.0))
    assert drawn(canvas)[0].strip(), "one of sixteen thousand values is seen"


@given(
    values=st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=50),
    width=st.integers(1, 30),
    height=st.integers(1, 8),
    shift=st.floats(-60, 60),
)
def test_no_values_and_no_size_break_a_plot(
    values: list[float], width: int, height: int, shift: float
) -> None:
    curve = Curve([float(at) for at in range(len(values))], values)
    low, high = plotting.range_of(curve.values, 3.0)
    assert low < high
    canvas = Canvas(width, height)
    plotting.over_time(canvas, curve, Frame(shift, shift + 20.0, low, high), (3.0,))
    plotting.against(canvas, values, values, Frame(low, high, low, high))
    assert [len(line) for line in drawn(canvas)] == [width] * height


@pytest.mark.parametrize("unit", ["N", "m", "rad", "count"])
def test_noise_below_the_shown_digits_does_not_fill_a_plot(unit: str) -> None:
    noise = Curve([0.0, 1.0], [-2e-7, 3e-7])
    low, high = plotting.range_of(noise.values, least=4 * finest(unit))
    assert high - low == pytest.approx(4 * finest(unit))
    assert len({figure(low + share * (high - low), unit)[0] for share in (0.0, 0.5, 1.0)}) == 3
    wide = Curve([0.0, 1.0], [0.0, 1000.0])
    assert plotting.range_of(wide.values, least=4 * finest(unit)) == plotting.range_of(wide.values)


def test_two_readings_are_put_together_by_what_held_at_the_time() -> None:
    xs, ys = plotting.together(Curve([1.0, 3.0], [10.0, 30.0]), Curve([0.5, 1.5, 2.5, 3.5], [1, 2, 3, 4]))
    assert (xs, ys) == ([10.0, 10.0, 30.0], [2, 3, 4])


def test_a_scale_keeps_still_while_its_values_fit() -> None:
    assert plotting.steady((0.0, 10.0), (1.0, 9.0)) == (0.0, 10.0)
    assert plotting.steady((0.0, 10.0), (1.0, 11.0)) == (1.0, 11.0)
    assert plotting.steady((0.0, 10.0), (4.0, 5.0)) == (4.0, 5.0)


def test_a_sparkline_goes_between_its_own_ends() -> None:
    assert bars([1.0, 2.0, 3.0]) == "▁▅█"
    assert bars([2.0, 2.0]) == "▅▅"
    assert Series().sparkline(3) == "   "


def test_numbers_at_an_axis_can_be_told_apart_however_small_its_range_is() -> None:
    for low, high in ((0.0, 1e-6), (1.02e-6, 1.06e-6), (-3e-6, 3e-6), (0.0, 2e-4), (1.0, 1.001)):
        found = [plotting.label(low + share * (high - low), high - low) for share in (0.0, 0.5, 1.0)]
        assert len(set(found)) == 3, found
        assert all(len(text) <= 8 for text in found), found
