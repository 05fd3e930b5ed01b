# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensor that explains the disagreements: each one in turn is assumed to be wrong and all others right."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cdff_common.geometry.se3 import FloatArray
from cdff_core.consistency.moments import Moments, fitted_rotation, rotation_information
from cdff_core.consistency.motion_agreement import CORRELATION, OFFSETS_S, OffsetLikelihood

#: Difference of the logarithms of the likelihoods of two sensors below which both are named.
_DECISIVE = 5.0
_EYE = np.eye(3)


@dataclass(frozen=True, slots=True, eq=False)
class PairGroups:
    """Moments of a pair of streams at its offset; the rotation maps base axes by second to those by first."""

    first: str
    second: str
    groups: tuple[Moments, ...]


@dataclass(frozen=True, slots=True, eq=False)
class RotationSuspects:
    """Sensors whose mount is probably wrong.

    Attributes
    ----------
    sensors : tuple of str
        The most likely one first; more than one if the data do not distinguish them.
    rotation : ndarray, shape (3, 3)
        Rotation from base axes by the stated mount of the first one to the base.
    covariance : ndarray, shape (3, 3)
        Covariance of the rotation in base axes, rad².
    """

    sensors: tuple[str, ...]
    rotation: FloatArray
    covariance: FloatArray


class _RotationFit(NamedTuple):
    gain: float  # of the log likelihood by the rotation
    sensor: str
    rotation: FloatArray
    covariance: FloatArray


class _OffsetFit(NamedTuple):
    log_likelihood: float
    stream: str
    offset_s: float
    sigma_s: float


def rotation_suspects(
    candidates: Sequence[str], pairs: Sequence[PairGroups], verticals: Mapping[str, Moments]
) -> RotationSuspects | None:
    """Return the sensors whose rotation explains the data best; None without any data about them.

    Parameters
    ----------
    candidates : sequence of str
        Sensors whose mount may be wrong; wheels define the base.
    pairs : sequence of PairGroups
    verticals : mapping of str to Moments
        Verticals by sensors.
    """
    fits: list[_RotationFit] = []
    for sensor in candidates:
        groups = _groups_of(sensor, pairs, verticals)
        if not groups:
            continue
        stacked = tuple(_stack_offsets(group) for group in groups)
        R = fitted_rotation(stacked)[0]
        gain = sum(float(group.log_likelihood(R) - group.log_likelihood(_EYE)) for group in groups)
        information = rotation_information(groups, R) / CORRELATION
        covariance = np.linalg.inv(information + 1e-2 * _EYE).astype(np.float64)
        fits.append(_RotationFit(gain / CORRELATION, sensor, R, covariance))
    if not fits:
        return None
    fits.sort(key=lambda fit: -fit.gain)
    best = fits[0]
    names = tuple(fit.sensor for fit in fits if fit.gain > max(best.gain - _DECISIVE, 0.0))
    return RotationSuspects(names or (best.sensor,), best.rotation, best.covariance)


def offset_suspects(
    streams: Sequence[str], likelihoods: Sequence[OffsetLikelihood], limit_s: float
) -> tuple[tuple[str, ...], float, float]:
    """Return the streams whose clock offset explains the data, the offset and its sigma, seconds."""
    within = np.abs(OFFSETS_S) <= limit_s + 1e-9
    fits: list[_OffsetFit] = []
    for stream in streams:
        total = np.zeros(len(OFFSETS_S))
        for pair in likelihoods:
            if stream == pair.second:
                total += pair.values
            elif stream == pair.first:
                total += pair.values[::-1]
            else:
                total += pair.values[within].max()
        weight = np.exp(total - total.max())
        weight /= weight.sum()
        mean_s = float(weight @ OFFSETS_S)
        sigma_s = float(np.sqrt(weight @ (OFFSETS_S - mean_s) ** 2))
        fits.append(_OffsetFit(float(total.max()), stream, mean_s, sigma_s))
    fits.sort(key=lambda fit: -fit.log_likelihood)
    best = fits[0]
    names = tuple(fit.stream for fit in fits if fit.log_likelihood > best.log_likelihood - _DECISIVE)
    return names, best.offset_s, best.sigma_s


def _groups_of(
    sensor: str, pairs: Sequence[PairGroups], verticals: Mapping[str, Moments]
) -> tuple[Moments, ...]:
    """Return the groups with the vectors of a sensor as b."""
    groups: list[Moments] = []
    for pair in pairs:
        if pair.second == sensor:
            groups += pair.groups
        elif pair.first == sensor:
            groups += [group.swapped() for group in pair.groups]
    if sensor in verticals:
        groups.append(verticals[sensor])
    return tuple(groups)


def _stack_offsets(group: Moments) -> Moments:
    """Return a group as one of a single time offset."""
    return Moments(group.n, group.aa[None], group.ab[None], group.bb[None], group.axes, group.floor)
