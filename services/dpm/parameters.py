# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of queries as text, from Zenoh and from HTTP alike: checked, unknown ones refused."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.clock import parse_stamp
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, checked_frame
from cdff_common.geometry.region import Region, parse_region
from cdff_common.interfaces.product import Status
from cdff_common.raster.choice import Choice, Disagreement, NavigationChoice
from dpm_store import Query
from dpm_store.clouds import DEFAULT_POINTS, MAX_POINTS
from dpm_store.frames import FARTHEST_FRAME_M, Known
from dpm_store.profile import MAX_CORNERS
from dpm_store.records import LATEST_NS
from dpm_store.windows import FARTHEST_M, WindowQuery
from services.dpm.terms import covariance_kind, metric_bounds, order_terms

GROUND = "ground"
#: Product -> ASN.1 type it is stored as; None where no type is fixed yet (contract §5).
PRODUCT_TYPES: dict[str, str | None] = {
    "pose": "TransformWithCovariance", "trajectory": "PoseTrajectory", "pointcloud": "Pointcloud",
    "dem": "ElevationMap", "navigation_map": "NavigationMap", "image": "Frame", "disparity": "Frame",
    "pose_graph": "PoseGraph", "detections": None, "track": None, "mesh": None,
    "feature_matches": "CorrespondenceMap2D", "landmarks": "LandmarkMap",
    "scan": "LidarScan", "image_pair": "FramePair", "imu_span": "ImuSpan", "sample": None,  # kept from sensors
    "delivery": None,  # derived for one request by the orchestrator, fetched by id
}  # fmt: skip
SEARCH = frozenset(
    {"type", "robot", "dfpc", "port", "status", "region", "frame", "region_frame", "child", "t0", "t1",
     "resolution_max_m", "after", "tag", "as_of", "superseded", "order", "limit", "cursor", "request", "point",
     "quality", "covariance_kind", "frames_revision"}
)  # fmt: skip
_PARCEL: dict[str, type] = {
    "robot": str, "dfpc": str, "port": str, "product": str, "encoding": str, "attachment": bytes, "payload": bytes,
}  # fmt: skip
_ROBOT = re.compile(r"[a-z][a-z0-9_]{0,63}\Z")


@dataclass(frozen=True, slots=True)
class WindowRequest:
    """What a map window is asked with."""

    query: WindowQuery
    min_coverage: float = 0.0


@dataclass(frozen=True, slots=True)
class CloudRequest:
    """What an assembled cloud is asked with."""

    query: Query
    points: int


@dataclass(frozen=True, slots=True, eq=False)
class ProfileRequest:
    """What a profile is asked with; ``path_m`` has shape ``(k, 2)``."""

    query: WindowQuery
    path_m: NDArray[np.float64]
    step_m: float | None


def check_names(parameters: Mapping[str, Any], known: frozenset[str], required: frozenset[str] = frozenset()) -> None:
    """Refuse unknown parameters, and ones that are missing."""
    unknown, missing = sorted(set(parameters) - known), sorted(required - set(parameters))
    if unknown:
        raise InputError(f"unknown parameter {unknown[0]!r}; known are {', '.join(sorted(known))}")
    if missing:
        raise InputError(f"parameter {missing[0]!r} is missing")


def robot_under(scope: str, parameters: Mapping[str, str]) -> str | None:
    """The robot that a query means: ``robot=`` where it is given; None for all of them.

    Raises
    ------
    InputError
        If a robot's keys are asked for another robot.
    """
    robot = parameters.get("robot")
    if robot is not None and not _ROBOT.match(robot):
        raise InputError(f"robot={robot!r}: expected a robot id or any")
    if scope == GROUND:
        return None if robot == "any" else robot
    if robot not in (None, scope):
        raise InputError(f"robot={robot!r} asked under the keys of {scope}: ask there for it, or under ground")
    return robot


def search_query(scope: str, parameters: Mapping[str, str]) -> Query:
    """The search that parameters ask for; answers do not depend on the scope asked."""
    check_names(parameters, SEARCH)
    p = parameters
    frame = checked_frame(p.get("region_frame", p.get("frame", "site")))
    types = tuple(t for t in p.get("type", "").split(",") if t)
    unknown = [t for t in types if t not in PRODUCT_TYPES]
    if unknown:
        raise InputError(f"type={unknown[0][:80]!r}: expected one of {', '.join(PRODUCT_TYPES)}")
    if "status" in p and p["status"] not in list(Status):
        raise InputError(f"status={p['status'][:80]!r}: expected one of {', '.join(Status)}")
    return Query(
        types=types,
        robot=robot_under(scope, p),
        dfpc=p.get("dfpc"),
        port=p.get("port"),
        status=p.get("status"),
        t0_ns=stamp(p, "t0"),
        t1_ns=stamp(p, "t1"),
        region=region_of(p),
        frame=frame,
        child=p.get("child"),
        resolution_max_m=number(p, "resolution_max_m", low=0.0),
        inserted_after=integer(p, "after", low=0),
        tags=tuple(t for t in p.get("tag", "").split(",") if t),
        as_of_ns=stamp(p, "as_of"),
        superseded=_superseded(p),
        **order_terms(p),
        metrics=metric_bounds(p["quality"]) if "quality" in p else (),
        covariance_kind=covariance_kind(p),
        frames_revision=integer(p, "frames_revision"),
        limit=integer(p, "limit", low=1, high=1000) or 100,
        cursor=p.get("cursor"),
    )


def _superseded(parameters: Mapping[str, str]) -> bool | None:
    wanted = parameters.get("superseded", "include")
    if wanted not in ("include", "exclude", "only"):
        raise InputError(f"superseded={wanted[:80]!r}: expected include, exclude or only")
    return {"include": None, "exclude": False, "only": True}[wanted]


def window_request(scope: str, p: Mapping[str, str], now_ns: int, *, navigation: bool = False) -> WindowRequest:
    """What a window of elevation, or of navigation maps, is asked with; ``max_age_s`` counts back from ``now_ns``."""
    frame = checked_frame(p.get("frame", "site"))
    region_frame = checked_frame(p.get("region_frame", frame), "region_frame")
    if region_frame != frame:
        raise InputError(f"region_frame={region_frame}, frame={frame}: a window's region is in the window's frame")
    newest_after = stamp(p, "newest_after")
    max_age_s = number(p, "max_age_s", low=0.0)
    if max_age_s is not None:
        newest_after = max(newest_after or 0, now_ns - int(max_age_s * 1e9))
    query = WindowQuery(
        region_of(p), number(p, "resolution_m", low=1e-4, high=1e4), frame, robot_under(scope, p), newest_after,
        stamp(p, "t1"), stamp(p, "as_of"), integer(p, "frames_revision"), **_choices(p, navigation),
    )  # fmt: skip
    if query.choice != Choice.POOLED and query.disagreement != Disagreement.KEEP:
        raise InputError(f"choice={query.choice}, disagreement={query.disagreement}: only pooled cells can disagree")
    return WindowRequest(query, number(p, "min_coverage", low=0.0, high=1.0) or 0.0)


def _choices(p: Mapping[str, str], navigation: bool) -> dict[str, Any]:
    """``choice`` of a query, of elevation with ``disagreement``: judgements are not pooled, so they cannot disagree."""
    if navigation:
        if "disagreement" in p:
            raise InputError(f"disagreement={p['disagreement'][:40]!r}: of navigation maps one is chosen, see choice")
        return {"judgement": NavigationChoice(one_of(p, "choice", tuple(NavigationChoice)))}
    return {
        "choice": Choice(one_of(p, "choice", tuple(Choice))),
        "disagreement": Disagreement(one_of(p, "disagreement", tuple(Disagreement))),
    }


def cloud_request(scope: str, p: Mapping[str, str]) -> CloudRequest:
    """What an assembled cloud is asked with."""
    query = Query(
        robot=robot_under(scope, p), region=region_of(p), frame=checked_frame(p.get("frame", "site")),
        t0_ns=stamp(p, "t0"), t1_ns=stamp(p, "t1"), as_of_ns=stamp(p, "as_of"),
        frames_revision=integer(p, "frames_revision"),
    )  # fmt: skip
    return CloudRequest(query, integer(p, "points", low=1, high=MAX_POINTS) or DEFAULT_POINTS)


def profile_request(scope: str, p: Mapping[str, str]) -> ProfileRequest:
    """What a profile is asked with: ``path=x1,y1,x2,y2,…``."""
    try:
        values = np.array([float(v) for v in p.get("path", "").split(",")])
    except ValueError as error:
        raise InputError(f"path={p.get('path', '')[:80]!r}: {error}; expected x1,y1,x2,y2,… in metres") from error
    if len(values) % 2 or not 4 <= len(values) <= 2 * MAX_CORNERS or not np.all(np.abs(values) <= FARTHEST_M):
        raise InputError(
            f"path of {len(values)} numbers: expected x,y of 2 to {MAX_CORNERS} corners within {FARTHEST_M:g} m"
        )
    query = window_request(scope, {k: v for k, v in p.items() if k not in ("path", "step_m")}, 0).query
    return ProfileRequest(query, values.reshape(-1, 2), number(p, "step_m", low=1e-4, high=1e6))


def one_of(parameters: Mapping[str, str], name: str, known: tuple[str, ...]) -> str:
    """A word of a few, the first by default; raises InputError for another."""
    value = parameters.get(name, known[0])
    if value not in known:
        raise InputError(f"{name}={value[:80]!r}: expected one of {', '.join(known)}")
    return str(value)


def known_of(parameters: Mapping[str, str]) -> Known:
    """What of the history counts: ``as_of``, ``frames_revision``."""
    return Known(stamp(parameters, "as_of"), integer(parameters, "frames_revision"))


def region_of(parameters: Mapping[str, str]) -> Region | None:
    """The region, or None where it is not given; raises InputError for a polygon that crosses itself."""
    if "region" not in parameters:
        return None
    region = parse_region(parameters["region"])
    if region.kind == "polygon":
        import shapely

        outline = shapely.Polygon(list(zip(region.values[0::2], region.values[1::2], strict=True)))
        if not outline.is_valid:
            raise InputError(f"region={region.text[:80]!r}: {shapely.is_valid_reason(outline)}")
    return region


def stamp(parameters: Mapping[str, str], name: str) -> int | None:
    """A time, or None where it is not given."""
    if name not in parameters:
        return None
    stamp_ns = parse_stamp(parameters[name], name)
    if abs(stamp_ns) > LATEST_NS:
        raise InputError(f"{name}={parameters[name]}: expected a time before the year 2116")
    return stamp_ns


def number(parameters: Mapping[str, str], name: str, *, low: float = -math.inf, high: float = math.inf) -> float | None:
    """A finite number, or None where it is not given."""
    if name not in parameters:
        return None
    try:
        value = float(parameters[name])
    except ValueError as error:
        raise InputError(f"{name}={parameters[name][:80]!r}: expected a number") from error
    if not math.isfinite(value) or not low <= value <= high:
        raise InputError(f"{name}={parameters[name][:80]}: expected a finite number from {low:g} to {high:g}")
    return value


def integer(parameters: Mapping[str, str], name: str, *, low: int = 0, high: int = 2**62) -> int | None:
    """A whole number, or None where it is not given."""
    if name not in parameters:
        return None
    text = parameters[name]
    if not re.fullmatch(r"\d{1,19}", text) or not low <= int(text) <= high:
        raise InputError(f"{name}={text[:80]!r}: expected a whole number from {low} to {high}")
    return int(text)


def batch_of(body: Any, robot: str | None = None) -> list[tuple[dict[str, str], bytes, str, bytes]]:
    """Products of a batch: a list of ``{robot, dfpc, port, product, encoding, attachment, payload}``.

    ``robot`` stands for those that name none. Raises InputError for anything else.
    """
    if not isinstance(body, (list, tuple)) or not body:
        raise InputError("batch: expected a list of products, one at least")
    found = []
    for place, one in enumerate(body):
        names = {"robot": robot, **one} if isinstance(one, Mapping) else {}
        wrong = [name for name in _PARCEL if not isinstance(names.get(name), _PARCEL[name])]
        if wrong or set(names) != set(_PARCEL):
            raise InputError(f"batch, product {place}: expected a map of {', '.join(_PARCEL)}")
        if robot is not None and names["robot"] != robot:
            raise InputError(f"batch, product {place}: of {str(names['robot'])[:64]}, put under the keys of {robot}")
        key = {name: names[name] for name in ("robot", "dfpc", "port", "product")}
        found.append((key, names["payload"], names["encoding"], names["attachment"]))
    return found


def revision_of(text: str | None) -> int | None:
    """The revision that an update was made from: ``if_match`` or an ETag ``"rN"``; None for ``*``, any.

    Raises
    ------
    InputError
        If it is missing, or is no revision.
    """
    if text is None:
        raise InputError("if_match is missing: name the revision that the change was made from, or * for any")
    if text == "*":
        return None
    match = re.fullmatch(r'(?:"r(\d{1,9})"|(\d{1,9}))', text.strip())
    if match is None:
        raise InputError(f'if_match={text[:80]!r}: expected a revision as 3, an ETag as "r3", or *')
    return int(match[1] or match[2])


def transform_of(body: Mapping[str, Any]) -> UncertainTransform:
    """``T`` (4x4 rows) and ``covariance`` (6x6 or absent) of a map; raises InputError."""
    try:
        matrix = np.array(body["T"], dtype=np.float64)
        if np.abs(matrix).max(initial=0.0) > FARTHEST_FRAME_M:  # before anything is calculated with it
            raise ValueError(f"a number of {np.abs(matrix).max():g}, expected at most {FARTHEST_FRAME_M:g} m")
        covariance = body.get("covariance")
        return UncertainTransform(matrix, None if covariance is None else np.array(covariance, dtype=np.float64))
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"transform: expected T as 4 rows of 4, covariance as 6 of 6 or none: {error}") from error
