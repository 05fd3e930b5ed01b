# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Elevation against true terrain (simulated), disparity against Middlebury, a real road against its camera's height.

The simulated part maps the log of ``rover_traverse`` with its true poses: what is judged is the mapping, not the poses.

References
----------
.. [1] Höhle, J., Höhle, M. (2009). Accuracy assessment of digital elevation models by means of robust statistical
   methods. ISPRS Journal 64(4). doi:10.1016/j.isprsjprs.2009.02.003 (NMAD, quantiles).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.profile import load_profile
from cdff_common.interfaces.registry import Registry
from cdff_common.types import ElevationMap, Frame, FramePair, TransformWithCovariance
from cdff_core.dfns.disparity_image._interface import DisparityImageInputs
from cdff_dev.elevation import compare

PROFILE = Path(__file__).resolve().parents[2] / "deploy" / "profiles" / "rover_traverse.yaml"
#: Folder, disparity scale and search range of the Middlebury pairs.
PAIRS = (("teddy", 4.0, 64), ("tsukuba", 16.0, 16))
#: Of the simulated runs; the lidar's noise is that of its data sheet.
CONFIG = {"resolution_m": 0.05, "far_factor": 0, "fusion": {"size_m": 60.0}}
T_BASE_CAMERA = se3.transform([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], np.zeros(3))


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Scores of the three sets."""
    return {
        "rover_traverse (simulated), true poses, 5 cm": _simulated(progress),
        "middlebury, all pixels with truth": {name: _middlebury(data, name, *rest) for name, *rest in PAIRS},
        "kitti_stereo, true poses, 20 cm": _kitti(data / "kitti_stereo" / "KITTI_sequence_1", progress),
    }


def _simulated(progress: Callable[[str], None]) -> dict[str, Any]:
    from cdff_dev.logs import open_log
    from cdff_dev.simulate.scenario import load_scenario
    from cdff_dev.simulate.store import simulated_log

    progress("dem: simulated traverse")
    scenario = load_scenario("rover_traverse")
    log, profile = open_log(simulated_log(scenario)), load_profile(PROFILE)
    terrain = next(iter(log.samples(["/site/truth.terrain"]))).value
    report: dict[str, Any] = {"seed": scenario.seed}
    for robot in profile.robot_ids:
        entry = profile.robot(robot)
        context = entry.context(entry.dfpc("digital_elevation_mapping"))
        for port, stream, variant in (("scan", "lidar.scan", "Lidar"), ("stereo", "navcam.pair", "Stereo")):
            ports = {f"/{robot}/truth.pose": "poses", f"/{robot}/{stream}": port}
            samples = (Sample(ports[s.stream], s.stamp_ns, s.seq, s.value) for s in log.samples(list(ports)))
            dem = _mapped(samples, context, variant, {**CONFIG, "range_sigma_m": scenario.lidar.range_sigma_m})
            for name, least in (("all cells", 1), ("5 or more measurements", 5)):
                report[f"{robot} {variant.lower()}, {name}"] = _rounded(compare(dem, terrain, least_count=least))
    return report


def _mapped(samples: Iterator[Sample], context: DfpcContext, variant: str, config: dict[str, Any]) -> ElevationMap:
    """The local map after all samples."""
    node = Registry.default().make_dfpc("digital_elevation_mapping")
    node.configure(config, context, variant)
    for sample in samples:
        list(node.step(sample))
    list(node.finish())
    dem: ElevationMap = node.call("get_map", {})
    return dem


def _middlebury(data: Path, name: str, scale: float, search: int) -> dict[str, Any]:
    """Bad-1, bad-2 and density, ours beside OpenCV's SGBM alone (block 5, its own left-right check)."""
    folder = data / "middlebury" / name
    left, right, given = (
        cv2.imread(str(folder / f), cv2.IMREAD_GRAYSCALE) for f in ("im2.png", "im6.png", "disp2.png")
    )
    truth = given.astype(np.float64) / scale
    node = Registry.default().make_dfn("disparity_image")
    node.configure({"num_disparities": search})
    frames = [Frame.from_image(i, stamp_ns=0) for i in (left, right)]
    ours = node.process(DisparityImageInputs(left=frames[0], right=frames[1])).disparity.image
    plain = cv2.StereoSGBM.create(0, search, 5, 200, 800, 1, 31, 10).compute(left, right) / 16.0

    def score(disparity: NDArray[np.floating]) -> dict[str, float]:
        known = (truth > 0) & np.isfinite(disparity)
        error = np.abs(disparity - truth)[known]
        return _rounded(
            {
                "bad_1": float(np.mean(error > 1.0)),
                "bad_2": float(np.mean(error > 2.0)),
                "density": float(known.sum() / np.count_nonzero(truth)),
            }
        )

    return {"disparity_image": score(ours), "opencv_sgbm": score(np.where(plain >= 0, plain, np.nan))}


def _kitti(folder: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Height of the left camera above the mapped road along its path; 1.65 m by the data set's description."""
    progress("dem: KITTI")
    P = np.loadtxt(folder / "calib_kitti.txt").reshape(-1, 3, 4)
    T = np.loadtxt(folder / "poses.txt").reshape(-1, 3, 4)
    T_c0_c = np.tile(np.eye(4), (len(T), 1, 1))
    T_c0_c[:, :3, :3], T_c0_c[:, :3, 3] = se3.normalise_rotation(T[:, :, :3]), T[:, :, 3]
    T_site_base = T_BASE_CAMERA @ T_c0_c @ se3.inverse(T_BASE_CAMERA)
    frames = FrameGraph()
    frames.set_static("kitti/base", "kitti/navcam_left", UncertainTransform(T_BASE_CAMERA, np.zeros((6, 6))))

    def samples() -> Iterator[Sample]:
        for i, pose in enumerate(T_site_base):
            stamp_ns = i * 100_000_000
            left, right = (
                cv2.imread(str(folder / f"image_{s}_kitti" / f"{i:06d}.png"), cv2.IMREAD_GRAYSCALE) for s in "lr"
            )
            yield Sample("stereo", stamp_ns, i, FramePair.from_images(
                left, right, baseline_m=-P[1][0, 3] / P[1][0, 0], camera_matrix=P[0][:, :3], stamp_ns=stamp_ns,
                sensor="kitti/navcam_left",
            ))  # fmt: skip
            yield Sample("poses", stamp_ns, i, TransformWithCovariance.from_transform(
                UncertainTransform(pose), parent="site", child="kitti/base", stamp_ns=stamp_ns
            ))  # fmt: skip

    config = {"resolution_m": 0.2, "max_height_m": 1.0, "fusion": {"size_m": 150.0}}
    dem = _mapped(samples(), DfpcContext("kitti", frames), "Stereo", config)
    row, col, inside = dem.geometry.cells_of(T_site_base[:, 0, 3], T_site_base[:, 1, 3])
    height_m = (T_site_base[:, 2, 3] - dem.layer("mean")[row, col])[inside]
    height_m = height_m[np.isfinite(height_m)]
    return _rounded({
        "places": len(height_m), "median_height_m": float(np.median(height_m)), "std_m": float(height_m.std())
    })  # fmt: skip


def _rounded(scores: dict[str, Any]) -> dict[str, Any]:
    return {k: round(v, 5) if isinstance(v, float) else v for k, v in scores.items()}
