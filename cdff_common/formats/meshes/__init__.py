# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Triangle meshes in OBJ, PLY, STL, glTF binary (GLB) and VRML files."""

from cdff_common.formats.meshes.arrays import UNITS, MeshArrays
from cdff_common.formats.meshes.read import MESH_FORMATS, detect_mesh, read_mesh

__all__ = ["MESH_FORMATS", "UNITS", "MeshArrays", "detect_mesh", "read_mesh"]
