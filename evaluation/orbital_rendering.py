# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare renderings of the orbital simulator with photographs, and measure their cost.

Comet 67P: each NAVCAM image is rendered with its true pose and Sun (Lommel-Seeliger, cast shadows, point
spread 1.2 px: 0.8 px of the lens and 0.9 px rms of the poses) and correlated with the photograph.

Mock-up of Tango (SPEED+): the silhouette of the mesh at the true pose, through the lens of the camera, is
compared with the strongest edge of the photograph within 15 px along the normal of the silhouette; the
distance of an image is the median over its silhouette. The Sun of these images is not known.

Cost: CPU seconds of one thread, for the mesh of Tango (23 360 triangles) in a third of 640 × 480 pixels.
"""

from __future__ import annotations

import csv
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import validated
from cdff_dev.simulate.orbit.body_scene import BodyLight, BodyScene
from cdff_dev.simulate.orbit.camera_view import CameraRays
from cdff_dev.simulate.orbit.images import CameraSimulator
from cdff_dev.simulate.orbit.meshes import load_body
from cdff_dev.simulate.orbit.scans import LidarSimulator
from cdff_dev.simulate.orbit.scenario import OrbitScenario
from cdff_dev.simulate.orbit.sensors import Camera
from cdff_dev.simulate.orbit.world import OrbitWorld, PlacedBody

PARTS = ("comet", "silhouettes", "cost")
#: Point spread of the comet's images, and search along the normals of silhouettes, pixels.
COMET_PSF_PX, SEARCH_PX, STEP_PX = 1.2, 15.0, 0.5
#: Smallest gradient of an edge of a photograph, numbers per pixel.
EDGE_DN_PX = 3.0
REPETITIONS = 12


def evaluate(data: Path, progress: Callable[[str], None], parts: tuple[str, ...] = PARTS) -> dict[str, Any]:
    """Return the figures of each part."""
    functions = {"comet": comet, "silhouettes": silhouettes, "cost": cost}
    figures = {}
    for part in parts:
        progress(f"orbital rendering: {part}")
        figures[part] = functions[part](data)
    return figures


def comet(data: Path) -> dict[str, float]:
    """Return the correlations of renderings and photographs of comet 67P."""
    folder = data / "rosetta_67p"
    mesh = load_body(
        str(folder / "67p_16k.ply"), unit="km", material="regolith", size_m=(1e3, 1e4), field="67P"
    )
    scene = BodyScene(mesh)
    rays = CameraRays(
        Camera(
            rows=512,
            columns=512,
            focal_px=5863.2,
            principal_point_px=(256, 256),
            rate_hz=1.0,
            zero_point_e_s=1.0,
        )
    )
    correlations = []
    for row in _rows(folder):
        T = _pose(
            [float(row[k]) for k in ("qw", "qx", "qy", "qz")], [1e3 * float(row[f"t{a}_km"]) for a in "xyz"]
        )
        sun = T[:3, :3].T @ [float(row[f"sun_{a}"]) for a in "xyz"]
        view = rays.render([_placed(rays, scene, T, sun, 1.0)])
        photograph = _photograph(folder, row)
        rendered = gaussian_filter(view.radiance.astype(float), COMET_PSF_PX)
        correlations.append(np.corrcoef(rendered.ravel(), photograph.ravel())[0, 1])
    return {
        "images": len(correlations),
        "median_correlation": round(float(np.median(correlations)), 4),
        "smallest_correlation": round(float(np.min(correlations)), 4),
    }


def silhouettes(data: Path) -> dict[str, float]:
    """Return the distances of rendered silhouettes from edges of the photographs of the mock-up."""
    folder = data / "speedplus_lightbox"
    calibration = json.loads((folder / "camera.json").read_text(encoding="utf-8"))
    K = np.array(calibration["cameraMatrix"])
    camera = Camera(
        rows=1200,
        columns=1920,
        focal_px=K[0, 0],
        principal_point_px=(K[0, 2], K[1, 2]),
        distortion=tuple(np.ravel(calibration["distCoeffs"])),
        rate_hz=1.0,
        zero_point_e_s=1.0,
    )
    rays, scene = CameraRays(camera), BodyScene(_tango(data))
    medians = []
    for row in _rows(folder):
        T = _pose([float(row[k]) for k in ("qw", "qx", "qy", "qz")], [float(row[f"t{a}_m"]) for a in "xyz"])
        mask = rays.render([_placed(rays, scene, T, np.array([0.0, 0.0, 1.0]), 0.0)]).number > 0
        medians.append(silhouette_distance_px(mask, _photograph(folder, row)))
    return {
        "images": len(medians),
        "median_px": round(float(np.median(medians)), 2),
        "largest_px": round(float(np.max(medians)), 2),
    }


def silhouette_distance_px(mask: np.ndarray, photograph: np.ndarray) -> float:
    """Return the median distance of the outline of a mask (rows, columns) from the edges of an image."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = np.concatenate([contour[:, 0] for contour in contours])
    rows, columns = mask.shape
    margin = int(SEARCH_PX) + 2
    inside = (points >= margin) & (points < [columns - margin, rows - margin])
    points = points[inside.all(axis=1)]
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 3.0)
    normals = np.stack(
        [cv2.Sobel(soft, cv2.CV_32F, dx, 1 - dx)[points[:, 1], points[:, 0]] for dx in (1, 0)], axis=1
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-9
    offsets = np.arange(-SEARCH_PX, SEARCH_PX + STEP_PX, STEP_PX)
    at = (points[:, None] + offsets[None, :, None] * normals[:, None]).astype(np.float32)
    smooth = cv2.GaussianBlur(photograph.astype(np.float32), (0, 0), 1.5)
    values = cv2.remap(smooth, at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    gradient = np.abs(np.gradient(values, STEP_PX, axis=1))
    is_edge = gradient.max(axis=1) > EDGE_DN_PX
    # The points of the outline are the centres of its last pixels, half a pixel inside the edge.
    distances = np.abs(offsets[gradient.argmax(axis=1)] + 0.5)
    return float(np.median(distances[is_edge]))


def cost(data: Path) -> dict[str, float]:
    """Return frames, images and rays per CPU second."""
    values = {
        "kind": "orbit",
        "name": "cost",
        "seed": 1,
        "epoch": "2026-08-01T12:00:00Z",
        "orbit": {"semi_major_axis_m": 6_928_137.0, "inclination_deg": 51.6},
        "lighting": {"sun": {"phase_deg": 50.0}, "eclipse": False},
        "client": {
            "name": "client",
            "mesh": str(data / "speedplus_lightbox" / "tango.ply"),
            "inertia_kg_m2": [1.0, 1.2, 1.4],
            "attitude": {"orientation_xyzw": [0.2, 0.4, 0.4, 0.8], "rate_deg_s": [3.0, 2.0, 1.0]},
        },
        "servicer": {
            "start_m": [-3.0, 0.0, 0.0],
            "path": [{"kind": "hold", "duration_s": 100.0}],
            "cameras": {
                "camera": {
                    "rows": 480,
                    "columns": 640,
                    "focal_px": 1150.0,
                    "rate_hz": 1.0,
                    "zero_point_e_s": 3000.0,
                }
            },
            "lidars": {"lidar": {"rows": 1000, "columns": 1000, "field_deg": [40.0, 40.0], "rate_hz": 0.1}},
        },
    }
    world = OrbitWorld(validated(OrbitScenario, values, "cost"))
    camera, lidar = CameraSimulator(world, "camera"), LidarSimulator(world, "lidar")
    coverage = float(np.mean(camera.image(0.0, 0).mask > 0))
    poses = [world.placed(np.array([3.0 * k])) for k in range(REPETITIONS)]
    started = time.process_time()
    for bodies in poses:
        camera.rays.render(bodies)
    frame_s = (time.process_time() - started) / REPETITIONS
    started = time.process_time()
    for k in range(REPETITIONS):
        camera.image(3.0 * k, k)
    image_s = (time.process_time() - started) / REPETITIONS
    return {
        "coverage": round(coverage, 2),
        "frames_per_cpu_s": round(1.0 / frame_s, 1),
        "images_per_cpu_s": round(1.0 / image_s, 1),
        **_lidar_cost(lidar),
    }


def _lidar_cost(lidar: LidarSimulator) -> dict[str, float]:
    """Return beams of complete scans, and rays of casts without noise and mixed echoes, per CPU second."""
    echoes = len(lidar.scan(0.0, 0).points_m)
    beams = lidar.model.rows * lidar.model.columns
    started = time.process_time()
    for k in range(4):
        lidar.scan(10.0 * k, k)
    scan_s = (time.process_time() - started) / 4
    body = lidar.world.placed(np.zeros(1))[0]
    T_body_lidar = se3.inverse(body.T_base_body) @ lidar.model.mount.matrix()
    started = time.process_time()
    for _ in range(4):
        body.scene.cast(lidar.directions, T_body_lidar)
    cast_s = (time.process_time() - started) / 4
    return {
        "lidar_coverage": round(echoes / beams, 3),
        "lidar_beams_per_cpu_s": round(beams / scan_s),
        "lidar_rays_cast_per_cpu_s": round(beams / cast_s),
    }


def _tango(data: Path) -> Any:
    path = str(data / "speedplus_lightbox" / "tango.ply")
    return load_body(path, unit="m", material="paint_grey", size_m=(0.1, 3.0), field="Tango")


def _rows(folder: Path) -> Iterator[dict[str, str]]:
    with (folder / "truth.csv").open(encoding="utf-8") as file:
        yield from csv.DictReader(file)


def _photograph(folder: Path, row: dict[str, str]) -> np.ndarray:
    image = cv2.imread(str(folder / "images" / row["image"]), cv2.IMREAD_GRAYSCALE)
    return np.asarray(image, dtype=float)


def _pose(quaternion_wxyz: list[float], position_m: list[float]) -> FloatArray:
    w, *xyz = quaternion_wxyz
    q = np.array([*xyz, w])
    return se3.transform(se3.matrix_from_quaternion_xyzw(q / np.linalg.norm(q)), position_m)


def _placed(
    rays: CameraRays, scene: BodyScene, T_camera_body: FloatArray, sun: FloatArray, irradiance: float
) -> PlacedBody:
    light = BodyLight(np.asarray(sun, dtype=np.float32), irradiance, None)
    return PlacedBody(1, "client", scene, (rays.model.T_base_camera @ T_camera_body)[None], light)


def table(figures: dict[str, Any]) -> str:
    """Return the tables of the page."""
    of_comet, edge, speed = (figures[part] for part in PARTS)
    rows = [
        "| comparison with photographs | images | median | worst |",
        "|---|---|---|---|",
        f"| comet 67P: correlation | {of_comet['images']} | {of_comet['median_correlation']:.3f} | "
        f"{of_comet['smallest_correlation']:.3f} |",
        f"| mock-up of Tango: silhouette, px | {edge['images']} | {edge['median_px']:.1f} | "
        f"{edge['largest_px']:.1f} |",
        "",
        f"| cost, Tango in {100 * speed['coverage']:.0f} % of 640 × 480 pixels | per CPU second |",
        "|---|---|",
        f"| frames with shadows, without sensor effects | {speed['frames_per_cpu_s']:.0f} |",
        f"| complete images | {speed['images_per_cpu_s']:.1f} |",
        f"| lidar beams of complete scans, client in {100 * speed['lidar_coverage']:.0f} % of the field | "
        f"{speed['lidar_beams_per_cpu_s'] / 1e6:.1f} · 10⁶ |",
        "| lidar rays cast, without noise and mixed echoes | "
        f"{speed['lidar_rays_cast_per_cpu_s'] / 1e6:.1f} · 10⁶ |",
    ]
    return "\n".join(rows) + "\n"
