# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of features and correspondences: conversion from and to columns."""

from __future__ import annotations

from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.types.message import Message, check_columns
from cdff_common.types.validation import read_only


def _rows(values: ArrayLike, columns: int) -> NDArray[np.float64]:
    return np.asarray(values, dtype=np.float64).reshape(-1, columns)


def _stack(rows: list[NDArray[np.float64]], columns: int) -> NDArray[np.float64]:
    return np.stack(rows) if rows else np.zeros((0, columns))


def _descriptor_columns(where: str, rows: list[NDArray[np.float64]]) -> NDArray[np.float32]:
    """Return the descriptors ``(n, d)``; raises InputError if they differ in length."""
    sizes = {len(row) for row in rows}
    if len(sizes) > 1:
        raise InputError(f"{where}: descriptors of {min(sizes)} to {max(sizes)} numbers, expected one length")
    return np.array(rows, dtype=np.float32).reshape(len(rows), -1) if rows else np.zeros((0, 0), np.float32)


def _descriptor_rows(where: str, descriptors: ArrayLike | None, rows: int) -> NDArray[np.float64]:
    if descriptors is None:
        return np.zeros((rows, 0))
    array = np.asarray(descriptors, dtype=np.float64)
    if array.ndim != 2:
        raise InputError(f"{where}: descriptors of shape {array.shape}, expected (n, d)")
    check_columns(where, rows, {"descriptors": array})
    return array


def _checked_pair(
    pair: Any, source: NDArray[np.float64], sink: NDArray[np.float64], probability: float
) -> Any:
    """Return a pair of finite, read-only points without the validation of each field, which takes longer."""
    item = object.__new__(pair)
    object.__setattr__(item, "source", source)
    object.__setattr__(item, "sink", sink)
    object.__setattr__(item, "probability", probability)
    return item


class _CorrespondenceMapExt(Message):
    """Pairs of points; the dimension is that of the subclass."""

    __slots__ = ()
    items: tuple[Any, ...]

    @classmethod
    def _from_columns(
        cls, pair: Any, columns: int, sources: ArrayLike, sinks: ArrayLike, probabilities: ArrayLike | None
    ) -> Self:
        """Return the correspondences of rows of coordinates; without probabilities they are 1."""
        a, b = _rows(sources, columns), _rows(sinks, columns)
        p = (
            np.ones(len(a))
            if probabilities is None
            else np.asarray(probabilities, dtype=np.float64).reshape(-1)
        )
        check_columns(cls.__name__, len(a), {"sinks": b, "probabilities": p})
        if not (np.isfinite(a).all() and np.isfinite(b).all() and np.isfinite(p).all()):
            return cls(tuple(pair(a[i], b[i], p[i]) for i in range(len(a))))  # type: ignore[call-arg]
        rows = zip(read_only(a), read_only(b), p.tolist(), strict=True)
        return cls(tuple(_checked_pair(pair, *row) for row in rows))  # type: ignore[call-arg]

    @property
    def probabilities(self) -> NDArray[np.float64]:
        """``(n,)``, 0 to 1."""
        return np.array([item.probability for item in self.items], dtype=np.float64)


class CorrespondenceMap2DExt(_CorrespondenceMapExt):
    """Pairs of points in two images."""

    __slots__ = ()
    items: tuple[types.Correspondence2D, ...]

    @classmethod
    def from_arrays(
        cls, sources_px: ArrayLike, sinks_px: ArrayLike, probabilities: ArrayLike | None = None
    ) -> Self:
        """Return the map of ``n`` pairs: points ``(n, 2)`` of each image, probabilities ``(n,)``, by default
        1.
        """
        return cls._from_columns(types.Correspondence2D, 2, sources_px, sinks_px, probabilities)

    @property
    def sources_px(self) -> NDArray[np.float64]:
        """Points of the first image ``(n, 2)``."""
        return _stack([item.source for item in self.items], 2)

    @property
    def sinks_px(self) -> NDArray[np.float64]:
        """Points of the second image ``(n, 2)``."""
        return _stack([item.sink for item in self.items], 2)


class CorrespondenceMap3DExt(_CorrespondenceMapExt):
    """Pairs of points in two clouds."""

    __slots__ = ()
    items: tuple[types.Correspondence3D, ...]

    @classmethod
    def from_arrays(
        cls, sources_m: ArrayLike, sinks_m: ArrayLike, probabilities: ArrayLike | None = None
    ) -> Self:
        """Return the map of ``n`` pairs: points ``(n, 3)`` of each cloud, probabilities ``(n,)``, by default
        1.
        """
        return cls._from_columns(types.Correspondence3D, 3, sources_m, sinks_m, probabilities)

    @property
    def sources_m(self) -> NDArray[np.float64]:
        """Points of the first cloud ``(n, 3)``, in its frame."""
        return _stack([item.source for item in self.items], 3)

    @property
    def sinks_m(self) -> NDArray[np.float64]:
        """Points of the second cloud ``(n, 3)``, in its frame."""
        return _stack([item.sink for item in self.items], 3)


class VisualPointFeatureVector2DExt(Message):
    """Points of an image with descriptors."""

    __slots__ = ()
    items: tuple[types.VisualPointFeature2D, ...]

    @classmethod
    def from_arrays(
        cls, points_px: ArrayLike, descriptors: ArrayLike | None = None
    ) -> types.VisualPointFeatureVector2D:
        """Return features at ``(n, 2)`` with descriptors ``(n, d)``, d at most 128."""
        points = _rows(points_px, 2)
        rows = _descriptor_rows("VisualPointFeatureVector2D", descriptors, len(points))
        return types.VisualPointFeatureVector2D(tuple(map(types.VisualPointFeature2D, points, rows)))

    @property
    def points_px(self) -> NDArray[np.float64]:
        """Points ``(n, 2)``."""
        return _stack([item.point for item in self.items], 2)

    @property
    def descriptors(self) -> NDArray[np.float32]:
        """Return the descriptors ``(n, d)``; raises InputError if they differ in length."""
        return _descriptor_columns("VisualPointFeatureVector2D", [item.descriptor for item in self.items])


class VisualPointFeatureVector3DExt(Message):
    """Points of a cloud with descriptors; a point is a position, or a reference into a cloud."""

    __slots__ = ()
    list: tuple[types.VisualPointFeature3D, ...]

    @classmethod
    def from_arrays(
        cls,
        points_m: ArrayLike,
        descriptors: ArrayLike | None = None,
        feature_type: types.VisualPointFeature3DType | int = 0,
    ) -> types.VisualPointFeatureVector3D:
        """Return features at ``(n, 3)`` with descriptors ``(n, d)``, d at most 352."""
        points = _rows(points_m, 3)
        rows = _descriptor_rows("VisualPointFeatureVector3D", descriptors, len(points))
        features = tuple(
            types.VisualPointFeature3D(types.VisualPointFeature3DPoint("position", p), d)
            for p, d in zip(points, rows, strict=True)
        )
        return types.VisualPointFeatureVector3D(
            features, feature_type=types.VisualPointFeature3DType(feature_type)
        )

    @property
    def points_m(self) -> NDArray[np.float64]:
        """Positions ``(n, 3)``; NaN for a feature that refers to a cloud."""
        unknown = np.full(3, np.nan)
        positions = [item.point.value if item.point.kind == "position" else unknown for item in self.list]
        return _stack([np.asarray(row, dtype=np.float64) for row in positions], 3)

    @property
    def descriptors(self) -> NDArray[np.float32]:
        """Return the descriptors ``(n, d)``; raises InputError if they differ in length."""
        return _descriptor_columns("VisualPointFeatureVector3D", [item.descriptor for item in self.list])
