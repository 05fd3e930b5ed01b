# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of a product's metadata: to and from the header that travels with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import Box, Message
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.interfaces.product import Header
    from cdff_common.types.product import ProductMetadata, ProductQuality

#: In the order of ``Product-status-t`` and ``Product-covarianceKind-t``.
_STATUSES = ("OK", "DEGRADED", "FAILED")
_KINDS = ("none", "formal", "calibrated")


class ProductMetadataExt(Message):
    """The header of a product, with what a store knows of it."""

    __slots__ = ()
    if TYPE_CHECKING:
        id: str
        seq: int
        size: int
        sha256: str
        start_time: Time
        end_time: Time
        frame_id: str
        child_frame_id: str
        producer_id: str
        config_hash: str
        inputs: tuple[str, ...]
        quality: ProductQuality
        has_box: bool
        box: NDArray[np.float64]
        resolution: float

    @classmethod
    def from_header(
        cls, header: Header, *, robot: str, dfpc: str, port: str, product: str, encoding: str, size: int
    ) -> ProductMetadata:
        """Metadata of a product of ``size`` octets in ``encoding``."""
        from cdff_common.types.product import ProductMetadata, ProductMetricT, ProductQuality

        quality = ProductQuality(
            status=_STATUSES.index(header.quality.status.value),  # type: ignore[arg-type]  # the class takes its number
            reasons=header.quality.reasons,
            covariance_kind=_KINDS.index(header.quality.covariance_kind.value),  # type: ignore[arg-type]
            metrics=tuple(ProductMetricT(k, float(v)) for k, v in sorted(header.quality.metrics.items())),
        )
        return ProductMetadata(
            id=header.id, robot=robot, dfpc=dfpc, port=port, product=product, encoding=encoding, size=size,
            sha256=header.sha256 or "", seq=header.seq, start_time=Time.from_ns(header.t0_ns),
            end_time=Time.from_ns(header.t1_ns), frame_id=header.frame, child_frame_id=header.child or "",
            producer_id=header.producer, config_hash=header.config_hash, inputs=header.inputs, quality=quality,
            has_box=header.box_m is not None, box=np.array(header.box_m or (0.0,) * 6),
            resolution=header.resolution_m or 0.0,
        )  # fmt: skip

    @property
    def header(self) -> Header:
        """The header; raises InputError where its fields are no such."""
        from cdff_common.interfaces.product import CovarianceKind, Header, Quality, Status

        quality = Quality(
            Status(_STATUSES[self.quality.status]),
            self.quality.reasons,
            CovarianceKind(_KINDS[self.quality.covariance_kind]),
            {m.name: m.value for m in self.quality.metrics},
        )
        return Header(
            id=self.id, seq=self.seq, t0_ns=self.start_time.ns, t1_ns=self.end_time.ns, frame=self.frame_id,
            child=self.child_frame_id or None, producer=self.producer_id, config_hash=self.config_hash,
            inputs=self.inputs, quality=quality, box_m=self.extent_m(), resolution_m=self.resolution or None,
            sha256=self.sha256 or None,
        )  # fmt: skip

    @property
    def stamp_ns(self) -> int:
        """End of capture, nanoseconds."""
        return self.end_time.ns

    def extent_m(self) -> Box | None:
        """The stated box; None where there is none."""
        if not self.has_box:
            return None
        b = [float(v) for v in self.box]
        return (b[0], b[1], b[2], b[3], b[4], b[5])
