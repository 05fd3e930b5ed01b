# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the autonomy framework asks for: the parameters of contract §5 as one checked value."""

from __future__ import annotations

import math
import re
import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from cdff_common.clock import parse_stamp
from cdff_common.errors import InputError
from cdff_common.geometry import checked_frame
from cdff_common.geometry.region import Region, parse_region

#: Product -> (ASN.1 type that carries it, other types it can be asked for ``as``, formats it can be asked in).
CODECS = ("uper", "ber", "xer", "msgpack")
PRODUCTS: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "pose": ("TransformWithCovariance", ("RigidBodyState",), ("tum",)),
    "trajectory": ("PoseTrajectory", (), ("tum",)),
    "pointcloud": ("Pointcloud", (), ("ply",)),
    "dem": ("ElevationMap", ("Map",), ("tif",)),
    "navigation_map": ("NavigationMap", (), ("tif",)),
    "image": ("Frame", (), ("png",)),
}
#: Products that have a place, so that ``region``, ``resolution_m`` and ``min_coverage`` mean something.
SPATIAL = frozenset({"pointcloud", "dem", "navigation_map"})
PARAMETERS = frozenset(
    {
        "type",
        "robot",
        "region",
        "region_frame",
        "frame",
        "child",
        "t",
        "max_age_s",
        "resolution_m",
        "min_coverage",
        "as",
        "format",
        "deliver",
        "deadline_ms",
        "explain",
        "every_s",
        "priority",
        "progress",
        "request",
    }
)
#: A Zenoh query stops after so long by default: who waits longer has read how to ask.
_ZENOH_TIMEOUT_S = 10.0
#: Below the 10 s after which a Zenoh query stops by default, so that a plain ``get`` still sees the answer.
DEFAULT_DEADLINE_MS = 8_000
DEADLINE_BOUNDS_MS = (100, 3_600_000)
DEFAULT_PRIORITY = 5
_PRIORITY = re.compile(r"[0-9]\Z")
_REQUEST_ID = re.compile(r"[A-Za-z0-9_.-]{1,64}\Z")
_ROBOT = re.compile(r"[a-z][a-z0-9_]{0,31}\Z")


@dataclass(frozen=True, slots=True)
class ProductRequest:
    """A checked request.

    Attributes
    ----------
    id : str
        The requester's name for it; a UUID made here where none was given.
    product : str
        Key of ``PRODUCTS``.
    robot : str
        Robot id or ``any``.
    frame : str
        Frame to deliver in; for a pose the parent.
    child : str or None
        Of a pose: the frame whose pose is asked for; None means ``{robot}/base``.
    region : Region or None
        In ``region_frame``; None means wherever there is something.
    t_ns : int or None
        Mission time asked for: of a pose the pose at it, of others what was captured until then; None means now.
    max_age_s : float
        Mission now minus end of capture may be at most this; infinite where not asked.
    resolution_m : float or None
        Finer data are aggregated to it; coarser ones are delivered as they are, and the answer says so.
    min_coverage : float
        Part of the region, 0 to 1, that must hold data; 0 means any.
    type_name : str
        ASN.1 type to deliver (``as``, or what the product and format imply).
    format : str
        A codec or a file format.
    deliver : str
        ``auto`` (inline up to 1 MB), ``inline`` or ``reference``.
    deadline_s : float
        Seconds until the answer must have been sent.
    explain : bool
        Say what would be done instead of doing it.
    every_s : float or None
        Of a standing request: least time between two answers, 0 for each change; its deadline is then its lease, which
        can be renewed. None means one answer.
    priority : int
        0 to 9; a higher one is admitted before, and may take a sensor's mode from, a lower one.
    progress : bool
        Whether progress is told. A query that keeps only the last reply would get it beside a late error, so it is told
        only to who asks for it, or waits for longer than Zenoh's default.
    """

    id: str
    product: str
    robot: str
    frame: str = "site"
    child: str | None = None
    region: Region | None = None
    region_frame: str = "site"
    t_ns: int | None = None
    max_age_s: float = math.inf
    resolution_m: float | None = None
    min_coverage: float = 0.0
    type_name: str = ""
    format: str = "uper"
    deliver: str = "auto"
    deadline_s: float = DEFAULT_DEADLINE_MS / 1000
    explain: bool = False
    priority: int = DEFAULT_PRIORITY
    every_s: float | None = None
    progress: bool = True

    @property
    def is_spatial(self) -> bool:
        """Whether region, resolution and coverage apply."""
        return self.product in SPATIAL

    @property
    def frames(self) -> frozenset[str]:
        """The frames that it names."""
        near = None if self.region is None else self.region.near_frame
        placed = self.region_frame if self.region is not None else None
        return frozenset(f for f in (self.frame, self.child, placed, near) if f is not None)

    def describe(self) -> dict[str, Any]:
        """What was asked, as plain data for the journal, job lists and answers."""
        return {
            "request": self.id,
            "type": self.product,
            "robot": self.robot,
            "frame": self.frame,
            "child": self.child,
            "region": None if self.region is None else self.region.text,
            "region_frame": self.region_frame,
            "t_ns": self.t_ns,
            "max_age_s": None if math.isinf(self.max_age_s) else self.max_age_s,
            "resolution_m": self.resolution_m,
            "min_coverage": self.min_coverage,
            "as": self.type_name,
            "format": self.format,
            "deliver": self.deliver,
            "deadline_s": self.deadline_s,
            "priority": self.priority,
            "every_s": self.every_s,
        }


def parse_request(parameters: Mapping[str, str], scope: str) -> ProductRequest:
    """Check the parameters of a request that arrived under ``scope`` (a robot id or ``ground``).

    Raises
    ------
    InputError
        Naming the parameter, its value and what was expected.
    """
    unknown = sorted(set(parameters) - PARAMETERS)
    if unknown:
        raise InputError(f"unknown parameter {unknown[0]!r}; known are {', '.join(sorted(PARAMETERS))}")
    product = parameters.get("type", "")
    if product not in PRODUCTS:
        raise InputError(f"type={product!r}: expected one of {', '.join(PRODUCTS)}")
    robot = parse_robot(parameters.get("robot"), scope, any_robot=True)
    frame = checked_frame(parameters.get("frame", "site"))
    region = parse_region(parameters["region"]) if "region" in parameters else None
    spatial_only = sorted({"region", "region_frame", "resolution_m", "min_coverage"} & set(parameters))
    if spatial_only and product not in SPATIAL:
        raise InputError(f"{spatial_only[0]} means nothing for type={product}; it is for {', '.join(sorted(SPATIAL))}")
    if "child" in parameters and product != "pose":
        raise InputError(f"child means nothing for type={product}; it is for pose")
    min_coverage = _number(parameters, "min_coverage", 0.0, 0.0, 1.0) or 0.0
    if min_coverage > 0.0 and region is None:
        raise InputError(f"min_coverage={min_coverage}: expected a region to cover")
    type_name, codec = _type_and_format(product, parameters.get("as"), parameters.get("format", "uper"))
    request_id = parameters.get("request") or str(uuid.uuid4())
    if not _REQUEST_ID.match(request_id):
        raise InputError(f"request={request_id!r}: expected up to 64 letters, digits, '.', '_' or '-', as in a UUID")
    deliver = parameters.get("deliver", "auto")
    if deliver not in ("auto", "inline", "reference"):
        raise InputError(f"deliver={deliver!r}: expected auto, inline or reference")
    explain = parameters.get("explain", "false")
    if explain not in ("true", "false"):
        raise InputError(f"explain={explain!r}: expected true or false")
    deadline_s, every_s = parse_deadline_s(parameters), _number(parameters, "every_s", None, 0.0, 3600.0)
    told = every_s is not None or deadline_s >= _ZENOH_TIMEOUT_S
    progress = parameters.get("progress", "true" if told else "false")
    if progress not in ("true", "false"):
        raise InputError(f"progress={progress!r}: expected true or false")
    priority = parameters.get("priority", str(DEFAULT_PRIORITY))
    if not _PRIORITY.match(priority):
        raise InputError(f"priority={priority!r}: expected a digit, 0 (least) to 9")
    return ProductRequest(
        id=request_id,
        product=product,
        robot=robot,
        frame=frame,
        child=checked_frame(parameters["child"], "child") if "child" in parameters else None,
        region=region,
        region_frame=checked_frame(parameters.get("region_frame", frame), "region_frame"),
        t_ns=parse_stamp(parameters["t"]) if "t" in parameters else None,
        max_age_s=_number(parameters, "max_age_s", math.inf, 0.0, math.inf) or 0.0,
        resolution_m=_number(parameters, "resolution_m", None, 1e-4, 1e4),
        min_coverage=min_coverage,
        type_name=type_name,
        format=codec,
        deliver=deliver,
        deadline_s=deadline_s,
        explain=explain == "true",
        priority=int(priority),
        every_s=every_s,
        progress=progress == "true",
    )


def parse_deadline_s(parameters: Mapping[str, str]) -> float:
    """Return ``deadline_ms`` in seconds; raises InputError."""
    return (_number(parameters, "deadline_ms", DEFAULT_DEADLINE_MS, *DEADLINE_BOUNDS_MS) or 0.0) / 1000


def parse_robot(robot: str | None, scope: str, *, any_robot: bool = False) -> str:
    """Return the robot meant by ``robot=`` under ``scope`` (contract §5, Scopes); raises InputError.

    ``any_robot`` tells whether ``any`` may be asked under ``ground``.
    """
    expected = "a robot id, or any" if any_robot else "a robot id"
    if scope == "ground":
        if robot is None:
            raise InputError(f"robot is missing: under scope ground it is required ({expected})")
        if not _ROBOT.match(robot) or (robot == "any" and not any_robot):
            raise InputError(f"robot={robot!r}: expected {expected}")
        return robot
    if robot is not None and robot != scope:
        raise InputError(f"robot={robot!r} asked under the keys of {scope}: ask there for it, or under ground")
    return scope


def _type_and_format(product: str, asked: str | None, text: str) -> tuple[str, str]:
    native, others, files = PRODUCTS[product]
    if text not in (*CODECS, *files):
        raise InputError(f"format={text!r}: a {product} comes as {', '.join((*CODECS, *files))}")
    if asked is not None and asked not in (native, *others):
        raise InputError(f"as={asked!r}: a {product} comes as {', '.join((native, *others))}")
    if text in files:
        if asked is not None and asked != native:
            raise InputError(f"as={asked} with format={text}: a file format carries {native}")
        return native, text
    if asked is None:
        asked = "Map" if product == "dem" and text == "uper" else native
    return asked, text


def _number(parameters: Mapping[str, str], name: str, default: float | None, low: float, high: float) -> float | None:
    if name not in parameters:
        return default
    try:
        value = float(parameters[name])
    except ValueError as error:
        raise InputError(f"{name}={parameters[name]!r}: expected a number") from error
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(f"{name}={parameters[name]}: expected {low:g} to {high:g}")
    return value
