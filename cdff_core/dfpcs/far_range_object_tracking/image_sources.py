# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sources of one image: detected, fitted, and the point spread that bright stars show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import BoolArray, Float32Array, FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import Frame, FrameModeT, ObjectDetection
from cdff_core.dfns.point_source_centroiding.interface import PointSourceCentroidingInputs
from cdff_core.dfns.point_source_detection.interface import PointSourceDetectionInputs
from cdff_core.dfns.star_field_background.interface import (
    StarFieldBackgroundInputs,
    StarFieldBackgroundOutputs,
)

#: Range of signal-to-noise ratios of the stars from which the point spread is measured, least number of
#: these stars, and gain of one image in the mean.
_SPREAD_SNR, _SPREAD_STARS, _SPREAD_GAIN = (20.0, 300.0), 4, 0.3
#: Ratio of the axes of the point spread above which the image is smeared.
_SMEARED = 1.5
#: Weights of red, green and blue, ITU-R BT.601-7 §2.5.1.
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)
#: Distance below which two sources are the same, pixels.
_SAME_PX = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class ImageSources:
    """Sources of an image, brightest first.

    Attributes
    ----------
    pixels, covariances : ndarray (n, 2), (n, 2, 2)
        Column and row, and their covariance.
    snr : ndarray (n,)
    evidence : ndarray (n,)
        Evidence of a defect, see MultiTargetAssociation.
    is_defect, is_extended, is_weak : ndarray of bool (n,)
        Light in a single pixel; larger than a point; found near a predicted position only.
    boxes : ndarray (n, 4)
        First and last column, first and last row of an extended source.
    """

    pixels: FloatArray
    covariances: FloatArray
    snr: FloatArray
    evidence: FloatArray
    is_defect: BoolArray
    is_extended: BoolArray
    is_weak: BoolArray
    boxes: FloatArray

    def __len__(self) -> int:
        return len(self.pixels)

    def selected(self, indices: IntArray | BoolArray) -> ImageSources:
        """Return the chosen sources."""
        return ImageSources(*[getattr(self, name)[indices] for name in self.__dataclass_fields__])

    @classmethod
    def joined(cls, first: ImageSources, second: ImageSources) -> ImageSources:
        """Return the sources of both."""
        names = cls.__dataclass_fields__
        return cls(*[np.concatenate([getattr(first, n), getattr(second, n)]) for n in names])

    @property
    def sigmas_px(self) -> FloatArray:
        """Standard deviation of each centroid along an axis, shape (n,)."""
        return np.asarray(np.sqrt(0.5 * np.trace(self.covariances, axis1=1, axis2=2)))


class SourceExtractor:
    """Extraction of the sources of the images of one camera.

    Parameters
    ----------
    background, detect, detect_weak, centroid : Dfn
        DFNs of the slots.
    point_spread_px : float
        Initial standard deviation of the point spread.
    saturation_dn : float
        Grey level from which a pixel is saturated; 0 for the largest of the pixel type.
    """

    def __init__(
        self,
        background: Dfn,  # type: ignore[type-arg]
        detect: Dfn,  # type: ignore[type-arg]
        detect_weak: Dfn,  # type: ignore[type-arg]
        centroid: Dfn,  # type: ignore[type-arg]
        point_spread_px: float,
        saturation_dn: float,
    ) -> None:
        self._background, self._detect = background, detect
        self._detect_weak, self._centroid = detect_weak, centroid
        self._saturation_dn = saturation_dn
        self.point_spread = np.eye(2) * point_spread_px**2
        self.image: StarFieldBackgroundOutputs | None = None

    @property
    def is_smeared(self) -> bool:
        """True if the stars are drawn out in one direction."""
        low, high = np.linalg.eigvalsh(self.point_spread)
        return bool(high > _SMEARED**2 * low)

    def extract(self, frame: Frame) -> ImageSources:
        """Return the sources of an image.

        Raises
        ------
        InputError, RefusedError
            If the image cannot be used.
        """
        image, saturation = linear_grey(frame)
        self.image = None
        self.image = self._background.process(
            StarFieldBackgroundInputs(image=image, saturation=self._saturation_dn or saturation)
        )
        detections = self._detect.process(
            PointSourceDetectionInputs(
                residual=self.image.residual,
                noise=self.image.noise,
                mask=self.image.mask,
                point_spread=self.point_spread,
            )
        )
        sources = self._fit_sources(
            detections.points,
            detections.snr,
            detections.is_extended,
            detections.boxes,
            np.zeros((2,), np.int64),
        )
        usable = ~detections.is_trail & np.isfinite(sources.pixels).all(axis=1)
        return sources.selected(np.asarray(usable))

    def weak_sources(self, position_px: FloatArray, reach_px: float, known: FloatArray) -> ImageSources:
        """Return the weak sources within a distance of an image position (2,), without sources at ``known``
        positions (n, 2).
        """
        image = self.image
        assert image is not None
        rows, cols = image.residual.shape
        margin = reach_px + 4.0
        first = np.maximum(np.floor(position_px - margin), 0).astype(int)
        last = np.minimum(np.ceil(position_px + margin), [cols - 1, rows - 1]).astype(int)
        if np.any(last - first < 6):
            return _no_sources()
        window = (slice(first[1], last[1] + 1), slice(first[0], last[0] + 1))
        detections = self._detect_weak.process(
            PointSourceDetectionInputs(
                residual=image.residual[window],
                noise=image.noise[window],
                mask=image.mask[window],
                point_spread=self.point_spread,
            )
        )
        points = detections.points + first
        is_near = np.linalg.norm(points - position_px, axis=1) < reach_px
        is_near &= ~detections.is_trail & ~detections.is_extended
        if len(known) and is_near.any():
            distances = np.linalg.norm(points[:, None] - known, axis=2).min(axis=1)
            is_near &= distances > _SAME_PX
        sources = self._fit_sources(
            points[is_near],
            detections.snr[is_near],
            detections.is_extended[is_near],
            detections.boxes[is_near],
            first,
            is_weak=True,
        )
        return sources.selected(np.asarray(np.isfinite(sources.pixels).all(axis=1)))

    def _fit_sources(
        self,
        points: FloatArray,
        snr: FloatArray,
        is_extended: BoolArray,
        boxes: FloatArray,
        origin: IntArray,
        *,
        is_weak: bool = False,
    ) -> ImageSources:
        """Return the sources at points (n, 2): point sources fitted, extended ones with their centroid of
        light.
        """
        image = self.image
        assert image is not None
        fit = self._centroid.process(
            PointSourceCentroidingInputs(
                residual=image.residual, noise=image.noise, points=points, point_spread=self.point_spread
            )
        )
        if not is_weak:
            self._learn_point_spread(fit.spreads, fit.snr, is_extended | fit.is_single_pixel)
        pixels, covariances = fit.centroids.copy(), fit.covariances.copy()
        shifted = boxes + np.repeat(origin, 2)
        # The centroid of the light of an extended source; its error is that of the light within its box.
        size = np.maximum(np.ptp(shifted.reshape(-1, 2, 2), axis=2) + 1.0, 1.0)
        pixels[is_extended] = points[is_extended]
        covariances[is_extended] = np.einsum("ni,ij->nij", (0.02 * size[is_extended]) ** 2 + 0.01, np.eye(2))
        ratio = np.where(is_extended, snr, fit.snr)
        return ImageSources(
            pixels=pixels,
            covariances=covariances,
            snr=np.nan_to_num(ratio, nan=0.0),
            evidence=np.where(is_extended, -25.0, np.nan_to_num(fit.defect_evidence, nan=0.0)),
            is_defect=fit.is_single_pixel & ~is_extended,
            is_extended=is_extended,
            is_weak=np.full(len(points), is_weak),
            boxes=shifted,
        )

    def _learn_point_spread(self, spreads: FloatArray, snr: FloatArray, excluded: BoolArray) -> None:
        """Move the point spread towards the median point spread of bright stars; it is round unless the
        image is smeared.
        """
        is_star = (
            (snr > _SPREAD_SNR[0]) & (snr < _SPREAD_SNR[1]) & ~excluded & np.isfinite(spreads).all(axis=1)
        )
        if is_star.sum() < _SPREAD_STARS:
            return
        uu, uv, vv = np.median(spreads[is_star], axis=0)
        measured_spread = np.array([[uu, uv], [uv, vv]])
        low, high = np.linalg.eigvalsh(measured_spread)
        if low < 0.04:
            return
        if high < _SMEARED**2 * low:
            measured_spread = np.diag([uu, vv])
        is_first = np.allclose(self.point_spread, self.point_spread[0, 0] * np.eye(2))
        gain = 1.0 if is_first or high > _SMEARED**2 * low else _SPREAD_GAIN
        self.point_spread = self.point_spread + gain * (measured_spread - self.point_spread)


def linear_grey(frame: Frame) -> tuple[Float32Array, float]:
    """Return the grey levels (r, c) of an image and the largest value of its pixel type.

    Raises
    ------
    InputError
        If the colour order is not known, or levels are not finite.
    """
    image = frame.image
    limit = float(np.iinfo(image.dtype).max) if image.dtype.kind in "ui" else float("inf")
    if image.ndim == 3:
        if frame.metadata.mode not in (FrameModeT.MODE_RGB, FrameModeT.MODE_BGR):
            raise InputError(
                f"image {image.shape} in mode {frame.metadata.mode.name}: expected GRAY, RGB or BGR"
            )
        weights = _LUMA if frame.metadata.mode is FrameModeT.MODE_RGB else _LUMA[::-1]
        grey = np.asarray(image.astype(np.float32) @ weights, np.float32)
    else:
        grey = np.asarray(image, np.float32)
    if image.dtype.kind == "f" and not np.isfinite(grey).all():
        raise InputError(f"image {image.shape}: expected finite grey levels")
    return grey, limit


def _no_sources() -> ImageSources:
    none = np.zeros(0, bool)
    return ImageSources(
        np.zeros((0, 2)), np.zeros((0, 2, 2)), np.zeros(0), np.zeros(0), none, none, none, np.zeros((0, 4))
    )


def source_detection(sources: ImageSources, index: int, number: int) -> ObjectDetection:
    """Return the detection of a source; the box of a point has the width of its error."""
    if sources.is_extended[index]:
        first_u, last_u, first_v, last_v = sources.boxes[index]
        box = np.array([first_u, first_v, last_u - first_u + 1.0, last_v - first_v + 1.0])
    else:
        box = np.array([*(sources.pixels[index] - 1.5), 3.0, 3.0])
    score = 1.0 - float(np.exp(-0.5 * min(sources.snr[index], 30.0) ** 2))
    return ObjectDetection(label=f"object {number}", score=score, image_box=box)
