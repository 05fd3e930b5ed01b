# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Traces: contexts in attachments, spans of calls, and refusals of wrong settings."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from cdff_common import tracing
from cdff_common.bus.message import pack, split_context, unpack, with_context
from cdff_common.errors import ConfigurationError, InputError

ROOT_KEY = "cdff/@v1/mana/orchestrator/@rpc/request"


@pytest.fixture
def exporter(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Exporter of the tracer of this process, with the finished spans in memory."""
    module = pytest.importorskip(
        "opentelemetry.sdk.trace.export.in_memory_span_exporter",
        reason="install the extra otel: `make peers`",
    )
    exporter = module.InMemorySpanExporter()
    tracer = tracing.Tracer(exporter, "test")
    monkeypatch.setattr(tracing, "tracer", tracer)
    yield lambda: (tracer.provider.force_flush(), exporter.get_finished_spans())[1]
    tracer.provider.shutdown()


def test_without_the_variable_nothing_is_imported_and_attachments_stay_as_they_are() -> None:
    program = (
        "import sys; from cdff_common import tracing, bus; tracing.start('a', {});"
        "assert tracing.tracer is None and tracing.current() == '';"
        "assert not [m for m in sys.modules if m.startswith('opentelemetry')]"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == 0
    header = pack({"id": "a"})
    assert (with_context(header), with_context(b"")) == (header, b"")
    assert split_context(header) == (header, "")
    with tracing.span("work"):
        assert list(tracing.traced(ROOT_KEY, "", iter("ab"))) == ["a", "b"]


@pytest.mark.parametrize("ratio", ["1.5", "-0.1", "half", "nan"])
def test_a_ratio_outside_its_range_is_refused(ratio: str, tmp_path: Any) -> None:
    pytest.importorskip("opentelemetry.sdk.trace", reason="install the extra otel: `make peers`")
    with pytest.raises(ConfigurationError, match=r"CDFF_TRACES_RATIO=.*expected a fraction"):
        tracing.start("a", {"CDFF_TRACES": str(tmp_path), "CDFF_TRACES_RATIO": ratio})


@pytest.mark.parametrize(("ratio", "count"), [("0", 0), ("1", 1)])
def test_the_ratio_is_the_fraction_of_the_requests_that_are_traced(
    ratio: str, count: int, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("opentelemetry.sdk.trace", reason="install the extra otel: `make peers`")
    monkeypatch.setattr(tracing, "tracer", None)
    tracing.start("a", {"CDFF_TRACES": str(tmp_path), "CDFF_TRACES_RATIO": ratio})
    (context,) = tracing.traced(ROOT_KEY, "", (tracing.current() for _ in range(1)))
    tracing.stop()
    (file,) = tmp_path.glob("a_*.jsonl")
    assert file.read_text().count('"spanId"') == count
    assert bool(context) == bool(count)


def test_a_missing_library_is_refused_with_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace.export", None)
    with pytest.raises(ConfigurationError, match=r"cdff\[otel\]"):
        tracing.start("a", {"CDFF_TRACES": "http://127.0.0.1:4318/v1/traces"})


def test_a_call_carries_the_context_of_its_span_and_the_receiver_gets_the_same_attachment(
    exporter: Any,
) -> None:
    header = pack({"id": "a", "seq": 3})

    def answer() -> Iterator[bytes]:
        yield with_context(header)
        yield with_context(b"")

    with_header, alone = tracing.traced(ROOT_KEY, "", answer())
    (root,) = exporter()
    for sent, original in ((with_header, header), (alone, b"")):
        received, parent = split_context(sent)
        assert (received, parent) == (original, unpack(sent)["traceparent"])
        assert parent.startswith(f"00-{root.context.trace_id:032x}-{root.context.span_id:016x}-")
        assert with_context(sent) == sent
        assert list(tracing.traced("cdff/@v1/mana/dpm/@rpc/get", parent, iter("a"))) == ["a"]
    child = exporter()[-1]
    assert (child.name, child.parent.span_id) == ("dpm.get", root.context.span_id)
    assert child.attributes["cdff.scope"] == "mana"


def test_the_work_of_a_call_belongs_to_its_span_but_not_its_pauses(exporter: Any) -> None:
    def answer() -> Iterator[str]:
        yield tracing.current()
        yield tracing.current()

    replies = tracing.traced(ROOT_KEY, "", answer())
    first = next(replies)
    assert first
    assert tracing.current() == ""
    assert list(replies) == [first]


def test_an_error_is_the_status_of_the_span(exporter: Any) -> None:
    def fail() -> Iterator[str]:
        raise InputError("resolution_m=0: expected a positive number")
        yield ""

    with pytest.raises(InputError):
        list(tracing.traced(ROOT_KEY, "", fail()))
    (root,) = exporter()
    assert root.status.description == "InputError: resolution_m=0: expected a positive number"


def test_an_answer_that_is_not_read_to_its_end_is_closed_inside_its_span(exporter: Any) -> None:
    contexts: list[str] = []

    def answer() -> Iterator[str]:
        try:
            yield "a"
            yield "b"
        finally:
            contexts.append(tracing.current())

    replies = tracing.traced(ROOT_KEY, "", answer())
    assert next(replies) == "a"
    replies.close()  # type: ignore[attr-defined]
    (span,) = exporter()
    assert [context.split("-")[2] for context in contexts] == [f"{span.context.span_id:016x}"]


def test_calls_without_a_parent_that_are_no_requests_are_not_traced(exporter: Any) -> None:
    assert list(tracing.traced("cdff/@v1/ground/dpm/@rpc/stat", "", iter("a"))) == ["a"]
    with tracing.span("step"):
        pass
    assert exporter() == ()


def test_a_kept_context_is_that_of_the_last_request_and_is_used_once(exporter: Any) -> None:
    def answer() -> Iterator[str]:
        tracing.keep("mana/lidar_slam")
        yield tracing.current()

    (parent,) = tracing.traced(ROOT_KEY, "", answer())
    assert (tracing.kept("mana/lidar_slam"), tracing.kept("mana/lidar_slam")) == (parent, "")
    list(tracing.traced(ROOT_KEY, "", answer()))
    tracing.keep("mana/lidar_slam")  # of a request that is not traced
    assert tracing.kept("mana/lidar_slam") == ""


def test_the_oldest_kept_contexts_are_dropped(exporter: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tracing, "_KEPT", 2)

    def answer() -> Iterator[str]:
        for subject in "abac":
            tracing.keep(subject)
        yield ""

    list(tracing.traced(ROOT_KEY, "", answer()))
    assert [subject for subject in "abc" if tracing.kept(subject)] == ["a", "c"]


def test_spans_that_a_full_disk_refuses_are_lost_and_the_service_works(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("opentelemetry.sdk.trace", reason="install the extra otel: `make peers`")
    monkeypatch.setattr(tracing, "tracer", None)
    (tmp_path / f"a_{os.getpid()}.jsonl").symlink_to("/dev/full")
    tracing.start("a", {"CDFF_TRACES": str(tmp_path)})
    assert list(tracing.traced(ROOT_KEY, "", iter("b"))) == ["b"]
    tracing.stop()
    assert "1 spans are not written" in caplog.text


def test_a_folder_receives_the_spans_as_otlp_in_json(tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("opentelemetry.sdk.trace", reason="install the extra otel: `make peers`")
    monkeypatch.setattr(tracing, "tracer", None)
    tracing.start("dpm", {"CDFF_TRACES": str(tmp_path / "traces")})

    def fail() -> Iterator[str]:
        yield ""
        raise InputError("no region")

    with pytest.raises(InputError):
        list(tracing.traced(ROOT_KEY, "", fail()))
    tracing.stop()
    assert tracing.tracer is None
    (file,) = (tmp_path / "traces").glob("dpm_*.jsonl")
    (batch,) = json.loads(file.read_text())["resourceSpans"]
    assert {"key": "service.name", "value": {"stringValue": "dpm"}} in batch["resource"]["attributes"]
    (span,) = batch["scopeSpans"][0]["spans"]
    assert (span["name"], span["parentSpanId"]) == ("orchestrator.request", "")
    assert (len(span["traceId"]), len(span["spanId"])) == (32, 16)
    assert int(span["endTimeUnixNano"]) >= int(span["startTimeUnixNano"])
    assert span["status"] == {"code": 2, "message": "InputError: no region"}


@pytest.mark.parametrize("value", [b"traceparent", pack(["traceparent"]), pack({"a": "traceparent"})])
def test_attachments_that_only_contain_the_word_are_not_changed(value: bytes) -> None:
    assert split_context(value) == (value, "")
