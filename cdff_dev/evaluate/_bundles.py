# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bundles to adjust, and GTSAM and COLMAP (Ceres) on them; every answer's cost is computed by our own code."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.types import BundleCameras, BundleLenses, BundlePoints, BundleProblem
from cdff_common.types.columns import pack_poses
from cdff_core.dfns.bundle_optimization._kernels import NO_LOSS
from cdff_core.dfns.bundle_optimization._system import System
from cdff_dev.evaluate import _colmap

Float = NDArray[np.float64]

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
    mine = np.flatnonzero(cam == i)
    number[mine] = np.arange(len(mine))
    image = pycolmap.Image(name=str(i), keypoints=px[mine], camera_id=int(z["lens"][i]) + 1, image_id=i + 1)
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
pycolmap.create_default_bundle_adjuster(options, config, rec).solve()
cpu = time.process_time() - started
poses = np.array([rec.image(i + 1).cam_from_world().matrix() for i in range(len(z["poses"]))])
lenses = np.array([rec.camera(i + 1).params for i in range(len(z["lenses"]))])
points = np.array([rec.point3D(int(i)).xyz for i in ids])
np.savez(sys.argv[2], poses=poses, lenses=lenses, points=points, cpu=cpu)
"""


def ring(
    cameras: int = 40, points: int = 4000, views: int = 14, sigma_px: float = 1.0, seed: int = 0, free: int = 0
) -> tuple[BundleProblem, Float, Float]:
    """Cameras around a field of points, everything off by 0.1 m and 0.6 degrees; true poses and points."""
    rng = np.random.default_rng(seed)
    X = rng.uniform([-10, -10, -3], [10, 10, 3], (points, 3))
    T = []
    for angle in np.linspace(0, 2 * np.pi, cameras, endpoint=False):
        c = np.array([25 * np.cos(angle), 25 * np.sin(angle), 2.0])
        z = -c / np.linalg.norm(c)
        x = np.cross(z, [0.0, 0.0, 1.0])
        x /= np.linalg.norm(x)
        T.append(se3.transform(np.stack([x, np.cross(z, x), z], axis=1), c))
    poses = np.array(T)
    cam = np.concatenate([rng.choice(cameras, views, replace=False) for _ in range(points)])
    pt = np.repeat(np.arange(points), views)
    inverse = se3.inverse(poses)[cam]
    p = np.einsum("nij,nj->ni", inverse[:, :3, :3], X[pt]) + inverse[:, :3, 3]
    pixels = p[:, :2] / p[:, 2:] * 800.0 + [500.0, 400.0] + rng.normal(0.0, sigma_px, (len(cam), 2))
    off = [
        se3.transform(se3.exp_so3(rng.normal(0, 0.01, 3)) @ t[:3, :3], t[:3, 3] + rng.normal(0, 0.1, 3)) for t in poses
    ]
    off[0] = poses[0]
    problem = BundleProblem.from_arrays(
        off, [800.0, 800.0, 500.0, 400.0], X + rng.normal(0, 0.1, X.shape), (cam, pt), pixels, frame="site", free=free
    )
    return problem, poses, X


def cost(problem: BundleProblem) -> float:
    """Half the sum of squared residuals."""
    return System.of(problem, 0, NO_LOSS, 1.0).residuals(System.first(problem))[3]


def by_ceres(python: str, problem: BundleProblem, tolerance: float) -> tuple[BundleProblem, float]:
    """COLMAP's bundle adjustment, and its CPU seconds without building the problem."""
    found = _colmap.run(
        python, _CERES,
        {
            "lenses": problem.lenses.values, "lens": problem.cameras.lenses.astype(np.int64),
            "poses": se3.inverse(problem.cameras.matrices)[:, :3], "points": problem.points.positions,
            "cam": problem.observations.cameras.astype(np.int64), "pt": problem.observations.points.astype(np.int64),
            "px": problem.observations.pixels[:, :2].copy(), "free": np.array(bool(problem.lenses.free.any())),
            "tolerance": np.array(tolerance),
        },
    )  # fmt: skip
    T = np.tile(np.eye(4), (len(found["poses"]), 1, 1))
    T[:, :3] = found["poses"]
    return _with(problem, se3.inverse(T), found["lenses"], found["points"]), float(found["cpu"])


def by_gtsam(problem: BundleProblem, tolerance: float) -> tuple[BundleProblem, float]:
    """GTSAM's Levenberg-Marquardt, and its CPU seconds without building the graph; lenses as the problem says."""
    import gtsam

    v, free = problem.lenses.values, bool(problem.lenses.free.any())
    noise, graph, values = gtsam.noiseModel.Unit.Create(2), gtsam.NonlinearFactorGraph(), gtsam.Values()
    o = problem.observations
    for k in range(len(o.cameras)):
        i, p, uv = int(o.cameras[k]), int(o.points[k]), o.pixels[k, :2]
        lens = int(problem.cameras.lenses[i])
        graph.add(gtsam.GeneralSFMFactor2Cal3Bundler(uv, noise, _key("x", i), _key("p", p), _key("k", lens)))
    for i, T in enumerate(problem.cameras.matrices):
        values.insert(_key("x", i), gtsam.Pose3(T))
    for p, X in enumerate(problem.points.positions):
        values.insert(_key("p", p), X)
    for i, lens in enumerate(v):
        calibration = gtsam.Cal3Bundler(lens[0], lens[4], lens[5], lens[2], lens[3])
        values.insert(_key("k", i), calibration)
        if not free:
            # As good as fixed: GTSAM's factor with its own lens wants it as a variable.
            tight = gtsam.noiseModel.Isotropic.Sigma(3, 1e-8)
            graph.add(gtsam.PriorFactorCal3Bundler(_key("k", i), calibration, tight))
    T = problem.cameras.matrices[0]
    # A weak prior holds the whole where it is; it does not pull, since that costs nothing.
    graph.add(gtsam.PriorFactorPose3(_key("x", 0), gtsam.Pose3(T), gtsam.noiseModel.Isotropic.Sigma(6, 1e-3)))
    parameters = gtsam.LevenbergMarquardtParams.CeresDefaults()
    parameters.setRelativeErrorTol(tolerance)
    parameters.setAbsoluteErrorTol(0.0)
    parameters.setMaxIterations(500)
    started = time.process_time()
    found = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    cpu = time.process_time() - started
    poses = np.array([found.atPose3(_key("x", i)).matrix() for i in range(len(problem.cameras.ids))])
    points = np.array([found.atPoint3(_key("p", p)) for p in range(len(problem.points.ids))])
    lenses = []
    for i, lens in enumerate(v):
        k = found.atCal3Bundler(_key("k", i))
        lenses.append([k.fx(), lens[2], lens[3], k.k1(), k.k2()])
    return _with(problem, poses, np.array(lenses), points), cpu


def _key(kind: str, row: int) -> Any:
    import gtsam

    return gtsam.symbol(kind, row)


def _with(problem: BundleProblem, matrices: Float, lenses: Float, points: Float) -> BundleProblem:
    c, p = problem.cameras, problem.points
    values = problem.lenses.values.copy()
    values[:, 0] = values[:, 1] = lenses[:, 0]
    values[:, 2:6] = lenses[:, 1:5]
    T = se3.transform(se3.normalise_rotation(matrices[:, :3, :3]), matrices[:, :3, 3])
    return replace(
        problem, cameras=BundleCameras(c.ids, c.stamps, pack_poses(T, "camera"), c.lenses, c.fixed),
        lenses=BundleLenses(values, problem.lenses.free), points=BundlePoints(p.ids, points, p.fixed),
    )  # fmt: skip
