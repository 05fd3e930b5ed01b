# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Model of the scenario files ``deploy/simulation/*.yaml``: terrain, rovers and sensors of a simulation."""

from __future__ import annotations

import hashlib
import json
from functools import cached_property
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from cdff_common.clock import parse_stamp
from cdff_common.errors import ConfigurationError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import StrictModel, validated
from cdff_dev.simulate.faults.model import Faults
from cdff_dev.simulate.fields import Mount, NotNegative, Positive
from cdff_dev.simulate.rovers_in_view_model import RoversInView
from cdff_dev.simulate.scenario_files import SCENARIO_FOLDER, read_scenario

__all__ = ["SCENARIO_FOLDER", "Scenario", "load_scenario"]


class Spectrum(StrictModel):
    """Fractal relief: power spectrum ``k^-(2 hurst + 2)`` between two wavelengths, with given slopes."""

    hurst: Annotated[float, Field(gt=0, lt=1)]
    longest_m: Positive
    split_m: Positive
    shortest_m: Positive
    rms_slope_deg: Annotated[float, Field(ge=0, le=30, description="of the relief longer than split_m")]
    rms_slope_fine_deg: Annotated[float, Field(ge=0, le=30, description="of the relief shorter than split_m")]


class Craters(StrictModel):
    """Simple craters: parabolic bowl, rim, and ejecta that decrease with the cube of the distance."""

    count: Annotated[int, Field(ge=0, le=2000)]
    diameter_min_m: Positive
    diameter_max_m: Positive
    slope: Annotated[float, Field(gt=0, description="cumulative size-frequency exponent")]
    depth_ratio: tuple[Positive, Positive]
    rim_ratio: Positive
    half_width_m: Positive


class Rocks(StrictModel):
    """Rocks: convex meshes, partly in the ground, none on the paths of the rovers."""

    count: Annotated[int, Field(ge=0, le=50_000)]
    diameter_min_m: Positive
    diameter_max_m: Positive
    slope: Annotated[float, Field(gt=0, description="cumulative size-frequency exponent")]
    half_width_m: Positive
    track_clearance_m: NotNegative


class Boulder(StrictModel):
    """A rock at a given place."""

    centre_xy_m: tuple[float, float]
    diameter_m: Positive
    albedo: Annotated[float, Field(gt=0, le=2, description="relative to the mean of the ground")] = 0.9


class Plain(StrictModel):
    """A circular area with reduced relief, without craters and rocks."""

    centre_xy_m: tuple[float, float]
    radius_m: Positive
    margin_m: Annotated[
        float, Field(gt=0, description="width of the ring in which the relief grows to its full height")
    ]
    relief: Annotated[float, Field(ge=0, le=1, description="factor of the fractal relief inside the radius")]


class Surface(StrictModel):
    """Appearance of terrain and sun."""

    texel_m: Positive
    albedo_contrast: Annotated[float, Field(ge=0, le=1)]
    detail_texel_m: Positive
    detail_contrast: Annotated[float, Field(ge=0, le=1)]
    pebbles_per_m2: NotNegative
    sun_elevation_deg: Annotated[float, Field(gt=5, le=90)]
    sun_azimuth_deg: float
    ambient: Annotated[float, Field(ge=0, le=1)]
    haze_distance_m: Positive


class TerrainModel(StrictModel):
    """The terrain: a fine grid in the centre, coarser cells further out."""

    fine_half_width_m: Positive
    resolution_m: Positive
    far_half_width_m: Positive
    growth: Annotated[float, Field(gt=1, le=1.5)]
    spectrum: Spectrum
    craters: Craters
    rocks: Rocks
    plains: tuple[Plain, ...] | None = None
    boulders: tuple[Boulder, ...] | None = Field(None, description="rocks at given places, in addition")
    surface: Surface | None = Field(None, description="required if there are cameras")


#: Columns: the axes of a camera frame (x right, y down, z forward) in a frame with x forward and z up.
BODY_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


class Navcam(StrictModel):
    """A rectified stereo camera; ``mount`` is the pose of the left camera."""

    mount: Mount
    rows: Annotated[int, Field(ge=16, le=4096)]
    columns: Annotated[int, Field(ge=16, le=4096)]
    focal_px: Positive
    baseline_m: Positive
    rate_hz: Positive
    psf_sigma_px: NotNegative
    read_noise_dn: NotNegative
    shot_noise_dn2_per_dn: NotNegative
    exposure_sigma: Annotated[float, Field(ge=0, le=0.5, description="relative, per pair")]
    balance_sigma: Annotated[float, Field(ge=0, le=0.1, description="relative, between the two cameras")]
    vignetting: Annotated[float, Field(ge=0, le=0.9, description="relative loss in the corners")]
    gain_dn: Positive

    @property
    def camera_matrix(self) -> FloatArray:
        """Intrinsics ``(3, 3)``, pixels; pixel centres at integers."""
        cx, cy = (self.columns - 1) / 2, (self.rows - 1) / 2
        return np.array([[self.focal_px, 0, cx], [0, self.focal_px, cy], [0, 0, 1.0]])

    @property
    def T_base_left(self) -> FloatArray:
        """Pose of the left camera in the base, shape (4, 4)."""
        return self.mount.matrix() @ se3.transform(BODY_OPTICAL, [0, 0, 0])

    @property
    def T_base_right(self) -> FloatArray:
        """Pose of the right camera in the base, shape (4, 4)."""
        return self.T_base_left @ se3.transform(np.eye(3), [self.baseline_m, 0, 0])


class Lidar(StrictModel):
    """A spinning lidar: one ring per elevation, one column per azimuth."""

    mount: Mount
    rings: Annotated[int, Field(ge=1, le=256)]
    columns: Annotated[int, Field(ge=8, le=8192)]
    elevation_min_deg: float
    elevation_max_deg: float
    rate_hz: Annotated[float, Field(gt=0, description="rate of the recorded revolutions")]
    revolution_s: Positive | None = Field(None, description="duration of one revolution; default 1 / rate_hz")
    range_min_m: Positive
    range_max_m: Positive
    range_sigma_m: NotNegative
    dropout: Annotated[float, Field(ge=0, lt=1)]

    @property
    def sweep_s(self) -> float:
        """Duration of a scan, from the start of the first to the end of the last column, seconds."""
        return self.revolution_s or 1.0 / self.rate_hz


class Imu(StrictModel):
    """Gyroscope and accelerometer: white noise, a constant bias per run, and a random walk of the bias."""

    mount: Mount
    rate_hz: Positive
    gyro_noise_rad_s_sqrt_hz: NotNegative
    gyro_bias_sigma_rad_s: NotNegative
    gyro_walk_rad_s2_sqrt_hz: NotNegative
    acc_noise_m_s2_sqrt_hz: NotNegative
    acc_bias_sigma_m_s2: NotNegative
    acc_walk_m_s3_sqrt_hz: NotNegative


class Wheels(StrictModel):
    """Odometry of slipping wheels, and the covariance that it reports."""

    rate_hz: Positive
    slip_mean: Annotated[float, Field(ge=0, lt=0.9)]
    slip_per_slope: Annotated[float, Field(ge=0, description="additional slip per sine of the uphill slope")]
    slip_sigma: NotNegative
    slip_correlation_s: Positive
    side_slip_per_slope: NotNegative
    yaw_gain_sigma: NotNegative
    yaw_noise_rad_sqrt_m: NotNegative
    reported_distance_sigma: Annotated[
        float, Field(ge=0, description="relative, of each increment (fully correlated)")
    ]
    reported_side_sigma: Annotated[
        float, Field(ge=0, description="relative, of each increment (fully correlated)")
    ]
    reported_yaw_sigma_rad_sqrt_m: NotNegative
    reported_tilt_sigma_rad: NotNegative


class Chassis(StrictModel):
    """Geometry of the wheels; the base frame is ``base_height_m`` above the plane of the wheel contacts."""

    wheelbase_m: Positive
    track_m: Positive
    wheel_footprint_m: Positive
    base_height_m: NotNegative


class RoverPath(StrictModel):
    """Path of one rover: start pose, curvature along the path, and rest times before and after the motion."""

    start_xy_m: tuple[float, float]
    heading_deg: float
    curvature_1pm: Annotated[tuple[tuple[float, float], ...], Field(min_length=2)]
    speed_m_s: Positive
    rest_before_s: NotNegative
    rest_after_s: NotNegative
    ramp_s: Positive


class Scenario(StrictModel):
    """Contents of a scenario file."""

    name: str
    seed: Annotated[int, Field(ge=0)]
    epoch: str
    duration_s: Positive
    gravity_m_s2: Positive
    terrain: TerrainModel
    chassis: Chassis
    navcam: Navcam | None = None
    lidar: Lidar
    imu: Imu
    wheels: Wheels
    truth_rate_hz: Positive
    truth_map_m: Positive | None = Field(None, description="cell size of the true map; default 0.05 m")
    robots: Annotated[dict[str, RoverPath], Field(min_length=1)]
    rovers_in_view: RoversInView | None = Field(
        None, description="bodies of the rovers in the images of the others; without it they are not visible"
    )
    faults: Faults | None = Field(None, description="faults of the sensors; without it the sensors have none")

    @model_validator(mode="after")
    def _check_surface_for_cameras(self) -> Scenario:
        if self.navcam is not None and self.terrain.surface is None:
            raise ValueError("terrain.surface is missing: navcam needs the appearance of the terrain")
        if self.rovers_in_view is not None and (self.navcam is None or self.faults is not None):
            raise ValueError("rovers_in_view: expected with navcam and without faults")
        return self

    @property
    def epoch_ns(self) -> int:
        """Mission time at the start, nanoseconds."""
        return parse_stamp(self.epoch, "epoch")

    @cached_property
    def digest(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of all fields of the scenario."""
        text = json.dumps(self.model_dump(mode="json", exclude_none=True), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def load_scenario(name: str, seed: int | None = None) -> Scenario:
    """Read a shipped scenario on terrain by name, or a file by path; ``seed`` replaces the seed of the file.

    Raises
    ------
    ConfigurationError
        If there is no such scenario, or a key or value in it is wrong.
    """
    data = read_scenario(name)
    if data.get("kind") == "orbit":
        raise ConfigurationError(f"{name}: a scenario in orbit, expected one on terrain: without kind")
    if seed is not None:
        data["seed"] = seed
    return validated(Scenario, data, name)
