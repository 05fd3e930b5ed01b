# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Convex shapes of the links of a URDF: boxes, cylinders and spheres.

The collision shapes of a link are used if it has any, otherwise its visual shapes.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from cdff_common.errors import ConfigurationError
from cdff_common.geometry.se3 import FloatArray, transform_points
from cdff_common.geometry.urdf import numbers, origin_of

#: Vertices of the polygon that replaces a circle. It is circumscribed, so that it contains the circle.
_CIRCLE_POINTS = 24
_UNIT_CUBE = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))


@dataclass(frozen=True, slots=True, eq=False)
class LinkShape:
    """A convex shape of a link.

    Attributes
    ----------
    link : str
        Name of the link.
    points_m : array, shape (n, 3)
        Points in the frame of the link, metres; their convex hull contains the shape.
    """

    link: str
    points_m: FloatArray


def read_shapes(urdf: str) -> tuple[LinkShape, ...]:
    """Return the shapes of all links of a URDF document, which ``read_urdf`` must accept.

    Raises
    ------
    ConfigurationError
        If a shape is a mesh or malformed, or no link has a shape.
    """
    shapes = [
        _shape(link.get("name", ""), element)
        for link in ElementTree.fromstring(urdf).findall("link")
        for element in link.findall("collision") or link.findall("visual")
    ]
    if not shapes:
        raise ConfigurationError("URDF: no link has a collision or visual shape")
    return tuple(shapes)


def _shape(link: str, element: ElementTree.Element) -> LinkShape:
    """Return the shape of a ``collision`` or ``visual`` element in the frame of its link."""
    geometry, where = element.find("geometry"), f"shape of link {link!r}"
    shape = None if geometry is None else next(iter(geometry), None)

    def length(attribute: str) -> float:
        return float(numbers(shape, attribute, (np.nan,), where)[0])

    match None if shape is None else shape.tag:
        case "box":
            points = _UNIT_CUBE * numbers(shape, "size", (np.nan,) * 3, where)
        case "cylinder":
            points = _cylinder(length("radius"), length("length"))
        case "sphere":
            points = _sphere(length("radius"))
        case tag:
            kind = "none" if tag is None else f"<{tag}>"
            raise ConfigurationError(f"URDF: shape {kind} of link {link!r}, expected box, cylinder or sphere")
    return LinkShape(link, transform_points(origin_of(element, where), points))


def _cylinder(radius_m: float, length_m: float) -> FloatArray:
    """Return the vertices (n, 3) of a prism that contains a cylinder about z, metres."""
    circle = _circle(radius_m)
    return np.concatenate(
        [np.column_stack([circle, np.full(len(circle), z * length_m)]) for z in (-0.5, 0.5)]
    )


def _sphere(radius_m: float) -> FloatArray:
    """Return points (n, 3) whose convex hull contains a sphere: circles of latitude of a larger sphere."""
    latitudes_rad = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _CIRCLE_POINTS // 2 + 1)
    outer_radius_m = radius_m / np.cos(np.pi / _CIRCLE_POINTS)
    return np.concatenate(
        [
            np.column_stack(
                [np.cos(a) * _circle(outer_radius_m), np.full(_CIRCLE_POINTS, np.sin(a) * outer_radius_m)]
            )
            for a in latitudes_rad
        ]
    )


def _circle(radius_m: float) -> FloatArray:
    """Return the vertices (n, 2) of a regular polygon around a circle, metres."""
    angles_rad = 2.0 * np.pi * np.arange(_CIRCLE_POINTS) / _CIRCLE_POINTS
    outer_radius_m = radius_m / np.cos(np.pi / _CIRCLE_POINTS)
    return np.asarray(outer_radius_m * np.column_stack([np.cos(angles_rad), np.sin(angles_rad)]))
