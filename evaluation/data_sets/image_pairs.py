# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Image pairs with known correspondences: measured stereo, hand-marked points, warped views."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.formats.image import read_image
from cdff_core.imaging.two_view import transfer

Float = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class ImagePair:
    """Two images, and points ``(n, 2)`` of the left one with their true positions in the right one."""

    name: str
    left: Image
    right: Image
    points: Float
    partners: Float
    H: Float | None = None


def grey(path: Path) -> Image:
    """Read an image file as 8-bit grey values."""
    image = read_image(path)
    if image.ndim == 3:
        image = cv2.cvtColor(np.ascontiguousarray(image[:, :, :3]), cv2.COLOR_RGB2GRAY)
    return np.ascontiguousarray(image)


def corner_points(image: Image, max_points: int = 400) -> Float:
    """Return corners ``(n, 2)`` of an image, whole pixels, at least 8 pixels apart."""
    corners = cv2.goodFeaturesToTrack(image, max_points, 0.01, 8.0)
    return np.zeros((0, 2)) if corners is None else np.asarray(corners[:, 0], np.float64)


def marked_dlr(data: Path) -> ImagePair:
    """Return the images of DLR's mock-up for on-orbit servicing, with hand-marked points."""
    folder = data / "cdff_upstream" / "Images"
    text = (folder / "DlrMatches.xml").read_text(encoding="utf-8")
    numbers = np.array(text[text.index("<data>") + 6 : text.index("</data>")].split(), np.float64).reshape(
        -1, 4
    )
    left, right = grey(folder / "DlrLeft.png"), grey(folder / "DlrRight.png")
    return ImagePair("dlr_mock_up", left, right, numbers[:, :2], numbers[:, 2:])


def middlebury(data: Path, name: str) -> ImagePair:
    """Return Teddy or Tsukuba with measured disparities; those of Tsukuba are whole pixels."""
    folder, scale = data / "middlebury" / name, {"teddy": 4.0, "tsukuba": 16.0}[name]
    left, right = grey(folder / "im2.png"), grey(folder / "im6.png")
    disparity = grey(folder / "disp2.png").astype(np.float64) / scale
    points = corner_points(left)
    d = disparity[points[:, 1].astype(int), points[:, 0].astype(int)]
    known = (d > 0.0) & (points[:, 0] - d > 2.0)
    return ImagePair(name, left, right, points[known], points[known] - np.column_stack([d, 0.0 * d])[known])


def truth_of(pair: ImagePair, data: Path, sources: Float) -> Float:
    """Return the true positions ``(n, 2)`` in the right image of points of the left one; NaN if unknown."""
    if pair.H is not None:
        return transfer(pair.H, sources)
    scale = {"teddy": 4.0, "tsukuba": 16.0}[pair.name]
    disparity = grey(data / "middlebury" / pair.name / "disp2.png").astype(np.float64) / scale
    rows, columns = disparity.shape
    pixels = np.clip(np.rint(sources), 0, [columns - 1, rows - 1]).astype(int)
    d = disparity[pixels[:, 1], pixels[:, 0]]
    return sources - np.column_stack([np.where(d > 0.0, d, np.nan), 0.0 * d])


def base_images(data: Path) -> dict[str, Image]:
    """Return the measured images that ``warped`` uses, by name."""
    kitti = sorted((data / "kitti_stereo").rglob("*.png"))
    return {
        "kitti_a": grey(kitti[0]),
        "teddy": grey(data / "middlebury" / "teddy" / "im2.png"),
        "kitti_b": grey(kitti[len(kitti) // 3]),
        "minnie": grey(data / "cdff_upstream" / "MinnieStereo" / "MinnieRectLeft.png"),
        "dlr": grey(data / "cdff_upstream" / "Images" / "DLR_OOS_camL0000.pgm"),
    }


def warped(name: str, base: Image, seed: int, size: tuple[int, int] = (480, 360)) -> ImagePair:
    """Return a window of an image, and a view of it that is rotated, scaled, tilted and differently lit."""
    rng = np.random.default_rng(seed)
    width, height = min(size[0], base.shape[1]), min(size[1], base.shape[0])
    x, y = rng.integers(0, base.shape[1] - width + 1), rng.integers(0, base.shape[0] - height + 1)
    left = np.ascontiguousarray(base[y : y + height, x : x + width])
    angle, scale = np.radians(rng.uniform(-30.0, 30.0)), 1.4 ** rng.uniform(-1.0, 1.0)
    centre = np.array([[1.0, 0.0, -width / 2], [0.0, 1.0, -height / 2], [0.0, 0.0, 1.0]])
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    tilt = rng.uniform(-0.3, 0.3, 2) / width
    warp = np.array([[c, -s, rng.uniform(-20, 20)], [s, c, rng.uniform(-20, 20)], [tilt[0], tilt[1], 1.0]])
    H = np.linalg.inv(centre) @ warp @ centre
    view = cv2.warpPerspective(
        left, H, (width, height), flags=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    )
    noisy = rng.uniform(0.8, 1.2) * view + rng.uniform(-10, 10) + rng.normal(0.0, 2.0, view.shape)
    right = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    points = corner_points(left, 200)
    partners = transfer(H, points)
    inside = ((partners > 8) & (partners < [width - 8, height - 8])).all(axis=1)
    return ImagePair(f"{name}_{seed}", left, right, points[inside], partners[inside], H)
