# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Make bundle adjustment problems, and solve them with GTSAM and COLMAP (Ceres)."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import rotate_covariance, swap_rotation_translation
from cdff_common.types import BundleCameras, BundleLenses, BundlePoints, BundleProblem
from cdff_common.types.columns import pack_poses
from cdff_core.dfns.bundle_optimization._kernels import NO_LOSS
from cdff_core.dfns.bundle_optimization._system import System
from evaluation.peers import colmap

Float = NDArray[np.float64]
#: Standard deviation, metres and radians, of a fixed camera in GTSAM.
FIXED_SIGMA = 1e-7

_CERES = """
import sys, time, numpy as np, pycolmap
z = np.load(sys.argv[1])
rec = pycolmap.Reconstruction()
for i, v in enumerate(z["lenses"]):
    # COLMAP's RADIAL is f cx cy k1 k2; its origin does not matter here.
    rec.add_camera_with_trivial_rig(pycolmap.Camera(
        model="RADIAL", width=4000, height=4000, params=[v[0], v[2], v[3], v[4], v[5]], camera_id=i + 1))
cam, pt, px = z["cam"], z["pt"], z["px"]
number = np.zeros(len(cam), int)
for i, P in enumerate(z["poses"]):
    rows = np.flatnonzero(cam == i)
    number[rows] = np.arange(len(rows))
    image = pycolmap.Image(name=str(i), keypoints=px[rows], camera_id=int(z["lens"][i]) + 1, image_id=i + 1)
    rec.add_image_with_trivial_frame(image, pycolmap.Rigid3d(P))
order = np.argsort(pt, kind="stable")
starts = np.searchsorted(pt[order], np.arange(len(z["points"]) + 1))
ids = np.zeros(len(z["points"]), int)
for p, X in enumerate(z["points"]):
    rows = order[starts[p]:starts[p + 1]]
    track = pycolmap.Track([pycolmap.TrackElement(int(cam[k]) + 1, int(number[k])) for k in rows])
    ids[p] = rec.add_point3D(X, track)
options = pycolmap.BundleAdjustmentOptions()
options.print_summary = False
options.refine_focal_length = options.refine_extra_params = bool(z["free"])
solver = options.ceres.solver_options
solver.num_threads, solver.max_num_iterations = 1, 500
solver.gradient_tolerance, solver.function_tolerance = 1e-12, float(z["tolerance"])
started = time.process_time()
config = pycolmap.BundleAdjustmentConfig()
for i in range(len(z["poses"])):
    config.add_image(i + 1)
config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, rec)
adjuster.solve()
cpu = time.process_time() - started
started = time.process_time()
if z["covariance"]:
    of_poses = pycolmap.BACovarianceOptions(params=pycolmap.BACovarianceOptionsParams.POSES)
    assert pycolmap.estimate_ba_covariance(of_poses, rec, adjuster) is not None
covariance_cpu = time.process_time() - started
poses = np.array([rec.image(i + 1).cam_from_world().matrix() for i in range(len(z["poses"]))])
lenses = np.array([rec.camera(i + 1).params for i in range(len(z["lenses"]))])
points = np.array([rec.point3D(int(i)).xyz for i in ids])
np.savez(sys.argv[2], poses=poses, lenses=lenses, points=points, cpu=cpu, covariance_cpu=covariance_cpu)
"""


def ring(
    cameras: int = 40,
    points: int = 4000,
    views: int = 14,
    sigma_px: float = 1.0,
    seed: int = 0,
    free: int = 0,
) -> tuple[BundleProblem, Float, Float]:
    """Return a ring of cameras around points, with errors of 0.1 m and 0.6 degrees, and the true values.

    The true values are the poses (cameras, 4, 4) and points (points, 3).
    """
    rng = np.random.default_rng(seed)
    X = rng.uniform([-10, -10, -3], [10, 10, 3], (points, 3))
    T = []
    for angle in np.linspace(0, 2 * np.pi, cameras, endpoint=False):
        centre = np.array([25 * np.cos(angle), 25 * np.sin(angle), 2.0])
        z = -centre / np.linalg.norm(centre)
        x = np.cross(z, [0.0, 0.0, 1.0])
        x /= np.linalg.norm(x)
        T.append(se3.transform(np.stack([x, np.cross(z, x), z], axis=1), centre))
    poses = np.array(T)
    cam = np.concatenate([rng.choice(cameras, views, replace=False) for _ in range(points)])
    pt = np.repeat(np.arange(points), views)
    inverse = se3.inverse(poses)[cam]
    p = np.einsum("nij,nj->ni", inverse[:, :3, :3], X[pt]) + inverse[:, :3, 3]
    pixels = p[:, :2] / p[:, 2:] * 800.0 + [500.0, 400.0] + rng.normal(0.0, sigma_px, (len(cam), 2))
    initial_poses = [
        se3.transform(se3.exp_so3(rng.normal(0, 0.01, 3)) @ t[:3, :3], t[:3, 3] + rng.normal(0, 0.1, 3))
        for t in poses
    ]
    initial_poses[0] = poses[0]
    problem = BundleProblem.from_arrays(
        initial_poses,
        [800.0, 800.0, 500.0, 400.0],
        X + rng.normal(0, 0.1, X.shape),
        (cam, pt),
        pixels,
        frame="site",
        free=free,
    )
    return problem, poses, X


def cost(problem: BundleProblem) -> float:
    """Return the cost: half the sum of squared residuals, pixels²."""
    return System.of(problem, 0, NO_LOSS, 1.0).residuals(System.initial_estimate(problem))[3]


def solve_with_ceres(
    python: str, problem: BundleProblem, tolerance: float, *, covariance: bool = False
) -> tuple[BundleProblem, float, float]:
    """Solve a problem with COLMAP.

    Returns
    -------
    tuple of BundleProblem, float, float
        The solution, CPU seconds without building the problem, and CPU seconds of the covariances of all
        poses (0 unless requested).
    """
    result = colmap.run(
        python,
        _CERES,
        {
            "lenses": problem.lenses.values,
            "lens": problem.cameras.lenses.astype(np.int64),
            "poses": se3.inverse(problem.cameras.matrices)[:, :3],
            "points": problem.points.positions,
            "cam": problem.observations.cameras.astype(np.int64),
            "pt": problem.observations.points.astype(np.int64),
            "px": problem.observations.pixels[:, :2].copy(),
            "free": np.array(bool(problem.lenses.free.any())),
            "tolerance": np.array(tolerance),
            "covariance": np.array(covariance),
        },
    )
    T = np.tile(np.eye(4), (len(result["poses"]), 1, 1))
    T[:, :3] = result["poses"]
    adjusted = _with_values(problem, se3.inverse(T), result["lenses"], result["points"])
    return adjusted, float(result["cpu"]), float(result["covariance_cpu"])


def solve_with_gtsam(problem: BundleProblem, tolerance: float) -> tuple[BundleProblem, float]:
    """Solve a problem with GTSAM's Levenberg-Marquardt; return the solution and CPU seconds without building
    the graph.
    """
    import gtsam

    graph, values = gtsam_graph(problem), gtsam_values(problem)
    parameters = gtsam.LevenbergMarquardtParams.CeresDefaults()
    parameters.setRelativeErrorTol(tolerance)
    parameters.setAbsoluteErrorTol(0.0)
    parameters.setMaxIterations(500)
    started = time.process_time()
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    cpu = time.process_time() - started
    poses = np.array([result.atPose3(_key("x", i)).matrix() for i in range(len(problem.cameras.ids))])
    points = np.array([result.atPoint3(_key("p", p)) for p in range(len(problem.points.ids))])
    lenses = []
    for i, lens in enumerate(problem.lenses.values):
        k = result.atCal3Bundler(_key("k", i))
        lenses.append([k.fx(), lens[2], lens[3], k.k1(), k.k2()])
    return _with_values(problem, poses, np.array(lenses), points), cpu


def gtsam_covariances(problem: BundleProblem) -> tuple[Float, float]:
    """Return the covariances ``(n, 6, 6)`` of the poses of a solved problem by GTSAM's marginals for a
    variance of 1 px^2, and CPU seconds.
    """
    import gtsam

    graph, values = gtsam_graph(problem), gtsam_values(problem)
    started = time.process_time()
    marginals = gtsam.Marginals(graph, values)
    blocks = [marginals.marginalCovariance(_key("x", i)) for i in range(len(problem.cameras.ids))]
    cpu = time.process_time() - started
    right = swap_rotation_translation(np.array(blocks))
    return rotate_covariance(right, problem.cameras.matrices[:, :3, :3]), cpu


def gtsam_graph(problem: BundleProblem, *, is_fixed: bool = True) -> Any:
    """Return the factors of a problem; ``is_fixed`` adds priors of the fixed cameras, or of the first one."""
    import gtsam

    noise, graph = gtsam.noiseModel.Unit.Create(2), gtsam.NonlinearFactorGraph()
    observations, cameras = problem.observations, problem.cameras
    for k in range(len(observations.cameras)):
        i, p, uv = int(observations.cameras[k]), int(observations.points[k]), observations.pixels[k, :2]
        lens = int(cameras.lenses[i])
        graph.add(gtsam.GeneralSFMFactor2Cal3Bundler(uv, noise, _key("x", i), _key("p", p), _key("k", lens)))
    if not problem.lenses.free.any():
        # GTSAM's factor requires the lens as a variable; a tight prior fixes it.
        tight_noise = gtsam.noiseModel.Isotropic.Sigma(3, 1e-8)
        for i, lens in enumerate(problem.lenses.values):
            graph.add(gtsam.PriorFactorCal3Bundler(_key("k", i), _calibration(lens), tight_noise))
    if is_fixed:
        # Without fixed cameras a weak prior on the first camera fixes the gauge without changing the cost.
        fixed_cameras = np.flatnonzero(cameras.fixed)
        sigma = 1e-3 if not len(fixed_cameras) else FIXED_SIGMA
        for i in fixed_cameras if len(fixed_cameras) else [0]:
            T = gtsam.Pose3(cameras.matrices[i])
            graph.add(
                gtsam.PriorFactorPose3(_key("x", int(i)), T, gtsam.noiseModel.Isotropic.Sigma(6, sigma))
            )
    return graph


def gtsam_values(problem: BundleProblem) -> Any:
    """Return poses, points and lenses of a problem as GTSAM's values."""
    import gtsam

    values = gtsam.Values()
    for i, T in enumerate(problem.cameras.matrices):
        values.insert(_key("x", i), gtsam.Pose3(T))
    for p, X in enumerate(problem.points.positions):
        values.insert(_key("p", p), X)
    for i, lens in enumerate(problem.lenses.values):
        values.insert(_key("k", i), _calibration(lens))
    return values


def _calibration(lens: Float) -> Any:
    import gtsam

    return gtsam.Cal3Bundler(lens[0], lens[4], lens[5], lens[2], lens[3])


def _key(kind: str, row: int) -> Any:
    import gtsam

    return gtsam.symbol(kind, row)


def _with_values(problem: BundleProblem, matrices: Float, lenses: Float, points: Float) -> BundleProblem:
    cameras, p = problem.cameras, problem.points
    values = problem.lenses.values.copy()
    values[:, 0] = values[:, 1] = lenses[:, 0]
    values[:, 2:6] = lenses[:, 1:5]
    T = se3.transform(se3.normalise_rotation(matrices[:, :3, :3]), matrices[:, :3, 3])
    return replace(
        problem,
        cameras=BundleCameras(
            cameras.ids, cameras.stamps, pack_poses(T, "camera"), cameras.lenses, cameras.fixed
        ),
        lenses=BundleLenses(values, problem.lenses.free),
        points=BundlePoints(p.ids, points, p.fixed),
    )
