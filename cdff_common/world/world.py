# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Frame graph and items at one mission time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from cdff_common.errors import CdffError, ProductNotFoundError
from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.interfaces.product import Header
from cdff_common.world.difference import WorldDifference, difference


@dataclass(frozen=True, slots=True, eq=False)
class WorldEdge:
    """Transform between two frames at the time of the world.

    Attributes
    ----------
    parent, child : str
    transform : UncertainTransform
        ``T_parent_child``, interpolated if the child moves.
    source : str
        Stream or product that states it; empty for a fixed frame.
    """

    parent: str
    child: str
    transform: UncertainTransform
    source: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class WorldItem:
    """Newest value of a stream at the time of the world.

    Attributes
    ----------
    name : str
        ``/{robot}/{sensor}.{stream}`` or ``/{robot}/{dfpc}.{port}``.
    type_name : str
        ASN.1 type of the value.
    frame : str
        Frame of the value, for a pose the parent; empty if it has none.
    stamp_ns : int
        End of capture, mission time.
    value : Any
        A message of ``cdff_common.types``; None if only its metadata were retrieved.
    header : Header or None
        Header of a product.
    """

    name: str
    type_name: str
    frame: str
    stamp_ns: int
    value: Any
    header: Header | None = None


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """Frames and items at one mission time.

    Attributes
    ----------
    stamp_ns : int
    edges : tuple of WorldEdge
        By child; every child has one parent.
    items : tuple of WorldItem
        By name.
    omitted : mapping of str to str
        Frames and streams without a place at this time, with the reasons.
    """

    stamp_ns: int
    edges: tuple[WorldEdge, ...]
    items: tuple[WorldItem, ...]
    omitted: Mapping[str, str] = field(default_factory=dict)
    _graph: FrameGraph = field(default_factory=FrameGraph, init=False, repr=False)

    def __post_init__(self) -> None:
        for edge in self.edges:
            self._graph.set_static(edge.parent, edge.child, edge.transform)

    @classmethod
    def of(
        cls,
        stamp_ns: int,
        edges: Iterable[WorldEdge],
        items: Iterable[WorldItem],
        omitted: Mapping[str, str] | None = None,
    ) -> World:
        """Return the world of edges in order of preference, without those that contradict earlier ones.

        A frame has one parent. A second pose of it, such as the one by SLAM next to that by odometry, makes
        its parent a child of the frame, unless it is a true pose.
        """
        graph, reasons = FrameGraph(), dict(omitted or {})
        edge_of_child: dict[str, WorldEdge] = {}
        for edge in edges:
            edge_in_tree, placed_edge = edge_of_child.get(edge.child), edge
            if edge_in_tree is not None and edge.parent not in edge_of_child and "/truth." not in edge.source:
                placed_edge = WorldEdge(edge.child, edge.parent, edge.transform.inverse(), edge.source)
            try:
                if placed_edge.child in edge_of_child:
                    raise CdffError("a second pose of the frame")
                graph.set_static(placed_edge.parent, placed_edge.child, placed_edge.transform)
            except CdffError as error:
                reason = (
                    str(error)
                    if edge_in_tree is None
                    else f"{edge_in_tree.source or 'a fixed frame'} is used instead"
                )
                reasons.setdefault(f"{edge.parent} to {edge.child} by {edge.source or 'profile'}", reason)
                continue
            edge_of_child[placed_edge.child] = placed_edge
        ordered = sorted(items, key=lambda item: item.name)
        return cls(
            stamp_ns, tuple(edge_of_child[name] for name in sorted(edge_of_child)), tuple(ordered), reasons
        )

    @property
    def frames(self) -> tuple[str, ...]:
        """All frames of the graph, sorted."""
        return self._graph.frames

    def transform(self, parent: str, child: str) -> UncertainTransform:
        """Return ``T_parent_child``, with covariance if every edge between them has one.

        Raises
        ------
        FrameNotFoundError
            If a frame is unknown or no chain connects the two.
        """
        return self._graph.lookup(parent, child, self.stamp_ns)

    def items_of(self, type_name: str | None = None, frame: str | None = None) -> tuple[WorldItem, ...]:
        """Return the items of a type, in a frame, or both."""
        return tuple(
            item for item in self.items if type_name in (None, item.type_name) and frame in (None, item.frame)
        )

    def item(self, name: str) -> WorldItem:
        """Return an item by name; raises ProductNotFoundError."""
        for item in self.items:
            if item.name == name:
                return item
        known_names = ", ".join(item.name for item in self.items) or "none"
        raise ProductNotFoundError(f"no item {name!r} in the world; it has {known_names}")

    def difference_to(self, later: World) -> WorldDifference:
        """Return the changes from this world to a later one."""
        return difference(self, later)
