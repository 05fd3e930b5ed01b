# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Several logs as one: order of the samples, first samples, content without a stream, equal names."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.types import Time
from cdff_dev.logs.indexed import IndexedLog, IndexedStream
from cdff_dev.logs.joined import JoinedLog
from cdff_dev.logs.source import Unconverted


def _log(stream: str, *stamps_us: int, other: str = "") -> IndexedLog:
    stamps_ns = np.array(stamps_us, np.int64) * 1000
    indexed = IndexedStream("Time", stamps_ns, lambda i: Time.from_ns(int(stamps_ns[i])))
    unconverted = {other: Unconverted("text", 2, "no type")} if other else {}
    return IndexedLog({stream: indexed}, unconverted)


def test_samples_of_all_logs_are_in_the_order_of_their_stamps() -> None:
    log = JoinedLog({"a.bag": _log("/a/clock.time", 1, 5), "b.bag": _log("/b/clock.time", 3, 5, 9)})
    order = [(s.stamp_ns, s.stream, s.seq) for s in log.samples()]
    assert order == sorted(order)
    assert [stamp_ns for stamp_ns, *_ in order] == [1000, 3000, 5000, 5000, 9000]
    assert [s.stamp_ns for s in log.samples_from(5000, ["/b/clock.time"])] == [5000, 9000]
    assert {name: s.stamp_ns for name, s in log.first_samples().items()} == {
        "/a/clock.time": 1000,
        "/b/clock.time": 3000,
    }
    assert log.streams["/b/clock.time"].count == 3
    assert log.stamps_ns("/a/clock.time").tolist() == [1000, 5000]


def test_content_without_a_stream_names_its_log() -> None:
    log = JoinedLog({"a.bag": _log("/a/clock.time", 1, other="/chat"), "b.bag": _log("/b/clock.time", 3)})
    assert list(log.unconverted) == ["a.bag: /chat"]


def test_a_stream_in_two_logs_is_refused_with_their_names() -> None:
    with pytest.raises(InputError, match=r"/a/clock.time is in a.bag and in b.bag"):
        JoinedLog({"a.bag": _log("/a/clock.time", 1), "b.bag": _log("/a/clock.time", 3)})
