# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reference cloud, with which other clouds are registered."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, Protocol, TypeVar

from cdff_common.errors import InputError, RefusedError
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfpc import Sample
from cdff_common.types import Pointcloud


class PreparedCloud(Protocol):
    """Cloud prepared for registration."""

    @property
    def points_m(self) -> FloatArray:
        """Points (n, 3)."""


PreparedT = TypeVar("PreparedT", bound=PreparedCloud)


class ReferenceCloud(Generic[PreparedT]):
    """A reference cloud, prepared once, and the sample that waits for the first reference.

    Parameters
    ----------
    prepare : callable
        Returns the prepared cloud of a sample; raises InputError.
    """

    def __init__(self, prepare: Callable[[Sample], PreparedT]) -> None:
        self._prepare = prepare
        self.clear()

    def clear(self) -> None:
        """Remove the reference and the waiting sample."""
        self.sample: Sample | None = None
        self.waiting: Sample | None = None
        self._prepared: PreparedT | None = None
        self._fault = ""

    @property
    def frame(self) -> str:
        """Frame of the reference; empty without one."""
        return "" if self.sample is None else self.sample.value.frame

    @property
    def id(self) -> str:
        """Id of the reference's sample; empty without a reference."""
        return "" if self.sample is None else self.sample.id

    def replace(self, sample: Sample) -> Sample | None:
        """Prepare a new reference; return the sample that waited for it."""
        self.sample, self._prepared = sample, None
        try:
            self._prepared = self._prepare(sample)
        except InputError as error:
            self._fault = f"bad_{sample.port}:{error}"
        waiting, self.waiting = self.waiting, None
        return waiting

    def prepared(self) -> PreparedT:
        """Return the prepared cloud; raises RefusedError if it could not be prepared."""
        if self._prepared is None:
            raise RefusedError(self._fault, [self._fault])
        return self._prepared

    def cloud(self) -> Pointcloud | None:
        """Return the prepared points; None without them."""
        if self.sample is None or self._prepared is None:
            return None
        return Pointcloud.from_points(
            self._prepared.points_m, frame=self.frame, stamp_ns=self.sample.stamp_ns
        )
