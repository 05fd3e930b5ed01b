# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rate, offset, gaps and frame of a stream."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import IMUSensors, TransformWithCovariance
from cdff_core.runtime.stream_counters import StreamCounters

MS = 1_000_000


def sample(seq: int, stamp_ns: int, frame: str = "mana/imu", child: str = "") -> Sample:
    value = IMUSensors(acc=np.array([0, 0, 9.81]), gyro=np.zeros(3))
    return Sample(port="imu", stamp_ns=stamp_ns, seq=seq, value=value, frame=frame, child=child)


def counters(*stamps: tuple[int, int], delay_ns: int = 20 * MS) -> StreamCounters:
    stream = StreamCounters({"mana/base", "mana/imu"})
    for seq, stamp_ns in stamps:
        stream.add(sample(seq, stamp_ns), stamp_ns + delay_ns, 0.0)
    return stream


def test_rate_and_offset_are_those_of_the_newest_samples() -> None:
    stream = counters(*((i, 100 * MS * i) for i in range(200)))
    assert stream.rate_hz == pytest.approx(10.0)
    assert stream.offset_s == pytest.approx(-0.02)
    assert (stream.gaps, stream.lost, stream.backwards) == (0, 0, 0)


def test_a_single_late_sample_does_not_change_the_offset() -> None:
    stream = counters(*((i, 100 * MS * i) for i in range(9)))
    stream.add(sample(9, 900 * MS), 5000 * MS, 0.0)
    assert stream.offset_s == pytest.approx(-0.02)


def test_missing_numbers_are_gaps_and_a_restart_of_the_source_is_none() -> None:
    stream = counters((0, 0), (1, MS), (5, 2 * MS), (6, 3 * MS), (0, 4 * MS), (2, 5 * MS))
    assert (stream.gaps, stream.lost) == (2, 4)


def test_a_stamp_that_is_not_newer_is_counted_and_starts_the_rate_again() -> None:
    stream = counters((0, 0), (1, 100 * MS), (2, 50 * MS), (3, 60 * MS))
    assert stream.backwards == 1
    assert stream.rate_hz == pytest.approx(100.0)


def test_the_frame_of_a_pose_is_its_child() -> None:
    stream = StreamCounters({"mana/base"})
    pose = TransformWithCovariance()
    stream.add(Sample(port="odometry", stamp_ns=0, seq=0, value=pose, frame="odom", child="mana/bse"), 0, 0.0)
    body = stream.to_dict(2.5)
    assert (body["frame"], body["frame_known"], body["silent_s"]) == ("mana/bse", False, 2.5)


def test_the_last_value_is_stated_in_words() -> None:
    assert (
        counters((0, 0)).to_dict(0.0)["last"]
        == "specific force 0.00, 0.00, 9.81 m/s², rate 0.0, 0.0, 0.0 °/s"
    )


def test_a_stream_without_samples_has_no_measurements() -> None:
    body = StreamCounters(set()).to_dict(1.0)
    assert (body["count"], body["rate_hz"], body["offset_s"], body["silent_s"]) == (0, None, None, None)
    assert body["frame_known"]
