# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Series of images made from one photograph of stars: turned, with new noise and with injected objects."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.camera import CameraModel
from cdff_common.geometry import se3
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.point_source_centroiding.interface import PointSourceCentroidingInputs
from cdff_core.dfns.point_source_detection.interface import PointSourceDetectionInputs
from cdff_core.dfns.star_field_background.interface import StarFieldBackgroundInputs
from cdff_core.dfns.star_identification.interface import StarIdentificationInputs

#: Field of view of the shared photographs, degrees (README.txt of the set).
FIELD_DEG = 11.42
#: Width of the point spread of the photographs and therefore of injected objects, pixels.
SPREAD_PX = 0.6
#: Date of the photographs, 29 July 2019, nanoseconds.
PHOTOGRAPH_NS = 1_564_358_400_000_000_000
_TRAIL = 2


@dataclass(frozen=True, slots=True, eq=False)
class StarField:
    """A photograph of stars, separated into background, stars and noise.

    Attributes
    ----------
    camera : CameraModel
    background, stars, noise : ndarray of float32 (r, c)
        Levels, light of the stars, and standard deviation of the noise of the background, DN.
    lens_error_rad : float
        Standard deviation of the direction of a star by the lens along an axis: the residuals of the stars
        of the photograph beyond their noise.
    """

    camera: CameraModel
    background: Float32Array
    stars: Float32Array
    noise: Float32Array
    lens_error_rad: float = 0.0

    @classmethod
    def read(cls, path: Path) -> StarField:
        """Return the field of a photograph."""
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.float32)
        rows, cols = image.shape
        camera, lens_error_rad = calibrated(image)
        remove = Registry.default().make_dfn("StarFieldBackground", "TileMedian")
        detect = Registry.default().make_dfn("PointSourceDetection", "MatchedFilter")
        remove.configure()
        detect.configure({"min_snr": 5.0})
        removed = remove.process(StarFieldBackgroundInputs(image=image, saturation=float("inf")))
        sources = detect.process(
            PointSourceDetectionInputs(
                residual=removed.residual,
                noise=removed.noise,
                mask=removed.mask,
                point_spread=np.eye(2) * SPREAD_PX**2,
            )
        )
        # Light around sources is kept, the rest is noise of the photograph.
        near = np.zeros(image.shape, np.uint8)
        columns, lines = np.rint(sources.points).astype(int).T
        near[np.clip(lines, 0, rows - 1), np.clip(columns, 0, cols - 1)] = 1
        near = cv2.dilate(near, np.ones((5, 5), np.uint8))
        bright = (removed.residual > 4.0 * removed.noise).astype(np.uint8)
        near |= cv2.dilate(bright, np.ones((3, 3), np.uint8))
        # The trail of a satellite in one photograph does not turn with the stars.
        near[removed.mask == _TRAIL] = 0
        background = image - removed.residual
        return cls(
            camera,
            background,
            np.where(near > 0, removed.residual, 0).astype(np.float32),
            removed.noise,
            lens_error_rad,
        )

    def turned(self, R_0_camera: FloatArray) -> Float32Array:
        """Return the light of the stars seen by a camera turned by ``R_0_camera`` from that of the
        photograph.
        """
        rows, cols = self.light_shape
        # The map is smooth: it is computed at every 32nd pixel.
        u, v = np.arange(0, cols + 32, 32.0), np.arange(0, rows + 32, 32.0)
        grid = np.stack(np.meshgrid(u, v), axis=-1)
        places = self.camera.project(self.camera.rays(grid.reshape(-1, 2)) @ R_0_camera.T).reshape(grid.shape)
        scale = np.array([[1.0 / 32.0, 0.0, 0.0], [0.0, 1.0 / 32.0, 0.0]])
        maps = [
            cv2.warpAffine(
                np.ascontiguousarray(places[..., axis], dtype=np.float32),
                scale,
                (cols, rows),
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            )
            for axis in range(2)
        ]
        return np.asarray(cv2.remap(self.stars, maps[0], maps[1], cv2.INTER_CUBIC), np.float32)

    @property
    def light_shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.camera.rows, self.camera.cols

    def add_source(self, light: Float32Array, pixel: FloatArray, snr: float) -> None:
        """Add a point source at column and row with a signal-to-noise ratio of its total light to
        ``light``.
        """
        rows, cols = light.shape
        if not (8 <= pixel[0] < cols - 8 and 8 <= pixel[1] < rows - 8):
            return
        column, row = np.rint(pixel).astype(int)
        x, y = np.arange(column - 6, column + 7) - pixel[0], np.arange(row - 6, row + 7) - pixel[1]
        shape = np.outer(_pixel_light(y, SPREAD_PX), _pixel_light(x, SPREAD_PX))
        sigma = float(self.noise[row, column])
        light[row - 6 : row + 7, column - 6 : column + 7] += (
            snr * sigma / np.linalg.norm(shape) * shape
        ).astype(np.float32)

    def photograph(self, light: Float32Array, rng: np.random.Generator) -> np.ndarray:
        """Return an image (r, c), uint16 in steps of 16 as of the camera, of the light with new noise."""
        variance = self.noise**2 * (1.0 + np.maximum(light, 0.0) / self.background)
        noise = rng.standard_normal(light.shape, dtype=np.float32) * np.sqrt(variance)
        levels = np.clip(self.background + light + noise, 0, 65535)
        return (np.rint(levels / 16.0) * 16.0).clip(0, 65535).astype(np.uint16)


def pinhole(rows: int, cols: int) -> CameraModel:
    """Return the camera of the photographs without distortion."""
    focal = 0.5 * cols / np.tan(np.radians(0.5 * FIELD_DEG))
    return CameraModel(rows, cols, focal, focal, 0.5 * (cols - 1), 0.5 * (rows - 1))


def calibrated(image: Float32Array) -> tuple[CameraModel, float]:
    """Return the camera of a photograph with focal length and radial distortion by its stars, and the
    standard deviation of the errors of the lens that remain, rad.
    """
    camera = pinhole(*image.shape)
    remove = Registry.default().make_dfn("StarFieldBackground", "TileMedian")
    detect = Registry.default().make_dfn("PointSourceDetection", "MatchedFilter")
    fit = Registry.default().make_dfn("PointSourceCentroiding", "PointSpreadFit")
    identify = Registry.default().make_dfn("StarIdentification", "PairVerification")
    for dfn in (remove, detect, fit, identify):
        dfn.configure()
    spread = np.eye(2) * SPREAD_PX**2
    removed = remove.process(StarFieldBackgroundInputs(image=image, saturation=65535.0))
    star_points = detect.process(
        PointSourceDetectionInputs(
            residual=removed.residual, noise=removed.noise, mask=removed.mask, point_spread=spread
        )
    )
    fitted = fit.process(
        PointSourceCentroidingInputs(
            residual=removed.residual,
            noise=removed.noise,
            points=star_points.points[:80],
            point_spread=spread,
        )
    )
    valid = np.isfinite(fitted.centroids).all(axis=1)
    rays = camera.rays(fitted.centroids[valid])
    stars = identify.process(
        StarIdentificationInputs(
            directions=rays,
            sigmas=np.full(len(rays), 2e-5),
            stamp=PHOTOGRAPH_NS,
            attitude=None,
            attitude_sigma=0.0,
        )
    )
    focal = camera.fx * stars.scale
    matched = stars.stars >= 0
    n = int(matched.sum())
    noise = 0.5 * np.trace(fitted.covariances[valid][matched], axis1=1, axis2=2) / focal**2
    # Five parameters are adjusted to 2 n coordinates.
    excess = 0.5 * stars.residual**2 * 2.0 * n / (2.0 * n - 5.0) - float(noise.mean())
    calibrated_camera = CameraModel(
        camera.rows,
        camera.cols,
        focal,
        focal,
        camera.cx,
        camera.cy,
        (-stars.radial * stars.scale**3, 0.0, 0.0, 0.0),
    )
    return calibrated_camera, float(np.sqrt(max(excess, 0.0)))


def centroid_bound_px(snr: float, spread_px: float = SPREAD_PX, noise_ratio: float = 0.0) -> float:
    """Return the Cramér–Rao bound of a coordinate of a point source, root mean square over the offsets of the
    source from the centre of its pixel.

    The variance of a pixel is that of the background, plus the photon noise of the source as in
    ``StarField.photograph``. Both the mean and the variance of a pixel contain information on the position
    (Kay 1993, Fundamentals of Statistical Signal Processing: Estimation Theory, equation 3.31).

    Parameters
    ----------
    snr : float
        Signal-to-noise ratio of the total light in the noise of the background, fitted at a known position.
    noise_ratio : float
        Standard deviation of the noise of the background, relative to the level of the background; 0 for
        sources without photon noise.
    """
    variances = []
    step_px = 1e-4
    x = np.arange(-12, 13)
    for u in np.linspace(-0.5, 0.5, 11):
        for v in np.linspace(-0.5, 0.5, 11):
            across, down = _pixel_light(x - u, spread_px), _pixel_light(x - v, spread_px)
            slope = (_pixel_light(x - u - step_px, spread_px) - across) / step_px
            shape = np.outer(down, across)
            scale = snr / np.linalg.norm(shape)
            light, by_u = scale * shape, scale * np.outer(down, slope)
            variance = 1.0 + noise_ratio * light
            information = by_u**2 / variance + 0.5 * (noise_ratio * by_u / variance) ** 2
            variances.append(1.0 / information.sum())
    return float(np.sqrt(np.mean(variances)))


def _pixel_light(x: FloatArray, spread_px: float) -> FloatArray:
    """Return the part of the light of a Gaussian in pixels with centres ``x``."""
    from scipy.special import ndtr

    return np.asarray(ndtr((x + 0.5) / spread_px) - ndtr((x - 0.5) / spread_px))


def drift(rng: np.random.Generator, count: int, step_rad: float) -> list[FloatArray]:
    """Return rotations R_0_camera of a camera that turns with a random constant rate and small jitter."""
    direction = rng.normal(size=3) * [1.0, 1.0, 0.3]
    direction *= step_rad / np.linalg.norm(direction[:2])
    jitter = np.cumsum(rng.normal(0.0, 0.1 * step_rad, (count, 3)), axis=0)
    return [np.asarray(se3.exp_so3((i - 0.5 * count) * direction + jitter[i])) for i in range(count)]
