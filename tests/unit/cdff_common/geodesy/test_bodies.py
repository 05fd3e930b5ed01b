# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bodies of the IAU's set, of our registry, and defined by a user."""

import pyproj
import pytest
from pyproj.database import query_crs_info
from pyproj.enums import PJType

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


@pytest.mark.req("CDFF-SUP-080")
def test_bodies_of_the_iau_are_those_of_pyproj() -> None:
    infos = query_crs_info(auth_name="IAU_2015", pj_types=PJType.GEOGRAPHIC_2D_CRS)
    spheres = {int(info.code): info.name for info in infos if info.name.endswith("(2015) - Sphere / Ocentric")}
    bodies = [found for found in map(body, body_names()) if found.crs is not None and found.crs.startswith("IAU_2015:")]
    assert len(spheres) > 90
    assert {found.naif_id * 100 for found in bodies if found.naif_id is not None} == set(spheres)
    for found in bodies:
        theirs = pyproj.CRS.from_authority("IAU_2015", (found.naif_id or 0) * 100)
        assert found.geographic_crs == theirs
        assert found.radii_m == (theirs.ellipsoid.semi_major_metre,) * 3


@pytest.mark.parametrize(
    ("name", "naif_id", "radii_m", "sphere_m"),
    [  # as published; the sphere is that of equal volume
        ("bennu", 2101955, (283.065, 271.215, 249.720), 490.06 / 2),
        ("ryugu", 2162173, (502.0, 502.0, 0.872 * 502.0), 448.0),
        ("didymos", 920065803, (851.0 / 2, 849.0 / 2, 620.0 / 2), 761.0 / 2),
        ("dimorphos", 120065803, (177.0 / 2, 174.0 / 2, 116.0 / 2), 151.0 / 2),
        ("apophis", 2099942, (170.0, 170.0, 170.0), 340.0 / 2),
        ("tempel_tuttle", 1000095, (1800.0, 1800.0, 1800.0), 1800.0),
    ],
)
def test_a_body_that_the_iau_lacks_has_a_sphere_of_our_own(
    name: str, naif_id: int, radii_m: tuple[float, float, float], sphere_m: float
) -> None:
    found = body(name)
    assert found.naif_id == naif_id
    assert found.radii_m == pytest.approx(radii_m, rel=1e-3)
    assert found.axes_m == pytest.approx((sphere_m, sphere_m), abs=1e-5)
    assert "doi" in found.source or "Comets" in found.source
    again = pyproj.CRS.from_wkt(found.geographic_crs.to_wkt())
    assert again.ellipsoid.semi_major_metre == pytest.approx(found.axes_m[0])


def test_no_body_of_ours_takes_the_name_or_number_of_another() -> None:
    bodies = [body(name) for name in body_names()]
    numbers = [found.naif_id for found in bodies if found.naif_id is not None]
    assert len(set(numbers)) == len(numbers)
    taken = {info.name.split(" (2015)")[0].lower() for info in query_crs_info(auth_name="IAU_2015")}
    assert not taken & {found.name.replace("_", " ") for found in bodies if "IAU_2015" not in (found.crs or "")}


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
    assert mine.axes_m[0] == pytest.approx(800 ** (1 / 3), abs=1e-5)
    rounder = Body.from_dict(mine.to_dict() | {"crs": None, "mean_radius_m": 9.0})
    assert rounder.axes_m[0] == pytest.approx(9.0)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"kind": "cheese"}, "cheese"),
        ({"kind": "moon", "radii_m": [1, -1, 1]}, "radii"),
        ({"kind": "moon", "radii_m": [1, 1]}, "expected 3"),
        ({"kind": "moon", "radii_m": [1, 1, 1], "mean_radius_m": 2}, "at most 1"),
        ({"kind": "moon", "mean_radius_m": 2}, "mean_radius_m"),
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
