# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/product.asn by cdff generate; do not edit.

"""Types of ``asn1/product.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import Message
from cdff_common.types.product_ext import ProductMetadataExt
from cdff_common.types.time import Time


class ProductStatusT(IntEnum):
    """Status of a product; FAILED has no value."""

    STATUS_OK = 0
    STATUS_DEGRADED = 1
    STATUS_FAILED = 2


class ProductCovarianceKindT(IntEnum):
    """Origin of a covariance."""

    COVARIANCE_NONE = 0
    COVARIANCE_FORMAL = 1
    COVARIANCE_CALIBRATED = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ProductMetricT(Message):
    """Quality metric.

    Attributes
    ----------
    name : str, at most 256 bytes
        with its unit, e.g. rmse_px.
    value : float
    """

    ASN1_NAME: ClassVar[str] = "Product-metric-t"
    name: str = ""
    value: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ProductQuality(Message):
    """Quality of a product: status, reasons, covariance kind and metrics.

    Attributes
    ----------
    status : ProductStatusT
    reasons : tuple[str, ...]
        short codes, e.g. few_inliers:12<30.
    covariance_kind : ProductCovarianceKindT
    metrics : tuple[ProductMetricT, ...]
    """

    ASN1_NAME: ClassVar[str] = "Product-Quality"
    status: ProductStatusT = ProductStatusT.STATUS_OK
    reasons: tuple[str, ...] = ()
    covariance_kind: ProductCovarianceKindT = ProductCovarianceKindT.COVARIANCE_NONE
    metrics: tuple[ProductMetricT, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ProductMetadata(ProductMetadataExt):
    """Metadata of a product: producer, time, frame, inputs and quality.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    id : str, at most 256 bytes
        UUID; equal for repetitions and replays of one result.
    robot : str, at most 256 bytes
    dfpc : str, at most 256 bytes
    port : str, at most 256 bytes
    product : str, at most 256 bytes
        pose, dem, ...: the name in requests.
    encoding : str, at most 256 bytes
        of the payload, e.g. application/vnd.cdff+uper;Pointcloud/1.
    size : int, 0..9223372036854775807
        bytes of the payload.
    sha256 : str, at most 256 bytes
        of the payload, hexadecimal; empty if not computed.
    seq : int, 0..9223372036854775807
        sequence number of the products of one port, from 0.
    start_time : Time
        t0: start of capture of the source data.
    end_time : Time
        t1: end of capture.
    frame_id : str, at most 256 bytes
        frame of the values; for a pose the parent.
    child_frame_id : str, at most 256 bytes
        of a pose, else empty.
    producer_id : str, at most 256 bytes
        dfpc/implementation/version.
    config_hash : str, at most 256 bytes
    inputs : tuple[str, ...]
        ids of the source products.
    quality : ProductQuality
    has_box : bool
    box : NDArray[np.float64], shape (6,)
        m, xmin ymin zmin xmax ymax zmax in frameId.
    resolution : float
        m, of a cell or voxel; 0 if it has none.
    """

    ASN1_NAME: ClassVar[str] = "Product-Metadata"
    msg_version: int = 1
    id: str = ""
    robot: str = ""
    dfpc: str = ""
    port: str = ""
    product: str = ""
    encoding: str = ""
    size: int = 0
    sha256: str = ""
    seq: int = 0
    start_time: Time = field(default_factory=Time)
    end_time: Time = field(default_factory=Time)
    frame_id: str = ""
    child_frame_id: str = ""
    producer_id: str = ""
    config_hash: str = ""
    inputs: tuple[str, ...] = ()
    quality: ProductQuality = field(default_factory=ProductQuality)
    has_box: bool = False
    box: NDArray[np.float64] = field(default_factory=lambda: np.zeros((6,), np.float64))
    resolution: float = 0.0

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.end_time.ns
