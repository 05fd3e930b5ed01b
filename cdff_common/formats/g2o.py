# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose graphs as g2o text: ``VERTEX_SE2``, ``EDGE_SE2``, ``VERTEX_SE3:QUAT``, ``EDGE_SE3:QUAT``, priors and
``FIX``.

Kümmerle et al. (2011), doi:10.1109/ICRA.2011.5979949. A planar graph is read into the same columns as a
spatial one: poses with z = 0 and a rotation about z, information in the rows of x, y and rz; ``dimension``
distinguishes them. Lines of other kinds are refused, since a graph without some of its measurements is a
different graph.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.formats.file_source import Readable, Source, load
from cdff_common.geometry import se3

_IDENTITY = "0 0 0 0 0 0 1"
#: Tag -> number of leading integers and of all numbers.
_COUNTS = {
    "VERTEX_SE2": (1, 4),
    "EDGE_SE2": (2, 11),
    "EDGE_PRIOR_SE2": (1, 10),
    "VERTEX_SE3:QUAT": (1, 8),
    "EDGE_SE3:QUAT": (2, 30),
    "EDGE_SE3_PRIOR": (2, 30),
}
_SPATIAL = ("VERTEX_SE3:QUAT", "EDGE_SE3:QUAT", "EDGE_SE3_PRIOR")
#: Rows of a planar graph's x, y and rotation in ``[x y z rx ry rz]``.
_PLANE = (0, 1, 5)


@dataclass(frozen=True, slots=True, eq=False)
class G2oGraph:
    """Pose graph as columns.

    Attributes
    ----------
    dimension : int
        2 or 3.
    ids : NDArray[np.int64], shape (n,)
        Vertices with a pose, unique, in file order. Edges may end at other vertices.
    poses : NDArray[np.float64], shape (n, 7)
        ``T_world_vertex``: x y z (m), qx qy qz qw of unit length.
    ends : NDArray[np.int64], shape (m, 2)
        Ids of the vertices a and b of each edge; a = b is a prior, whose measurement is ``T_world_a``.
    measurements : NDArray[np.float64], shape (m, 7)
        ``T_a_b``, as ``poses``.
    information : NDArray[np.float64], shape (m, 6, 6)
        Symmetric, in the order x y z rx ry rz, of an error in b: ``Log(T_a_b^-1 T_world_a^-1 T_world_b)``.
    fixed : NDArray[np.int64], shape (k,)
        Ids of vertices that are not optimised.
    """

    dimension: int
    ids: NDArray[np.int64]
    poses: NDArray[np.float64]
    ends: NDArray[np.int64]
    measurements: NDArray[np.float64]
    information: NDArray[np.float64]
    fixed: NDArray[np.int64]

    @property
    def matrices(self) -> NDArray[np.float64]:
        """``T_world_vertex (n, 4, 4)``."""
        return _matrices(self.poses)

    @property
    def measured_matrices(self) -> NDArray[np.float64]:
        """``T_a_b (m, 4, 4)``."""
        return _matrices(self.measurements)


def read_g2o(source: Readable) -> G2oGraph:
    """Read a graph.

    Raises
    ------
    CodecError
        With file name and line: for lines of another kind, missing or non-finite numbers, a quaternion that
        is not of unit length, a repeated vertex, planar and spatial lines in one file, or no line.
    """
    s = load(source)
    lines: dict[str, list[tuple[int, list[str]]]] = {tag: [] for tag in _COUNTS}
    edge_lines: list[tuple[str, int]] = []  # of edges, in file order
    fixed: list[str] = []
    for number, line in enumerate(s.data.decode("utf-8", "replace").splitlines(), start=1):
        words = line.split("#")[0].split()
        if not words:
            continue
        tag, numbers = words[0], words[1:]
        if tag == "FIX":
            fixed += numbers
        elif tag in _COUNTS:
            if tag.startswith("EDGE"):
                edge_lines.append((tag, len(lines[tag])))
            lines[tag].append((number, numbers))
        elif tag != "PARAMS_SE3OFFSET":
            raise s.error(f"line {number}: {tag[:40]!r}, expected one of {', '.join(_COUNTS)} or FIX")
        elif " ".join(numbers[1:]) != _IDENTITY:
            raise s.error(
                f"line {number}: sensor offset {' '.join(numbers[1:])[:80]!r}, expected {_IDENTITY}"
            )
    spatial = any(lines[tag] for tag in _SPATIAL)
    tags = _SPATIAL if spatial else tuple(tag for tag in _COUNTS if tag not in _SPATIAL)
    if any(tag_lines and tag not in tags for tag, tag_lines in lines.items()):
        raise s.error("planar and spatial lines in one file, expected one kind")
    if not any(lines.values()):
        raise s.error(f"no line of {', '.join(_COUNTS)}")
    tables = {tag: _table(s, tag, lines[tag]) for tag in tags}
    vertex, edge, prior = tags
    pose_columns = 7 if spatial else 3
    ids, poses = tables[vertex][0][:, 0], _poses_7(s, tables[vertex][1])
    if len(np.unique(ids)) != len(ids):
        raise s.error(f"vertex {_first_repeated(ids)} is repeated")
    names = [edge, prior]
    first = {edge: 0, prior: len(lines[edge])}
    rows = np.array([first[tag] + index for tag, index in edge_lines], dtype=np.int64)
    ends = np.concatenate([tables[edge][0], tables[prior][0][:, [0, 0]]])[rows]
    values = np.concatenate([tables[name][1] for name in names])[rows]
    return G2oGraph(
        3 if spatial else 2,
        ids,
        poses,
        ends,
        _poses_7(s, values[:, :pose_columns]),
        _symmetric(values[:, pose_columns:]),
        np.array([_vertex_id(s, word) for word in fixed], dtype=np.int64),
    )


def write_g2o(graph: G2oGraph) -> bytes:
    """Return a graph in g2o format; every number reads back identically.

    Raises
    ------
    InputError
        If columns have different lengths, or the dimension is neither 2 nor 3.
    """
    n, m = len(graph.ids), len(graph.ends)
    if graph.dimension not in (2, 3):
        raise InputError(f"pose graph of dimension {graph.dimension}, expected 2 or 3")
    if (
        graph.poses.shape != (n, 7)
        or graph.measurements.shape != (m, 7)
        or graph.information.shape != (m, 6, 6)
    ):
        raise InputError(
            f"{n} vertices with poses {graph.poses.shape}, {m} edges with measurements "
            f"{graph.measurements.shape}, "
            f"information {graph.information.shape}: expected (n, 7), (m, 7), (m, 6, 6)"
        )
    spatial = graph.dimension == 3
    vertex, edge, prior = _SPATIAL if spatial else ("VERTEX_SE2", "EDGE_SE2", "EDGE_PRIOR_SE2")
    indices = np.arange(6) if spatial else np.array(_PLANE)
    upper_rows, upper_columns = np.triu_indices(len(indices))
    priors = graph.ends[:, 0] == graph.ends[:, 1]
    out = [f"PARAMS_SE3OFFSET 0 {_IDENTITY}"] if spatial and priors.any() else []
    out += [
        f"{vertex} {i} {_text(row)}"
        for i, row in zip(graph.ids, _file_columns(graph.poses, spatial), strict=True)
    ]
    out += [f"FIX {i}" for i in graph.fixed]
    numbers = np.hstack(
        [
            _file_columns(graph.measurements, spatial),
            graph.information[:, indices[upper_rows], indices[upper_columns]],
        ]
    )
    for (a, b), is_prior, row in zip(graph.ends, priors, numbers, strict=True):
        head = f"{prior} {a} 0" if is_prior and spatial else f"{prior} {a}" if is_prior else f"{edge} {a} {b}"
        out.append(f"{head} {_text(row)}")
    return "".join(f"{line}\n" for line in out).encode()


def lifted_se2(x_y_theta: ArrayLike) -> NDArray[np.float64]:
    """Return poses ``(n, 7)`` of planar poses ``(n, 3)``: x, y in metres and the rotation about z in
    radians.
    """
    p = np.asarray(x_y_theta, dtype=np.float64).reshape(-1, 3)
    out = np.zeros((len(p), 7))
    out[:, :2] = p[:, :2]
    out[:, 5], out[:, 6] = np.sin(p[:, 2] / 2.0), np.cos(p[:, 2] / 2.0)
    return out


def plane_se2(poses: ArrayLike) -> NDArray[np.float64]:
    """Return x, y and the rotation about z ``(n, 3)``, in (-pi, pi], the inverse of ``lifted_se2``."""
    p = np.asarray(poses, dtype=np.float64).reshape(-1, 7)
    rotation_rad = 2.0 * np.arctan2(p[:, 5], p[:, 6])
    return np.column_stack([p[:, :2], -np.remainder(np.pi - rotation_rad, 2.0 * np.pi) + np.pi])


def _matrices(poses: NDArray[np.float64]) -> NDArray[np.float64]:
    return (
        se3.transform_from_quaternion_xyzw(poses[:, :3], poses[:, 3:]) if len(poses) else np.zeros((0, 4, 4))
    )


def _file_columns(poses: NDArray[np.float64], spatial: bool) -> NDArray[np.float64]:
    return poses if spatial else plane_se2(poses)


def _text(row: NDArray[np.float64]) -> str:
    return " ".join(f"{v:.17g}" for v in row.tolist())


def _table(
    s: Source, tag: str, lines: list[tuple[int, list[str]]]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return integers ``(n, k)`` and numbers ``(n, ...)`` of the lines of one tag."""
    integer_count, count = _COUNTS[tag]
    for number, words in lines:
        if len(words) != count:
            raise s.error(f"line {number}: {len(words)} numbers, expected {count}")
    heads = [_vertex_id(s, word) for _, words in lines for word in words[:integer_count]]
    try:
        values = np.array([words[integer_count:] for _, words in lines], dtype=np.float64).reshape(
            -1, count - integer_count
        )
    except ValueError as error:
        raise s.error(f"{tag}: {error}") from error
    rows_not_finite = np.flatnonzero(~np.isfinite(values).all(axis=1))
    if rows_not_finite.size:
        raise s.error(f"line {lines[int(rows_not_finite[0])][0]}: a number that is not finite")
    return np.array(heads, dtype=np.int64).reshape(-1, integer_count), values


def _vertex_id(s: Source, word: str) -> int:
    try:
        value = int(word)
    except ValueError as error:
        raise s.error(f"vertex {word[:40]!r}: expected an integer") from error
    if abs(value) >= 1 << 62:
        raise s.error(f"vertex {word[:40]}: expected a number below 2^62")
    return value


def _first_repeated(ids: NDArray[np.int64]) -> int:
    values, counts = np.unique(ids, return_counts=True)
    return int(values[counts > 1][0])


def _poses_7(s: Source, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return poses ``(n, 7)`` with normalised quaternions, since files contain as few as six digits."""
    if values.shape[1] == 3:
        return lifted_se2(values)
    norm = np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
    if np.any(np.abs(norm - 1.0) > 0.01):
        raise s.error("a quaternion is not of unit length")
    return np.hstack([values[:, :3], values[:, 3:] / norm])


def _symmetric(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return symmetric ``(m, 6, 6)`` of upper triangles ``(m, 21)`` or, planar, ``(m, 6)``."""
    indices = np.arange(6) if triangles.shape[1] == 21 else np.array(_PLANE)
    upper_rows, upper_columns = np.triu_indices(len(indices))
    out = np.zeros((len(triangles), 6, 6))
    out[:, indices[upper_rows], indices[upper_columns]] = triangles
    out[:, indices[upper_columns], indices[upper_rows]] = triangles
    return out
