"""Spans on their way to OpenTelemetry, if its SDK is installed: to a collector, else as JSON."""

from __future__ import annotations

import importlib
import io
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from robotree.tui.errors import NotInstalled, SupervisorError

if TYPE_CHECKING:
    from robotree.vr.supervision.past import CallSpan

ENDPOINT = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT")
"""Variables that name a collector, as OpenTelemetry's specification says; one of them is enough."""


class NotExported(SupervisorError):
    """The collector has not taken the spans."""

    def __init__(self) -> None:
        """Say where to look."""
        super().__init__(f"the collector that {ENDPOINT[1]} names did not take the spans; does it run?")


def _module(name: str, package: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise NotInstalled("history --otel", package, f"pip install {package}") from None


def export(spans: Sequence[CallSpan]) -> str:
    """Send spans to the collector that the environment names; without one return them as JSON.

    Raises:
        NotInstalled: OpenTelemetry's SDK is not there, or its exporter for collectors.
        NotExported: the collector did not take them.
    """
    sdk = _module("opentelemetry.sdk.trace", "opentelemetry-sdk")
    ready = [_readable(span) for span in spans]
    output = io.StringIO()
    if any(os.environ.get(name) for name in ENDPOINT):
        name = "opentelemetry.exporter.otlp.proto.http.trace_exporter"
        package = "opentelemetry-exporter-otlp-proto-http"
        exporter = _module(name, package).OTLPSpanExporter()
    else:
        exporter = importlib.import_module(f"{sdk.__name__}.export").ConsoleSpanExporter(out=output)
    result = exporter.export(ready)
    exporter.shutdown()
    if result.name != "SUCCESS":
        raise NotExported
    return output.getvalue().strip()


def _readable(span: CallSpan) -> Any:
    """Return a span as the SDK has it."""
    sdk = importlib.import_module("opentelemetry.sdk.trace")
    api = importlib.import_module("opentelemetry.trace")
    resources = importlib.import_module("opentelemetry.sdk.resources")

    def context(number: int) -> Any:
        flags = api.TraceFlags(api.TraceFlags.SAMPLED)
        return api.SpanContext(span.trace, number, is_remote=False, trace_flags=flags)

    code = api.StatusCode.ERROR if span.error else api.StatusCode.OK
    return sdk.ReadableSpan(
        span.name,
        context=context(span.span),
        parent=context(span.parent) if span.parent else None,
        resource=resources.Resource({"service.name": "robotree"}),
        attributes=span.attributes,
        kind=api.SpanKind.SERVER,
        status=api.Status(code, span.error or None),
        start_time=span.begin,
        end_time=span.end,
    )
