# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images and depth images of ``visp_rbt_rgbd`` with the objects in them, and other depth images."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.formats.meshes.read import read_mesh
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import DistanceImage, Frame, Mesh, Time, TransformWithCovariance

#: Rotation from the frame of the meshes to that of the poses of the data set: x, -z, y.
R_POSE_MESH = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
#: Time between the frames, as in ``cdff replay`` of the folder.
INTERVAL_NS = 100_000_000
#: Unit of the depths, metres.
UNIT_M = 1e-3
Change = Callable[[int, ByteArray], ByteArray]


@dataclass(frozen=True)
class TrackedObjects:
    """Cube and dragon on a table, seen by a camera that moves; the objects and the board do not.

    Attributes
    ----------
    folder : Path
    """

    folder: Path

    @cached_property
    def camera_matrix(self) -> FloatArray:
        """Camera matrix of both cameras, px."""
        camera = json.loads((self.folder / "cam.json").read_text())
        fx, fy, cx, cy = (camera[name] for name in ("px", "py", "u0", "v0"))
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    @cached_property
    def boards(self) -> dict[int, FloatArray]:
        """T_camera_board (4, 4) of each frame, by the colour images."""
        rows = np.loadtxt(self.folder / "camera_from_board.csv", delimiter=",", skiprows=1)
        return {int(row[0]): se3.transform(row[1:].reshape(3, 4)[:, :3], row[4::4]) for row in rows}

    @cached_property
    def frames(self) -> list[int]:
        """Numbers of the frames."""
        return sorted(self.boards)

    def start(self, name: str) -> FloatArray:
        """Return the hand-made T_camera_mesh (4, 4) of an object in the first frame; 1 to 2.5 cm off."""
        starts = json.loads((self.folder / "initial_guess.json").read_text())
        return np.asarray(np.array(starts[name]) @ se3.transform(R_POSE_MESH, np.zeros(3)))

    def by_board(self, name: str) -> dict[int, FloatArray]:
        """Return the start pose of an object moved with the board, for each frame."""
        start = self.boards[self.frames[0]]
        return {k: T @ se3.inverse(start) @ self.start(name) for k, T in self.boards.items()}

    def model(self, name: str) -> Sample:
        """Return the sample of the mesh of an object, in its own frame."""
        mesh = read_mesh(self.folder / "models" / name / f"{name}.obj")
        value = Mesh.from_arrays(mesh.vertices, mesh.triangles, frame=f"{name}/body", stamp_ns=0)
        return Sample("model", 0, 0, value, id=name)

    def guess(self, name: str) -> Sample:
        """Return the sample of the start pose of an object."""
        value = TransformWithCovariance.from_transform(
            UncertainTransform(self.start(name)), parent="camera", child=f"{name}/body", stamp_ns=0
        )
        return Sample("guess", 0, 0, value, id="guess")

    def depth(self, frame: int, change: Change | None = None) -> Sample:
        """Return the sample of a depth image; ``change`` is applied to the frame number and the raw image."""
        raw = _image(self.folder / "depth" / f"{frame:04d}.png")
        value = distance_image(raw if change is None else change(frame, raw), self.camera_matrix, frame)
        return Sample("depth", frame * INTERVAL_NS, frame, value, id=f"d{frame}", frame="camera")

    def image(self, frame: int, change: Change | None = None) -> Sample:
        """Return the sample of a colour image; ``change`` is applied to the frame number and the image."""
        pixels = _image(self.folder / "color" / f"{frame:04d}.png")
        value = Frame.from_image(
            pixels if change is None else change(frame, pixels),
            sensor="camera",
            stamp_ns=frame * INTERVAL_NS,
            mode="BGR",
            camera_matrix=self.camera_matrix,
        )
        return Sample("image", frame * INTERVAL_NS, frame, value, id=f"i{frame}")


def distance_image(raw: ByteArray, camera_matrix: FloatArray, frame: int = 0) -> DistanceImage:
    """Return a depth image (r, c) of millimetres as a message; 0 and 65535 are no measurement."""
    K = camera_matrix
    depth_m = np.where(raw == np.iinfo(np.uint16).max, 0.0, raw * UNIT_M)
    return DistanceImage(
        ref_time=Time.from_ns(frame * INTERVAL_NS),
        width=raw.shape[1],
        height=raw.shape[0],
        scale_x=1.0 / K[0, 0],
        scale_y=1.0 / K[1, 1],
        center_x=-K[0, 2] / K[0, 0],
        center_y=-K[1, 2] / K[1, 1],
        data=depth_m.ravel(),
    )


def kitchen_depths(data: Path, every: int) -> list[tuple[str, DistanceImage]]:
    """Return name and depth image of each ``every``-th frame of ``seven_scenes_redkitchen``."""
    K = np.array([[585.0, 0.0, 320.0], [0.0, 585.0, 240.0], [0.0, 0.0, 1.0]])
    files = sorted((data / "seven_scenes_redkitchen" / "frames").glob("*.depth.png"))[::every]
    return [(file.name.split(".")[0], distance_image(_image(file), K)) for file in files]


def _image(path: Path) -> ByteArray:
    import cv2

    return np.asarray(cv2.imread(str(path), cv2.IMREAD_UNCHANGED))
