# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parts and repetitions of a log."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header
from cdff_common.types import IMUSensors, Time, TransformWithCovariance
from cdff_dev.logs import LogSource, open_log
from cdff_dev.logs.formats.infuse.writer import LogWriter
from cdff_dev.play.log_part import LogPart
from cdff_dev.play.looped_log import LoopedLog

S = 1_000_000_000
IMU, ODOMETRY = "/mana/imu.sample", "/mana/wheels.odometry"


@pytest.fixture
def log(tmp_path: Path) -> Iterator[LogSource]:
    """Ten seconds of inertial samples at 10 Hz, and a pose of odometry each second, 1 m further."""
    with LogWriter(tmp_path / "a.msg") as writer:
        for n in range(101):
            t_ns = 100 * S + n * S // 10
            writer.write(IMU, IMUSensors(Time.from_ns(t_ns), np.ones(3), np.zeros(3), np.zeros(3)), t_ns)
            if n % 10 == 0:
                T = UncertainTransform(se3.transform(np.eye(3), [n / 10, 0.0, 0.0]), np.eye(6))
                pose = TransformWithCovariance.from_transform(T, parent="odom", child="base", stamp_ns=t_ns)
                writer.write(ODOMETRY, pose, t_ns)
    with open_log(tmp_path / "a.msg") as opened:
        yield opened


def test_a_part_has_the_streams_and_the_interval_asked_for(log: LogSource) -> None:
    part = LogPart(log, ["*/imu.*"], "2", duration_s=3.0)
    samples = list(part.samples())
    assert {sample.stream for sample in samples} == {IMU} == set(part.streams)
    assert [samples[0].stamp_ns, samples[-1].stamp_ns] == [102 * S, 105 * S]
    assert (part.streams[IMU].t0_ns, part.streams[IMU].t1_ns) == (102 * S, 105 * S)


@pytest.mark.parametrize(
    ("patterns", "start", "match"),
    [
        (["*/lidar.*"], "0", "no stream matches"),
        ([], "11", "the log has 10 s"),
        ([], "-11", "the log has 10 s"),
        ([], "soon", "expected seconds"),
    ],
)
def test_a_part_without_samples_is_refused(
    log: LogSource, patterns: list[str], start: str, match: str
) -> None:
    with pytest.raises(InputError, match=match):
        LogPart(log, patterns, start)


@pytest.mark.parametrize("duration_s", [-1.0, float("nan"), float("inf")])
def test_durations_that_are_none_are_refused(log: LogSource, duration_s: float) -> None:
    with pytest.raises(InputError, match=r"--duration .* expected seconds, 0 or more"):
        LogPart(log, duration_s=duration_s)


def test_a_negative_start_counts_from_the_end(log: LogSource) -> None:
    assert next(LogPart(log, start="-2.5").samples()).stamp_ns == 107 * S + S // 2


def test_a_repeated_log_continues_time_and_odometry(log: LogSource) -> None:
    samples = list(islice(LoopedLog(log).samples(), 3 * 112))
    stamps = [sample.stamp_ns for sample in samples if sample.stream == IMU]
    assert len(stamps) == 303
    assert set(np.diff(stamps)) == {S // 10}
    times = [sample.value.timestamp.microseconds * 1000 for sample in samples if sample.stream == IMU]
    assert times == stamps
    x_m = [sample.value.transform.matrix[0, 3] for sample in samples if sample.stream == ODOMETRY]
    np.testing.assert_allclose(x_m[:12], [*range(11), 10.0], atol=1e-9)
    assert x_m[-1] == pytest.approx(30.0)
    assert len({sample.seq for sample in samples if sample.stream == IMU}) == 303


def test_the_stamps_of_static_poses_do_not_set_the_time_of_a_part(log: LogSource, tmp_path: Path) -> None:
    with LogWriter(tmp_path / "b.msg") as writer:
        for sample in log.samples():
            writer.write(sample.stream, sample.value, sample.stamp_ns)
        pose = TransformWithCovariance.from_transform(
            UncertainTransform.identity(), parent="base", child="imu", stamp_ns=S
        )
        writer.write("/mana/tf_static.imu", pose, 1_000_000_000 * S)
    with open_log(tmp_path / "b.msg") as static:
        part = LogPart(static, start="-2")
        assert next(sample.stamp_ns for sample in part.samples()) == 108 * S
        assert max(info.t1_ns for info in part.streams.values()) == 110 * S
        assert part.left_out == ["/mana/tf_static.imu"]


@pytest.mark.parametrize(
    ("start", "duration_s"), [("0", 2.97), ("3.04", 2.97), ("3.04", 1.0), ("-1.55", None)]
)
def test_a_repeated_part_has_no_gap_between_its_laps(
    log: LogSource, start: str, duration_s: float | None
) -> None:
    looped = LoopedLog(LogPart(log, ["*/imu.*"], start, duration_s))
    stamps_ns = [sample.stamp_ns for sample in islice(looped.samples(), 200)]
    assert set(np.diff(stamps_ns)) == {S // 10}


def test_a_log_is_read_from_a_stamp_on_like_its_rest(log: LogSource) -> None:
    later = [(s.stream, s.seq) for s in log.samples() if s.stamp_ns >= 104 * S]
    assert [(s.stream, s.seq) for s in log.samples_from(104 * S)] == later
    part = LogPart(log, ["*/imu.*"], "1970-01-01T00:01:42Z", duration_s=3.0)
    assert [s.stamp_ns for s in part.samples_from(104 * S + S // 2)][::5] == [104 * S + S // 2, 105 * S]
    assert next(part.samples_from(0)).stamp_ns == 102 * S


def test_a_repeated_log_is_read_from_a_stamp_of_a_later_lap_on(log: LogSource) -> None:
    whole_samples = list(islice(LoopedLog(log).samples(), 300))
    chosen = whole_samples[250]
    later = next(iter(LoopedLog(log).samples_from(chosen.stamp_ns)))
    assert (later.stream, later.seq, later.stamp_ns) == (chosen.stream, chosen.seq, chosen.stamp_ns)
    poses = (s for s in LoopedLog(log).samples_from(chosen.stamp_ns) if s.stream == ODOMETRY)
    expected = next(s for s in whole_samples[250:] if s.stream == ODOMETRY)
    np.testing.assert_array_equal(next(poses).value.transform.matrix, expected.value.transform.matrix)


def test_a_log_that_is_no_longer_repeated_ends_with_its_lap(log: LogSource) -> None:
    looped = LoopedLog(log)
    samples = looped.samples()
    first = [next(samples) for _ in range(120)]
    looped.is_repeated = False
    assert len(first) + len(list(samples)) == 2 * 112
    assert looped.lap_end_ns(first[0].stamp_ns) == 110 * S
    assert looped.lap_end_ns(first[-1].stamp_ns) == 110 * S + 101 * S // 10
    assert max(info.t1_ns for info in looped.streams.values()) == 110 * S


def test_the_first_lap_has_the_samples_and_headers_of_the_log(tmp_path: Path) -> None:
    header = Header("00000000-0000-4000-8000-000000000001", 7, S, S, "mana/imu", "recorded")
    with LogWriter(tmp_path / "b.msg") as writer:
        for n in (1, 2):
            value = IMUSensors(Time.from_ns(n * S), np.ones(3), np.zeros(3), np.zeros(3))
            writer.write(IMU, value, n * S, header)
    with open_log(tmp_path / "b.msg") as log:
        samples = list(islice(LoopedLog(log).samples(), 4))
    assert [sample.header.id == header.id for sample in samples if sample.header] == [
        True,
        True,
        False,
        False,
    ]
