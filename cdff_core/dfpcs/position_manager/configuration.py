# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the position manager, in groups."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from cdff_common.interfaces.dfn import StrictModel
from cdff_common.interfaces.dfpc import DfpcConfig

Seconds = Annotated[float, Field(gt=0, le=86_400)]
Scale = Annotated[float, Field(ge=0.01, le=10_000)]
Sigma = Annotated[float, Field(ge=0, le=10)]


class StartParameters(StrictModel):
    """Parameters of the first estimate, all standard deviations."""

    tilt_sigma_rad: float = Field(
        default=0.05, ge=0, le=1, description="roll and pitch of a start pose that is not levelled, rad"
    )
    gyro_bias_sigma_rad_s: Sigma = Field(default=3e-3, description="gyro bias of a start in motion, rad/s")
    acc_bias_sigma_m_s2: Sigma = Field(default=0.008, description="accelerometer bias, m/s^2")


class WheelParameters(StrictModel):
    """Slip model of the wheel odometry: a first-order Gauss-Markov process."""

    slip_sigma: tuple[Sigma, Sigma, Sigma] = Field(
        default=(0.09, 0.025, 0.03),
        description="standard deviation of slip forward, left and up, metres per metre of path length",
    )


class MountParameters(StrictModel):
    """Errors of mounts for which the profile states no standard deviation (``sigma_m``, ``sigma_deg``)."""

    imu_sigma_deg: float = Field(
        default=0.5,
        ge=0,
        le=20,
        description="rotation of the IMU, °; data sheets state 0.25° (ADIS16495, largest) to 1° (ADIS16460, "
        "typical) between the axes and the package",
    )
    sensor_sigma_deg: float = Field(
        default=0.2, ge=0, le=20, description="rotation of camera or lidar: residual of its calibration, °"
    )
    sensor_sigma_m: float = Field(
        default=0.005, ge=0, le=1, description="position of camera or lidar in the base, m"
    )


class OdometryParameters(StrictModel):
    """Visual and lidar odometry."""

    visual_scale: Scale = Field(default=1.0, description="factor on the variances of visual odometry")
    lidar_scale: Scale = Field(default=1.45, description="factor on the variances of lidar odometry")
    correlated: tuple[Literal["visual_odometry", "lidar_odometry"], ...] = Field(
        default=(), description="odometries with common errors, which are combined by covariance intersection"
    )
    max_gap_s: Seconds = Field(
        default=2.0, description="longest interval between the poses of an increment, s"
    )
    timeout_s: Seconds = Field(
        default=1.2,
        description="silence of accurate sources after which poses from wheels or IMU are published, s",
    )


class FixParameters(StrictModel):
    """Correction by absolute poses."""

    weighting: Literal["intersection", "kalman"] = Field(
        default="intersection",
        description="intersection for fixes with common errors (of one map), kalman for independent fixes",
    )
    scale: Scale = Field(default=1.0, description="factor on the variances of a fix")


class ClockParameters(StrictModel):
    """Detection of wrong stamps and of jumps of the mission clock."""

    max_ahead_s: Seconds = Field(
        default=5.0,
        description="a stamp further ahead of the newest one is refused until other samples confirm it, s",
    )
    max_silence_s: Seconds = Field(
        default=30.0, description="silence of all sources after which position and velocity are unknown, s"
    )


class TimelineParameters(StrictModel):
    """Resolution and length of the timeline."""

    memory_s: Seconds = Field(default=20.0, description="greatest delay of a measurement that is used, s")
    dense_s: Seconds = Field(default=60.0, description="age up to which every estimate is kept, s")
    thin_s: Seconds = Field(default=1.0, description="interval of the older estimates that are kept, s")
    history_s: Seconds = Field(
        default=3600.0, description="age at which estimates are removed, except pinned ones, s"
    )
    imu_period_s: Seconds = Field(default=0.5, description="interval of estimates from the IMU alone, s")
    extrapolation_s: float = Field(
        default=0.2, ge=0, le=10, description="prediction beyond the newest estimate on request, s"
    )

    @model_validator(mode="after")
    def _check_dense(self) -> TimelineParameters:
        if self.dense_s < self.memory_s:
            raise ValueError(
                f"dense_s={self.dense_s:g} is less than memory_s={self.memory_s:g}: late measurements would "
                "be inserted into a thinned timeline; increase dense_s"
            )
        return self


class PublicationParameters(StrictModel):
    """Rate of the trajectory output."""

    trajectory_period_s: Seconds = Field(default=5.0, description="least time between trajectories, s")
    trajectory_growth: float = Field(
        default=0.02,
        ge=0,
        le=1,
        description="relative growth of the trajectory after which it is published again",
    )


class PositionManagerConfig(DfpcConfig):
    """Parameters of PositionManager; scales and slip were fitted on training seeds of the evaluation."""

    start: StartParameters = StartParameters()
    wheels: WheelParameters = WheelParameters()
    mounts: MountParameters = MountParameters()
    odometry: OdometryParameters = OdometryParameters()
    fixes: FixParameters = FixParameters()
    clock: ClockParameters = ClockParameters()
    timeline: TimelineParameters = TimelineParameters()
    publication: PublicationParameters = PublicationParameters()

    @model_validator(mode="after")
    def _check_imu_period(self) -> PositionManagerConfig:
        period_s, silence_s = self.timeline.imu_period_s, self.clock.max_silence_s
        if period_s > silence_s:
            raise ValueError(
                f"timeline.imu_period_s={period_s:g} is more than clock.max_silence_s={silence_s:g}: an IMU "
                "alone would count as silence; increase max_silence_s"
            )
        return self
