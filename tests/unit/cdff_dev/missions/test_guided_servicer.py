# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A guided servicer: commanded displacements, refused motions, lost sensors, and its log."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.geometry import se3
from cdff_dev.logs import LogSample
from cdff_dev.missions.orbit.guided_log import GuidedLog
from cdff_dev.missions.orbit.servicer import GuidedServicer
from cdff_dev.simulate.orbit.rendezvous import simulate_orbit
from tests.unit.cdff_dev.simulate.orbit.conftest import small_scenario

NO_ERRORS = {"scale_sigma": 0.0, "position_sigma_m": 0.0}
STAR_TRACKER = {"rate_hz": 1.0, "sun_exclusion_deg": 0.0, "earth_exclusion_deg": 0.0}


def guided(**changes: Any) -> GuidedServicer:
    values: dict[str, Any] = {
        "servicer__thrust": NO_ERRORS,
        "servicer__cameras": {},
        "servicer__star_tracker": STAR_TRACKER,
        "servicer__path": [{"kind": "hold", "duration_s": 2.0}],
        "servicer__gnss": {"rate_hz": 0.5},
        "servicer__lidars": {
            "lidar": {"kind": "flash", "rows": 16, "columns": 16, "field_deg": [30.0, 30.0], "rate_hz": 0.5}
        },
    }
    return GuidedServicer(small_scenario(**{**values, **changes}))


def of_stream(servicer: GuidedServicer, stream: str, steps: range) -> list[LogSample]:
    return [s for step in steps for s in servicer.samples(step) if s.stream == stream]


def client_in_base(servicer: GuidedServicer, step: int) -> np.ndarray:
    """Return the true position of the client in the base at the start of a step."""
    poses = {s.stream: s.value.transform.matrix for s in servicer.samples(step) if "truth.pose" in s.stream}
    return np.asarray(
        (se3.inverse(poses["/servicer/truth.pose"]) @ poses["/client/truth.pose"])[:3, 3], dtype=float
    )


def test_a_displacement_in_the_base_moves_the_servicer_towards_the_client() -> None:
    servicer = guided()
    before_m = client_in_base(servicer, 2)
    assert servicer.move(np.array([5.0, 0.0, 0.0]), 10.0, 3.0, in_base=True) == (3.0, 13.0)
    after_m = client_in_base(servicer, 14)
    assert np.linalg.norm(before_m) == pytest.approx(15.0, abs=0.1)
    assert np.linalg.norm(after_m) == pytest.approx(10.0, abs=0.1)
    half_m = client_in_base(servicer, 8)
    assert np.linalg.norm(half_m) == pytest.approx(12.5, abs=0.1)


def test_the_errors_of_the_thrusters_change_the_end_of_a_motion() -> None:
    servicer = guided(servicer__thrust={"scale_sigma": 0.05, "position_sigma_m": 0.1})
    servicer.move(np.array([5.0, 0.0, 0.0]), 10.0, 3.0, in_base=True)
    error_m = abs(np.linalg.norm(client_in_base(servicer, 14)) - 10.0)
    assert 0.005 < error_m < 1.0


def test_motions_into_the_client_or_before_the_end_of_another_are_refused() -> None:
    servicer = guided()
    with pytest.raises(InputError, match="displacement"):
        servicer.move(np.array([15.0, 0.0, 0.0]), 10.0, 3.0, in_base=True)
    with pytest.raises(InputError, match="near_m"):
        servicer.move(np.array([14.2, 0.0, 0.0]), 10.0, 3.0, in_base=True)
    assert np.linalg.norm(client_in_base(servicer, 20)) == pytest.approx(15.0, abs=0.1)  # it did not move
    servicer.move(np.array([1.0, 0.0, 0.0]), 10.0, 3.0, in_base=True)
    with pytest.raises(InputError, match=r"moves for another 6\.0 s"):
        servicer.move(np.array([1.0, 0.0, 0.0]), 10.0, 7.0, in_base=True)
    with pytest.raises(InputError, match="finite"):
        servicer.move(np.array([np.nan, 0.0, 0.0]), 10.0, 30.0, in_base=True)


def test_a_lost_sensor_delivers_no_samples_for_the_stated_time() -> None:
    servicer = guided()
    assert servicer.lose_sensor("lidar", 4.0, 2.0) == 6.0
    times_s = [
        (s.stamp_ns - servicer.scenario.epoch_ns) * 1e-9
        for s in of_stream(servicer, "/servicer/lidar.scan", range(10))
    ]
    np.testing.assert_allclose(times_s, [6.0, 8.0])
    with pytest.raises(InputError, match="sensor 'sonar': expected one of gnss, lidar, star_tracker"):
        servicer.lose_sensor("sonar", 4.0, 2.0)


def test_without_commands_the_scans_and_poses_are_those_of_the_simulated_scenario() -> None:
    servicer = guided(servicer__path=[{"kind": "hold", "duration_s": 6.0}])
    expected = {
        (entry.stream, entry.stamp_ns): value for entry, value in simulate_orbit(servicer.scenario, workers=0)
    }
    compared = 0
    for stream in ("/servicer/lidar.scan", "/servicer/truth.pose", "/servicer/truth.lidar_target"):
        for sample in of_stream(servicer, stream, range(6)):
            other = expected[stream, sample.stamp_ns]
            if stream.endswith("scan"):
                np.testing.assert_array_equal(sample.value.points_m, other.points_m)
            elif stream.endswith("pose"):
                np.testing.assert_allclose(sample.value.transform.matrix, other.transform.matrix)
            else:
                matrices = [v.detections[0].pose.transform.matrix for v in (sample.value, other)]
                np.testing.assert_allclose(*matrices)
            compared += 1
    assert compared >= 9


def test_the_error_of_the_star_tracker_is_constant_over_the_steps() -> None:
    servicer = guided(
        servicer__star_tracker={
            **STAR_TRACKER,
            "cross_sigma_arcsec": 0.0,
            "roll_sigma_arcsec": 0.0,
            "bias_sigma_arcsec": 50.0,
        }
    )
    truth = of_stream(servicer, "/servicer/truth.pose", range(4))
    measured = of_stream(servicer, "/servicer/star_tracker.attitude", range(4))
    errors = np.array(
        [
            se3.log_so3(t.value.transform.matrix[:3, :3].T @ m.value.transform.matrix[:3, :3])
            for t, m in zip(truth, measured, strict=True)
        ]
    )
    np.testing.assert_allclose(errors, np.tile(errors[0], (4, 1)), atol=1e-9)
    assert np.degrees(np.linalg.norm(errors[0])) * 3600.0 > 5.0


def test_the_log_reports_up_to_which_time_it_is_complete() -> None:
    log = GuidedLog(guided().scenario, None)
    samples = iter(log.samples(["/servicer/lidar.scan"]))
    epoch_ns = log.servicer.scenario.epoch_ns
    assert log.ready_ns() == epoch_ns
    assert next(samples).stamp_ns == epoch_ns
    next(samples)
    begin_ns, end_ns = log.move(np.array([1.0, 0.0, 0.0]), 5.0, in_base=True)
    assert (begin_ns - epoch_ns, end_ns - begin_ns) == (3_000_000_000, 5_000_000_000)
    assert log.ready_ns() == epoch_ns + 2_000_000_000
    log.close()
    assert all("/truth." not in stream for stream in log.streams)


def test_sensors_that_the_steps_do_not_support_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="rates up to 1 Hz"):
        guided(servicer__lidars={"lidar": {"rows": 8, "columns": 8, "field_deg": [9, 9], "rate_hz": 4.0}})
