# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Meshes of the bodies of a scenario, with their materials: built-in models and files."""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import CodecError, ConfigurationError
from cdff_common.formats.meshes import UNITS, read_mesh
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.orbit.built_in import BUILT_IN_MODELS
from cdff_dev.simulate.orbit.materials import MATERIALS, Material

#: Names of the built-in models.
BUILT_IN = tuple(BUILT_IN_MODELS)


@dataclass(frozen=True, slots=True, eq=False)
class BodyMesh:
    """Mesh of a body in its axes.

    Attributes
    ----------
    vertices_m : ndarray float64 (n, 3)
    triangles : ndarray int64 (m, 3)
    material : ndarray intp (m,)
        Row of ``materials`` of each triangle.
    materials : tuple of Material
    """

    vertices_m: FloatArray
    triangles: NDArray[np.int64]
    material: NDArray[np.intp]
    materials: tuple[Material, ...]

    @property
    def radius_m(self) -> float:
        """Largest distance of a vertex from the origin."""
        return float(np.linalg.norm(self.vertices_m, axis=1).max())

    @property
    def extent_m(self) -> float:
        """Largest extent along an axis."""
        return float(np.ptp(self.vertices_m, axis=0).max())


def mesh_file(name: str) -> Path:
    """Return the file of a mesh: an absolute path, or one relative to the working folder or ``CDFF_DATA``.

    Raises
    ------
    ConfigurationError
        If there is no such file.
    """
    folders = [Path(), *([Path(os.environ["CDFF_DATA"])] if os.environ.get("CDFF_DATA") else [])]
    for folder in folders:
        if (folder / name).is_file():
            return folder / name
    raise ConfigurationError(
        f"mesh={name!r}: no such file in the working folder"
        f"{f' or {folders[1]}' if len(folders) > 1 else '; set CDFF_DATA to the folder of the data sets'}"
        f"; built-in are {', '.join(BUILT_IN)}"
    )


def mesh_digest(name: str) -> str:
    """Return the SHA-256 of a mesh file, or the name of a built-in model."""
    return name if name in BUILT_IN else hashlib.sha256(mesh_file(name).read_bytes()).hexdigest()


def load_body(
    mesh: str, *, unit: str, material: str | Material, size_m: tuple[float, float], field: str
) -> BodyMesh:
    """Return the mesh of a body in metres.

    Parameters
    ----------
    material : str or Material
        Of a mesh file; built-in models have their own.
    size_m : (float, float)
        Plausible largest extent.
    field : str
        Path of the body in the scenario, for messages.

    Raises
    ------
    ConfigurationError
        If the mesh is missing, is not a mesh, or its size is not plausible.
    """
    if mesh in BUILT_IN:
        body = _built_in(mesh)
    else:
        try:
            path = mesh_file(mesh)
        except ConfigurationError as error:
            raise ConfigurationError(f"{field}.{error}") from error
        try:
            arrays = read_mesh(path).scaled(UNITS[unit])
        except CodecError as error:
            raise ConfigurationError(f"{field}.mesh={mesh!r}: {error}") from error
        chosen = MATERIALS[material] if isinstance(material, str) else material
        of_first = np.zeros(len(arrays.triangles), np.intp)
        body = BodyMesh(arrays.vertices, arrays.triangles, of_first, (chosen,))
        low, high = size_m
        if not low <= body.extent_m <= high:
            unlikely = {
                name: body.extent_m / UNITS[unit] * scale
                for name, scale in UNITS.items()
                if low <= body.extent_m / UNITS[unit] * scale <= high
            }
            likely = f"; with unit {', '.join(unlikely)} it would be" if unlikely else ""
            raise ConfigurationError(
                f"{field}.mesh={mesh!r}: the largest extent is {body.extent_m:g} m with unit {unit}, "
                f"expected {low:g} to {high:g} m ({field}.size_m){likely}"
            )
    return body


def _built_in(name: str) -> BodyMesh:
    """Return the mesh of a built-in model: its shapes with their materials."""
    shapes = BUILT_IN_MODELS[name]()
    names = sorted({shape.material for shape in shapes})
    starts = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    return BodyMesh(
        np.concatenate([shape.vertices for shape in shapes]),
        np.concatenate([shape.triangles + start for shape, start in zip(shapes, starts[:-1], strict=True)]),
        np.concatenate([np.full(len(s.triangles), names.index(s.material), np.intp) for s in shapes]),
        tuple(MATERIALS[name] for name in names),
    )
