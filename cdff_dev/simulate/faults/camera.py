# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Faults of a stereo camera: calibration, rolling shutter, exposure and blur, glare, dust on the lens."""

from __future__ import annotations

import math
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import gaussian_filter

from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import StrictModel
from cdff_dev.simulate.fields import Positive

Float32Array = NDArray[np.float32]


class CalibrationError(StrictModel):
    """Differences between the true and the stated calibration; drawn once for each rover.

    Source: pinhole model with radial distortion, Brown (1966), Decentering distortion of lenses.
    """

    focal_sigma: Annotated[
        float, Field(ge=0, le=0.1, description="focal length of both cameras, relative")
    ] = 0.0
    baseline_sigma: Annotated[float, Field(ge=0, le=0.1, description="baseline, relative")] = 0.0
    principal_point_sigma_px: Annotated[float, Field(ge=0, le=20, description="of each camera, px")] = 0.0
    rotation_sigma_deg: Annotated[
        float, Field(ge=0, le=2, description="right camera relative to the left one, about each axis, °")
    ] = 0.0
    mount_sigma_deg: Annotated[
        float, Field(ge=0, le=10, description="pair in the base, about each axis, °")
    ] = 0.0
    distortion_sigma: Annotated[
        float, Field(ge=0, le=0.2, description="residual k1 of each camera, of normalised coordinates")
    ] = 0.0


class RollingShutter(StrictModel):
    """Rows that are exposed one after another; the stamp is the middle of the exposure of the first row.

    Source: Meingast, Geyer, Sastry (2005), Geometric models of rolling-shutter cameras, arXiv:cs/0503076.
    """

    readout_s: Annotated[float, Field(ge=0, le=0.5, description="from the first to the last row, s")]


class Exposure(StrictModel):
    """Exposure time, which blurs moving images, and wrong exposure, which saturates or darkens them.

    Each pixel is the mean along the path of its point during the exposure, computed from the true motion and
    depth.

    Source: Longuet-Higgins, Prazdny (1980), doi:10.1098/rspb.1980.0057 (image motion).
    """

    time_s: Annotated[float, Field(ge=0, le=0.5, description="exposure time, s")] = 0.0
    stops: Annotated[float, Field(ge=-5, le=5, description="exposure error, powers of two")] = 0.0
    stops_sigma: Annotated[float, Field(ge=0, le=3, description="per pair, powers of two")] = 0.0


class Glare(StrictModel):
    """Veiling glare: sunlight scattered in the lens; its radiance decreases with the square of the angle.

    It occurs if no terrain hides the sun and the sun is within the hood's angle of the optical axis.

    Source: Talvala et al. (2007), Veiling glare in high dynamic range imaging, ACM Transactions on Graphics
    26(3); McCann, Rizzi (2007), Camera and visual veiling glare in HDR images, Journal of the SID 15(9).
    """

    veil: Annotated[float, Field(ge=0, le=10, description="radiance 10° from the sun; sunlit plain: 0.7")]
    hood_deg: Annotated[
        float, Field(gt=0, le=180, description="angle of the sun beyond which there is none, °")
    ] = 80.0


class LensDust(StrictModel):
    """Dust on the front lens: blurred specks that attenuate the image and scatter the light of the sky.

    Positions are drawn once for each camera.

    Source: Willson, Maimone, Johnson, Scherr (2005), An optical model for image artifacts produced by dust
    particles on lenses, i-SAIRAS.
    """

    specks: Annotated[int, Field(ge=0, le=5000, description="number in each image")]
    diameter_px: Annotated[tuple[Positive, Positive], Field(description="smallest and largest diameter, px")]
    attenuation: Annotated[float, Field(ge=0, le=1, description="in the centre of a speck")] = 0.3
    scatter: Annotated[
        float, Field(ge=0, le=1, description="fraction of the lost light that sky light replaces")
    ] = 0.3


class CameraFaults(StrictModel):
    """Faults of the stereo camera."""

    calibration: CalibrationError | None = None
    rolling_shutter: RollingShutter | None = None
    exposure: Exposure | None = None
    glare: Glare | None = None
    dust: LensDust | None = None


#: Largest number of samples of a pixel's path during the exposure.
_BLUR_SAMPLES = 24
#: Angle from the sun below which the veil is constant, degrees.
_SUN_CORE_DEG = 1.0
#: Angle before the edge of the hood in which glare decreases to zero, degrees.
_HOOD_EDGE_DEG = 10.0


def blurred(image: Float32Array, displacement_px: FloatArray) -> Float32Array:
    """Return an image ``(rows, columns)``, averaged along the displacements ``(rows, columns, 2)``."""
    rows, columns = image.shape
    longest = float(np.abs(displacement_px).max(initial=0.0))
    if longest < 0.05:
        return image
    v, u = np.mgrid[0:rows, 0:columns].astype(np.float32)
    d = displacement_px.astype(np.float32)
    n = min(max(2, math.ceil(longest) + 1), _BLUR_SAMPLES)
    total = np.zeros_like(image)
    for fraction in (np.arange(n, dtype=np.float32) + 0.5) / n - 0.5:
        at_u, at_v = u + fraction * d[..., 0], v + fraction * d[..., 1]
        total += cv2.remap(image, at_u, at_v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(total / np.float32(n))


def veil(glare: Glare, directions: FloatArray, axis: FloatArray, sun: FloatArray) -> FloatArray:
    """Return the radiance ``(n,)`` that glare adds to pixels with unit directions ``(n, 3)``.

    Parameters
    ----------
    axis, sun : NDArray[np.float64], shape (3,)
        Unit vectors along the optical axis and towards the sun.
    """
    off_axis = math.degrees(math.acos(float(np.clip(axis @ sun, -1.0, 1.0))))
    entering = float(np.clip((glare.hood_deg - off_axis) / _HOOD_EDGE_DEG, 0.0, 1.0))
    angle = np.degrees(np.arccos(np.clip(directions @ sun, -1.0, 1.0)))
    return np.asarray(glare.veil * entering * (10.0 / np.maximum(angle, _SUN_CORE_DEG)) ** 2)


def dust_map(dust: LensDust, rows: int, columns: int, rng: np.random.Generator) -> Float32Array:
    """Return the fraction of the light ``(rows, columns)`` that dust removes."""
    transmission = np.ones((rows, columns), dtype=np.float32)
    v, u = np.mgrid[0:rows, 0:columns].astype(np.float32)
    for _ in range(dust.specks):
        centre_u, centre_v = rng.uniform(0.0, columns), rng.uniform(0.0, rows)
        radius = 0.5 * math.exp(rng.uniform(*np.log(dust.diameter_px)))
        rise = np.clip(1.5 - np.hypot(u - centre_u, v - centre_v) / radius, 0.0, 1.0)
        transmission *= (1.0 - dust.attenuation * rise).astype(np.float32)
    return np.asarray(1.0 - gaussian_filter(transmission, 1.0, mode="nearest"), dtype=np.float32)
