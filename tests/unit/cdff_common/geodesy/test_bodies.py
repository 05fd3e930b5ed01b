# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bodies of the IAU, of this project's registry, and defined by a user."""

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
def test_an_iau_body_has_its_code(name: str, kind: str, naif_id: int, code: str) -> None:
    result = body(name)
    assert (result.kind, result.naif_id) == (kind, naif_id)
    assert result.geographic_crs.to_authority() == ("IAU_2015", code)
    assert result.radii_m is not None
    assert result.radii_m[0] == result.axes_m[0]


@pytest.mark.req("CDFF-SUP-080")
def test_iau_bodies_agree_with_pyproj() -> None:
    infos = query_crs_info(auth_name="IAU_2015", pj_types=PJType.GEOGRAPHIC_2D_CRS)
    spheres = {
        int(info.code): info.name for info in infos if info.name.endswith("(2015) - Sphere / Ocentric")
    }
    bodies = [
        result
        for result in map(body, body_names())
        if result.crs is not None and result.crs.startswith("IAU_2015:")
    ]
    assert len(spheres) > 90
    numbers = {result.naif_id * 100 for result in bodies if result.naif_id is not None}
    assert numbers == set(spheres) - {39900}  # the Earth has WGS 84
    for result in bodies:
        iau_crs = pyproj.CRS.from_authority("IAU_2015", (result.naif_id or 0) * 100)
        assert result.geographic_crs == iau_crs
        assert result.radii_m == (iau_crs.ellipsoid.semi_major_metre,) * 3


@pytest.mark.parametrize(
    ("name", "naif_id", "radii_m", "sphere_m"),
    [  # published values; the sphere has the same volume as the body
        ("bennu", 2101955, (283.065, 271.215, 249.720), 490.06 / 2),
        ("ryugu", 2162173, (502.0, 502.0, 0.872 * 502.0), 448.0),
        ("didymos", 920065803, (851.0 / 2, 849.0 / 2, 620.0 / 2), 761.0 / 2),
        ("dimorphos", 120065803, (177.0 / 2, 174.0 / 2, 116.0 / 2), 151.0 / 2),
        ("apophis", 2099942, (170.0, 170.0, 170.0), 340.0 / 2),
        ("tempel_tuttle", 1000095, (1800.0, 1800.0, 1800.0), 1800.0),
    ],
)
def test_a_body_unknown_to_the_iau_has_its_own_sphere(
    name: str, naif_id: int, radii_m: tuple[float, float, float], sphere_m: float
) -> None:
    result = body(name)
    assert result.naif_id == naif_id
    assert result.radii_m == pytest.approx(radii_m, rel=1e-3)
    assert result.axes_m == pytest.approx((sphere_m, sphere_m), abs=1e-5)
    assert "doi" in result.source or "Comets" in result.source
    crs = pyproj.CRS.from_wkt(result.geographic_crs.to_wkt())
    assert crs.ellipsoid.semi_major_metre == pytest.approx(result.axes_m[0])


def test_registered_bodies_have_unique_names_and_numbers() -> None:
    bodies = [body(name) for name in body_names()]
    numbers = [result.naif_id for result in bodies if result.naif_id is not None]
    assert len(set(numbers)) == len(numbers)
    iau_names = {info.name.split(" (2015)")[0].lower() for info in query_crs_info(auth_name="IAU_2015")}
    assert not iau_names & {
        result.name.replace("_", " ")
        for result in bodies
        if "IAU_2015" not in (result.crs or "") and result.name != "earth"
    }


def test_an_orbital_target_has_only_engineering_frames() -> None:
    target = body("orbital_target")
    crs = pyproj.CRS.from_wkt(target.fixed_crs.to_wkt())
    assert crs.is_engineering
    assert [axis.direction for axis in crs.axis_info] == ["east", "north", "up"]
    with pytest.raises(InputError, match="no longitude"):
        _ = target.geographic_crs


def test_every_registered_body_can_be_constructed() -> None:
    assert len(body_names()) > 90
    assert all(
        body(name).name == name for name in ("asteroid_52_europa", "europa", "hartley_2", *body_names()[:10])
    )


def test_an_unknown_body_is_refused_by_name() -> None:
    with pytest.raises(ConfigurationError, match="'vulcan'"):
        body("vulcan")


def test_a_body_survives_conversion_to_plain_data() -> None:
    original = Body.from_dict(
        {"name": "mascot", "kind": "asteroid", "radii_m": [10, 10, 8], "source": "test"}
    )
    assert Body.from_dict(original.to_dict()) == original
    assert original.axes_m[0] == pytest.approx(800 ** (1 / 3), abs=1e-5)
    rounder = Body.from_dict(original.to_dict() | {"crs": None, "mean_radius_m": 9.0})
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
def test_an_invalid_body_is_refused(fields: dict[str, object], reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        Body.from_dict({"name": "x", **fields})


def test_codes_of_the_iau_2000_standard_give_the_2015_sphere() -> None:
    assert crs_of("IAU2000:49900").to_authority() == ("IAU_2015", "49900")
    with pytest.raises(InputError, match="IAU2000:30166"):
        crs_of("IAU2000:30166")
