# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is handed out: pages of a search, products in the form asked for, windows and clouds assembled from many."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from cdff_common.codecs import encode
from cdff_common.codecs.siblings import wire_type
from cdff_common.errors import ProductNotFoundError, UnavailableError
from cdff_common.interfaces.product import Status
from dpm_store import Page, ProductRecord, Query
from dpm_store.clouds import DERIVED_PORT as CLOUD_PORT
from dpm_store.maps import DERIVED_PORT
from dpm_store.navigation import DERIVED_PORT as NAVIGATION_PORT
from dpm_store.patches import DERIVED_DFPC
from dpm_store.profile import elevation_profile
from dpm_store.windows import Window
from services.dpm.announcing import Announcing
from services.dpm.convert import Converted, convert
from services.dpm.parameters import CloudRequest, ProfileRequest, WindowRequest

#: Answers larger than this are handed over by reference where the asker leaves it open (contract §5).
INLINE_BYTES = 1_000_000


@dataclass(frozen=True, slots=True)
class Answer:
    """A product as it was asked for: bytes, encoding or media type, and metadata that go with them.

    ``reference`` is the id to pull it by where it was too large to send at once.
    """

    body: Converted
    metadata: dict[str, Any]
    reference: str | None = None


class Delivering(Announcing):
    """Operations that hand out products, stored and derived ones."""

    def search(self, query: Query) -> Page:
        """One page of products; raises FrameNotFoundError where the region's frame is not known."""
        self._count("searches")
        if query.region is not None:
            self._frames.check_known(query.frame)
            self._frames.check_known(query.region.near_frame or query.frame)
        return self.store.search(query)

    def product(self, product_id: str, format_name: str | None = None, as_type: str | None = None) -> Answer:
        """A product by id, in a codec, file format or InFuse type."""
        self._count("gets")
        record = self.store.get(product_id)
        payload = self.store.payload(product_id)
        wkt = self.crs_wkt(record.header.frame, format_name)
        body = convert(record.type_name, record.codec, payload, format_name, as_type, record.header, wkt=wkt)
        return Answer(body, record.to_dict())

    def crs_wkt(self, frame: str, format_name: str | None) -> str | None:
        """CRS of a frame as WKT, for the formats that say one."""
        return self.store.places.of(frame).wkt if format_name in ("tif", "geojson") else None

    def newest(self, query: Query, format_name: str | None = None, as_type: str | None = None) -> Answer:
        """The newest product that a search finds and that has a value."""
        for record in self.search(query).items:
            if record.header.quality.status is not Status.FAILED:
                return self.product(record.id, format_name, as_type)
        raise ProductNotFoundError("no product of that kind" + (f" in {query.region.text}" if query.region else ""))

    def window(
        self, asked: WindowRequest, format_name: str | None = None, as_type: str | None = None, deliver: str = "auto"
    ) -> Answer:
        """An elevation window; stored and handed over by id where it is large or asked by reference.

        Raises
        ------
        UnavailableError
            If less of the region is covered than asked.
        """
        self._count("windows")
        window = self.elevation(asked)
        return self._derived(window, window.map, DERIVED_PORT, "dem", format_name, as_type, deliver)

    def navigation_window(
        self, asked: WindowRequest, format_name: str | None = None, as_type: str | None = None, deliver: str = "auto"
    ) -> Answer:
        """As ``window``, of navigation maps."""
        self._count("windows")
        window = self.navigation(asked)
        return self._derived(window, window.map, NAVIGATION_PORT, "navigation_map", format_name, as_type, deliver)

    def cloud(
        self, asked: CloudRequest, format_name: str | None = None, as_type: str | None = None, deliver: str = "auto"
    ) -> Answer:
        """All points of a region in one frame, within a budget; stored and handed over by id as windows are."""
        self._count("windows")
        made = self.store.clouds.assemble(asked.query, asked.points)
        return self._derived(made, made.cloud, CLOUD_PORT, "pointcloud", format_name, as_type, deliver)

    def profile(self, asked: ProfileRequest) -> dict[str, Any]:
        """Elevation along a line, as plain data."""
        self._count("windows")
        return elevation_profile(self.store.maps, asked.query, asked.path_m, asked.step_m).to_dict()

    def _derived(
        self, made: Any, value: Any, port: str, product: str, format_name: str | None, as_type: str | None, deliver: str
    ) -> Answer:
        """A derived product inline, or stored and by id where it is large or asked by reference."""
        payload, wire = encode(value, "uper"), wire_type(value)
        wkt = self.crs_wkt(made.header.frame, format_name)
        body = convert(wire, "uper", payload, format_name, as_type, made.header, value=value, wkt=wkt)
        metadata = made.header.to_dict() | made.manifest() | {"robot": made.robot}
        if deliver == "inline" or (deliver == "auto" and len(body.data) <= INLINE_BYTES):
            return Answer(body, metadata)
        self.store.put(
            made.header, payload, robot=made.robot, dfpc=DERIVED_DFPC, port=port, product=product, type_name=wire,
            codec="uper", value=value,
        )  # fmt: skip
        self._tell()
        return Answer(Converted(b"", "", ""), metadata, made.header.id)

    def elevation(self, asked: WindowRequest) -> Window:
        """An elevation window as a value; raises UnavailableError below the coverage asked."""
        return _covered(self.store.maps.elevation_window(asked.query), asked)

    def navigation(self, asked: WindowRequest) -> Window:
        """A window of navigation maps as a value; raises UnavailableError below the coverage asked."""
        return _covered(self.store.maps.navigation.window(asked.query), asked)

    def payload(self, product_id: str, offset: int = 0, length: int | None = None) -> tuple[ProductRecord, bytes]:
        """Bytes as they are stored, from an offset on."""
        self._count("gets")
        return self.store.get(product_id), self.store.payload(product_id, offset, length)


def _covered(window: Window, asked: WindowRequest) -> Window:
    if window.coverage < asked.min_coverage:
        raise UnavailableError(f"coverage {window.coverage:.3f} of the region, asked {asked.min_coverage:.3f}")
    return window
