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

from cdff_common.types import validation as check
from cdff_common.types.message import Message
from cdff_common.types.product_ext import ProductMetadataExt
from cdff_common.types.time import Time


class ProductStatusT(IntEnum):
    """FAILED has no value."""

    STATUS_OK = 0
    STATUS_DEGRADED = 1
    STATUS_FAILED = 2


class ProductCovarianceKindT(IntEnum):
    """How a covariance was come by."""

    COVARIANCE_NONE = 0
    COVARIANCE_FORMAL = 1
    COVARIANCE_CALIBRATED = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ProductMetricT(Message):
    """A number that says how well it went.

    Attributes
    ----------
    name : str, at most 256 octets
        with its unit: rmse_px.
    value : float
    """

    ASN1_NAME: ClassVar[str] = "Product-metric-t"
    name: str = ""
    value: float = 0.0

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "name", check.text(self.name, "ProductMetricT.name", 256))
        put(self, "value", check.real(self.value, "ProductMetricT.value"))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ProductQuality(Message):
    """How far a product can be trusted.

    Attributes
    ----------
    status : ProductStatusT
    reasons : tuple[str, ...]
        short codes: few_inliers:12<30.
    covariance_kind : ProductCovarianceKindT
    metrics : tuple[ProductMetricT, ...]
    """

    ASN1_NAME: ClassVar[str] = "Product-Quality"
    status: ProductStatusT = ProductStatusT.STATUS_OK
    reasons: tuple[str, ...] = ()
    covariance_kind: ProductCovarianceKindT = ProductCovarianceKindT.COVARIANCE_NONE
    metrics: tuple[ProductMetricT, ...] = ()

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "status", check.enumeration(self.status, "ProductQuality.status", ProductStatusT))
        put(
            self,
            "reasons",
            check.items(self.reasons, "ProductQuality.reasons", 0, 256, lambda v, w: check.text(v, w, 256)),
        )
        put(
            self,
            "covariance_kind",
            check.enumeration(self.covariance_kind, "ProductQuality.covariance_kind", ProductCovarianceKindT),
        )
        put(
            self,
            "metrics",
            check.items(
                self.metrics, "ProductQuality.metrics", 0, 1024, lambda v, w: check.instance(v, w, ProductMetricT)
            ),
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ProductMetadata(ProductMetadataExt):
    """Who made a product, when, where, from what, and how far it can be trusted.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    id : str, at most 256 octets
        UUID; equal for retries and replays of one result.
    robot : str, at most 256 octets
    dfpc : str, at most 256 octets
    port : str, at most 256 octets
    product : str, at most 256 octets
        pose, dem, ... as it is asked for.
    encoding : str, at most 256 octets
        of the payload: application/vnd.cdff+uper;Pointcloud/1.
    size : int, 0..9223372036854775807
        octets of the payload.
    sha256 : str, at most 256 octets
        of the payload, hexadecimal; empty where it was not taken.
    seq : int, 0..9223372036854775807
        counts the products of one port from 0.
    start_time : Time
        t0: begin of capture of what it was made from.
    end_time : Time
        t1: end of it.
    frame_id : str, at most 256 octets
        frame of the values; of a pose the parent.
    child_frame_id : str, at most 256 octets
        of a pose; else empty.
    producer_id : str, at most 256 octets
        dfpc/implementation/version.
    config_hash : str, at most 256 octets
    inputs : tuple[str, ...]
        ids of what it was made from.
    quality : ProductQuality
    has_box : bool
    box : NDArray[np.float64], shape (6,)
        m, xmin ymin zmin xmax ymax zmax in frameId.
    resolution : float
        m, of a cell or voxel; 0 where it has none.
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "ProductMetadata.msg_version", 0, 4294967295))
        put(self, "id", check.text(self.id, "ProductMetadata.id", 256))
        put(self, "robot", check.text(self.robot, "ProductMetadata.robot", 256))
        put(self, "dfpc", check.text(self.dfpc, "ProductMetadata.dfpc", 256))
        put(self, "port", check.text(self.port, "ProductMetadata.port", 256))
        put(self, "product", check.text(self.product, "ProductMetadata.product", 256))
        put(self, "encoding", check.text(self.encoding, "ProductMetadata.encoding", 256))
        put(self, "size", check.integer(self.size, "ProductMetadata.size", 0, 9223372036854775807))
        put(self, "sha256", check.text(self.sha256, "ProductMetadata.sha256", 256))
        put(self, "seq", check.integer(self.seq, "ProductMetadata.seq", 0, 9223372036854775807))
        put(self, "start_time", check.instance(self.start_time, "ProductMetadata.start_time", Time))
        put(self, "end_time", check.instance(self.end_time, "ProductMetadata.end_time", Time))
        put(self, "frame_id", check.text(self.frame_id, "ProductMetadata.frame_id", 256))
        put(self, "child_frame_id", check.text(self.child_frame_id, "ProductMetadata.child_frame_id", 256))
        put(self, "producer_id", check.text(self.producer_id, "ProductMetadata.producer_id", 256))
        put(self, "config_hash", check.text(self.config_hash, "ProductMetadata.config_hash", 256))
        put(
            self,
            "inputs",
            check.items(self.inputs, "ProductMetadata.inputs", 0, 65535, lambda v, w: check.text(v, w, 256)),
        )
        put(self, "quality", check.instance(self.quality, "ProductMetadata.quality", ProductQuality))
        put(self, "has_box", check.boolean(self.has_box, "ProductMetadata.has_box"))
        put(self, "box", check.real_array(self.box, "ProductMetadata.box", ((6, 6),)))
        put(self, "resolution", check.real(self.resolution, "ProductMetadata.resolution"))
        self._check_together()
