"""A command with all that it caused is one trace."""

from __future__ import annotations

import sys

import pytest

from robotree.tui.errors import NotInstalled
from robotree.tui.line.otel import export
from robotree.vr.base.history_event import HistoryEvent
from robotree.vr.supervision.past import CallSpan, spans_of


def call(robot: str, key: str, begin: float, error: str = "") -> list[HistoryEvent]:
    return [
        HistoryEvent(kind="accepted", unix=begin, robot=robot, key=key, command="go", caller="anna@pts/3"),
        HistoryEvent(kind="ended", unix=begin + 1.5, robot=robot, key=key, command="go", error=error),
    ]


def test_robots_that_export_apart_give_one_trace() -> None:
    (parent,), (child,) = spans_of(call("team", "k", 1.0)), spans_of(call("arm", "k/1", 2.0, "Busy"))
    assert parent.trace == child.trace
    assert (parent.parent, child.parent) == (0, parent.span)
    assert (child.name, child.end - child.begin, child.error) == ("arm.go", 1_500_000_000, "Busy: ")
    (other,) = spans_of(call("team", "l", 1.0))
    assert other.trace != parent.trace


def test_a_call_that_goes_on_is_no_span_yet() -> None:
    assert spans_of(call("arm", "k", 1.0)[:1]) == []


def test_without_the_sdk_one_sentence_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace", None)
    spans: list[CallSpan] = []
    with pytest.raises(NotInstalled, match="pip install opentelemetry-sdk"):
        export(spans)
