# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bodies: those of the IAU_2015 set, additional ones of a registry, and orbital targets.

A body is also a frame of its name: body-fixed, origin at its centre, z along the rotation axis, x to the
prime meridian, metres (the axes of an orbital target are those of its model). Longitudes are east positive,
latitudes planetocentric.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from cdff_common.contract.names import NAME
from cdff_common.errors import ConfigurationError, InputError

KINDS = ("star", "planet", "dwarf_planet", "moon", "asteroid", "comet", "target")
_AUTHORITY = "IAU_2015"
_SPHERE = re.compile(r"(.+) \(2015\) - Sphere / Ocentric\Z")
_NAME = re.compile(rf"{NAME}\Z")
#: Smallest NAIF id of comets and asteroids; Borrelly, the first comet, is 1000005.
_COMETS, _ASTEROIDS = range(1_000_000, 2_000_000), 2_000_000
_DWARF_PLANETS = {999, 2_000_001}
#: Older USGS codes of the same spheres.
_ALIAS = re.compile(r"IAU2000:(\d+00)\Z")


@dataclass(frozen=True, slots=True)
class Body:
    """Celestial body or orbital target.

    Attributes
    ----------
    name : str
        Name of the body and of its body-fixed frame.
    kind : str
        One of ``KINDS``.
    naif_id : int or None
    radii_m : tuple of 3 float, or None
        Semi-axes of its shape; those of the sphere if longitude and latitude refer to one.
    crs : str or None
        Geographic CRS: ``authority:code``, WKT2 or PROJJSON; None without longitude and latitude.
    source : str
        Source of the numbers.
    """

    name: str
    kind: str
    naif_id: int | None = None
    radii_m: tuple[float, float, float] | None = None
    crs: str | None = None
    source: str = ""

    def __post_init__(self) -> None:
        if not _NAME.match(self.name):
            raise InputError(f"body {self.name[:80]!r}: expected lower case letters, digits and _")
        if self.kind not in KINDS:
            raise InputError(f"body {self.name}: kind {self.kind[:40]!r}, expected one of {', '.join(KINDS)}")
        if self.radii_m is not None and not all(0.0 < r < 1e10 for r in self.radii_m):
            raise InputError(f"body {self.name}: radii_m {self.radii_m}, expected metres above 0")
        if self.crs is not None:
            _check_geographic(self.name, self.geographic_crs)

    @property
    def geographic_crs(self) -> Any:
        """``pyproj.CRS`` of longitude and latitude; raises InputError if the body has none."""
        if self.crs is None:
            raise InputError(f"body {self.name} is a {self.kind}: it has no longitude and latitude")
        return crs_of(self.crs)

    @property
    def fixed_crs(self) -> Any:
        """``pyproj.CRS`` of the body-fixed frame: geocentric, or an engineering CRS for bodies without
        surface.
        """
        import pyproj

        if self.crs is None:
            return pyproj.CRS.from_json_dict(engineering_projjson(self.name, height=True))
        a, b = self.axes_m
        return pyproj.CRS.from_dict({"proj": "geocent", "a": a, "b": b, "units": "m"})

    @property
    def axes_m(self) -> tuple[float, float]:
        """Equatorial and polar semi-axis of the reference ellipsoid, metres."""
        ellipsoid = self.geographic_crs.ellipsoid
        return float(ellipsoid.semi_major_metre), float(ellipsoid.semi_minor_metre)

    def to_dict(self) -> dict[str, Any]:
        """Return the dict form for MessagePack and JSON."""
        return asdict(self) | {"radii_m": None if self.radii_m is None else list(self.radii_m)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Body:
        """Return the body of a dict form; a body with radii and without a CRS gets a sphere.

        The radius is ``mean_radius_m`` (of equal volume) if given, else the geometric mean of the radii.

        Raises
        ------
        InputError
            If a field is missing, unknown or out of range, or the CRS is not geographic.
        """
        fields = {"name", "kind", "naif_id", "radii_m", "mean_radius_m", "crs", "source"}
        if unknown := sorted(set(map(str, data)) - fields):
            raise InputError(f"body: unknown field {unknown[0][:80]!r}, expected {', '.join(sorted(fields))}")
        try:
            radii, naif_id = data.get("radii_m"), data.get("naif_id")
            if radii is not None and len(radii) != 3:
                raise InputError(f"body {data['name']}: {len(radii)} radii, expected 3")
            axes = None if radii is None else (float(radii[0]), float(radii[1]), float(radii[2]))
            name, kind, crs = str(data["name"]), str(data["kind"]), data.get("crs")
            if crs is None and axes is not None and kind != "target":
                crs = sphere_wkt(name, _sphere_m(name, axes, data.get("mean_radius_m")))
            elif data.get("mean_radius_m") is not None:
                raise InputError(
                    f"body {name}: mean_radius_m is of bodies with radii_m, a surface and no crs"
                )
            return cls(
                name,
                kind,
                None if naif_id is None else int(naif_id),
                axes,
                None if crs is None else str(crs),
                str(data.get("source", "")),
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"body {dict(data)!r:.200}: {error!r}") from error


def body(name: str) -> Body:
    """Return a body of the IAU_2015 set or of the registry; raises ConfigurationError for others."""
    entry = _registry().get(name)
    if entry is None:
        raise ConfigurationError(f"body {name[:80]!r}: unknown; expected one of {', '.join(body_names())}")
    value: Body = entry() if callable(entry) else entry
    return value


def body_names() -> tuple[str, ...]:
    """Return the names of all bodies, sorted."""
    return tuple(sorted(_registry()))


@lru_cache(maxsize=256)
def crs_of(text: str) -> Any:
    """Return a ``pyproj.CRS`` of ``authority:code``, an OGC URI, WKT2 or PROJJSON.

    ``IAU2000:`` codes of spheres are mapped to those of IAU_2015, since PROJ does not contain the set of
    2000.

    Raises
    ------
    InputError
        If it is none of these.
    """
    import pyproj

    alias = _ALIAS.match(text)
    try:
        return pyproj.CRS.from_user_input(f"{_AUTHORITY}:{alias[1]}" if alias else text)
    except pyproj.exceptions.CRSError as error:
        raise InputError(f"CRS {text[:80]!r}: {str(error)[:200]}") from error


def sphere_wkt(name: str, radius_m: float) -> str:
    """Return the WKT2 of a planetocentric geographic CRS on a sphere, for a body without a standard CRS."""
    title = name.replace("_", " ").title()
    return (
        f'GEOGCRS["{title} (CDFF) - Sphere / Ocentric",DATUM["{title} (CDFF) - '
        f'Sphere",ELLIPSOID["{title} (CDFF) - '
        f'Sphere",{radius_m:.6f},0,LENGTHUNIT["metre",1]]],PRIMEM["Reference Meridian",0,ANGLEUNIT["degree",'
        '0.0174532925199433]],CS[ellipsoidal,2],AXIS["geodetic latitude '
        '(Lat)",north,ORDER[1],ANGLEUNIT["degree",'
        '0.0174532925199433]],AXIS["geodetic longitude '
        '(Lon)",east,ORDER[2],ANGLEUNIT["degree",0.0174532925199433]]]'
    )


def engineering_projjson(frame: str, *, height: bool = False) -> dict[str, Any]:
    """Return the PROJJSON of a metric engineering CRS named after a frame: x, y, and z if ``height``."""
    axes = [
        {"name": "x", "abbreviation": "x", "direction": "east", "unit": "metre"},
        {"name": "y", "abbreviation": "y", "direction": "north", "unit": "metre"},
    ]
    if height:
        axes.append({"name": "z", "abbreviation": "z", "direction": "up", "unit": "metre"})
    return {
        "$schema": "https://proj.org/schemas/v0.7/projjson.schema.json",
        "type": "EngineeringCRS",
        "name": frame,
        "datum": {"type": "EngineeringDatum", "name": f"Origin and axes of frame {frame}"},
        "coordinate_system": {"subtype": "Cartesian", "axis": axes},
    }


def _sphere_m(name: str, axes_m: tuple[float, float, float], mean_m: float | None) -> float:
    """Return the radius of the sphere for longitude and latitude, metres, at most the largest semi-axis."""
    if not all(0.0 < r < 1e10 for r in axes_m):
        raise InputError(f"body {name}: radii_m {axes_m}, expected metres above 0")
    radius_m = math.prod(axes_m) ** (1.0 / 3.0) if mean_m is None else float(mean_m)
    if not 0.0 < radius_m <= max(axes_m):
        raise InputError(
            f"body {name}: mean_radius_m {radius_m:g}, expected above 0 and at most {max(axes_m):g}"
        )
    return radius_m


def _check_geographic(name: str, crs: Any) -> None:
    axes = {axis.direction for axis in crs.axis_info}
    if not crs.is_geographic or axes != {"east", "north"}:
        raise InputError(
            f"body {name}: CRS {crs.name!r} with axes {sorted(axes)}, expected a geographic one, "
            "east positive"
        )


@cache
def _registry() -> dict[str, Any]:
    """Return the bodies by name, those of IAU_2015 as factories, since reading 100 definitions is slow."""
    from pyproj.database import query_crs_info
    from pyproj.enums import PJType

    bodies: dict[str, Any] = {}
    for info in query_crs_info(auth_name=_AUTHORITY, pj_types=PJType.GEOGRAPHIC_2D_CRS):
        if match := _SPHERE.match(info.name):
            name = re.sub(r"[^a-z0-9]+", "_", match[1].lower()).strip("_")
            name = name if name[0].isalpha() else f"asteroid_{name}"
            bodies[name] = cache(lambda name=name, code=info.code: _of_iau(name, int(code)))
    for name, entry in _additional_bodies().items():
        bodies[name] = Body.from_dict({"name": name, **entry})
    return bodies


def _additional_bodies() -> dict[str, Any]:
    from cdff_common.interfaces.yaml_file import read_mapping

    return dict(read_mapping(Path(__file__).with_name("bodies.yaml")))


def _of_iau(name: str, code: int) -> Body:
    """Return the body with the sphere of a coordinate reference system of the IAU."""
    text = f"{_AUTHORITY}:{code}"
    radius_m = float(crs_of(text).ellipsoid.semi_major_metre)
    return Body(
        name,
        _kind(code // 100),
        code // 100,
        (radius_m, radius_m, radius_m),
        text,
        "Archinal et al. 2018, doi:10.1007/s10569-017-9805-5",
    )


def _kind(naif_id: int) -> str:
    """Return the kind of a body by its NAIF number."""
    if naif_id in _DWARF_PLANETS:
        return "dwarf_planet"
    if naif_id == 10:
        return "star"
    if naif_id in _COMETS:
        return "comet"
    if naif_id >= _ASTEROIDS:
        return "asteroid"
    return "planet" if naif_id % 100 == 99 else "moon"
