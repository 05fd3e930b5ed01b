# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faults of a spinning lidar: calibration, beam width with mixed pixels, range walk, and dust."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import StrictModel


class RingOffsets(StrictModel):
    """Constant errors of each ring, drawn once for each lidar.

    Source: Glennie, Lichti (2010), Static calibration and analysis of the Velodyne HDL-64E S2,
    doi:10.3390/rs2061610.
    """

    range_sigma_m: Annotated[float, Field(ge=0, le=0.5, description="m")] = 0.0
    elevation_sigma_deg: Annotated[float, Field(ge=0, le=2, description="°")] = 0.0


class MountError(StrictModel):
    """Difference between the true and the stated pose of the lidar in the base, drawn once.

    Source: residual of an extrinsic calibration.
    """

    rotation_sigma_deg: Annotated[float, Field(ge=0, le=10, description="about each axis, °")] = 0.0
    translation_sigma_m: Annotated[float, Field(ge=0, le=0.5, description="along each axis, m")] = 0.0


class BeamWidth(StrictModel):
    """A beam with a Gaussian profile: seven rays, whose echoes are summed.

    Echoes from surfaces closer together than the range resolution are one echo: its range is the mean,
    weighted by the received power, and lies between the surfaces (a mixed pixel). Of separate echoes, the
    stronger one is measured.

    Source: Hebert, Krotkov (1992), 3D measurements from imaging laser radars: how good are they?,
    Image and Vision Computing 10(3).
    """

    divergence_mrad: Annotated[float, Field(gt=0, le=50, description="full angle at 1/e² of the power, mrad")]
    resolution_m: Annotated[float, Field(gt=0, description="smallest distance of separate echoes, m")] = 0.5


class RangeWalk(StrictModel):
    """Range error by signal power: a weak echo crosses the threshold of the receiver later.

    The leading edge is linear. The lidar is calibrated on a perpendicular target of reflectance 0.6 at the
    reference range, where the error is zero; echoes below the threshold are lost.

    Source: Amann et al. (2001), Laser ranging: a critical review of usual techniques for distance
    measurement, Optical Engineering 40(1).
    """

    rise_m: Annotated[float, Field(ge=0, description="length of the leading edge (c/2 times rise time), m")]
    threshold: Annotated[
        float, Field(gt=0, lt=1, description="power relative to a white target at the reference range")
    ]
    reference_m: Annotated[float, Field(gt=0, description="reference range, m")] = 10.0


class DustPlume(StrictModel):
    """A plume of dust that the wheels raise, fixed relative to the rover.

    A beam returns from the plume with exponentially distributed depth: in a dense plume at its leading edge.

    Source: Phillips, Guenther, McAree (2017), When the dust settles, doi:10.1002/rob.21701.
    """

    returns_per_m: Annotated[float, Field(ge=0, description="rate of returns along a beam in the plume, 1/m")]
    from_m: Annotated[float, Field(ge=0, description="nearest distance of the plume, m")] = 1.0
    to_m: Annotated[float, Field(gt=0, description="farthest distance of the plume, m")] = 6.0
    azimuth_deg: Annotated[float, Field(description="direction of the plume in the lidar frame, °")] = 180.0
    width_deg: Annotated[float, Field(gt=0, le=360, description="angular width of the plume, °")] = 90.0

    @model_validator(mode="after")
    def _check_distances(self) -> DustPlume:
        if self.to_m <= self.from_m:
            raise ValueError(f"to_m {self.to_m}: expected more than from_m {self.from_m}")
        return self


class LidarFaults(StrictModel):
    """Faults of the lidar."""

    rings: RingOffsets | None = None
    mount: MountError | None = None
    beam: BeamWidth | None = None
    range_walk: RangeWalk | None = None
    dust: DustPlume | None = None


#: Rays of a beam: the axis and six at this fraction of the radius of the beam.
_RING_FRACTION = 0.7
_RING_WEIGHT = math.exp(-2.0 * _RING_FRACTION**2)
#: Reflectance of the target on which the lidar was calibrated.
_CALIBRATION_REFLECTANCE = 0.6
#: Reflectance that a return from dust has.
DUST_REFLECTANCE = 0.05


def beam_offsets(beam: BeamWidth | None) -> tuple[FloatArray, FloatArray]:
    """Return the angles ``(k, 2)`` of the rays of a beam from its axis, radians, and weights ``(k,)``."""
    if beam is None:
        return np.zeros((1, 2)), np.ones(1)
    phase = np.arange(6) * math.pi / 3.0
    radius = 0.5e-3 * beam.divergence_mrad * _RING_FRACTION
    ring = radius * np.column_stack([np.cos(phase), np.sin(phase)])
    weights = np.array([1.0, *[_RING_WEIGHT] * 6])
    return np.concatenate([np.zeros((1, 2)), ring]), weights / weights.sum()


def echo(beam: BeamWidth | None, range_m: FloatArray, power: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return range and power of the measured echo of each beam.

    Parameters
    ----------
    range_m, power : NDArray[np.float64], shape (k, ...)
        Range of each ray, infinite without a hit, and received power.

    Returns
    -------
    tuple of NDArray[np.float64], shape (...)
        The range is infinite and the power zero if no ray hits a surface.
    """
    if beam is None:
        return range_m[0], power[0]
    hit = np.isfinite(range_m)
    first = hit & (range_m - np.where(hit.any(axis=0), range_m.min(axis=0), 0.0) <= beam.resolution_m)
    echoes = np.stack([first, hit & ~first]) * np.where(hit, power, 0.0)
    total = echoes.sum(axis=1)
    stronger = total.argmax(axis=0)[None]
    received = np.take_along_axis(total, stronger, axis=0)[0]
    weighted = (echoes * np.where(hit, range_m, 0.0)).sum(axis=1)
    mean = np.take_along_axis(weighted, stronger, axis=0)[0] / np.where(received > 0, received, 1.0)
    return np.where(received > 0, mean, np.inf), received


def walk(model: RangeWalk, range_m: FloatArray, power: FloatArray) -> FloatArray:
    """Return ranges with the error of the walk; infinite where the echo is below the threshold.

    Parameters
    ----------
    power : NDArray[np.float64]
        Reflectance times cosine of incidence, without the decrease with range.
    """
    amplitude = power * (model.reference_m / np.maximum(range_m, 1e-3)) ** 2
    error = (
        model.rise_m * model.threshold * (1.0 / np.maximum(amplitude, 1e-9) - 1.0 / _CALIBRATION_REFLECTANCE)
    )
    return np.where(amplitude > model.threshold, range_m + error, np.inf)


def dust_ranges(
    model: DustPlume, azimuth_rad: FloatArray, shape: tuple[int, ...], rng: np.random.Generator
) -> FloatArray:
    """Return the range at which dust returns each beam, array of ``shape``; infinite for beams without such a
    return.

    Parameters
    ----------
    azimuth_rad : NDArray[np.float64], broadcastable to shape
        Azimuth of the beams in the lidar frame.
    """
    rate = max(model.returns_per_m, 1e-12)
    range_m = model.from_m + rng.exponential(1.0 / rate, shape)
    off = np.abs(np.angle(np.exp(1j * (azimuth_rad - math.radians(model.azimuth_deg)))))
    inside: NDArray[np.bool_] = (off <= math.radians(0.5 * model.width_deg)) & (range_m < model.to_m)
    return np.where(inside, range_m, np.inf)
