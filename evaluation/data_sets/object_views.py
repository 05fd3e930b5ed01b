# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Models of objects and recorded single views of them, with approximate poses."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product
from pathlib import Path

import cv2
import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from evaluation.data_sets.clouds import milk_carton
from evaluation.data_sets.depth_motion import depth_motion

#: Number of points of a model.
MODEL_POINTS = 20_000
#: Rotation from the frame of the meshes of ``visp_rbt_rgbd`` to the frame of its poses: x, -z, y. With it the
#: points of ``dragon.init`` are within 0.6 mm of the mesh; without it they are up to 22 mm away.
_R_POSE_MESH = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """A model (n, 3) and a scene (m, 3), metres, and the equivalent poses ``T_scene_model`` (4, 4).

    There is no pose if the scene does not contain the model.
    """

    name: str
    model_m: FloatArray
    scene_m: FloatArray
    poses: tuple[FloatArray, ...]


def tracked_objects(data: Path, step: int = 1) -> Iterator[View]:
    """Yield dragon and cube in every ``step``-th frame of ``visp_rbt_rgbd``.

    Their poses are the start poses of the data set, moved with the board in the colour images.
    """
    folder = data / "visp_rbt_rgbd"
    boards = _board_poses(folder)
    start = se3.inverse(next(iter(boards.values())))
    starts = json.loads((folder / "initial_guess.json").read_text())
    models = {name: mesh_points(folder / "models" / name / f"{name}.obj") for name in starts}
    for frame in list(boards)[::step]:
        scene = _tracked_scene(folder, frame)
        for name, T_start in starts.items():
            poses = _equivalent_poses(name, boards[frame] @ start @ np.array(T_start))
            yield View(f"{name} {frame}", models[name], scene, poses)


def tracked_poses_by_depth(data: Path) -> dict[str, tuple[FloatArray, ...]]:
    """Return the start poses of dragon and cube moved with the depth camera, for the names of all views."""
    folder = data / "visp_rbt_rgbd"
    boards = _board_poses(folder)
    motion = depth_motion({frame: _tracked_scene(folder, frame) for frame in boards}, boards)
    starts = json.loads((folder / "initial_guess.json").read_text())
    return {
        f"{name} {frame}": _equivalent_poses(name, T_frame_start @ np.array(T_start))
        for name, T_start in starts.items()
        for frame, T_frame_start in motion.items()
    }


def _board_poses(folder: Path) -> dict[int, FloatArray]:
    """Return ``T_camera_board`` (4, 4) of the colour camera in each frame."""
    rows = np.loadtxt(folder / "camera_from_board.csv", delimiter=",", skiprows=1)
    return {int(row[0]): _pose(row[1:]) for row in rows}


def _tracked_scene(folder: Path, frame: int) -> FloatArray:
    return depth_points(folder / "depth" / f"{frame:04d}.png", 607.178, 607.234, 321.391, 241.918)


def _equivalent_poses(name: str, T: FloatArray) -> tuple[FloatArray, ...]:
    return tuple(T @ S for S in (_cube_rotations() if name == "cube" else (np.eye(4),)))


def absent_objects(data: Path, every: int) -> Iterator[View]:
    """Yield dragon and cube with some frames of ``seven_scenes_redkitchen``, without these objects."""
    folder = data / "visp_rbt_rgbd"
    for path in sorted((data / "seven_scenes_redkitchen" / "frames").glob("*.depth.png"))[::every]:
        scene = depth_points(path, 585.0, 585.0, 320.0, 240.0)
        for name in ("dragon", "cube"):
            model = mesh_points(folder / "models" / name / f"{name}.obj")
            yield View(f"{name} in kitchen {path.name[:6]}", model, scene, ())


def crops(data: Path, seeds: range) -> Iterator[View]:
    """Yield parts of recorded scenes as models, one for each seed.

    A random half of the points is the scene. The model is the part of the other half around a random point,
    within 0.25 of its distance to the sensor, at a random pose. Parts whose standard deviation across their
    plane is below 0.1 radii are drawn again, since the pose of a plane is not unique.
    """
    _, table, _ = milk_carton(data)
    frames = sorted((data / "seven_scenes_redkitchen" / "frames").glob("*.depth.png"))
    for seed in seeds:
        rng = np.random.default_rng(seed)
        if seed % 2:
            path = frames[int(rng.integers(len(frames)))]
            name, points = f"kitchen {path.name[:6]}", depth_points(path, 585.0, 585.0, 320.0, 240.0)
        else:
            name, points = "table", table
        half = rng.permutation(len(points))
        source, scene = points[half[::2]], points[half[1::2]]
        while True:
            centre = source[int(rng.integers(len(source)))]
            radius = 0.25 * float(np.linalg.norm(centre))
            model = source[np.linalg.norm(source - centre, axis=1) < radius]
            if len(model) > 2000 and np.sqrt(np.linalg.eigvalsh(np.cov(model.T))[0]) > 0.1 * radius:
                break
        T = se3.transform_from_vector(np.concatenate([rng.normal(size=3), rng.normal(size=3)]))
        yield View(f"{name}, seed {seed}", se3.transform_points(se3.inverse(T), model), scene, (T,))


def mesh_points(path: Path) -> FloatArray:
    """Return random points (n, 3), metres, evenly distributed on the surface of a Wavefront mesh.

    They are in the frame of the poses of ``visp_rbt_rgbd``.
    """
    vertices, triangles = [], []
    for line in path.read_text().splitlines():
        kind, *fields = line.split() or [""]
        if kind == "v":
            vertices.append([float(x) for x in fields[:3]])
        elif kind == "f":
            corners = [int(field.split("/")[0]) - 1 for field in fields]
            triangles += [(corners[0], *corners[k : k + 2]) for k in range(1, len(corners) - 1)]
    a, b, c = np.moveaxis(np.array(vertices)[np.array(triangles)], 1, 0)
    rng = np.random.default_rng(0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    row = rng.choice(len(area), MODEL_POINTS, p=area / area.sum())
    s, t = rng.random((2, MODEL_POINTS, 1))
    s, t = np.where(s + t > 1.0, 1.0 - s, s), np.where(s + t > 1.0, 1.0 - t, t)
    return np.asarray((a[row] + s * (b - a)[row] + t * (c - a)[row]) @ _R_POSE_MESH.T)


def depth_points(path: Path, fx: float, fy: float, cx: float, cy: float) -> FloatArray:
    """Return the points (n, 3), metres, of a depth image in millimetres; x right, y down, z forward."""
    depth = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    row, column = np.nonzero((depth > 0) & (depth < 65535))
    z = depth[row, column] * 1e-3
    return np.stack([(column - cx) / fx * z, (row - cy) / fy * z, z], axis=1)


def _pose(row: FloatArray) -> FloatArray:
    """Return the pose (4, 4) of a row (12,) with its upper three rows."""
    return np.vstack([row.reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])


def _cube_rotations() -> tuple[FloatArray, ...]:
    """Return the 24 rotations (4, 4) of a cube."""
    rotations = []
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            R = np.eye(3)[list(order)] * np.array(signs)[:, None]
            if np.linalg.det(R) > 0.0:
                rotations.append(se3.transform(R, np.zeros(3)))
    return tuple(rotations)
