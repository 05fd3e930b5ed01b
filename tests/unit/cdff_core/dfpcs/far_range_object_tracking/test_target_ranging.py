# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Range of a resolved target: an interval without its attitude, and whether it is informative."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Mesh, TransformWithCovariance, Vector3d
from cdff_core.bearing_tracking.camera_attitude import CameraAttitude
from cdff_core.dfns.star_field_background.interface import StarFieldBackgroundOutputs
from cdff_core.dfpcs.far_range_object_tracking.configuration import FarRangeObjectTrackingConfig
from cdff_core.dfpcs.far_range_object_tracking.target_ranging import (
    TargetRange,
    TargetRanging,
    _Window,
    target_model,
)
from tests.support.satellite import satellite
from tests.support.star_scene import CAMERA, SATELLITE_SUN, satellite_light

ATTITUDE = CameraAttitude(np.eye(3), np.zeros((3, 3)), np.zeros(0, bool))


def measured(extent_px: float, *, is_attitude_known: bool, **config: object) -> tuple[TargetRange, float]:
    """Return the range of the satellite with an extent in the image, and the true range."""
    vertices, triangles = satellite()
    range_m = CAMERA.fx * float(np.ptp(vertices, axis=0).max()) / extent_px
    R = se3.exp_so3([0.3, -0.5, 0.2])
    light = satellite_light(se3.transform(R, [0.0, 0.0, range_m]))
    light += np.random.default_rng(1).normal(0.0, 20.0, light.shape).astype(np.float32)
    ranging = TargetRanging(_configured(), FarRangeObjectTrackingConfig(**config))
    if "target_sizes_m" not in config:
        mesh = Mesh.from_arrays(vertices, triangles, frame="client/body", stamp_ns=0)
        ranging.give_model(Sample("model", 0, 0, mesh))
    ranging.give_sun(Sample("sun", 0, 0, Vector3d(SATELLITE_SUN)))
    if is_attitude_known:
        T = UncertainTransform(se3.transform(R, np.zeros(3)), np.zeros((6, 6)))
        value = TransformWithCovariance.from_transform(T, parent="inertial", child="client/body", stamp_ns=0)
        ranging.give_attitude(Sample("body_attitude", 0, 0, value))
    rows, columns = np.nonzero(light > 200.0)
    box = np.array([columns.min(), columns.max(), rows.min(), rows.max()], float)
    noise, mask = np.full(light.shape, 20.0, np.float32), np.zeros(light.shape, np.uint8)
    image = StarFieldBackgroundOutputs(residual=light, noise=noise, mask=mask, saturated=0.0)
    return ranging.measure(0, CAMERA, ATTITUDE, image, box, 0.49 * np.eye(2)), range_m


def _configured() -> object:
    dfn = Registry.default().make_dfn("ApparentSizeRanging", "RenderedComparison")
    dfn.configure()
    return dfn


@pytest.mark.parametrize("extent_px", [12.0, 30.0, 60.0])
def test_without_the_attitude_the_interval_contains_the_range_and_is_not_informative(
    extent_px: float,
) -> None:
    result, range_m = measured(extent_px, is_attitude_known=False)
    low, high = result.interval_m
    assert low < range_m < high
    assert abs(result.range_m - range_m) < 2.0 * result.sigma_m
    assert result.reasons[0] == "range_interval"
    assert result.reasons[1].startswith("range_uninformative:0.")
    assert result.metrics["range_relative_sigma"] == pytest.approx(result.sigma_m / result.range_m)
    assert (result.metrics["range_low_m"], result.metrics["range_high_m"]) == (low, high)


@pytest.mark.parametrize("extent_px", [20.0, 50.0])
def test_with_the_attitude_the_range_is_informative(extent_px: float) -> None:
    result, range_m = measured(extent_px, is_attitude_known=True)
    assert result.reasons == ()
    assert abs(result.range_m - range_m) < 3.0 * result.sigma_m
    assert result.sigma_m < 0.1 * result.range_m


@pytest.mark.parametrize("is_attitude_known", [True, False])
def test_the_pose_of_the_target_agrees_with_the_truth_within_its_covariance(is_attitude_known: bool) -> None:
    result, range_m = measured(50.0, is_attitude_known=is_attitude_known)
    T, covariance = result.T_camera_body.matrix, result.T_camera_body.covariance
    R = se3.exp_so3([0.3, -0.5, 0.2])
    np.testing.assert_allclose(T[:3, :3], R if is_attitude_known else np.eye(3), atol=1e-6)
    position_m, sigmas = T[:3, 3], np.sqrt(np.diag(covariance))
    assert (np.abs(position_m - [0.0, 0.0, range_m]) < 3.0 * sigmas[:3]).all()
    # Across the line of sight: half a pixel, or a quarter of the extent of 50 pixels.
    across_px = sigmas[:2] * CAMERA.fx / position_m[2]
    np.testing.assert_allclose(across_px, 0.5 if is_attitude_known else 12.5, rtol=0.15)
    assert sigmas[2] == pytest.approx(result.sigma_m, rel=1e-3)
    # A rotation that is uniform between -pi and pi, without the attitude.
    np.testing.assert_allclose(sigmas[3:], 0.01 if is_attitude_known else np.pi / np.sqrt(3.0))


def test_the_limit_of_an_informative_range_is_configured() -> None:
    result, _ = measured(50.0, is_attitude_known=False, informative_range=0.6)
    assert result.reasons == ("range_interval",)


@pytest.mark.parametrize(
    ("frame", "name"), [("client/body", "client"), ("/body", "target"), ("cubesat", "cubesat")]
)
def test_the_target_has_the_name_of_the_frame_of_its_model(frame: str, name: str) -> None:
    vertices, triangles = satellite()
    model = target_model(Mesh.from_arrays(vertices, triangles, frame=frame, stamp_ns=0), 1e-3)
    assert model.name == name
    np.testing.assert_allclose(model.vertices_m, 1e-3 * vertices, rtol=1e-6)


def test_a_target_below_five_pixels_has_no_range() -> None:
    with pytest.raises(RefusedError) as refusal:
        measured(4.0, is_attitude_known=True)
    assert refusal.value.reasons[0].startswith("unresolved:")


@pytest.mark.parametrize("extent_px", [40, 400])
def test_the_window_of_a_large_target_is_smoothed_before_its_reduction(extent_px: int) -> None:
    rows, columns = CAMERA.rows, CAMERA.cols
    stripes = np.where(np.arange(columns) // 2 % 2, 1.0, -1.0).astype(np.float32)
    image = StarFieldBackgroundOutputs(
        residual=np.repeat(stripes[None], rows, axis=0),
        noise=np.full((rows, columns), 2.0, np.float32),
        mask=np.zeros((rows, columns), np.uint8),
        saturated=0.0,
    )
    centre = 0.5 * np.array([columns, rows])
    box = np.repeat(centre, 2) + 0.5 * extent_px * np.array([-1, 1, -1, 1])
    window = _Window.around(CAMERA, ATTITUDE, image, box, 0.49 * np.eye(2))
    factor = CAMERA.fx / window.focal_px
    assert (factor > 1.5) is (extent_px > 100)
    assert bool(np.abs(window.image).mean() < 0.2) is (factor > 1.5)
    assert window.noise == pytest.approx(2.0 / factor)
    expected_px = np.hypot(0.7, 0.5 * factor if factor > 1.0 else 0.0) / factor
    assert window.point_spread_px == pytest.approx(expected_px)
