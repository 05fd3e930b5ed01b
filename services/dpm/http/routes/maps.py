# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``/api/v1/maps/{layer}``: windows assembled from patches, clouds of a region, elevation along a line."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, Query
from fastapi.responses import Response
from pydantic import Field

from cdff_common.contract.queries import (
    AreaStatisticsParameters,
    CloudParameters,
    ContourParameters,
    DeliveryParameters,
    DifferenceParameters,
    NavigationWindowParameters,
    ProfileParameters,
    SurfaceParameters,
    ViewshedParameters,
    WindowParameters,
    WithdrawalParameters,
)
from services.dpm.http.context import Ctx
from services.dpm.http.converted_files import file_response
from services.dpm.http.middleware.roles import allowed
from services.dpm.http.models import OpenModel
from services.dpm.operations.retrieval import DeliveredProduct
from services.dpm.rendering.convert import file_formats

router = APIRouter(prefix="/api/v1/maps", tags=["maps"])


def _file_of(type_name: str) -> dict[int | str, dict[str, Any]]:
    media_types = ("application/octet-stream", *file_formats(type_name).values())
    return {200: {"description": "The requested file", "content": {name: {} for name in media_types}}}


_FORMAT = Field(max_length=16, description="Codec or file format")


class WindowFileParameters(WindowParameters):
    """An elevation window and its format."""

    format: Annotated[str, _FORMAT] = "tif"


class NavigationFileParameters(NavigationWindowParameters):
    """A window of navigation maps and its format."""

    format: Annotated[str, _FORMAT] = "tif"


class CloudFileParameters(CloudParameters):
    """An assembled cloud and its format."""

    format: Annotated[str, _FORMAT] = "ply"


class ProfileAnswer(OpenModel):
    """Elevation along a line: columns of one length, null where unobserved."""

    distance_m: list[float]
    x_m: list[float]
    y_m: list[float]
    mean_m: list[float | None]
    sigma_m: list[float | None]
    count: list[float]
    resolution_m: float
    coverage: float
    patches: list[str]


class Distribution(OpenModel):
    """Distribution of the values of cells; with percentiles."""

    mean: float
    std: float
    min: float
    max: float


class AreaStatistics(OpenModel):
    """Statistics of an area; null where nothing is observed, or an error is unknown."""

    cells: int
    area_m2: float
    coverage: float
    height_m: Distribution | None
    mean_sigma_m: float | None
    slope_deg: Distribution | None
    roughness_m: Distribution | None


@router.get("/dem/window", response_class=Response, responses=_file_of("ElevationMap"))
def window(context: Ctx, parameters: Annotated[WindowFileParameters, Query()]) -> Response:
    """Return the elevation of a region, assembled from every patch; ``CDFF-…`` headers state origin and
    coverage.
    """
    product = context.dpm.retrieval.window(parameters, _form(parameters.format))
    return file_response(context, product.body, "dem_window", origin_headers(product.metadata))


@router.get("/navigation_map/window", response_class=Response, responses=_file_of("NavigationMap"))
def navigation(context: Ctx, parameters: Annotated[NavigationFileParameters, Query()]) -> Response:
    """Return the traversability of a region: each cell is from the newest map, the oldest map, or the map
    with the worst class.
    """
    product = context.dpm.retrieval.navigation_window(parameters, _form(parameters.format))
    return file_response(context, product.body, "navigation_map_window", origin_headers(product.metadata))


@router.get("/pointcloud/window", response_class=Response, responses=_file_of("Pointcloud"))
def cloud(context: Ctx, parameters: Annotated[CloudFileParameters, Query()]) -> Response:
    """Return the points of a region from all clouds, in one frame, downsampled evenly to ``points``."""
    product = context.dpm.retrieval.cloud(parameters, _form(parameters.format))
    metadata = product.metadata
    headers = {
        "CDFF-Points": str(metadata["points"]),
        "CDFF-Points-Seen": str(metadata["points_seen"]),
        "CDFF-Voxel-M": f"{metadata['voxel_m']:g}",
    }
    return file_response(context, product.body, "pointcloud_window", headers)


@router.get("/dem/profile", response_model=ProfileAnswer)
def profile(context: Ctx, parameters: Annotated[ProfileParameters, Query()]) -> dict[str, Any]:
    """Return the elevation along a path; each sample is the value of its cell."""
    return context.dpm.retrieval.profile(parameters)


_RASTER: dict[int | str, dict[str, Any]] = {
    200: {
        "description": "GeoTIFF, or arrays with corner_m and resolution_m",
        "content": {"image/tiff": {}, "application/x-npz": {}},
    }
}


@router.get("/dem/surface", response_class=Response, responses=_RASTER)
def surface(context: Ctx, parameters: Annotated[SurfaceParameters, Query()]) -> Response:
    """Return slope with its standard deviation, aspect and roughness of a region, by local planes."""
    return _analysed(context, context.dpm.terrain.surface(parameters))


@router.get("/dem/viewshed", response_class=Response, responses=_RASTER)
def viewshed(context: Ctx, parameters: Annotated[ViewshedParameters, Query()]) -> Response:
    """Return the visibility from a point: its probability, and the hidden height with its error."""
    return _analysed(context, context.dpm.terrain.viewshed(parameters))


@router.get("/dem/difference", response_class=Response, responses=_RASTER)
def difference(context: Ctx, parameters: Annotated[DifferenceParameters, Query()]) -> Response:
    """Return the change of the heights from the captures until a time to those after it."""
    return _analysed(context, context.dpm.terrain.difference(parameters))


@router.get(
    "/dem/contours",
    response_class=Response,
    responses={200: {"description": "Lines in metres", "content": {"application/geo+json": {}}}},
)
def contours(context: Ctx, parameters: Annotated[ContourParameters, Query()]) -> Response:
    """Return contour lines as GeoJSON."""
    return _analysed(context, context.dpm.terrain.contours(parameters))


@router.get("/dem/statistics", response_model=AreaStatistics)
def statistics(context: Ctx, parameters: Annotated[AreaStatisticsParameters, Query()]) -> Response:
    """Return statistics of the heights and slopes of a region, and its volumes above and below a plane."""
    return _analysed(context, context.dpm.terrain.statistics(parameters))


class Withdrawn(OpenModel):
    """Ids of the products that were removed from all maps, and of those that were made from them."""

    withdrawn: list[str]
    derived: list[str]
    robots: list[str]
    applied: bool


@router.post("/withdrawals", response_model=Withdrawn, openapi_extra=allowed("operator"))
def withdraw(context: Ctx, selection: WithdrawalParameters) -> dict[str, Any]:
    """Remove patches, or all maps of a robot in a time, and the maps made from them, from all maps."""
    return context.dpm.withdrawal.run(selection)


def _analysed(context: Ctx, product: DeliveredProduct) -> Response:
    name = f"dem_{product.metadata['analysis']}"
    return file_response(context, product.body, name, origin_headers(product.metadata))


def _form(format_name: str) -> DeliveryParameters:
    return DeliveryParameters.parse({"format": format_name})


def origin_headers(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return headers that state the patches, coverage and times of a window."""
    return {
        "CDFF-Coverage": f"{metadata['coverage']:.4f}",
        "CDFF-Resolution-M": f"{metadata['resolution_m']:g}",
        "CDFF-Patches": str(len(metadata["patches"])),
        "CDFF-Disagreeing": str(metadata["disagreeing"]),
        "CDFF-Differing-Robots": ",".join(
            a["robot"] for a in metadata.get("agreement", ()) if a["excess_sigma_m"]
        ),
        "CDFF-Frames-Revision": str(metadata["frames_revision"]),
        "CDFF-Newest-Ns": str(metadata["newest_ns"]),
        "CDFF-Oldest-Ns": str(metadata["oldest_ns"]),
    }
