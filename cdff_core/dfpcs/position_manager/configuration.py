# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the position manager."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from cdff_common.interfaces.dfpc import DfpcConfig

Seconds = Annotated[float, Field(gt=0, le=86_400)]
Scale = Annotated[float, Field(ge=0.01, le=10_000)]
Sigma = Annotated[float, Field(ge=0, le=10)]


class PositionManagerConfig(DfpcConfig):
    """Parameters of PositionManager.

    The scales of the odometries' covariances and the slip were chosen on training seeds of the evaluation, which are
    not those that judge (docs/dfpcs/position_manager.md).
    """

    levelling: dict[str, Any] = Field(default_factory=dict)
    prediction: dict[str, Any] = Field(default_factory=dict)
    correction: dict[str, Any] = Field(default_factory=dict)
    fix_correction: dict[str, Any] = Field(default_factory=dict)
    weighting: dict[str, Any] = Field(default_factory=dict)
    visual_increment: dict[str, Any] = Field(default_factory=dict)
    lidar_increment: dict[str, Any] = Field(default_factory=dict)
    wheel_increment: dict[str, Any] = Field(default_factory=dict)
    interpolation: dict[str, Any] = Field(default_factory=dict)

    levelling_s: Annotated[Seconds, Field(description="IMU readings that level the start pose")] = 0.5
    start_wait_s: Annotated[Seconds, Field(description="longest wait for those readings")] = 1.0
    start_tilt_sigma_rad: Annotated[
        float, Field(ge=0, le=1, description="roll, pitch of a start that is not levelled")
    ] = 0.05
    start_speed_sigma_m_s: Annotated[Sigma, Field(description="of a start that the IMU feels to be in motion")] = 0.5
    unknown_speed_sigma_m_s: Annotated[
        Sigma, Field(description="of a start that no IMU feels, and of a velocity that is doubted: a car's")
    ] = 15.0
    rest_speed_sigma_m_s: Annotated[Sigma, Field(description="of a start that the IMU feels to be at rest")] = 0.02
    gyro_bias_sigma_rad_s: Annotated[Sigma, Field(description="before it is felt at rest")] = 3e-3
    felt_bias_sigma_rad_s: Annotated[Sigma, Field(description="of the mean rate at rest")] = 2.2e-4
    acc_bias_sigma_m_s2: Annotated[Sigma, Field(description="of the accelerometer's bias")] = 0.008

    slip_sigma: Annotated[tuple[Sigma, Sigma, Sigma], Field(description="ahead, aside, up, per way")] = (
        0.09,
        0.025,
        0.03,
    )
    slip_time_s: Annotated[Seconds, Field(description="over which slip changes")] = 6.0
    wheel_floor_m: Annotated[Sigma, Field(description="of a wheel increment, also at rest")] = 1e-3
    wheel_floor_rad: Annotated[Sigma, Field(description="of its turn, also at rest")] = 3e-4
    wheel_period_s: Annotated[Seconds, Field(description="wheel poses that come faster are skipped")] = 0.045
    max_wheel_speed_m_s: Annotated[float, Field(gt=0, le=100, description="beyond it the wheels' origin was reset")] = (
        5.0
    )

    visual_scale: Annotated[Scale, Field(description="of what visual odometry says of its variances")] = 1.0
    lidar_scale: Annotated[Scale, Field(description="of what lidar odometry says of its variances")] = 1.45
    degraded_scale: Annotated[Scale, Field(description="of the variances of a DEGRADED odometry, further")] = 25.0
    unstated_sigma_m: Annotated[Sigma, Field(description="of an increment whose odometry states no covariance")] = 0.02
    unstated_sigma_rad: Annotated[Sigma, Field(description="of its turn")] = 0.005
    correlated: Annotated[
        tuple[Literal["visual_odometry", "lidar_odometry"], ...],
        Field(description="odometries that share errors: weighed by covariance intersection"),
    ] = ()
    odometry_gap_s: Annotated[Seconds, Field(description="longest interval whose increment is taken")] = 2.0
    visual_timeout_s: Annotated[Seconds, Field(description="silence after which wheels or IMU are published")] = 1.2

    refusals: Annotated[
        int, Field(ge=1, le=100, description="increments refused in a row before velocity is doubted")
    ] = 3

    fix_weighting: Annotated[
        Literal["intersection", "kalman"],
        Field(description="intersection where fixes share errors, as of one map; kalman where each has its own"),
    ] = "intersection"
    fix_scale: Annotated[Scale, Field(description="of what a fix says of its variances")] = 1.0

    max_ahead_s: Annotated[
        Seconds, Field(description="a stamp farther beyond the newest is refused until others confirm it")
    ] = 5.0
    confirm_s: Annotated[
        Seconds, Field(description="over which samples of another time show that the clock jumped")
    ] = 1.0
    blind_s: Annotated[
        Seconds, Field(description="silence of all sources after which place and speed are taken as lost")
    ] = 30.0
    imu_period_s: Annotated[Seconds, Field(description="estimates where nothing but the IMU speaks")] = 0.5
    memory_s: Annotated[Seconds, Field(description="how late a measurement may come")] = 20.0
    dense_s: Annotated[Seconds, Field(description="time line with every estimate")] = 60.0
    thin_s: Annotated[Seconds, Field(description="between the estimates that are kept after that")] = 1.0
    history_s: Annotated[Seconds, Field(description="time line kept; pinned times stay")] = 3600.0
    trajectory_period_s: Annotated[Seconds, Field(description="between trajectories that are published, at least")] = (
        5.0
    )
    trajectory_share: Annotated[
        float, Field(ge=0, le=1, description="by which the trajectory must have grown to be published again")
    ] = 0.02
    extrapolation_s: Annotated[
        float, Field(ge=0, le=10, description="how far beyond its ends the time line answers")
    ] = 0.2

    @model_validator(mode="after")
    def _spans_fit(self) -> PositionManagerConfig:
        if self.dense_s < self.memory_s:
            raise ValueError(
                f"dense_s={self.dense_s:g} is less than memory_s={self.memory_s:g}: what a late measurement takes "
                "again must not be thinned by then; make dense_s the larger"
            )
        if self.imu_period_s > self.blind_s:
            raise ValueError(
                f"imu_period_s={self.imu_period_s:g} is more than blind_s={self.blind_s:g}: an IMU that speaks alone "
                "would not be taken; make blind_s the larger"
            )
        return self
