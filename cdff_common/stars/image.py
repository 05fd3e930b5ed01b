# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of stars and other point sources: where they are, how bright, and how their light spreads."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.camera.model import CameraModel
from cdff_common.errors import InputError
from cdff_common.stars.catalogue import StarCatalogue

FloatArray = NDArray[np.float64]

#: Half width of the image of a point source in standard deviations; 4e-7 of its light falls outside.
_SPREAD_SIGMAS = 5.2


def electron_rates(magnitudes: ArrayLike, zero_point_e_s: float) -> FloatArray:
    """Return the signals ``(n,)`` of sources, photoelectrons per second.

    Parameters
    ----------
    magnitudes : array_like (n,)
    zero_point_e_s : float
        Signal of a source of magnitude 0 in the camera, photoelectrons per second.
    """
    return np.asarray(zero_point_e_s * 10.0 ** (-0.4 * np.asarray(magnitudes, dtype=float)))


def visible_stars(
    catalogue: StarCatalogue, camera: CameraModel, R_inertial_camera: ArrayLike, margin_px: float = 0.0
) -> tuple[NDArray[np.intp], FloatArray]:
    """Return the ascending indices ``(k,)`` of the stars in the image, and their pixels ``(k, 2)``.

    Parameters
    ----------
    R_inertial_camera : array_like (3, 3)
        Orientation of the camera; its inertial axes are those of the catalogue.
    margin_px : float
        Width of a border around the image whose stars are returned as well.

    Raises
    ------
    InputError
        If the size of the image is unknown, or the orientation is not a rotation.
    """
    R = np.asarray(R_inertial_camera, dtype=float)
    if R.shape != (3, 3) or not np.allclose(R.T @ R, np.eye(3), atol=1e-6):
        raise InputError(f"R_inertial_camera={R.tolist()}: expected a rotation matrix (3, 3)")
    if camera.rows <= 0 or camera.cols <= 0:
        raise InputError(f"camera {camera.cols}x{camera.rows}: expected the size of the image")
    nearby_rows = catalogue.near(R[:, 2], _half_field_rad(camera, margin_px))
    pixels = camera.project(catalogue.directions[nearby_rows] @ R)
    inside = (pixels >= -0.5 - margin_px) & (pixels <= np.array([camera.cols, camera.rows]) - 0.5 + margin_px)
    is_visible = inside.all(axis=1)  # the pixels of a star behind the camera are NaN
    return nearby_rows[is_visible], pixels[is_visible]


def _half_field_rad(camera: CameraModel, margin_px: float) -> float:
    """Return an upper bound of the angle between the optical axis and the rays of the image."""
    u = np.linspace(-0.5 - margin_px, camera.cols - 0.5 + margin_px, 17)
    v = np.linspace(-0.5 - margin_px, camera.rows - 0.5 + margin_px, 17)
    border = np.concatenate(
        [np.column_stack([u, np.full(17, edge)]) for edge in (v[0], v[-1])]
        + [np.column_stack([np.full(17, edge), v]) for edge in (u[0], u[-1])]
    )
    rays = camera.rays(border)
    if not np.isfinite(rays).all():
        return np.pi  # the lens model is undefined on the border: search all stars
    return float(np.arccos(np.clip(rays[:, 2], -1.0, 1.0)).max()) * 1.02


def add_sources(
    image: NDArray[np.float32],
    pixels: ArrayLike,
    signals: ArrayLike,
    sigma_px: float,
    trails_px: ArrayLike | None = None,
) -> None:
    """Add point sources with a Gaussian point spread, integrated over the pixels, to an image in place.

    Parameters
    ----------
    image : ndarray float32 (rows, cols)
        C-contiguous; the unit is that of the signals.
    pixels : array_like (n, 2)
        Positions (u, v), pixel centres at integers; at the middle of the exposure.
    signals : array_like (n,)
        Sum of each source over all pixels.
    sigma_px : float
        Standard deviation of the point spread, above 0.
    trails_px : array_like (n, 2) or (2,), optional
        Displacement of each source during the exposure.

    Raises
    ------
    InputError
        If a shape or a value is wrong.
    """
    from cdff_common.stars._kernels import add_trails

    positions_px = np.ascontiguousarray(pixels, dtype=float).reshape(-1, 2)
    strength = np.ascontiguousarray(signals, dtype=float).reshape(-1)
    trails = np.zeros_like(positions_px) if trails_px is None else np.asarray(trails_px, dtype=float)
    if image.dtype != np.float32 or image.ndim != 2 or not image.flags.c_contiguous:
        raise InputError(f"image: {image.dtype} {image.shape}, expected float32 (rows, cols), C-contiguous")
    if len(strength) != len(positions_px) or trails.shape not in ((2,), positions_px.shape):
        raise InputError(
            f"{len(positions_px)} pixels, {len(strength)} signals, trails {trails.shape}: "
            "expected equal numbers"
        )
    trails = np.ascontiguousarray(np.broadcast_to(trails, positions_px.shape))
    if not (
        sigma_px > 0.0
        and np.isfinite(positions_px).all()
        and np.isfinite(strength).all()
        and np.isfinite(trails).all()
    ):
        raise InputError(f"sigma_px={sigma_px}: expected above 0, and finite pixels, signals and trails")
    add_trails(image, positions_px, trails, strength, float(sigma_px), _SPREAD_SIGMAS * float(sigma_px))
