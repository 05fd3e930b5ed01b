# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Estimate poses with a fixed-lag smoother of GTSAM, for comparison with the position manager.

The smoother uses the same measurements and covariances: preintegrated IMU readings between estimates, and
increments of wheel and visual odometry as relative poses. It has no state for slip; the wheel noise is
therefore a random walk.
"""

from __future__ import annotations

import itertools

import gtsam
import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import rotate_covariance, swap_rotation_translation
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.gravity_levelling.interface import GravityLevellingInputs
from cdff_core.dfns.odometry_increment.interface import OdometryIncrementInputs
from evaluation.runs.dead_reckoning import EPOCH_NS, VISUAL, SimulatedRun

LAG_S = 5.0
_VISUAL_SCALE = 1.0 / VISUAL.stated
_X, _V, _B = (gtsam.symbol_shorthand.X, gtsam.symbol_shorthand.V, gtsam.symbol_shorthand.B)


def smooth(drive: SimulatedRun, ports: tuple[str, ...]) -> tuple[int, UncertainTransform]:
    """Return stamp and value of the last pose ``T_site_base``."""
    imu = drive.samples["imu"]
    stamps = np.array([s.stamp_ns for s in imu])
    forces, rates = (np.array([getattr(s.value, a) for s in imu]) for a in ("acc", "gyro"))
    level = _dfn("gravity_levelling", None, {}).process(
        GravityLevellingInputs(specific_force=forces[:50], rates_rad_s=rates[:50])
    )
    gravity = float(np.linalg.norm(forces[:50].mean(axis=0)))
    origin = drive.context.frames.lookup("site", "mana/odom", 0).matrix
    T = origin @ se3.transform(level.rotation, np.zeros(3))
    edges = _edges(drive, ports)
    times = sorted({t for start_ns, end_ns, *_ in edges for t in (start_ns, end_ns)})
    keys = {t: k for k, t in enumerate(times)}
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    velocity, bias = np.zeros(3), gtsam.imuBias.ConstantBias(np.zeros(3), level.gyro_bias_rad_s)
    tilt = 0.008 / gravity
    graph.add(gtsam.PriorFactorPose3(_X(0), gtsam.Pose3(T), _sigmas([tilt, tilt, 1e-5, 1e-5, 1e-5, 1e-5])))
    graph.add(gtsam.PriorFactorVector(_V(0), velocity, _sigmas([0.02] * 3)))
    graph.add(gtsam.PriorFactorConstantBias(_B(0), bias, _sigmas([0.008] * 3 + [2.2e-4] * 3)))
    values.insert(_X(0), gtsam.Pose3(T))
    values.insert(_V(0), velocity)
    values.insert(_B(0), bias)
    smoother = gtsam.IncrementalFixedLagSmoother(LAG_S, gtsam.ISAM2Params())
    smoother.update(graph, values, _key_times(0, times[0]))
    by_end: dict[int, list[tuple[int, int, FloatArray, FloatArray]]] = {}
    for edge in edges:
        by_end.setdefault(edge[1], []).append(edge)
    params = _params(drive, gravity)
    state = gtsam.NavState(gtsam.Pose3(T), velocity)
    for previous_ns, current_ns in itertools.pairwise(times):
        k = keys[current_ns]
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        preintegrated = gtsam.PreintegratedCombinedMeasurements(params, bias)
        first_reading = int(np.searchsorted(stamps, previous_ns, "right")) - 1
        end_reading = int(np.searchsorted(stamps, current_ns, "left"))
        nodes = np.concatenate([[previous_ns], stamps[first_reading:end_reading][1:], [current_ns]])
        for i, (start_ns, end_ns) in enumerate(itertools.pairwise(nodes), start=first_reading):
            if end_ns > start_ns:
                preintegrated.integrateMeasurement(forces[i], rates[i], float(end_ns - start_ns) * 1e-9)
        graph.add(
            gtsam.CombinedImuFactor(_X(k - 1), _V(k - 1), _X(k), _V(k), _B(k - 1), _B(k), preintegrated)
        )
        for start_ns, _, step, covariance in by_end[current_ns]:
            noise = gtsam.noiseModel.Gaussian.Covariance(
                swap_rotation_translation(_with_right_error(step, covariance))
            )
            graph.add(gtsam.BetweenFactorPose3(_X(keys[start_ns]), _X(k), gtsam.Pose3(step), noise))
        state = preintegrated.predict(state, bias)
        values.insert(_X(k), state.pose())
        values.insert(_V(k), state.velocity())
        values.insert(_B(k), bias)
        smoother.update(graph, values, _key_times(k, current_ns))
        result = smoother.calculateEstimate()
        state = gtsam.NavState(result.atPose3(_X(k)), result.atVector(_V(k)))
        bias = result.atConstantBias(_B(k))
    k = keys[times[-1]]
    pose = state.pose().matrix()
    marginals = gtsam.Marginals(smoother.getFactors(), smoother.calculateEstimate())
    covariance = rotate_covariance(
        swap_rotation_translation(marginals.marginalCovariance(_X(k))), pose[:3, :3]
    )
    return times[-1], UncertainTransform(pose, 0.5 * (covariance + covariance.T))


def _edges(drive: SimulatedRun, ports: tuple[str, ...]) -> list[tuple[int, int, FloatArray, FloatArray]]:
    """Return the odometry increments: start and end stamp, ``T_base1_base2``, covariance (left error)."""
    wheel = _dfn("odometry_increment", "DistanceModel", {})
    visual = _dfn("odometry_increment", "CovarianceDifference", {"floor_m": 5e-5, "floor_rad": 1e-5})
    increments = []
    for port in (p for p in ports if p.endswith("odometry")):
        samples = drive.samples[port]
        mount = np.eye(4)
        if port != "odometry":
            mount = drive.context.frames.lookup("mana/base", samples[0].value.child_frame, 0).matrix
        for previous, current in itertools.pairwise(samples):
            A, B = previous.value.transform, current.value.transform
            dfn, scale = (wheel, 1.0) if port == "odometry" else (visual, _VISUAL_SCALE)
            step = dfn.process(
                OdometryIncrementInputs(
                    first=A.matrix,
                    second=B.matrix,
                    mount=mount,
                    first_covariance=A.covariance,
                    second_covariance=B.covariance,
                )
            )
            covariance = scale * step.covariance + (np.diag([1e-6] * 6) if port == "odometry" else 0.0)
            increments.append((previous.stamp_ns, current.stamp_ns, step.increment, covariance))
    return increments


def _params(drive: SimulatedRun, gravity: float) -> gtsam.PreintegrationCombinedParams:
    params = gtsam.PreintegrationCombinedParams.MakeSharedU(gravity)
    params.setAccelerometerCovariance(3e-3**2 * np.eye(3))
    params.setGyroscopeCovariance(1.6e-4**2 * np.eye(3))
    params.setIntegrationCovariance(1e-10 * np.eye(3))
    params.setBiasAccCovariance(1.6e-4**2 * np.eye(3))
    params.setBiasOmegaCovariance(6e-6**2 * np.eye(3))
    params.setBodyPSensor(gtsam.Pose3(drive.context.frames.lookup("mana/base", "mana/imu", 0).matrix))
    return params


def _with_right_error(step: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the covariance of the error on the right, as in GTSAM, for an error on the left, as in CDFF."""
    R = np.kron(np.eye(2), step[:3, :3])
    return np.asarray(R.T @ covariance @ R)


def _key_times(k: int, stamp_ns: int) -> dict[int, float]:
    t_s = (stamp_ns - EPOCH_NS) * 1e-9
    return {_X(k): t_s, _V(k): t_s, _B(k): t_s}


def _sigmas(values: list[float]) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values))


def _dfn(name: str, implementation: str | None, parameters: dict[str, float]):  # type: ignore[no-untyped-def]
    node = Registry.default().make_dfn(name, implementation)
    node.configure(parameters)
    return node
