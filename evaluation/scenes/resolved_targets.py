# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ranges by apparent size: photographs of comet 67P, and simulated images of a satellite among stars."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.camera import CameraModel
from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import Mesh, TransformWithCovariance, Vector3d
from cdff_core.bearing_tracking.camera_attitude import CameraAttitude
from cdff_core.dfns.star_field_background.interface import StarFieldBackgroundOutputs
from cdff_core.dfpcs.far_range_object_tracking.configuration import FarRangeObjectTrackingConfig
from cdff_core.dfpcs.far_range_object_tracking.target_ranging import TargetRanging
from cdff_dev.simulate.orbit.body_scene import BodyLight, BodyScene
from cdff_dev.simulate.orbit.camera_view import CameraRays
from cdff_dev.simulate.orbit.meshes import BodyMesh, load_body
from cdff_dev.simulate.orbit.sensors import Camera
from cdff_dev.simulate.orbit.world import PlacedBody

#: Camera of the photographs of 67P, README.txt of the set.
COMET_CAMERA = CameraModel(512, 512, 5863.2, 5863.2, 256.0, 256.0)
#: Level of the light of the comet in the photographs, and their noise, grey levels.
_COMET_LEVEL, _COMET_NOISE = 20.0, 2.0
#: Extents, pixels, and number of simulated views of each.
_EXTENTS_PX, _VIEWS = (20.0, 40.0, 100.0), 30
_SPREAD_PX = 0.8
#: Rows of the renderer in a row of the image, and views that may be drawn for each one that shows light.
_FINE, _ATTEMPTS = 4, 20


def comet_ranges(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the errors of the range on the photographs of 67P, with attitude and Sun and without."""
    folder = data / "rosetta_67p"
    mesh = load_body(
        str(folder / "67p_16k.ply"), unit="km", material="regolith", size_m=(1e3, 1e4), field="67P"
    )
    with (folder / "truth.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    results = []
    for k, row in enumerate(rows):
        if k % 10 == 0:
            progress(f"far_range_object_tracking: photograph {k + 1} of {len(rows)}")
        image = cv2.imread(str(folder / "images" / row["image"]), cv2.IMREAD_GRAYSCALE).astype(np.float32)
        w, x, y, z = (float(row[name]) for name in ("qw", "qx", "qy", "qz"))
        T = se3.transform(
            se3.matrix_from_quaternion_xyzw([x, y, z, w]), [1e3 * float(row[f"t{a}_km"]) for a in "xyz"]
        )
        sun = np.array([float(row[f"sun_{a}"]) for a in "xyz"])
        results.append(_measured(mesh, image, COMET_CAMERA, T, sun, (_COMET_LEVEL, _COMET_NOISE, 0.7)))
    return _summary(results)


def simulated_ranges(seed: int, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the errors of the range of the built-in satellite by its extent, for random views."""
    rng = np.random.default_rng(seed)
    mesh = load_body("satellite", unit="m", material="foil_gold", size_m=(0.1, 100.0), field="satellite")
    scene = BodyScene(mesh)
    focal = 2560.0
    camera = CameraModel(256, 256, focal, focal, 127.5, 127.5)
    # The renderer shows small bodies as points: the pixels are means of finer ones.
    middle = _FINE * 128.0 - 0.5
    rays = CameraRays(
        Camera(
            rows=_FINE * 256,
            columns=_FINE * 256,
            focal_px=_FINE * focal,
            principal_point_px=(middle, middle),
            rate_hz=1.0,
            zero_point_e_s=1.0,
        )
    )
    figures = {}
    for extent_px in _EXTENTS_PX:
        progress(f"far_range_object_tracking: satellite of {extent_px:g} pixels")
        results: list[dict[str, float]] = []
        attempts = 0
        while len(results) < _VIEWS:
            attempts += 1
            if attempts > _ATTEMPTS * _VIEWS:
                raise InputError(
                    f"satellite of {extent_px:g} pixels: light in {len(results)} of {attempts - 1} views, "
                    f"expected in {_VIEWS}; the renderer shows bodies below its limit as points"
                )
            R = se3.exp_so3(rng.normal(size=3) * 2.0)
            sun = rng.normal(size=3) - np.array([0.0, 0.0, 1.0])
            sun /= np.linalg.norm(sun)
            if sun[2] > 0.2:
                continue
            range_m = focal * 5.8 / extent_px
            T = se3.transform(R, range_m * np.array([*rng.normal(0.0, 0.003, 2), 1.0]))
            light = BodyLight((R.T @ sun).astype(np.float32), 1.0, None)
            view = rays.render([PlacedBody(1, "client", scene, (rays.model.T_base_camera @ T)[None], light)])
            fine = view.radiance.astype(np.float32).reshape(256, _FINE, 256, _FINE)
            radiance = cv2.GaussianBlur(fine.mean(axis=(1, 3)), (0, 0), _SPREAD_PX)
            level = 0.1 * float(np.percentile(radiance[radiance > 0.0], 90.0)) if radiance.any() else 0.0
            if level <= 0.0:
                continue
            image = np.minimum(radiance / level * 10.0, 1000.0)
            image += rng.normal(0.0, 1.0, image.shape)
            results.append(_measured(mesh, image.astype(np.float32), camera, T, sun, (5.0, 1.0, _SPREAD_PX)))
        figures[f"{extent_px:g}_px"] = _summary(results)
    return figures


def _measured(
    mesh: BodyMesh,
    image: np.ndarray,
    camera: CameraModel,
    T_camera_body: FloatArray,
    sun: FloatArray,
    levels: tuple[float, float, float],
) -> dict[str, float]:
    """Return the relative error, the squared normalised error and the interval of one image.

    ``levels`` are the level of the light, the noise, and the point spread, pixels.
    """
    level, noise, spread = levels
    ranging = TargetRanging(_dfn(), FarRangeObjectTrackingConfig())
    vertices = np.asarray(mesh.vertices_m, float)
    ranging.give_model(
        Sample(
            "model",
            0,
            0,
            Mesh.from_arrays(vertices, np.asarray(mesh.triangles), frame="client/body", stamp_ns=0),
        )
    )
    attitude = CameraAttitude(np.eye(3), np.zeros((3, 3)), np.zeros(0, bool))
    ranging.give_sun(Sample("sun", 0, 0, Vector3d(sun)))
    rows, columns = np.nonzero(cv2.morphologyEx(image, cv2.MORPH_OPEN, np.ones((3, 3))) > level)
    if len(rows) == 0:
        return {"refused": 1.0}
    box = np.array([columns.min(), columns.max(), rows.min(), rows.max()], float)
    removed = StarFieldBackgroundOutputs(
        residual=image,
        noise=np.full(image.shape, noise, np.float32),
        mask=np.zeros(image.shape, np.uint8),
        saturated=0.0,
    )
    T_true = float(np.linalg.norm(T_camera_body[:3, 3]))
    result: dict[str, float] = {}
    for is_known in (False, True):
        if is_known:
            value = TransformWithCovariance.from_transform(
                UncertainTransform(se3.transform(T_camera_body[:3, :3], np.zeros(3)), np.zeros((6, 6))),
                parent="inertial",
                child="client/body",
                stamp_ns=0,
            )
            ranging.give_attitude(Sample("body_attitude", 0, 0, value))
        try:
            estimate = ranging.measure(0, camera, attitude, removed, box, spread**2 * np.eye(2))
        except RefusedError:
            return {"refused": 1.0}
        if not is_known:
            result["inside"] = float(estimate.interval_m[0] <= T_true <= estimate.interval_m[1])
            result["width"] = float(np.ptp(estimate.interval_m) / T_true)
        elif estimate.reasons:
            result["refused"] = 1.0
        else:
            result["error"] = estimate.range_m / T_true - 1.0
            result["square"] = ((estimate.range_m - T_true) / estimate.sigma_m) ** 2
    return result


def _dfn() -> Any:
    dfn = Registry.default().make_dfn("ApparentSizeRanging", "RenderedComparison")
    dfn.configure()
    return dfn


def _summary(results: list[dict[str, float]]) -> dict[str, Any]:
    errors = np.array([r["error"] for r in results if "error" in r])
    inside = [r["inside"] for r in results if "inside" in r]
    return {
        "images": len(results),
        "measured": len(errors),
        "error_per_cent": {
            "median": round(100.0 * float(np.median(np.abs(errors))), 2),
            "p95": round(100.0 * float(np.percentile(np.abs(errors), 95)), 2),
            "largest": round(100.0 * float(np.abs(errors).max()), 2),
            "mean": round(100.0 * float(errors.mean()), 2),
        },
        "squared_error": round(float(np.mean([r["square"] for r in results if "square" in r])), 2),
        "degrees_of_freedom": 1,
        "interval_contains_range": round(float(np.mean(inside)), 3),
        "interval_width": round(float(np.median([r["width"] for r in results if "width" in r])), 2),
    }
