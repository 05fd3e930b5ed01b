# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of a search of items: in the URL, or as JSON, which has the same bounds."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from cdff_common.errors import InputError
from dpm_store import Query
from dpm_store.products.records import Order
from dpm_store.search.filters import Call
from dpm_store.search.filters import Field as Column
from services.dpm.http.cql2.expressions import LANGUAGES, MAX_TEXT, parse_filter
from services.dpm.http.cql2.queryables import STAC, Queryable, queryable
from services.dpm.http.models import Json
from services.dpm.http.search_places import both, geometry_of, touching_place
from services.dpm.http.stac.catalogue import Catalogue, FeaturePage, numbers_of, page_size, span_of
from services.dpm.http.stac.fields import Fields
from services.dpm.queries.bodies import validated

#: Longest URL parameter, and the largest number of properties in an order.
_MOST_LETTERS, _MOST_SORTED = 20_000, 8
#: Name of coordinates with longitude first on the body, as clients of the Earth send it.
_LONGITUDE_FIRST = "http://www.opengis.net/def/crs/OGC/1.3/CRS84"
Text = Annotated[str, Field(max_length=_MOST_LETTERS)] | None
Limit = Annotated[int, Field(ge=1, le=2**31)]
FilterText = Annotated[str, Field(max_length=MAX_TEXT)] | None
Language = Annotated[str, Field(max_length=40)] | None
ItemsForm = Annotated[
    Literal["json", "html", "parquet"] | None,
    Field(description="GeoJSON, HTML, or GeoParquet with the items of all pages; default: as Accept prefers"),
]


class PageParameters(BaseModel):
    """Parameters of a page of items."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    bbox: Text = Field(None, description="4 or 6 numbers: degrees of the body, longitude first")
    datetime: Text = Field(None, description="RFC 3339 time, or an interval t0/t1, open with ..")
    limit: Limit | None = Field(None, description="Items per page, at most 1000")
    token: Text = Field(None, description="Token of the previous page")
    filter: FilterText = Field(None, description="Condition in CQL2; see queryables")
    filter_lang: Language = Field(None, alias="filter-lang", description=" or ".join(LANGUAGES))
    filter_crs: Text = Field(None, alias="filter-crs", description=f"{_LONGITUDE_FIRST}, the only one")
    sortby: Text = Field(None, description="Properties with commas, - before one descends")
    fields: Text = Field(None, description="Fields to add with commas, - before one removes it")
    f: ItemsForm = None


class ItemsParameters(PageParameters):
    """Parameters of a page of a collection's items."""

    collections: Text = Field(None, description="The collection of the path, which pystac-client repeats")


class SearchParameters(PageParameters):
    """Parameters of a search; ``bbox`` or ``intersects``, not both."""

    collections: Text = Field(None, description="Ids, separated by commas")
    ids: Text = Field(None, description="Ids, separated by commas")
    intersects: Text = Field(None, description="A GeoJSON geometry in degrees of the body")


class SortedField(BaseModel):
    """A property of an order."""

    field: Annotated[str, Field(max_length=200)]
    direction: Literal["asc", "desc"] = "asc"


class FieldSelection(BaseModel):
    """Fields to add and to remove."""

    include: Annotated[list[Annotated[str, Field(max_length=200)]], Field(max_length=100)] | None = None
    exclude: Annotated[list[Annotated[str, Field(max_length=200)]], Field(max_length=100)] | None = None


class SearchBody(BaseModel):
    """A search as JSON."""

    model_config = ConfigDict(extra="forbid", populate_by_name=True)

    bbox: Annotated[list[float], Field(min_length=4, max_length=6)] | None = None
    datetime: Annotated[str, Field(max_length=100)] | None = None
    limit: Limit | None = None
    token: Annotated[str, Field(max_length=4000)] | None = None
    collections: Annotated[list[Annotated[str, Field(max_length=64)]], Field(max_length=100)] | None = None
    ids: Annotated[list[Annotated[str, Field(max_length=64)]], Field(max_length=1000)] | None = None
    intersects: Json | None = None
    filter: Json | bool | FilterText = None
    filter_lang: Language = Field(None, alias="filter-lang")
    filter_crs: Annotated[str, Field(max_length=200)] | None = Field(None, alias="filter-crs")
    sortby: Annotated[list[SortedField], Field(max_length=_MOST_SORTED)] | None = None
    fields: FieldSelection | None = None

    @property
    def selection(self) -> Fields | None:
        """The selection of fields; None for that of lists."""
        return (
            None if self.fields is None else Fields.of(self.fields.include or (), self.fields.exclude or ())
        )


_SEARCH_BODY = TypeAdapter(SearchBody)


def search_body(parameters: PageParameters, **other: Any) -> SearchBody:
    """Return the parameters of a GET search in the form of a POST search; raises InputError."""
    shared = {name: getattr(parameters, name) for name in ("datetime", "limit", "token", "filter")}
    fields = None
    if parameters.fields is not None:
        selection = Fields.parse(parameters.fields)
        fields = {"include": sorted(selection.include), "exclude": sorted(selection.exclude)}
    body = {
        "bbox": numbers_of(parameters.bbox),
        "filter-lang": parameters.filter_lang,
        "filter-crs": parameters.filter_crs,
        "sortby": None if parameters.sortby is None else sorted_fields(parameters.sortby),
        "fields": fields,
        **shared,
        **other,
    }
    return validated(_SEARCH_BODY, body, "search")


def sorted_fields(text: str) -> list[Json]:
    """Return the properties of an order as JSON; ``-`` before one descends."""
    names = [name.strip() for name in text.split(",") if name.strip()]
    return [
        {"field": name.lstrip("+-"), "direction": "desc" if name.startswith("-") else "asc"} for name in names
    ]


def find(catalogue: Catalogue, search: SearchBody) -> FeaturePage:
    """Return the products of a search.

    Raises
    ------
    InputError
        If the box, geometry, time, filter, order or token is malformed.
    """
    if search.bbox is not None and search.intersects is not None:
        raise InputError("bbox and intersects: give one of the two")
    intersects = None if search.intersects is None else geometry_of(search.intersects)
    t0_ns, t1_ns = span_of(search.datetime)
    where = filter_of(search.filter, search.filter_lang, search.filter_crs, STAC)
    if search.ids is not None:
        where = both(where, Call("in", (Column("id"), tuple(dict.fromkeys(search.ids)))))
    query = Query(
        types=tuple(search.collections or ()),
        t0_ns=t0_ns,
        t1_ns=t1_ns,
        limit=page_size(search.limit),
        cursor=search.token,
        where=where,
        **order_of([(item.field, item.direction == "desc") for item in search.sortby or ()], STAC),
    )
    return catalogue.find(query, bbox=search.bbox, intersects=intersects)


def filter_of(data: Any, language: str | None, crs: str | None, names: dict[str, Queryable] | Any) -> Any:
    """Return the expression of a filter, None without one; raises InputError."""
    if crs not in (None, _LONGITUDE_FIRST):
        raise InputError(f"filter-crs={str(crs)[:80]!r}: expected {_LONGITUDE_FIRST}")
    return None if data is None else parse_filter(data, names, touching_place, language)


def order_of(properties: list[tuple[str, bool]], names: Any) -> Json:
    """Return the fields of a store query for an order by properties, each ascending or descending."""
    columns = []
    for name, descending in properties:
        known = queryable(names, name)
        if known.field.is_metric:
            raise InputError(f"sortby: {name[:80]!r} is a metric, by which products are not sorted")
        columns.append((known.field.name, descending))
    if columns in ([], [("t1_ns", True)]):
        return {}
    return {"order": Order.OLDEST} if columns == [("t1_ns", False)] else {"sort": tuple(columns)}


def names_in(text: str | None) -> list[str] | None:
    """Return names that are separated by commas."""
    return None if text is None else [name for name in text.split(",") if name][:1000]


def json_in(text: str) -> Json:
    """Return the JSON object of a URL parameter; raises InputError."""
    try:
        data = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"intersects: expected GeoJSON: {error}") from error
    if not isinstance(data, dict):
        raise InputError(f"intersects: a {type(data).__name__}, expected a GeoJSON geometry")
    return data
