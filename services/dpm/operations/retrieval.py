# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Retrieval of products: searches, payloads in any form, assembled windows and clouds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cdff_common.codecs import encode
from cdff_common.codecs.wire_types import wire_type
from cdff_common.contract.limits import INLINE_BYTES
from cdff_common.contract.queries import (
    CloudParameters,
    DeliveryParameters,
    NavigationWindowParameters,
    NewestParameters,
    ProfileParameters,
    SearchParameters,
    WindowParameters,
)
from cdff_common.errors import ProductNotFoundError, UnavailableError
from cdff_common.geodesy import Georeference
from cdff_common.interfaces.product import Status
from dpm_store import NewProduct, Page, ProductRecord, Query, Store
from dpm_store.maps.clouds import DERIVED_PORT as CLOUD_PORT
from dpm_store.maps.elevation import DERIVED_PORT
from dpm_store.maps.navigation import DERIVED_PORT as NAVIGATION_PORT
from dpm_store.maps.patches import BATCH_BYTES, BATCHES, DERIVED_DFPC
from dpm_store.maps.profile import elevation_profile
from dpm_store.maps.windows import Window, WindowPlan, WindowQuery
from services.dpm.operations.checks import FrameNames
from services.dpm.operations.event_publisher import EventPublisher
from services.dpm.operations.work_budget import WorkBudget
from services.dpm.queries.store_queries import cloud_query, search_query, window_query
from services.dpm.rendering.convert import Converted, convert

#: Memory of derived products: of a window per cell, with its file; of a cloud per point of its limit; of a
#: strip of a window or a part of a profile.
_CELL_BYTES, _POINT_BYTES, _STRIP_BYTES = 72, 200, 32 << 20
#: Memory of a conversion, and of a decoded patch with its payload, in multiples of the payload.
CONVERSION_COPIES, _PATCH_COPIES = 5, 3
#: Number of products on the first page among which the newest usable one is searched.
_NEWEST_PAGE = 2
#: A product as it is stored.
AS_STORED = DeliveryParameters.parse({})


@dataclass(frozen=True, slots=True)
class DeliveredProduct:
    """A product in the requested form, with its metadata.

    ``reference`` is its id if it is delivered by reference; ``body`` is then empty.
    """

    body: Converted
    metadata: dict[str, Any]
    reference: str | None = None


class Retrieval:
    """Operations that return stored and derived products."""

    def __init__(
        self, store: Store, events: EventPublisher, frame_names: FrameNames, budget: WorkBudget
    ) -> None:
        self._store = store
        self._budget = budget
        self._events = events
        self._frame_names = frame_names

    def search(self, parameters: SearchParameters) -> Page:
        """Return one page of products; raises FrameNotFoundError for an unknown frame of the region."""
        return self.find(search_query(parameters))

    def find(self, query: Query) -> Page:
        """Return one page of a store query; raises FrameNotFoundError for an unknown frame of the region."""
        self._events.count("searches")
        if query.region is not None:
            self._frame_names.check_known(query.frame)
            self._frame_names.check_known(query.region.near_frame or query.frame)
        return self._store.search(query)

    def product(self, product_id: str, form: DeliveryParameters = AS_STORED) -> DeliveredProduct:
        """Return a product by id, in a codec, file format or InFuse type."""
        return self._product(self._store.get(product_id), form)

    def newest(self, parameters: NewestParameters, form: DeliveryParameters = AS_STORED) -> DeliveredProduct:
        """Return the first product of a search that is not FAILED, without its payload if it is ``known``.

        Raises
        ------
        ProductNotFoundError
            If there is none.
        """
        query = replace(search_query(parameters), limit=_NEWEST_PAGE)
        while True:
            page = self.find(query)
            usable = (r for r in page.items if r.header.quality.status is not Status.FAILED)
            if (record := next(usable, None)) is not None:
                if record.id == parameters.known:
                    return DeliveredProduct(Converted(b"", "", ""), record.to_dict(), record.id)
                return self._product(record, form)
            if page.cursor is None:
                where = f" in {parameters.region.text}" if parameters.region else ""
                raise ProductNotFoundError(f"no product of that kind{where}")
            query = replace(query, cursor=page.cursor, limit=parameters.limit)

    def _product(self, record: ProductRecord, form: DeliveryParameters) -> DeliveredProduct:
        self._events.count("gets")
        is_stored_form = form.format in (None, "native", record.codec) and form.as_type is None
        self._budget.charge(2 * record.size if is_stored_form else CONVERSION_COPIES * record.decoded_bytes)
        payload = self._store.payload(record.id)
        place = self.georeference(record.header.frame, form.format)
        body = convert(
            record.type_name, record.codec, payload, form.format, form.as_type, record.header, place=place
        )
        return DeliveredProduct(body, record.to_dict())

    def payload(
        self, product_id: str, offset: int = 0, length: int | None = None
    ) -> tuple[ProductRecord, bytes]:
        """Return the stored bytes from an offset on."""
        self._events.count("gets")
        record = self._store.get(product_id)
        self._budget.charge(2 * min(record.size, record.size if length is None else length))
        return record, self._store.payload(product_id, offset, length)

    def georeference(self, frame: str, format_name: str | None) -> Georeference | None:
        """Return the CRS of a frame and its axes in it; None for formats that do not state one."""
        return self._store.anchors.of(frame).georeference if format_name in ("tif", "geojson") else None

    def window(self, parameters: WindowParameters, form: DeliveryParameters = AS_STORED) -> DeliveredProduct:
        """Return an elevation window; raises UnavailableError below ``min_coverage``."""
        window = self.elevation(parameters)
        return self._delivered(window, window.map, DERIVED_PORT, "dem", form)

    def navigation_window(
        self, parameters: NavigationWindowParameters, form: DeliveryParameters = AS_STORED
    ) -> DeliveredProduct:
        """Return a window of navigation maps; raises UnavailableError below ``min_coverage``."""
        window = self.navigation(parameters)
        return self._delivered(window, window.map, NAVIGATION_PORT, "navigation_map", form)

    def cloud(self, parameters: CloudParameters, form: DeliveryParameters = AS_STORED) -> DeliveredProduct:
        """Return the points of a region from all clouds, in one frame, at most ``points``."""
        self._events.count("windows")
        self._budget.charge(_STRIP_BYTES + _POINT_BYTES * parameters.points)
        assembled = self._store.clouds.assemble(cloud_query(parameters), parameters.points)
        return self._delivered(assembled, assembled.cloud, CLOUD_PORT, "pointcloud", form)

    def profile(self, parameters: ProfileParameters) -> dict[str, Any]:
        """Return the elevation along a path, in JSON form."""
        self._events.count("windows")
        path_m = np.array(parameters.path).reshape(-1, 2)
        query = window_query(parameters, self._store.clock.now_ns())
        self._budget.charge(2 * _STRIP_BYTES)
        return elevation_profile(self._store.maps, query, path_m, parameters.step_m).to_dict()

    def elevation(self, parameters: WindowParameters) -> Window:
        """Return an elevation window as a value; raises UnavailableError below ``min_coverage``."""
        query = window_query(parameters, self._store.clock.now_ns())
        return _checked_coverage(self.assembled(query), parameters.min_coverage)

    def assembled(self, query: WindowQuery, more_cell_bytes: int = 0) -> Window:
        """Return an elevation window of a store query; ``more_cell_bytes`` is the memory of its use."""
        self._events.count("windows")
        plan = self._store.maps.plan(query)
        cells = plan.geometry.rows * plan.geometry.cols
        self._budget.charge(_window_bytes(plan) + more_cell_bytes * cells)
        return self._store.maps.elevation_window(query, plan)

    def navigation(self, parameters: NavigationWindowParameters) -> Window:
        """Return a window of navigation maps as a value; raises UnavailableError below ``min_coverage``."""
        self._events.count("windows")
        query = window_query(parameters, self._store.clock.now_ns())
        plan = self._store.maps.navigation.plan(query)
        self._budget.charge(_window_bytes(plan))
        return _checked_coverage(self._store.maps.navigation.window(query, plan), parameters.min_coverage)

    def _delivered(
        self, derived: Any, value: Any, port: str, product: str, form: DeliveryParameters
    ) -> DeliveredProduct:
        """Return a derived product inline; or store it and return its id, depending on ``deliver`` and its
        size.
        """
        type_name, header = wire_type(value), derived.header
        metadata = header.to_dict() | derived.manifest() | {"robot": derived.robot}
        if form.deliver != "reference":
            place = self.georeference(header.frame, form.format)
            body = convert(
                type_name, "uper", None, form.format, form.as_type, header, value=value, place=place
            )
            if form.deliver == "inline" or len(body.data) <= INLINE_BYTES:
                return DeliveredProduct(body, metadata)
            del body
        payload = encode(value, "uper")
        names = {"robot": derived.robot, "dfpc": DERIVED_DFPC, "port": port, "product": product}
        new = NewProduct(header, payload, **names, type_name=type_name, value=value)
        self._store.put_all([new])
        self._events.publish()
        return DeliveredProduct(Converted(b"", "", ""), metadata, header.id)


def _window_bytes(plan: WindowPlan) -> int:
    """Return the memory of a window: its layers and file, the strip in work, and the patches in memory."""
    cells = plan.geometry.rows * plan.geometry.cols
    reading = (
        BATCHES
        * _PATCH_COPIES
        * min(plan.selection.total_bytes, max(BATCH_BYTES, plan.selection.largest_bytes))
    )
    return _CELL_BYTES * cells + min(200 * cells, 6 * _STRIP_BYTES) + reading


def _checked_coverage(window: Window, min_coverage: float) -> Window:
    if window.coverage < min_coverage:
        raise UnavailableError(f"coverage {window.coverage:.3f} of the region, asked {min_coverage:.3f}")
    return window
