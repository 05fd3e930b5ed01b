# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Entry of a profile in the store at the start: robots, fixed frames, anchored sites, and changes of these.

A mount that differs from the one that the last profile entered becomes a revision from the end of the stored
data on: earlier data keep the old mount. Frames in which a robot moves and anchors of sites locate the stored
products; a different one is reported and not entered, because it would move all of them.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cdff_common.clock import format_stamp
from cdff_common.errors import InputError
from cdff_common.geodesy import Anchor, Body, body
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.profile import Profile, Robot, SiteAnchor
from dpm_store import Store
from dpm_store.frames.frames import FrameRevision
from dpm_store.products.records import Query

logger = logging.getLogger(__name__)

_PRODUCER = "profile/"
#: Differences of matrices and covariances up to this are rounding.
_ROUNDING = 1e-9
#: Resolution of stamps, nanoseconds.
_STAMP_NS = 1000


@dataclass(frozen=True, slots=True)
class FrameDifference:
    """Frame of a profile that differs from the store and is not entered.

    Attributes
    ----------
    frame, text, remedy : str
        ``text`` has the difference, ``remedy`` what the operator does.
    """

    frame: str
    text: str
    remedy: str


def enter(store: Store, profile: Profile) -> tuple[FrameDifference, ...]:
    """Add a profile's robots, fixed frames and anchored sites, and revisions of mounts that it changes.

    Frames that were first set by others than a profile are not changed.

    Returns
    -------
    tuple of FrameDifference
        Frames of the profile that differ from those in the store.
    """
    differences = list(_enter_anchors(store, profile))
    for robot in profile.robots:
        description = robot.model_dump(mode="json", include={"sensors", "limits"})
        description["dfpcs"] = [entry.name for entry in robot.dfpcs]
        store.robots.describe(robot.id, robot.doc, description)
        differences += _enter_frames(store, profile, robot)
    return tuple(differences)


def body_of(profile: Profile) -> Body:
    """Return the body of a profile: from the registry, unless the profile defines it."""
    b = profile.body
    if b.crs is None and b.radii_m is None:
        return body(b.name)
    radii = None if b.radii_m is None else list(b.radii_m)
    return Body.from_dict(
        {"name": b.name, "kind": b.kind, "crs": b.crs, "radii_m": radii, "source": profile.name}
    )


def _enter_anchors(store: Store, profile: Profile) -> Iterator[FrameDifference]:
    known = {revision.frame for revision in store.frames.current()}
    for frame, site in profile.body.anchors.items():
        location = Anchor(body_of(profile), site.lon_deg, site.lat_deg, site.height_m, site.azimuth_deg)
        if frame not in known:
            store.anchors.anchor(
                frame,
                location,
                sigma_m=site.sigma_m,
                sigma_deg=site.sigma_deg,
                producer=f"{_PRODUCER}{profile.name}",
            )
            continue
        entered = _last_of_a_profile(store, frame)
        T = UncertainTransform(location.T_body_frame, _covariance(site))
        if entered is not None and not _is_in_store(store, frame, entered, location.body.name, T):
            yield _difference(frame, entered, location.body.name, T)


def _covariance(site: SiteAnchor) -> FloatArray:
    return np.asarray(np.diag(np.square([site.sigma_m] * 3 + [np.deg2rad(site.sigma_deg)] * 3)))


def _enter_frames(store: Store, profile: Profile, robot: Robot) -> Iterator[FrameDifference]:
    graph, producer = robot.frame_graph(), f"{_PRODUCER}{profile.name}"
    known = {revision.frame for revision in store.frames.current()}
    for frame in graph.frames:
        parent = graph.parent_of(frame)
        if parent is None:
            continue
        T = graph.lookup(parent, frame, 0)
        entered = _last_of_a_profile(store, frame) if frame in known else None
        try:
            if frame not in known:
                store.frames.set(frame, parent, T, producer=producer)
            elif entered is None or _is_in_store(store, frame, entered, parent, T):
                continue
            elif _is_mount(graph, robot, frame):
                _revise(store, robot.id, frame, parent, T, producer)
            else:
                yield _difference(frame, entered, parent, T)
        except InputError as error:  # in the store the new parent is below the frame
            remedy = "use a new data directory for the new tree of frames"
            yield FrameDifference(frame, f"frame {frame} of the profile is not entered: {error}", remedy)


def _is_mount(graph: FrameGraph, robot: Robot, frame: str) -> bool:
    """Return True for a frame below the base, or in a fixed tree with it that is only of the robot.

    If fixed edges connect the base with a site, the edges above the base are the pose of the robot.
    """
    base = f"{robot.id}/base"
    if base in _ancestors(graph, frame):
        return True
    roots = {[f, *_ancestors(graph, f)][-1] for f in (base, frame)}
    return len(roots) == 1 and roots.pop().startswith(f"{robot.id}/")


def _ancestors(graph: FrameGraph, frame: str) -> list[str]:
    """Return the frames above a frame, the nearest first."""
    ancestors: list[str] = []
    parent = graph.parent_of(frame)
    while parent is not None:
        ancestors.append(parent)
        parent = graph.parent_of(parent)
    return ancestors


def _last_of_a_profile(store: Store, frame: str) -> FrameRevision | None:
    revisions = [r for r in store.frames.revisions(frame) if r.producer.startswith(_PRODUCER)]
    return revisions[-1] if revisions else None


def _is_in_store(
    store: Store, frame: str, entered: FrameRevision, parent: str, T: UncertainTransform
) -> bool:
    """Return True if the last profile, or the last correction, set the frame as this profile does."""
    current = store.frames.revisions(frame)[-1]
    return _is_same(entered, parent, T) or _is_same(current, parent, T)


def _is_same(revision: FrameRevision, parent: str, T: UncertainTransform) -> bool:
    stored = revision.T_parent_frame
    if revision.parent != parent or (stored.covariance is None) != (T.covariance is None):
        return False
    scale = 1.0 + float(np.abs(T.matrix).max())
    return np.allclose(stored.matrix, T.matrix, rtol=0.0, atol=_ROUNDING * scale) and (
        T.covariance is None
        or stored.covariance is None
        or np.allclose(stored.covariance, T.covariance, rtol=_ROUNDING, atol=1e-15)
    )


def _revise(store: Store, robot: str, frame: str, parent: str, T: UncertainTransform, producer: str) -> None:
    """Add a revision of a mount, valid after the data of the robot that the store has."""
    previous = store.frames.revisions(frame)[-1]
    newest = store.search(Query(robot=robot, limit=1)).items
    # Not limited by the clock: before the first message of the mission clock it is the wall clock.
    valid_from_ns = (newest[0].t1_ns // _STAMP_NS + 1) * _STAMP_NS if newest else None
    revision = store.frames.set(frame, parent, T, valid_from_ns=valid_from_ns, producer=producer)
    start = "for all data" if valid_from_ns is None else f"for data after {format_stamp(valid_from_ns)}"
    logger.warning(
        "frame %s: revision %d %s, %s; earlier data keep revision %d by %s",
        frame, revision.revision, start, _change(previous, parent, T), previous.revision, previous.producer,
    )  # fmt: skip


def _difference(frame: str, entered: FrameRevision, parent: str, T: UncertainTransform) -> FrameDifference:
    text = f"{frame} of the profile differs from the store: {_change(entered, parent, T)}"
    remedy = (
        f"restore it in the profile, or use a new data directory; to move all products of {frame}, set it "
        f"with PUT /api/v1/frames/{frame} and keep the profile"
    )
    return FrameDifference(frame, text, remedy)


def _change(revision: FrameRevision, parent: str, T: UncertainTransform) -> str:
    """Return the change of a frame in words."""
    if revision.parent != parent:
        return f"its parent is {parent}, not {revision.parent}"
    motion = np.linalg.inv(revision.T_parent_frame.matrix) @ T.matrix
    angle_deg = float(np.rad2deg(np.linalg.norm(se3.log_so3(motion[:3, :3]))))
    distance_m = float(np.linalg.norm(motion[:3, 3]))
    if distance_m < _ROUNDING and angle_deg < _ROUNDING:
        return f"with another standard deviation below {parent}"
    return f"moved by {distance_m:.4f} m and {angle_deg:.3f}° in {parent}"
