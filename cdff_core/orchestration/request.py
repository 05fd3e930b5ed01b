# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Request of the autonomy framework (OG2) as a validated value."""

from __future__ import annotations

import math
import re
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cdff_common.contract.acquisition import AcquisitionParameters
from cdff_common.contract.limits import DEFAULT_DEADLINE_MS
from cdff_common.contract.names import GROUND, ROBOT_ID
from cdff_common.contract.products import ProductType, product_type, requestable_products
from cdff_common.contract.queries import RequestParameters
from cdff_common.errors import InputError
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import CovarianceKind
from cdff_core.orchestration.accuracy import (
    NO_BOUNDS,
    SIGMA_DEG_PRODUCTS,
    SIGMA_M_PRODUCTS,
    AccuracyBounds,
)

#: Default timeout of a Zenoh query, seconds; a client with a longer deadline must set its own timeout.
_ZENOH_TIMEOUT_S = 10.0
DEFAULT_PRIORITY = 5


@dataclass(frozen=True, slots=True)
class ProductRequest:
    """A validated request, with the defaults resolved; the fields are those of ``RequestParameters``."""

    id: str  # id from the client, else a new UUID
    product: str  # name of a requestable product type
    robot: str  # robot id or ``any``
    frame: str = "site"  # frame of the product; for a pose its parent
    child: str | None = None  # child of a pose; None: ``{robot}/base``
    region: Region | None = None  # in ``region_frame``; None: unrestricted
    region_frame: str = "site"
    t_ns: int | None = None  # mission time of a pose, or latest capture time of other products; None: now
    #: Window of the end of capture of a scheduled request, mission time; None: now.
    window_ns: tuple[int, int] | None = None
    #: Largest age, from the end of capture to the mission time; infinite if not requested.
    max_age_s: float = math.inf
    #: Resolution to which finer data are aggregated; coarser data are delivered as they are.
    resolution_m: float | None = None
    min_coverage: float = 0.0  # minimum fraction of the region that must hold data, 0 to 1; 0: any
    #: Largest age of the oldest part; infinite if not requested.
    max_oldest_age_s: float = math.inf
    accuracy: AccuracyBounds = NO_BOUNDS
    type_name: str = ""  # ASN.1 type to deliver
    format: str = "uper"  # codec or file format
    deliver: str = "auto"  # ``auto`` (inline up to 1 MB), ``inline``, ``reference`` or ``none``
    deadline_s: float = DEFAULT_DEADLINE_MS / 1000  # time until the final reply, seconds
    explain: bool = False  # explain the request instead of executing it
    #: 0 to 9; higher priorities are admitted first and may take sensor modes from lower ones.
    priority: int = DEFAULT_PRIORITY
    #: Minimum time between two replies of a standing request, 0: at each change. Its deadline is a renewable
    #: lease. None: one reply.
    every_s: float | None = None
    #: Parameters of a single acquisition from the sensors of the plan; None: the sensors stream.
    acquire: AcquisitionParameters | None = None
    #: Send progress replies. By default only if the deadline is beyond the default timeout of Zenoh: a client
    #: that keeps only the last reply could otherwise receive a progress reply instead of a late error.
    progress: bool = True

    @property
    def is_spatial(self) -> bool:
        """True if region, resolution and coverage apply."""
        return product_type(self.product).is_spatial

    @property
    def frames(self) -> frozenset[str]:
        """Frames that the request names."""
        near = None if self.region is None else self.region.near_frame
        region_frame = self.region_frame if self.region is not None else None
        return frozenset(f for f in (self.frame, self.child, region_frame, near) if f is not None)

    def parameters(self) -> dict[str, Any]:
        """Return the parameters of this request, from which ``parse_request`` makes an equal one."""
        description = self.describe()
        t_ns, t0_ns, t1_ns = (description.pop(name) for name in ("t_ns", "t0_ns", "t1_ns"))
        description["deadline_ms"] = round(1000 * description.pop("deadline_s"), 3)
        named = description | {"t": t_ns, "t0": t0_ns, "t1": t1_ns, "progress": str(self.progress).lower()}
        if not self.is_spatial:
            del named["region_frame"], named["min_coverage"]
        return {name: value for name, value in named.items() if value is not None}

    def describe(self) -> dict[str, Any]:
        """Return plain data for the journal, job lists and replies."""
        return {
            "request": self.id,
            "type": self.product,
            "robot": self.robot,
            "frame": self.frame,
            "child": self.child,
            "region": None if self.region is None else self.region.text,
            "region_frame": self.region_frame,
            "t_ns": self.t_ns,
            "t0_ns": None if self.window_ns is None else self.window_ns[0],
            "t1_ns": None if self.window_ns is None else self.window_ns[1],
            "max_age_s": None if math.isinf(self.max_age_s) else self.max_age_s,
            "resolution_m": self.resolution_m,
            "min_coverage": self.min_coverage,
            "max_oldest_age_s": None if math.isinf(self.max_oldest_age_s) else self.max_oldest_age_s,
            **self.accuracy.describe(),
            "as": self.type_name,
            "format": self.format,
            "deliver": self.deliver,
            "deadline_s": self.deadline_s,
            "priority": self.priority,
            "every_s": self.every_s,
            "acquire": None if self.acquire is None else str(self.acquire),
        }


def parse_request(parameters: Mapping[str, str], scope: str) -> ProductRequest:
    """Validate the parameters of a request under ``scope`` (a robot id or ``ground``).

    Raises InputError with the parameter, its value and the expectation.
    """
    p = RequestParameters.parse(parameters)
    product = requested_type(p.type)
    spatial_only = sorted({"region", "region_frame", "resolution_m", "min_coverage"} & p.model_fields_set)
    if spatial_only and not product.is_spatial:
        spatial = ", ".join(sorted(t.name for t in requestable_products().values() if t.is_spatial))
        raise InputError(f"{spatial_only[0]} does not apply to type={p.type}; it applies to {spatial}")
    if p.child is not None and p.type != "pose":
        raise InputError(f"child does not apply to type={p.type}; it applies to pose")
    if p.min_coverage > 0.0 and p.region is None:
        raise InputError(f"min_coverage={p.min_coverage}: expected a region to cover")
    for name, products in (("max_sigma_m", SIGMA_M_PRODUCTS), ("max_sigma_deg", SIGMA_DEG_PRODUCTS)):
        if name in p.model_fields_set and p.type not in products:
            raise InputError(f"{name} does not apply to type={p.type}; it applies to {', '.join(products)}")
    if p.acquire is not None:
        others = [name for name in ("every_s", "t", "t0") if getattr(p, name) is not None]
        if others:
            raise InputError(f"acquire={p.acquire}: not together with {others[0]}: it is one acquisition now")
    type_name, form = _type_and_format(product, p.as_type, p.format)
    deadline_s = p.deadline_ms / 1000
    sends_progress = p.every_s is not None or deadline_s >= _ZENOH_TIMEOUT_S
    return ProductRequest(
        id=p.request or str(uuid.uuid4()),
        product=p.type,
        robot=parse_robot(p.robot, scope, any_robot=True),
        frame=p.frame,
        child=p.child,
        region=p.region,
        region_frame=p.region_frame or p.frame,
        t_ns=p.t,
        window_ns=None if p.t0 is None or p.t1 is None else (p.t0, p.t1),
        max_age_s=math.inf if p.max_age_s is None else p.max_age_s,
        resolution_m=p.resolution_m,
        min_coverage=p.min_coverage,
        max_oldest_age_s=math.inf if p.max_oldest_age_s is None else p.max_oldest_age_s,
        accuracy=AccuracyBounds(
            p.max_sigma_m,
            p.max_sigma_deg,
            None if p.covariance_kind is None else CovarianceKind(p.covariance_kind),
            p.status,
        ),
        type_name=type_name,
        format=form,
        deliver=p.deliver,
        deadline_s=deadline_s,
        explain=p.explain,
        priority=p.priority,
        every_s=p.every_s,
        acquire=p.acquire,
        progress=sends_progress if p.progress is None else p.progress,
    )


def parse_robot(robot: str | None, scope: str, *, any_robot: bool = False) -> str:
    """Return the robot that ``robot=`` selects under ``scope``; raises InputError.

    ``any_robot`` allows ``any`` under ``ground``.
    """
    expected = "a robot id, or any" if any_robot else "a robot id"
    if scope == GROUND:
        if robot is None:
            raise InputError(f"robot is missing: under scope ground it is required ({expected})")
        if not re.fullmatch(ROBOT_ID, robot) or (robot == "any" and not any_robot):
            raise InputError(f"robot={robot!r}: expected {expected}")
        return robot
    if robot is not None and robot != scope:
        raise InputError(
            f"robot={robot!r} under the keys of {scope}: expected {scope}; use the keys of {robot} or ground"
        )
    return scope


def requested_type(name: str) -> ProductType:
    """Return a requestable product type by name; raises InputError."""
    products = requestable_products()
    if name not in products:
        raise InputError(f"type={name[:80]!r}: expected one of {', '.join(products)}")
    return products[name]


def _type_and_format(product: ProductType, requested_name: str | None, file_format: str) -> tuple[str, str]:
    """Return ASN.1 type and format to deliver; raises InputError if the product does not have them."""
    if file_format not in product.formats:
        raise InputError(f"format={file_format!r}: a {product.name} comes as {', '.join(product.formats)}")
    if requested_name is not None and requested_name not in product.types:
        raise InputError(f"as={requested_name!r}: a {product.name} comes as {', '.join(product.types)}")
    native = product.types[0]
    if file_format in product.file_formats:
        if requested_name is not None and requested_name != native:
            raise InputError(f"as={requested_name} with format={file_format}: a file format carries {native}")
        return native, file_format
    if requested_name is None:
        requested_name = "Map" if product.name == "dem" and file_format == "uper" else native
    return requested_name, file_format
