# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bodies of the IAU's set, of our registry, and defined by a user."""

import pyproj
import pytest

from cdff_common.errors import ConfigurationError, InputError
from cdff_common.geodesy import Body, body, body_names, crs_of


@pytest.mark.parametrize(
    ("name", "kind", "naif_id", "code"),
    [
        ("mars", "planet", 499, "49900"),
        ("moon", "moon", 301, "30100"),
        ("phobos", "moon", 401, "40100"),
        ("ceres", "dwarf_planet", 2000001, "200000100"),
        ("itokawa", "asteroid", 2025143, "202514300"),
        ("churyumov_gerasimenko", "comet", 1000012, "100001200"),
    ],
)
@pytest.mark.req("CDFF-SUP-080")
def test_a_body_of_the_iau_has_its_code(name: str, kind: str, naif_id: int, code: str) -> None:
    found = body(name)
    assert (found.kind, found.naif_id) == (kind, naif_id)
    assert found.geographic_crs.to_authority() == ("IAU_2015", code)
    assert found.radii_m is not None
    assert found.radii_m[0] == found.axes_m[0]


@pytest.mark.parametrize("name", ["bennu", "ryugu", "didymos", "dimorphos", "apophis", "tempel_tuttle"])
def test_a_body_that_the_iau_lacks_has_a_sphere_of_our_own(name: str) -> None:
    found = body(name)
    assert found.radii_m is not None
    a, b, c = found.radii_m
    assert found.axes_m[0] == pytest.approx((a * b * c) ** (1 / 3), abs=1e-5)
    assert "doi" in found.source or "Comets" in found.source
    again = pyproj.CRS.from_wkt(found.geographic_crs.to_wkt())
    assert again.ellipsoid.semi_major_metre == pytest.approx(found.axes_m[0])


def test_an_orbital_target_is_all_engineering() -> None:
    target = body("orbital_target")
    crs = pyproj.CRS.from_wkt(target.fixed_crs.to_wkt())
    assert crs.is_engineering
    assert [axis.direction for axis in crs.axis_info] == ["east", "north", "up"]
    with pytest.raises(InputError, match="no longitude"):
        _ = target.geographic_crs


def test_every_body_of_the_registry_can_be_made() -> None:
    assert len(body_names()) > 90
    assert all(body(name).name == name for name in ("asteroid_52_europa", "europa", "hartley_2", *body_names()[:10]))


def test_an_unknown_body_is_named() -> None:
    with pytest.raises(ConfigurationError, match="'vulcan'"):
        body("vulcan")


def test_a_body_goes_through_plain_data() -> None:
    mine = Body.from_dict({"name": "mascot", "kind": "asteroid", "radii_m": [10, 10, 8], "source": "test"})
    assert Body.from_dict(mine.to_dict()) == mine


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"kind": "cheese"}, "cheese"),
        ({"kind": "moon", "radii_m": [1, -1, 1]}, "radii"),
        ({"kind": "moon", "radii_m": [1, 1]}, "expected 3"),
        ({"kind": "moon", "crs": "IAU_2015:49901"}, "east positive"),
        ({"kind": "moon", "crs": "EPSG:32631"}, "geographic"),
        ({"kind": "moon", "crs": "nonsense"}, "nonsense"),
        ({"kind": "moon", "colour": "red"}, "colour"),
        ({}, "kind"),
    ],
)
def test_what_is_no_body_is_refused(fields: dict[str, object], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        Body.from_dict({"name": "x", **fields})


def test_codes_of_the_older_set_are_read_as_the_same_sphere() -> None:
    assert crs_of("IAU2000:49900").to_authority() == ("IAU_2015", "49900")
    with pytest.raises(InputError, match="IAU2000:30166"):
        crs_of("IAU2000:30166")
