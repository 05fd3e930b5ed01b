# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prepared models of a compound, by name; meshes that were prepared before are not prepared again."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.formats.meshes.arrays import UNITS
from cdff_core.dfns.model_preparation.interface import ModelPreparationInputs, ModelPreparationOutputs
from cdff_core.object_models.model import content_hash

if TYPE_CHECKING:
    from cdff_common.interfaces.dfn import Dfn
    from cdff_common.types import Mesh

#: Number of prepared meshes that the process keeps, and the meshes by content and parameters: compounds of a
#: process share them, and one that is configured again does not prepare its meshes again.
_CACHED = 16
_PREPARED: dict[tuple[str, str], ModelPreparationOutputs] = {}


class PreparedModels:
    """Models by name, prepared by a DFN.

    Parameters
    ----------
    prepare : Dfn
        ModelPreparation.
    unit : str
        Unit of the vertices.
    """

    def __init__(self, prepare: Dfn[Any, Any, Any], unit: str) -> None:
        self._prepare, self._scale = prepare, UNITS[unit]
        self._by_name: dict[str, ModelPreparationOutputs] = {}
        self._parameters = f"{type(prepare).__module__} {getattr(prepare, 'config', '')!r}"

    @property
    def by_name(self) -> Mapping[str, ModelPreparationOutputs]:
        """Prepared models by name, in the order of their arrival."""
        return self._by_name

    def add(self, mesh: Mesh) -> str:
        """Prepare a mesh, whose frame is ``{name}/body``; return the name.

        Raises
        ------
        InputError
            If the mesh has no triangle or a vertex is not finite.
        DegenerateGeometryError
            If it has no extent.
        """
        name = model_name(mesh.frame)
        vertices_m = self._scale * np.asarray(mesh.data.vertices, np.float64)
        triangles = np.asarray(mesh.data.triangles, np.int64)
        if not len(triangles):
            raise InputError(f"model {name}: {len(vertices_m)} vertices and no triangle, expected a mesh")
        key = content_hash(vertices_m, triangles), self._parameters
        model = _PREPARED.get(key)
        if model is None:
            model = self._prepare.process(ModelPreparationInputs(vertices=vertices_m, triangles=triangles))
            while len(_PREPARED) >= _CACHED:
                _PREPARED.pop(next(iter(_PREPARED)), None)
            _PREPARED[key] = model
        self._by_name[name] = model
        return name

    def clear(self) -> None:
        """Remove the models; prepared meshes stay in the cache."""
        self._by_name.clear()


def model_name(frame: str) -> str:
    """Return the name of the body of a frame ``{name}/body``."""
    return frame.removesuffix("/body") or "model"


def body_frame(name: str) -> str:
    """Return the frame of the body of a name."""
    return f"{name}/body"
