# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Accuracy of products, and the bounds that a request sets on it.

The standard deviation of a pose is that in the worst direction: the root of the largest eigenvalue of the
3x3 covariance of its position or orientation. A trajectory or track has that of its worst pose, an elevation
map the root mean square of its cells. A covariance with unknown elements has an unknown standard deviation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.product import CovarianceKind
from cdff_common.types import ElevationMap, ObjectTrack, PoseTrajectory, TransformWithCovariance

#: Covariance kinds, the weakest first.
_KINDS = (CovarianceKind.NONE, CovarianceKind.FORMAL, CovarianceKind.CALIBRATED)


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Stated accuracy of a product; None is unknown.

    Attributes
    ----------
    sigma_m : float or None
        Standard deviation of the position, or of the elevation, metres.
    sigma_deg : float or None
        Standard deviation of the orientation, degrees.
    covariance_kind : CovarianceKind
    status : str
        OK, DEGRADED or FAILED.
    """

    sigma_m: float | None = None
    sigma_deg: float | None = None
    covariance_kind: CovarianceKind = CovarianceKind.NONE
    status: str = "OK"

    @property
    def text(self) -> str:
        """The known values as one phrase."""
        sigmas = [
            f"{value:.3g} {unit}"
            for value, unit in ((self.sigma_m, "m"), (self.sigma_deg, "deg"))
            if value is not None
        ]
        sigma = f"sigma {' and '.join(sigmas)}" if sigmas else "sigma unknown"
        return f"{sigma}, covariance {self.covariance_kind}, {self.status}"


@dataclass(frozen=True, slots=True)
class AccuracyBounds:
    """Bounds of a request on the accuracy of its product; None is no bound.

    Attributes
    ----------
    sigma_m, sigma_deg : float or None
        Largest standard deviations.
    covariance_kind : CovarianceKind or None
        Weakest kind of covariance.
    status : str or None
        ``OK`` excludes DEGRADED products.
    """

    sigma_m: float | None = None
    sigma_deg: float | None = None
    covariance_kind: CovarianceKind | None = None
    status: str | None = None

    @property
    def is_set(self) -> bool:
        """True if there is a bound."""
        return self != NO_BOUNDS

    def unmet(self, accuracy: Accuracy) -> tuple[str, ...]:
        """Return the bounds that an accuracy does not meet, as texts."""
        texts = []
        for name, limit, value in (
            ("sigma_m", self.sigma_m, accuracy.sigma_m),
            ("sigma_deg", self.sigma_deg, accuracy.sigma_deg),
        ):
            if limit is not None and (value is None or value > limit):
                stated = "unknown" if value is None else f"{value:.3g}"
                texts.append(f"{name}: {stated}, asked at most {limit:g}")
        kind = self.covariance_kind
        if kind is not None and _KINDS.index(accuracy.covariance_kind) < _KINDS.index(kind):
            texts.append(f"covariance_kind: {accuracy.covariance_kind}, asked {kind}")
        if self.status is not None and accuracy.status != self.status:
            texts.append(f"status: {accuracy.status}, asked {self.status}")
        return tuple(texts)

    def has_unknown(self, accuracy: Accuracy) -> bool:
        """Return True if an accuracy does not state a standard deviation that has a bound."""
        pairs = ((self.sigma_m, accuracy.sigma_m), (self.sigma_deg, accuracy.sigma_deg))
        return any(limit is not None and value is None for limit, value in pairs)

    def describe(self) -> dict[str, Any]:
        """Return plain data with the names of the parameters of a request."""
        return {
            "max_sigma_m": self.sigma_m,
            "max_sigma_deg": self.sigma_deg,
            "covariance_kind": None if self.covariance_kind is None else str(self.covariance_kind),
            "status": self.status,
        }


#: The bounds of a request that sets none.
NO_BOUNDS = AccuracyBounds()


def sigmas_of(value: Any) -> tuple[float | None, float | None]:
    """Return the standard deviations of a product: position or elevation, metres; orientation, degrees.

    Parameters
    ----------
    value : UncertainTransform or cdff_common.types object

    Returns
    -------
    sigma_m, sigma_deg : float or None
        None if unknown, or if the product has none.
    """
    function = _SIGMAS.get(type(value))
    return (None, None) if function is None else function(value)


def _of_transform(T: UncertainTransform) -> tuple[float | None, float | None]:
    return (None, None) if T.covariance is None else _of_covariances(np.asarray(T.covariance)[None])


def _of_poses(value: PoseTrajectory | ObjectTrack) -> tuple[float | None, float | None]:
    return _of_covariances(value.data.covariances.reshape(-1, 6, 6))


def _of_elevation(value: ElevationMap) -> tuple[float | None, float | None]:
    variance = np.asarray(value.layer("variance"), dtype=np.float64)
    variance = variance[np.isfinite(value.layer("mean"))]
    if not variance.size or not np.isfinite(variance).all():
        return None, None
    return math.sqrt(float(variance.mean())), None


def _of_covariances(covariances: NDArray[np.float64]) -> tuple[float | None, float | None]:
    """Return the worst standard deviations of poses with covariances ``(n, 6, 6)``."""
    sigma_m, sigma_rad = (_worst_sigma(covariances[:, part, part]) for part in (slice(0, 3), slice(3, 6)))
    return sigma_m, None if sigma_rad is None else math.degrees(sigma_rad)


def _worst_sigma(blocks: NDArray[np.float64]) -> float | None:
    """Return the root of the largest eigenvalue of covariances ``(n, 3, 3)``; None if one is unknown."""
    if not blocks.size or not np.isfinite(blocks).all():
        return None
    return math.sqrt(max(float(np.linalg.eigvalsh(blocks).max()), 0.0))


_SIGMAS: dict[type, Callable[[Any], tuple[float | None, float | None]]] = {
    UncertainTransform: _of_transform,
    TransformWithCovariance: lambda value: _of_transform(value.transform),
    PoseTrajectory: _of_poses,
    ObjectTrack: _of_poses,
    ElevationMap: _of_elevation,
}
#: Product types with a standard deviation of position or elevation, and those with one of the orientation.
SIGMA_M_PRODUCTS = ("pose", "trajectory", "track", "dem")
SIGMA_DEG_PRODUCTS = ("pose", "trajectory", "track")
