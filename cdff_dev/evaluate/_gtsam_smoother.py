# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The peer of the position manager: a fixed-lag smoother as a user of GTSAM would write it.

The same measurements and the same covariances: preintegrated IMU between estimates, increments of the wheels and of
visual odometry as relative poses. What it has not: slip as a state, so the wheels get the random walk of the first
version of the position manager.
"""

from __future__ import annotations

import itertools

import gtsam
import numpy as np

from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import from_right_perturbation, swap_rotation_translation
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.gravity_levelling._interface import GravityLevellingInputs
from cdff_core.dfns.odometry_increment._interface import OdometryIncrementInputs
from cdff_dev.evaluate._dead_reckoning import EPOCH_NS, VISUAL, Travel

LAG_S = 5.0
_VISUAL_SCALE = 1.0 / VISUAL.stated
_X, _V, _B = (gtsam.symbol_shorthand.X, gtsam.symbol_shorthand.V, gtsam.symbol_shorthand.B)


def smoothed(drive: Travel, ports: tuple[str, ...]) -> tuple[int, UncertainTransform]:
    """Time and value of the last pose ``T_site_base``."""
    imu = drive.samples["imu"]
    stamps = np.array([s.stamp_ns for s in imu])
    forces, rates = (np.array([getattr(s.value, a) for s in imu]) for a in ("acc", "gyro"))
    level = _dfn("gravity_levelling", None, {}).process(GravityLevellingInputs(forces[:50], rates[:50]))
    gravity = float(np.linalg.norm(forces[:50].mean(axis=0)))
    origin = drive.context.frames.lookup("site", "mana/odom", 0).matrix
    T = origin @ se3.transform(level.rotation, np.zeros(3))
    edges = _edges(drive, ports)
    times = sorted({t for first, second, *_ in edges for t in (first, second)})
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
    at = _stamped(0, times[0])
    smoother.update(graph, values, at)
    by_end: dict[int, list[tuple[int, int, FloatArray, FloatArray]]] = {}
    for edge in edges:
        by_end.setdefault(edge[1], []).append(edge)
    params = _params(drive, gravity)
    state = gtsam.NavState(gtsam.Pose3(T), velocity)
    for before, now in itertools.pairwise(times):
        k = keys[now]
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        felt = gtsam.PreintegratedCombinedMeasurements(params, bias)
        inside = slice(int(np.searchsorted(stamps, before, "right")) - 1, int(np.searchsorted(stamps, now, "left")))
        nodes = np.concatenate([[before], stamps[inside][1:], [now]])
        for i, (a, b) in enumerate(itertools.pairwise(nodes)):
            if b > a:
                felt.integrateMeasurement(forces[inside.start + i], rates[inside.start + i], float(b - a) * 1e-9)
        graph.add(gtsam.CombinedImuFactor(_X(k - 1), _V(k - 1), _X(k), _V(k), _B(k - 1), _B(k), felt))
        for first, _, step, covariance in by_end[now]:
            noise = gtsam.noiseModel.Gaussian.Covariance(swap_rotation_translation(_right(step, covariance)))
            graph.add(gtsam.BetweenFactorPose3(_X(keys[first]), _X(k), gtsam.Pose3(step), noise))
        state = felt.predict(state, bias)
        values.insert(_X(k), state.pose())
        values.insert(_V(k), state.velocity())
        values.insert(_B(k), bias)
        smoother.update(graph, values, _stamped(k, now))
        found = smoother.calculateEstimate()
        state = gtsam.NavState(found.atPose3(_X(k)), found.atVector(_V(k)))
        bias = found.atConstantBias(_B(k))
    k = keys[times[-1]]
    pose = state.pose().matrix()
    marginals = gtsam.Marginals(smoother.getFactors(), smoother.calculateEstimate())
    covariance = from_right_perturbation(pose, swap_rotation_translation(marginals.marginalCovariance(_X(k))))
    return times[-1], UncertainTransform(pose, 0.5 * (covariance + covariance.T))


def _edges(drive: Travel, ports: tuple[str, ...]) -> list[tuple[int, int, FloatArray, FloatArray]]:
    """Increments: begin, end, ``T_base1_base2`` and its covariance, error on the left."""
    wheel = _dfn("odometry_increment", "DistanceModel", {})
    visual = _dfn("odometry_increment", "CovarianceDifference", {"floor_m": 5e-5, "floor_rad": 1e-5})
    out = []
    for port in (p for p in ports if p.endswith("odometry")):
        samples = drive.samples[port]
        mount = np.eye(4)
        if port != "odometry":
            mount = drive.context.frames.lookup("mana/base", samples[0].value.child_frame, 0).matrix
        for a, b in itertools.pairwise(samples):
            A, B = a.value.transform, b.value.transform
            dfn, scale = (wheel, 1.0) if port == "odometry" else (visual, _VISUAL_SCALE)
            step = dfn.process(OdometryIncrementInputs(A.matrix, B.matrix, mount, A.covariance, B.covariance))
            covariance = scale * step.covariance + (np.diag([1e-6] * 6) if port == "odometry" else 0.0)
            out.append((a.stamp_ns, b.stamp_ns, step.increment, covariance))
    return out


def _params(drive: Travel, gravity: float) -> gtsam.PreintegrationCombinedParams:
    params = gtsam.PreintegrationCombinedParams.MakeSharedU(gravity)
    params.setAccelerometerCovariance(3e-3**2 * np.eye(3))
    params.setGyroscopeCovariance(1.6e-4**2 * np.eye(3))
    params.setIntegrationCovariance(1e-10 * np.eye(3))
    params.setBiasAccCovariance(1.6e-4**2 * np.eye(3))
    params.setBiasOmegaCovariance(6e-6**2 * np.eye(3))
    params.setBodyPSensor(gtsam.Pose3(drive.context.frames.lookup("mana/base", "mana/imu", 0).matrix))
    return params


def _right(step: FloatArray, covariance: FloatArray) -> FloatArray:
    """From the error on the left, as ours, to the one on the right, as GTSAM's."""
    R = np.kron(np.eye(2), step[:3, :3])
    return np.asarray(R.T @ covariance @ R)


def _stamped(k: int, stamp_ns: int) -> dict[int, float]:
    t_s = (stamp_ns - EPOCH_NS) * 1e-9
    return {_X(k): t_s, _V(k): t_s, _B(k): t_s}


def _sigmas(values: list[float]) -> gtsam.noiseModel.Diagonal:
    return gtsam.noiseModel.Diagonal.Sigmas(np.array(values))


def _dfn(name: str, implementation: str | None, parameters: dict[str, float]):  # type: ignore[no-untyped-def]  # any DFN
    node = Registry.default().make_dfn(name, implementation)
    node.configure(parameters)
    return node
