# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Traces of requests through the services with OpenTelemetry (extra ``otel``), off by default.

``CDFF_TRACES`` is the URL of a collector (OTLP over HTTP, as ``http://127.0.0.1:4318/v1/traces``),
or a folder, in which each process writes its spans as lines of OTLP in JSON. A trace starts at a
request to the orchestrator; of these, ``CDFF_TRACES_RATIO`` (default 1) is the fraction that is
traced. Calls carry the W3C context ``traceparent`` in their attachment, and products in the outbox
too. Without ``CDFF_TRACES``, no library is imported.
"""

from __future__ import annotations

import json
import logging
import os
from collections import OrderedDict
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import Any, TypeVar

from cdff_common.errors import ConfigurationError
from cdff_common.output import make_folder

T = TypeVar("T")
logger = logging.getLogger(__name__)

VARIABLE, RATIO = "CDFF_TRACES", "CDFF_TRACES_RATIO"
#: Name of the context in attachments (W3C Trace Context).
PARENT = "traceparent"
#: End of the keys of calls that start a trace.
_ROOT = "/orchestrator/@rpc/request"
#: Largest number of kept contexts.
_KEPT = 256


class Tracer:
    """Tracer of this process.

    Parameters
    ----------
    exporter : opentelemetry.sdk.trace.export.SpanExporter
        Destination of the spans, which a thread exports in batches.
    service : str
        Name of the process.
    ratio : float
        Fraction of the requests that are traced, 0 … 1.
    """

    def __init__(self, exporter: Any, service: str, ratio: float = 1.0) -> None:
        from opentelemetry import context, trace
        from opentelemetry.sdk.resources import Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
        from opentelemetry.sdk.trace.sampling import ParentBased, TraceIdRatioBased
        from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

        self._trace, self._context = trace, context
        self._format = TraceContextTextMapPropagator()
        self.provider = TracerProvider(
            sampler=ParentBased(TraceIdRatioBased(ratio)), resource=Resource({"service.name": service})
        )
        self.provider.add_span_processor(BatchSpanProcessor(exporter))
        self._tracer = self.provider.get_tracer("cdff")
        self._contexts: OrderedDict[str, str] = OrderedDict()

    def current(self) -> str:
        """Return the ``traceparent`` of the current span; empty if no span is recorded."""
        if not self._trace.get_current_span().is_recording():
            return ""
        carrier: dict[str, str] = {}
        self._format.inject(carrier)
        return carrier.get(PARENT, "")

    def begin(self, name: str, parent: str, attributes: Mapping[str, str]) -> tuple[Any, Any]:
        """Return a new span and the context in which it is current."""
        context = self._format.extract({PARENT: parent}) if parent else None
        span = self._tracer.start_span(name, context, attributes=attributes)
        return span, self._trace.set_span_in_context(span)

    @contextmanager
    def current_in(self, context: Any) -> Iterator[None]:
        """Make a context the current one inside the block."""
        token = self._context.attach(context)
        try:
            yield
        finally:
            self._context.detach(token)

    @contextmanager
    def span(self, name: str, parent: str, attributes: Mapping[str, str]) -> Iterator[None]:
        """Record a span inside the block; an exception is its error."""
        span, context = self.begin(name, parent, attributes)
        try:
            with self.current_in(context):
                yield
        except Exception as error:
            self.fail(span, error)
            raise
        finally:
            span.end()

    def fail(self, span: Any, error: Exception) -> None:
        """Record an error as the status of a span."""
        span.set_status(self._trace.StatusCode.ERROR, f"{type(error).__name__}: {error}")

    def keep(self, subject: str) -> None:
        """Keep the current context for work on a subject that another thread will do."""
        self._contexts.pop(subject, None)
        if parent := self.current():
            self._contexts[subject] = parent
            while len(self._contexts) > _KEPT:
                self._contexts.popitem(last=False)

    def kept(self, subject: str) -> str:
        """Return the context that was kept for a subject, once."""
        return self._contexts.pop(subject, "")


class SpanFile:
    """Exporter to a file: each line has a batch of spans as an export request of OTLP in JSON."""

    def __init__(self, path: Path) -> None:
        # Without a buffer: it would keep the lines that a full disk refuses, and fail when it is closed.
        self._file = path.open("ab", buffering=0)

    def export(self, spans: Sequence[Any]) -> Any:
        """Write the spans of one process."""
        from opentelemetry.sdk.trace.export import SpanExportResult

        resource = {"attributes": _attributes(spans[0].resource.attributes)}
        scope_spans = {"scope": {"name": "cdff"}, "spans": [_otlp(span) for span in spans]}
        batch = {"resourceSpans": [{"resource": resource, "scopeSpans": [scope_spans]}]}
        line = (json.dumps(batch, separators=(",", ":")) + "\n").encode()
        try:
            if (written := self._file.write(line)) < len(line):
                raise OSError(f"{written} of {len(line)} bytes written")
        except OSError as error:  # the disk is full: the spans are lost, the service works
            logger.warning("%s spans are not written to %s: %s", len(spans), self._file.name, error)
            return SpanExportResult.FAILURE
        return SpanExportResult.SUCCESS

    def force_flush(self, timeout_millis: int = 30_000) -> bool:
        """Do nothing and return True for success, because each batch is written at once."""
        return True

    def shutdown(self) -> None:
        """Close the file."""
        self._file.close()


def _otlp(span: Any) -> dict[str, Any]:
    body = {
        "traceId": f"{span.context.trace_id:032x}",
        "spanId": f"{span.context.span_id:016x}",
        "parentSpanId": "" if span.parent is None else f"{span.parent.span_id:016x}",
        "name": span.name,
        "kind": 1,
        "startTimeUnixNano": str(span.start_time),
        "endTimeUnixNano": str(span.end_time),
        "attributes": _attributes(span.attributes),
    }
    if span.status.description:
        body["status"] = {"code": 2, "message": span.status.description}
    return body


def _attributes(values: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [{"key": key, "value": {"stringValue": str(value)}} for key, value in values.items()]


#: Tracer of the process; None if tracing is off.
tracer: Tracer | None = None


def start(service: str, environment: Mapping[str, str] = os.environ) -> None:
    """Trace requests if ``CDFF_TRACES`` is set.

    Raises
    ------
    ConfigurationError
        If the extra ``otel`` is missing, the folder cannot be created, or the ratio is not in 0 … 1.
    """
    global tracer  # noqa: PLW0603
    if destination := environment.get(VARIABLE):
        ratio = _ratio(environment.get(RATIO, "1"))
        tracer = Tracer(_exporter(destination, service), service, ratio)


def stop() -> None:
    """Export the spans that wait; further ones are not recorded."""
    global tracer  # noqa: PLW0603
    if tracer is not None:
        tracer.provider.shutdown()
        tracer = None


def _ratio(text: str) -> float:
    try:
        ratio = float(text)
    except ValueError:
        ratio = -1.0
    if not 0.0 <= ratio <= 1.0:
        raise ConfigurationError(f"{RATIO}={text!r}: expected a fraction of the requests, 0 … 1")
    return ratio


def _exporter(destination: str, service: str) -> Any:
    try:
        import opentelemetry.sdk.trace.export  # noqa: F401

        if destination.startswith(("http://", "https://")):
            from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter

            return OTLPSpanExporter(endpoint=destination)
    except ImportError as error:
        raise ConfigurationError(
            f"{VARIABLE}={destination}: {error}; install the extra: pip install 'cdff[otel]'"
        ) from error
    return SpanFile(make_folder(Path(destination)) / f"{service}_{os.getpid()}.jsonl")


def span(name: str, parent: str = "", **attributes: str) -> AbstractContextManager[None]:
    """Return a block that is recorded as a span, if it belongs to a trace.

    Parameters
    ----------
    name : str
        Operation, such as ``lidar_slam.step``.
    parent : str
        ``traceparent`` of the span that caused it; default: the current span.
    attributes
        Values that the span states.
    """
    if tracer is None or not (parent or tracer.current()):
        return nullcontext()
    return tracer.span(name, parent, attributes)


def current() -> str:
    """Return the ``traceparent`` of the current span; empty if there is none."""
    return "" if tracer is None else tracer.current()


def keep(subject: str) -> None:
    """Keep the current context for work on a subject that another thread will do."""
    if tracer is not None:
        tracer.keep(subject)


def kept(subject: str) -> str:
    """Return the context that was kept for a subject, once; empty if there is none."""
    return "" if tracer is None else tracer.kept(subject)


def traced(key: str, parent: str, items: Iterator[T]) -> Iterator[T]:
    """Yield the items of an iterator that answers a call; its work is one span.

    A call without parent starts a trace if it is a request to the orchestrator; others are not traced.
    """
    if tracer is None or not (parent or key.endswith(_ROOT)):
        yield from items
        return
    scope, _, name = key.partition("/@v1/")[2].partition("/")
    recorded, context = tracer.begin(name.replace("/@rpc/", "."), parent, {"cdff.scope": scope})
    try:
        while True:
            with tracer.current_in(context):
                try:
                    item = next(items)
                except StopIteration:
                    return
            yield item
    except Exception as error:
        tracer.fail(recorded, error)
        raise
    finally:
        if isinstance(items, Generator):  # it has resources if the caller has read only some of its items
            with tracer.current_in(context):
                items.close()
        recorded.end()
