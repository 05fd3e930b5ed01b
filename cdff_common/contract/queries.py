# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of each operation of the DPM and of requests to the orchestrator."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, PlainSerializer, WithJsonSchema, model_validator

from cdff_common.contract.acquisition import AcquisitionParameters
from cdff_common.contract.limits import (
    DEADLINE_BOUNDS_MS,
    DEFAULT_DEADLINE_MS,
    DEFAULT_JOBS,
    DEFAULT_PAGE,
    DEFAULT_POINTS,
    MAX_GENERATIONS,
    MAX_JOBS,
    MAX_PAGE,
    MAX_POINTS,
)
from cdff_common.contract.metric_bounds import MetricBound, parse_metric_bounds
from cdff_common.contract.names import ANY_ROBOT, REQUEST_ID
from cdff_common.contract.parameters import (
    Acquire,
    Age,
    Flag,
    Frame,
    Names,
    Number,
    Parameters,
    PathM,
    PointM,
    RegionText,
    Robot,
    Stamp,
    Whole,
)
from cdff_common.errors import InputError
from cdff_common.interfaces.product import CovarianceKind, Status
from cdff_common.raster.cell_selection import Choice, Disagreement, NavigationChoice

Deliver = Literal["auto", "inline", "reference"]
RequestDeliver = Literal["auto", "inline", "reference", "none"]
MetricBounds = Annotated[
    tuple[MetricBound, ...],
    BeforeValidator(parse_metric_bounds),
    PlainSerializer(lambda bounds: ",".join(map(str, bounds)), return_type=str),
    WithJsonSchema({"type": "string"}),
]
Ordinal = Annotated[Whole, Field(ge=0, le=2**62)]
Resolution = Annotated[Number, Field(ge=1e-4, le=1e4)]
Sigma = Annotated[Number, Field(gt=0, le=1e9)]


class Order(StrEnum):
    """Order of a search."""

    NEWEST = "newest"
    OLDEST = "oldest"
    NEAREST = "nearest"


class HistoryViewParameters(Parameters):
    """State of the store and of the frame tree used for an answer; by default the newest."""

    as_of: Stamp | None = Field(None, description="State of the store at this time: nanoseconds or RFC 3339")
    frames_revision: Annotated[Whole, Field(ge=0, le=1 << 40)] | None = Field(
        None, description="Revision of the frame tree, from an earlier answer"
    )


class RegionParameters(HistoryViewParameters):
    """A region, its frame, and the robot that measured."""

    robot: Robot | None = Field(None, description="Robot id")
    region: RegionText | None = Field(
        None, description="bbox: | box: | circle: | polygon: | path: | near:, metres"
    )
    frame: Frame = Field("site", description="Frame of the region and of an assembled answer")


class SearchParameters(RegionParameters):
    """Filters of a search."""

    type: Names = Field(default_factory=tuple, description="Product types, separated by commas")
    dfpc: str | None = Field(None, description="DFPC that produced it")
    port: str | None = Field(None, description="Output port")
    status: Status | None = Field(None, description="Quality status")
    region_frame: Frame | None = Field(None, description="Frame of the region, instead of frame")
    child: str | None = Field(None, description="Child frame of a pose")
    t0: Stamp | None = Field(None, description="Captures that end at or after this: nanoseconds or RFC 3339")
    t1: Stamp | None = Field(None, description="Captures that start at or before this")
    resolution_max_m: Annotated[Number, Field(ge=0)] | None = Field(
        None, description="Largest cell or voxel size, metres"
    )
    after: Ordinal | None = Field(None, description="Inserted after this ordinal")
    tag: Names = Field(
        default_factory=tuple, description="Tags, separated by commas, that a product must all have"
    )
    superseded: Literal["include", "exclude", "only"] = Field(
        "include", description="Products that have a successor"
    )
    order: Order = Field(Order.NEWEST, description="By end of capture, or by distance to point")
    point: PointM | None = Field(
        None, description="For order=nearest: x,y in the region's frame; default: the region's centre"
    )
    quality: MetricBounds = Field(
        default_factory=tuple, description="Bounds of quality metrics, such as inliers>=30,rmse_px<0.5"
    )
    covariance_kind: CovarianceKind | None = Field(None, description="How the covariance was obtained")
    limit: Annotated[Whole, Field(ge=1, le=MAX_PAGE)] = Field(DEFAULT_PAGE, description="Products on a page")
    cursor: str | None = Field(None, description="Cursor of the previous page")


class NewestParameters(SearchParameters):
    """A search whose newest product is delivered."""

    known: str | None = Field(
        None,
        max_length=128,
        description="Id that the client holds; only the metadata of that product are delivered",
    )


class MapParameters(RegionParameters):
    """Parameters that windows of elevation and of navigation maps share."""

    region_frame: Frame | None = Field(None, description="Equal to frame, if given")
    resolution_m: Resolution | None = Field(
        None, description="Cell size, metres; coarser data keep their cells"
    )
    t1: Stamp | None = Field(
        None, description="Captures that ended at or before this: nanoseconds or RFC 3339"
    )
    newest_after: Stamp | None = Field(None, description="Lower limit of the end of the newest capture")
    max_age_s: Age | None = Field(None, description="Age of the newest capture")
    min_coverage: Annotated[Number, Field(ge=0, le=1)] = Field(
        0.0, description="Fraction of the region that must be observed; less is UNAVAILABLE (503)"
    )

    @model_validator(mode="after")
    def _region_is_in_the_frame(self) -> Self:
        if self.region_frame not in (None, self.frame):
            raise InputError(
                f"region_frame={self.region_frame}, frame={self.frame}: a window's region is in "
                "the window's frame"
            )
        return self


class ElevationParameters(Parameters):
    """Combination of several patches in one elevation cell."""

    choice: Choice | None = Field(
        None,
        description="Patches that determine a cell: weighted by default, pooled with another disagreement "
        "than keep",
    )
    disagreement: Disagreement = Field(
        Disagreement.KEEP, description="Treatment of pooled cells whose patches disagree"
    )

    @model_validator(mode="after")
    def _only_pooled_cells_disagree(self) -> Self:
        if self.choice not in (None, Choice.POOLED) and self.disagreement != Disagreement.KEEP:
            raise InputError(
                f"choice={self.choice}, disagreement={self.disagreement}: only pooled cells can disagree"
            )
        return self


class WindowParameters(ElevationParameters, MapParameters):
    """Parameters of an elevation window."""


class NavigationWindowParameters(MapParameters):
    """Parameters of a window of navigation maps."""

    choice: NavigationChoice = Field(
        NavigationChoice.NEWEST, description="Map that determines the class of a cell"
    )


class CloudParameters(RegionParameters):
    """Parameters of a cloud assembled from all clouds of a region."""

    t0: Stamp | None = Field(None, description="Captures that end at or after this: nanoseconds or RFC 3339")
    t1: Stamp | None = Field(None, description="Captures that start at or before this")
    points: Annotated[Whole, Field(ge=1, le=MAX_POINTS)] = Field(
        DEFAULT_POINTS, description="Largest number of points"
    )


class ProfileParameters(ElevationParameters, HistoryViewParameters):
    """Parameters of an elevation profile."""

    path: PathM = Field(description="x1,y1,x2,y2,… in frame, metres")
    step_m: Annotated[Number, Field(ge=1e-4, le=1e6)] | None = Field(
        None, description="Distance between samples, metres; default: the cell size"
    )
    robot: Robot | None = Field(None, description="Robot id")
    frame: Frame = Field("site", description="Frame of the path")
    resolution_m: Resolution | None = Field(None, description="Cell size, metres")
    t1: Stamp | None = Field(
        None, description="Captures that ended at or before this: nanoseconds or RFC 3339"
    )


class TerrainParameters(WindowParameters):
    """An analysis of the heights of a region."""


class TerrainRasterParameters(TerrainParameters):
    """An analysis whose result is a raster."""

    format: Literal["tif", "npz"] = Field("tif", description="GeoTIFF or numpy arrays")


class SurfaceParameters(TerrainRasterParameters):
    """Slope, aspect and roughness."""

    baseline_m: Annotated[Number, Field(gt=0, le=1e4)] | None = Field(
        None, description="Side of the square of cells of the local plane, metres; default: 3 cells"
    )


class ViewshedParameters(TerrainRasterParameters):
    """Visibility from a point."""

    observer: PointM = Field(description="x,y in frame, metres")
    observer_height_m: Annotated[Number, Field(ge=0, le=1e4)] = Field(
        2.0, description="Height of the eye above the ground"
    )
    target_height_m: Annotated[Number, Field(ge=0, le=1e4)] = Field(
        0.0, description="Height above the ground that is to be seen"
    )
    range_m: Annotated[Number, Field(gt=0, le=1e5)] | None = Field(
        None, description="Longest line of sight; without a region 50 m"
    )


class DifferenceParameters(TerrainRasterParameters):
    """Change of the heights between two times."""

    since: Stamp = Field(
        description="Captures that ended until this time are compared with later ones: ns or RFC 3339"
    )


class ContourParameters(TerrainParameters):
    """Contour lines."""

    interval_m: Annotated[Number, Field(ge=1e-3, le=1e4)] = Field(
        1.0, description="Difference in height of two lines, metres"
    )


class AreaStatisticsParameters(TerrainParameters):
    """Statistics of a region."""

    region: RegionText = Field(description="polygon: | bbox: | circle: | near:, metres")
    datum_m: Annotated[Number, Field(ge=-1e6, le=1e6)] | None = Field(
        None, description="Height of the plane of the volumes; default: the lowest height"
    )


#: Analyses of heights by name, with the model of their parameters.
TERRAIN_ANALYSES: dict[str, type[TerrainParameters]] = {
    "surface": SurfaceParameters,
    "viewshed": ViewshedParameters,
    "difference": DifferenceParameters,
    "contours": ContourParameters,
    "statistics": AreaStatisticsParameters,
}


class WithdrawalParameters(Parameters):
    """Products that are removed from all maps, by id, or by robot, time and DFPC."""

    id: Names = Field(default_factory=tuple, description="Ids of products, separated by commas")
    robot: Robot | None = Field(None, description="All maps of this robot")
    dfpc: str | None = Field(None, max_length=64, description="Only maps that this DFPC produced")
    t0: Stamp | None = Field(None, description="Captures that end at or after this: nanoseconds or RFC 3339")
    t1: Stamp | None = Field(None, description="Captures that start at or before this")
    type: Names = Field(
        ("dem", "navigation_map"), description="Product types, also of the products made from them"
    )
    reason: str = Field(min_length=1, max_length=1000, description="Reason, for the history")
    dry_run: Flag = Field(False, description="List the products and change nothing")

    @model_validator(mode="after")
    def _selection_is_by_id_or_by_robot(self) -> Self:
        if bool(self.id) == (self.robot is not None):
            raise InputError("id, or robot: give one of the two")
        if self.robot == ANY_ROBOT:
            raise InputError("robot=any: name one robot")
        if self.id and (self.dfpc, self.t0, self.t1) != (None, None, None):
            raise InputError("dfpc, t0, t1: they select maps of a robot, not single products")
        if not self.type:
            raise InputError("type: expected at least one product type")
        return self


class PoseParameters(HistoryViewParameters):
    """Parameters of ``T_parent_child`` at a time."""

    robot: Robot | None = Field(None, description="Robot id")
    t: Stamp | None = Field(None, description="Nanoseconds or RFC 3339; default: the newest")
    parent: Frame = Field("site", description="Parent frame")
    child: Frame | None = Field(None, description="Child frame; default: the robot's base")
    limit_s: Annotated[Number, Field(ge=0, le=3600)] | None = Field(
        None, description="Largest extrapolation, seconds"
    )


class DeliveryParameters(Parameters):
    """The form of a delivered product."""

    format: str | None = Field(None, max_length=16, description="Codec or file format; default: as stored")
    as_type: str | None = Field(None, alias="as", max_length=64, description="InFuse type")
    deliver: Deliver = Field("inline", description="Payload, its id, or the id if the payload is large")


class IdParameters(Parameters):
    """The id of a product."""

    id: str = Field(description="Product id")


class RevisionParameters(IdParameters):
    """A product and the revision on which a change is based."""

    if_match: str | None = Field(None, description='Revision as 3 or "r3", or * for any')


class UpdateParameters(RevisionParameters):
    """Parameters of a change of an annotation."""

    author: str | None = None


class PutParameters(Parameters):
    """Names of an inserted product."""

    robot: Robot | None = None
    dfpc: str
    port: str
    product: str


class FrameParameters(HistoryViewParameters):
    """A frame, in a state of the frame tree."""

    frame: str | None = None


class AnchoredFrameParameters(HistoryViewParameters):
    """The frame whose anchor is read or set."""

    frame: str


class BodyParameters(Parameters):
    """The name of a body."""

    name: str | None = None


class EventParameters(Parameters):
    """Events after an ordinal."""

    since: Ordinal = Field(0, description="Ordinal of the last known event")
    limit: Annotated[Whole, Field(ge=1, le=MAX_PAGE)] = Field(
        MAX_PAGE, description="Largest number of events"
    )
    kind: Names = Field(default_factory=tuple, description="Kinds of events, separated by commas")


class HistoryParameters(EventParameters):
    """Events of one scope, or of all."""

    scope: str | None = Field(None, max_length=64, description="Robot id or ground")


class ProvenanceParameters(Parameters):
    """Direction and depth of a provenance query."""

    direction: Literal["up", "down"] = Field("up", description="Up to the inputs, or down to the results")
    depth: Annotated[Whole, Field(ge=1, le=MAX_GENERATIONS)] = Field(
        MAX_GENERATIONS, description="Largest number of generations"
    )


class ProductProvenanceParameters(IdParameters, ProvenanceParameters):
    """A product and the direction of its provenance."""


class AlarmParameters(Parameters):
    """An active alarm."""

    kind: str
    source: str


class PayloadParameters(Parameters):
    """A part of a payload."""

    offset: Ordinal = 0
    len: Annotated[Whole, Field(ge=1)] | None = None


class RetentionParameters(Parameters):
    """Application of the retention rules, and the listing of every decision.

    ``confirm_clock`` states that the mission time is correct, after the clock was lost or has jumped.
    """

    apply: Flag = False
    all: Flag = False
    confirm_clock: Flag = False


Deadline = Annotated[Number, Field(ge=DEADLINE_BOUNDS_MS[0], le=DEADLINE_BOUNDS_MS[1])]


class RobotParameters(Parameters):
    """Robot of a call."""

    robot: Robot | None = Field(None, description="Robot id, or any")


class JobsParameters(RobotParameters):
    """Jobs of the orchestrator: one by its id, or the newest."""

    job: str | None = None
    limit: Annotated[Whole, Field(ge=1, le=MAX_JOBS)] = Field(
        DEFAULT_JOBS, description="Largest number of jobs"
    )
    state: Literal["any", "open"] = Field("any", description="Only the jobs that have not ended, or all")


class JobParameters(RobotParameters):
    """A job by its id or by the id of its request."""

    job: str


class RenewParameters(JobParameters):
    """A job and its new deadline."""

    deadline_ms: Deadline = DEFAULT_DEADLINE_MS


class CatalogueParameters(RobotParameters):
    """A product type, or all of them."""

    type: str | None = None


class ModeParameters(RobotParameters):
    """Change of the mode of a sensor."""

    sensor: str
    mode: str
    holder: str = ""
    acquire: Acquire = Field(
        default_factory=AcquisitionParameters, description="Parameters of a mode for single acquisitions"
    )


class FaultParameters(RobotParameters):
    """Simulated loss of a sensor, for the reason ``lost``, or its recovery."""

    sensor: str
    lost: str = ""


class ContactViewParameters(Parameters):
    """Parameters of a view of the exchange with robots over contact windows."""

    what: Literal["status", "plan", "estimate", "requests"] = Field("status", description="What to return")
    robot: Robot | None = Field(None, description="Robot of the estimate, the windows or the request")
    id: str | None = Field(None, pattern=rf"^{REQUEST_ID}$", description="Request to return or to keep")
    limit: Annotated[Whole, Field(ge=1, le=1000)] = Field(1000, description="Largest number of items")


class ContactParameters(ContactViewParameters):
    """Parameters of ``dpm/@rpc/contact``."""

    first: str | None = Field(
        None, max_length=64, description="Product of the robot that is sent before all others, with robot"
    )
    expires_s: Annotated[Number, Field(gt=0)] | None = Field(
        None, description="Time until a kept request expires, default a day"
    )


class ContactFirst(Parameters):
    """A product of a robot that is sent before all others, over HTTP."""

    robot: Robot = Field(description="Robot that sends it")
    id: str = Field(max_length=64, description="Product whose record is at the ground")


class ContactRequest(Parameters):
    """A request that is kept for a robot, over HTTP."""

    robot: Robot = Field(description="Robot that executes it")
    parameters: dict[str, str | int | float] = Field(
        min_length=1, max_length=64, description="Parameters of the request, as type, region and frame"
    )
    expires_s: Annotated[Number, Field(gt=0)] | None = Field(
        None, description="Time until it expires, default a day"
    )
    id: str | None = Field(
        None, pattern=rf"^{REQUEST_ID}$", description="Name of the request; the same name repeats nothing"
    )


class RequestParameters(Parameters):
    """Parameters of a request to the orchestrator."""

    type: str = Field(description="Product type")
    robot: Robot | None = Field(None, description="Robot id, or any")
    region: RegionText | None = Field(None, description="Region as in a search, metres")
    region_frame: Frame | None = Field(None, description="Frame of the region; default: frame")
    frame: Frame = Field("site", description="Frame of the answer; for a pose the parent")
    child: Frame | None = Field(None, description="Child frame of a pose; default: the robot's base")
    t: Stamp | None = Field(None, description="Mission time: nanoseconds or RFC 3339; default: the newest")
    t0: Stamp | None = Field(
        None, description="Start of the capture of a scheduled request, mission time; with t1"
    )
    t1: Stamp | None = Field(None, description="End of the capture of a scheduled request")
    max_age_s: Age | None = Field(None, description="Largest age")
    resolution_m: Resolution | None = Field(None, description="Cell size, metres")
    min_coverage: Annotated[Number, Field(ge=0, le=1)] = Field(
        0.0, description="Fraction of the region that must hold data"
    )
    max_oldest_age_s: Age | None = Field(None, description="Largest age of the oldest part of a map")
    max_sigma_m: Sigma | None = Field(
        None, description="Largest standard deviation of the position, or of the elevation of a map, metres"
    )
    max_sigma_deg: Sigma | None = Field(
        None, description="Largest standard deviation of the orientation, degrees"
    )
    covariance_kind: Literal["formal", "calibrated"] | None = Field(
        None, description="Weakest kind of covariance"
    )
    status: Literal["OK"] | None = Field(None, description="OK: no DEGRADED product")
    as_type: str | None = Field(None, alias="as", description="ASN.1 type of the answer")
    format: str = Field("uper", description="Codec or file format")
    deliver: RequestDeliver = Field(
        "auto", description="Payload, its id, the id above 1 MB, or none: the product stays in the DPM"
    )
    deadline_ms: Deadline = Field(DEFAULT_DEADLINE_MS, description="Time until the final answer")
    explain: Flag = Field(False, description="Describe the plan without running it")
    acquire: Acquire | None = Field(
        None, description="One acquisition for this request: now, or parameters as pan_deg:30,tilt_deg:-10"
    )
    every_s: Annotated[Number, Field(ge=0, le=3600)] | None = Field(
        None, description="Standing request: least time between answers, 0 for every change"
    )
    priority: Annotated[Whole, Field(ge=0, le=9)] = Field(5, description="9 is served first")
    progress: Flag | None = Field(None, description="Send progress replies")
    request: str | None = Field(None, pattern=rf"^{REQUEST_ID}$", description="Name of the request")

    @model_validator(mode="after")
    def _window_is_whole(self) -> Self:
        """Refuse a window of capture with only one end, in the wrong order, or together with ``t``."""
        if self.t0 is None and self.t1 is None:
            return self
        if self.t0 is None or self.t1 is None:
            missing = "t0" if self.t0 is None else "t1"
            raise InputError(f"{missing} is missing: a scheduled request has both t0 and t1")
        if self.t1 <= self.t0:
            raise InputError(f"t1={self.t1}: expected later than t0={self.t0}")
        if self.t is not None:
            raise InputError(f"t={self.t}: a scheduled request with t0 and t1 has no t")
        return self
