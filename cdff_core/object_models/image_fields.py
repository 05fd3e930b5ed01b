# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fields of edge orientations of an image and of a rendered body, and their agreement.

The field of an edge is its double-angle gradient ``(gx + i gy)^2 / (|g|^2 + limit^2)``: opposite directions
of the gradient are equal, because a face can be brighter or darker than its neighbour, and a weak edge counts
as much as a strong one (the orientation of Bigün and Granlund, ICCV 1987). The agreement is a normalised
correlation.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.arrays import BoolArray, FloatArray
from cdff_core.object_models.rendering import NO_FACE, Window, camera_normals, render

FieldArray = NDArray[np.complex64]
#: Grey levels added to the light before its logarithm, and gradients of weak edges of image and rendering.
_DARK, _WEAK_LIGHT, _WEAK_NORMAL = 8.0, 0.06, 0.3
#: Width of the seam outside the outline in which the image is compared, pixels.
_SEAM_PX = 2
#: Number of levels of each component of a normal by which faces are grouped.
_NORMAL_LEVELS = 5


class ImageField(NamedTuple):
    """Light of a window of an image.

    Attributes
    ----------
    edges : ndarray of complex64, shape (rows, columns)
    light : ndarray of float32, shape (rows, columns)
        Logarithm of the light above the background, 0 in the dark.
    """

    edges: FieldArray
    light: NDArray[np.float32]


class BodyField(NamedTuple):
    """Rendered body.

    Attributes
    ----------
    edges : ndarray of complex64, shape (rows, columns)
    mask : ndarray of bool, shape (rows, columns)
    labels : ndarray of int64, shape (rows, columns)
        Group of faces with similar normals; 0 without a face.
    """

    edges: FieldArray
    mask: BoolArray
    labels: NDArray[np.int64]


def image_field(signal: NDArray[np.float32]) -> ImageField:
    """Return the fields of a signal (rows, columns) above the background, grey levels of 8 bits."""
    light = (np.log(np.maximum(signal, 0.0) + _DARK) - math.log(_DARK)).astype(np.float32)
    return ImageField(_double_angle([light], _WEAK_LIGHT), light)


def body_field(
    vertices_m: FloatArray, triangles: NDArray[np.int64], T: FloatArray, window: Window
) -> BodyField:
    """Return the fields of a mesh at T_camera_model in a window."""
    face = render(vertices_m, triangles, T, window).face
    mask = face != NO_FACE
    normals = np.nan_to_num(camera_normals(vertices_m, triangles, T, face)).astype(np.float32)
    levels = np.rint(0.5 * (normals + 1.0) * (_NORMAL_LEVELS - 1)).astype(np.int64)
    labels = 1 + levels[..., 0] + _NORMAL_LEVELS * (levels[..., 1] + _NORMAL_LEVELS * levels[..., 2])
    channels = [np.ascontiguousarray(normals[..., i]) for i in range(3)]
    return BodyField(_double_angle(channels, _WEAK_NORMAL), mask, np.where(mask, labels, 0))


def _double_angle(channels: list[NDArray[np.float32]], weak: float) -> FieldArray:
    """Return the double-angle gradient summed over channels."""
    total = np.zeros(channels[0].shape, np.complex64)
    power = np.zeros(channels[0].shape, np.float32)
    for channel in channels:
        smooth = cv2.GaussianBlur(channel, (0, 0), 0.8)
        gx = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
        gy = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
        total += (gx + 1j * gy) ** 2
        power += gx**2 + gy**2
    field: FieldArray = (total / (power + np.float32(weak**2))).astype(np.complex64)
    return field


def window_field(
    signal: NDArray[np.float32], camera: Window, centre_px: FloatArray, extent_px: float, side_px: int
) -> tuple[Window, ImageField]:
    """Return a square window of an image, and its fields.

    Parameters
    ----------
    signal : ndarray of float32, shape (rows, columns)
        Grey levels above the background.
    camera : Window
        Camera of the image.
    centre_px : ndarray, shape (2,)
        Column and row of the centre of the window in the image.
    extent_px : float
        Side of the window in pixels of the image.
    side_px : int
        Side of the window in its own pixels.
    """
    scale = extent_px / side_px
    low = centre_px - 0.5 * extent_px
    blurred = cv2.GaussianBlur(signal, (0, 0), 0.5 * scale) if scale > 1.0 else signal
    to_window = np.array([[1.0, 0.0, -low[0]], [0.0, 1.0, -low[1]]]) / scale
    part = cv2.warpAffine(blurred, to_window, (side_px, side_px), flags=cv2.INTER_LINEAR)
    window = Window(
        camera.fx / scale,
        camera.fy / scale,
        (camera.cx - low[0]) / scale,
        (camera.cy - low[1]) / scale,
        side_px,
        side_px,
    )
    return window, image_field(np.asarray(part, np.float32))


def seam_mask(body: BodyField) -> BoolArray:
    """Return the mask (rows, columns) of the outline and its seam."""
    kernel = np.ones((2 * _SEAM_PX + 1,) * 2, np.uint8)
    return np.asarray(cv2.dilate(body.mask.astype(np.uint8), kernel) > 0)


def edge_energy(field: FieldArray) -> float:
    """Return the sum of the squared magnitudes of a field."""
    return float(np.vdot(field, field).real)


def edge_correlation(image: ImageField, body: BodyField, image_energy: float) -> float:
    """Return the correlation of the edges of image and body in the outline and its seam.

    Parameters
    ----------
    image_energy : float
        Energy of the edges of the image by which the correlation is normalised. If it differs between poses,
        poses whose outline contains few edges of the image are preferred, which makes the range wrong.
    """
    seam = seam_mask(body)
    ours = body.edges[seam]
    norm = math.sqrt(edge_energy(ours) * image_energy)
    return float(np.vdot(ours, image.edges[seam]).real) / norm if norm > 0.0 else 0.0


def agreement(image: ImageField, body: BodyField, light_sum: float) -> tuple[float, float, float]:
    """Return how a rendered body agrees with an image.

    Returns
    -------
    edges : float
        Normalised correlation of the fields in the outline and its seam, -1 to 1.
    inside : float
        Part of the light ``light_sum`` that is inside the outline and its seam.
    shading : float
        Part of the variance of the light in the outline that the groups of normals explain.
    """
    seam = seam_mask(body)
    edges = edge_correlation(image, body, edge_energy(image.edges[seam]))
    inside = float(image.light[seam].sum()) / max(light_sum, 1e-9)
    light, labels = image.light[body.mask], body.labels[body.mask]
    counts = np.bincount(labels)
    if not len(counts):
        return edges, inside, 0.0
    sums = np.bincount(labels, light)
    total = float(light.var()) * len(light)
    between = float((sums**2 / np.maximum(counts, 1)).sum()) - float(light.sum()) ** 2 / len(light)
    return edges, inside, between / total if total > 1e-9 else 0.0
