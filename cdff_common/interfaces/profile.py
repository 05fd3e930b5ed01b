# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The mission profile: robots, sensors, frames, limits, DFPCs and processes of one mission (contract §9).

Host values stay out of it: endpoints, keys and folders are process settings (``CDFF_*``).
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from cdff_common.errors import ConfigurationError
from cdff_common.geometry import FrameGraph, UncertainTransform, se3
from cdff_common.geometry.urdf import read_urdf
from cdff_common.interfaces.dfn import StrictModel, validated
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.interfaces.merging import MergingConfig
from cdff_common.interfaces.registry import Registry
from cdff_common.interfaces.yaml_file import read_mapping

RobotId = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,31}$")]
Name = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
FrameId = Annotated[str, Field(pattern=r"^[a-z0-9_]+(/[a-z0-9_]+)*$", max_length=128)]
_SOURCE = r"(sensor|product|dpm)/[a-z0-9_]+/[a-z0-9_]+"
Wiring = Annotated[str, Field(pattern=rf"^{_SOURCE}(\|{_SOURCE})*$")]
ModeNames = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]{0,63}(\|[a-z][a-z0-9_]{0,63})*$")]
Vector3 = tuple[float, float, float]

RESERVED_SCOPES = frozenset({"ground", "any"})


class FrameEdge(StrictModel):
    """A fixed transform ``T_parent_child``.

    Rotation is given by ``quaternion_xyzw`` or by ``rpy_deg`` (roll, pitch, yaw about x, y, z, applied in that order).
    ``sigma_m`` and ``sigma_deg`` are one standard deviation per axis; both 0 means known exactly.
    """

    parent: FrameId
    child: FrameId
    translation_m: Vector3 = (0.0, 0.0, 0.0)
    quaternion_xyzw: tuple[float, float, float, float] | None = None
    rpy_deg: Vector3 | None = None
    sigma_m: Annotated[float, Field(ge=0)] = 0.0
    sigma_deg: Annotated[float, Field(ge=0)] = 0.0

    @model_validator(mode="after")
    def _one_rotation(self) -> FrameEdge:
        if self.quaternion_xyzw is not None and self.rpy_deg is not None:
            raise ValueError("give quaternion_xyzw or rpy_deg, not both")
        return self

    @property
    def transform(self) -> UncertainTransform:
        """``T_parent_child`` with its covariance."""
        if self.quaternion_xyzw is not None:
            R = se3.matrix_from_quaternion_xyzw(self.quaternion_xyzw)
        else:
            roll, pitch, yaw = np.deg2rad(self.rpy_deg or (0.0, 0.0, 0.0))
            R = se3.exp_so3([0, 0, yaw]) @ se3.exp_so3([0, pitch, 0]) @ se3.exp_so3([roll, 0, 0])
        sigma = [self.sigma_m] * 3 + [float(np.deg2rad(self.sigma_deg))] * 3
        return UncertainTransform(se3.transform(R, self.translation_m), np.diag(np.square(sigma)))


Exposure = Literal["short", "normal", "long", "auto"]


class SensorMode(StrictModel):
    """One state of a sensor that the ICU can set.

    Attributes
    ----------
    on : bool
        Whether the sensor streams in it.
    rate_hz : float or None
        Samples a second.
    width_px, height_px : int or None
        Resolution of an image, or points of a sweep and rings.
    stereo : bool or None
        Of a stereo camera: both cameras, or one alone.
    exposure : str or None
        Class of exposure: short, normal, long or auto.
    """

    on: bool = True
    rate_hz: Annotated[float, Field(ge=0)] | None = None
    width_px: Annotated[int, Field(ge=1)] | None = None
    height_px: Annotated[int, Field(ge=1)] | None = None
    stereo: bool | None = None
    exposure: Exposure | None = None
    doc: str = ""


class ModeNeed(StrictModel):
    """What a DFPC needs of a sensor's mode, where it names none: every mode that streams and meets all of it serves."""

    min_rate_hz: Annotated[float, Field(ge=0)] = 0.0
    max_rate_hz: Annotated[float, Field(gt=0)] | None = None
    min_width_px: Annotated[int, Field(ge=1)] = 1
    min_height_px: Annotated[int, Field(ge=1)] = 1
    stereo: bool | None = None
    exposure: tuple[Exposure, ...] = ()

    def served_by(self, mode: SensorMode) -> bool:
        """Whether a mode meets it; what the mode leaves open is not met."""
        return (
            mode.on
            and (self.min_rate_hz == 0.0 or (mode.rate_hz or 0.0) >= self.min_rate_hz)
            and (self.max_rate_hz is None or (mode.rate_hz is not None and mode.rate_hz <= self.max_rate_hz))
            and (self.min_width_px == 1 or (mode.width_px or 0) >= self.min_width_px)
            and (self.min_height_px == 1 or (mode.height_px or 0) >= self.min_height_px)
            and (self.stereo is None or mode.stereo is self.stereo)
            and (not self.exposure or mode.exposure in self.exposure)
        )


class Sensor(StrictModel):
    """A sensor of a robot: what it is, where it sits, what it streams, which modes it has.

    Attributes
    ----------
    streams : mapping
        A stream's name to the type of its samples.
    modes, initial_mode
        Its modes, and the one it starts in and goes back to.
    switch_s : float
        How long a mode change takes, seconds.
    transitions : mapping of mode to mapping of mode to float
        Mode -> mode that may follow it -> seconds that takes. A mode named here can only be left so; one that is not
        may be followed by every mode after ``switch_s``. What has no direct way is reached over modes in between.
    refuses : tuple of str
        Modes it does not take now.
    range_m : float or None
        How far it sees, metres; None where that is not known.
    """

    kind: Literal["stereo_camera", "camera", "lidar", "imu", "wheels", "other"]
    frame: FrameId
    streams: dict[Name, str]
    modes: dict[Name, SensorMode] = {"off": SensorMode(on=False), "nominal": SensorMode()}
    initial_mode: Name = "nominal"
    switch_s: Annotated[float, Field(ge=0)] = 0.5
    transitions: dict[Name, dict[Name, Annotated[float, Field(ge=0)]]] = {}
    refuses: tuple[Name, ...] = ()
    range_m: Annotated[float, Field(gt=0)] | None = None
    calibration: dict[str, Any] = {}

    @model_validator(mode="after")
    def _modes_exist(self) -> Sensor:
        named = [self.initial_mode, *self.refuses, *self.transitions]
        for mode in (*named, *(to for following in self.transitions.values() for to in following)):
            if mode not in self.modes:
                raise ValueError(f"mode {mode!r} is not among modes {sorted(self.modes)}")
        return self

    def following(self, mode: str) -> dict[str, float]:
        """Modes that may follow one directly, and the seconds that takes."""
        if mode in self.transitions:
            return dict(self.transitions[mode])
        return {m: self.switch_s for m in self.modes if m != mode}

    def way(self, start: str, to: str) -> tuple[tuple[str, float], ...] | None:
        """The quickest way between two modes: those to pass and the seconds each takes; None where there is none."""
        known: dict[str, tuple[float, tuple[tuple[str, float], ...]]] = {start: (0.0, ())}
        open_modes = {start}
        while open_modes:
            mode = min(open_modes, key=lambda m: (known[m][0], m))
            if mode == to:
                return known[mode][1]
            open_modes.discard(mode)
            spent_s, steps = known[mode]
            for following, takes_s in self.following(mode).items():
                if following not in known or spent_s + takes_s < known[following][0]:
                    known[following] = (spent_s + takes_s, (*steps, (following, takes_s)))
                    open_modes.add(following)
        return None


class DfpcEntry(StrictModel):
    """A DFPC of a robot.

    Attributes
    ----------
    inputs : mapping of port to source
        ``sensor/{sensor}/{stream}`` or ``product/{dfpc}/{port}``, of the same robot, or ``dpm/{robot}/{product}``: what
        the DPM holds of any robot, as ``dpm/orbiter/dem``, read at activation and again when another is stored.
        Several, ``|``-separated, are alternatives of which a plan takes one and the first is what is taken without a
        plan.
    modes : mapping of sensor to mode
        Sensor modes it needs while active: a mode, several that serve as well (``nominal|fast``), or what it needs of
        one (``ModeNeed``).
    warm_up_s : float
        How long after its activation what it makes may be relied on, seconds: what it feeds is activated then.
    activation : "on_request" or "always"
        Whether the orchestrator switches it on for requests or keeps it on from the start.
    linger_s : float
        How long it stays on after its last holder let go, seconds.
    """

    name: Name
    implementation: str | None = None
    parameters: dict[str, Any] = {}
    inputs: dict[Name, Wiring]
    modes: dict[Name, ModeNames | ModeNeed] = {}
    activation: Literal["on_request", "always"] = "on_request"
    linger_s: Annotated[float, Field(ge=0)] = 30.0
    warm_up_s: Annotated[float, Field(ge=0)] = 0.0
    process: Name | None = None
    seed: int = 0
    queue: Annotated[int, Field(ge=1, le=10_000)] = 64
    reorder_s: Annotated[float, Field(ge=0, le=5)] = 0.05
    step_timeout_s: Annotated[float, Field(gt=0)] = 10.0


class Robot(StrictModel):
    """A robot: frames, sensors, limits, DFPCs.

    ``limits`` holds bounds of motion for the DFPCs, and what the orchestrator plans within: ``memory_mb`` and
    ``cpu_cores`` for all DFPCs together, ``max_speed_m_s`` for where it may be in time. ``urdf`` names the file of its
    internal joints, beside the profile; once read, it holds the document. Its fixed joints are frames like ``frames``.
    """

    id: RobotId
    doc: str = ""
    frames: tuple[FrameEdge, ...] = ()
    sensors: dict[Name, Sensor] = {}
    limits: dict[Name, float] = {}
    dfpcs: tuple[DfpcEntry, ...] = ()
    urdf: str = ""

    @model_validator(mode="after")
    def _names_are_wired(self) -> Robot:
        if self.id in RESERVED_SCOPES:
            raise ValueError(f"robot id {self.id!r} is reserved")
        names = [d.name for d in self.dfpcs]
        if len(set(names)) != len(names):
            raise ValueError(f"robot {self.id} names a DFPC twice: {names}")
        for entry in self.dfpcs:
            for sensor, need in entry.modes.items():
                modes = self.sensors.get(sensor, _NO_SENSOR).modes
                wrong = [m for m in need.split("|") if m not in modes] if isinstance(need, str) else []
                if sensor not in self.sensors or wrong or not self.modes_of(entry)[sensor]:
                    raise ValueError(f"{self.id}.{entry.name} needs mode {sensor}:{need}, which no sensor has")
            for port, wiring in entry.inputs.items():
                for source in wiring.split("|"):
                    kind, owner, item = source.split("/")
                    if kind == "sensor" and item not in self.sensors.get(owner, _NO_SENSOR).streams:
                        raise ValueError(f"{self.id}.{entry.name}.{port}: no sensor stream {owner}/{item}")
                    if kind == "product" and owner not in names:
                        raise ValueError(f"{self.id}.{entry.name}.{port}: no DFPC {owner!r} in this robot")
        return self

    def modes_of(self, entry: DfpcEntry) -> dict[str, str]:
        """Sensors whose mode matters to a DFPC, and the modes that serve it, ``|``-separated."""
        return {
            name: need
            if isinstance(need, str)
            else "|".join(m for m, mode in self.sensors[name].modes.items() if need.served_by(mode))
            for name, need in entry.modes.items()
            if name in self.sensors
        }

    def dfpc(self, name: str) -> DfpcEntry:
        """Return the entry of a DFPC; raises ConfigurationError with what is known."""
        for entry in self.dfpcs:
            if entry.name == name:
                return entry
        raise ConfigurationError(
            f"robot {self.id} has no DFPC {name!r}; it has {', '.join(d.name for d in self.dfpcs)}"
        )

    def frame_graph(self) -> FrameGraph:
        """The robot's fixed frames."""
        graph = FrameGraph()
        for edge in self.frames:
            graph.set_static(edge.parent, edge.child, edge.transform)
        if self.urdf:
            model = read_urdf(self.urdf)
            for joint in (j for j in model.joints if not j.movable):
                ends = model.frame(self.id, joint.parent), model.frame(self.id, joint.child)
                graph.set_static(*ends, UncertainTransform(joint.origin, np.zeros((6, 6))))
        return graph

    def context(self, entry: DfpcEntry) -> DfpcContext:
        """What the DFPC of an entry is told of where it runs."""
        sensors = {name: sensor.model_dump() for name, sensor in self.sensors.items()}
        return DfpcContext(self.id, self.frame_graph(), dict(self.limits), sensors, entry.seed, self.urdf)


_NO_SENSOR = Sensor(kind="other", frame="none", streams={})


class SiteAnchor(StrictModel):
    """Where a site lies on the body.

    Longitude east positive, latitude as the body's CRS has it, metres above its surface; ``azimuth_deg`` is the bearing
    of the site's y axis, clockwise from north. ``sigma_m`` and ``sigma_deg`` are one standard deviation per axis.
    """

    lon_deg: Annotated[float, Field(ge=-360, le=360)]
    lat_deg: Annotated[float, Field(ge=-90, le=90)]
    height_m: float = 0.0
    azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    sigma_m: Annotated[float, Field(ge=0)] = 0.0
    sigma_deg: Annotated[float, Field(ge=0)] = 0.0


class Body(StrictModel):
    """The body that the site lies on, and where; without longitude and latitude the site is not anchored.

    Attributes
    ----------
    name : str
        Of the IAU's bodies or of our registry (``cdff dpm bodies``), or one of its own with ``crs`` or ``radii_m``.
    kind : str
        Of a body of its own: planet, moon, asteroid, comet, …
    crs : str or None
        Geographic CRS in place of the registry's: ``authority:code``, WKT2 or PROJJSON.
    radii_m : tuple of 3 float, or None
        Semi-axes of a body of its own, metres.
    sites : mapping of frame to SiteAnchor
        Further sites beside ``site``.
    """

    name: Name = "mars"
    kind: str = "planet"
    crs: str | None = None
    radii_m: Vector3 | None = None
    site_lon_deg: Annotated[float, Field(ge=-360, le=360)] | None = None
    site_lat_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    site_height_m: float = 0.0
    site_azimuth_deg: Annotated[float, Field(ge=-360, le=360)] = 0.0
    sites: dict[FrameId, SiteAnchor] = {}

    @model_validator(mode="after")
    def _both_or_none(self) -> Body:
        if (self.site_lon_deg is None) != (self.site_lat_deg is None):
            raise ValueError("site_lon_deg and site_lat_deg go together: give both, or neither")
        if self.site_lon_deg is not None and "site" in self.sites:
            raise ValueError("site is anchored twice: by site_lon_deg and among sites")
        return self

    @property
    def anchors(self) -> dict[str, SiteAnchor]:
        """Every site that is anchored, by frame."""
        if self.site_lon_deg is None or self.site_lat_deg is None:
            return dict(self.sites)
        site = SiteAnchor(
            lon_deg=self.site_lon_deg, lat_deg=self.site_lat_deg, height_m=self.site_height_m,
            azimuth_deg=self.site_azimuth_deg,
        )  # fmt: skip
        return {"site": site, **self.sites}


class History(StrictModel):
    """Pre-processed sensor data that the DPM keeps: of which streams, how densely, and for how long.

    Attributes
    ----------
    robot : str or None
        None for every robot that has the stream.
    sensor, stream : str
        As in the robot's ``sensors``.
    every_n : int
        Each n-th sample.
    every_s : float
        At least so many seconds of capture time apart.
    span_s : float
        Inertial samples are kept as spans of so many seconds; of other types one by one.
    keep_s : float or None
        How long, seconds of mission time; None for ever.
    """

    robot: RobotId | None = None
    sensor: Name
    stream: Name
    every_n: Annotated[int, Field(ge=1)] = 1
    every_s: Annotated[float, Field(ge=0)] = 0.0
    span_s: Annotated[float, Field(gt=0, le=3600)] = 10.0
    keep_s: Annotated[float, Field(gt=0)] | None = None


class Retention(StrictModel):
    """How long products of a type are kept (``*``: of all types together); absent types are kept for ever.

    Age in seconds of mission time; quotas in bytes and in products, of each robot; density, at most ``per_cell``
    products per cell of ``cell_m`` metres and span of ``span_s`` seconds. ``prefer`` says which ones stay.
    """

    product: str
    robot: RobotId | None = None
    dfpc: Name | None = None
    port: Name | None = None
    max_age_s: Annotated[float, Field(gt=0)] | None = None
    max_bytes: Annotated[int, Field(gt=0)] | None = None
    max_count: Annotated[int, Field(gt=0)] | None = None
    per_cell: Annotated[int, Field(gt=0)] | None = None
    cell_m: Annotated[float, Field(gt=0)] | None = None
    span_s: Annotated[float, Field(gt=0)] | None = None
    prefer: Literal["newest", "best"] = "newest"

    @model_validator(mode="after")
    def _density_is_whole(self) -> Retention:
        if (self.per_cell is None) != (self.cell_m is None and self.span_s is None):
            raise ValueError(f"retention of {self.product}: per_cell goes with cell_m, span_s or both")
        return self


class Profile(StrictModel):
    """One mission.

    ``merging`` has the maps that the robots make put where they belong (``services.map_merging``): its parameters, none
    of them needed. Absent, nobody does.
    """

    name: Name
    doc: str = ""
    body: Body = Body()
    robots: Annotated[tuple[Robot, ...], Field(min_length=1)]
    retention: tuple[Retention, ...] = ()
    history: tuple[History, ...] = ()
    threads_per_process: Annotated[int, Field(ge=1, le=64)] = 1
    merging: MergingConfig | None = None

    @model_validator(mode="after")
    def _robots_are_unique(self) -> Profile:
        ids = [r.id for r in self.robots]
        if len(set(ids)) != len(ids):
            raise ValueError(f"a robot is named twice: {ids}")
        return self

    @model_validator(mode="after")
    def _history_is_of_streams_that_are_there(self) -> Profile:
        for policy in self.history:
            of = [r for r in self.robots if policy.robot in (None, r.id)]
            if not any(policy.stream in r.sensors.get(policy.sensor, _NO_SENSOR).streams for r in of):
                raise ValueError(f"history of {policy.sensor}/{policy.stream}: no such stream of its robots")
        return self

    def robot(self, robot_id: str) -> Robot:
        """Return a robot; raises ConfigurationError with what is known."""
        for robot in self.robots:
            if robot.id == robot_id:
                return robot
        raise ConfigurationError(f"no robot {robot_id!r} in profile {self.name}; it has {', '.join(self.robot_ids)}")

    @property
    def robot_ids(self) -> tuple[str, ...]:
        """Ids of all robots."""
        return tuple(r.id for r in self.robots)

    def processes(self) -> dict[str, list[tuple[str, DfpcEntry]]]:
        """DFPCs by process: ``{robot}_{process or dfpc}`` to ``[(robot, entry), …]``."""
        groups: dict[str, list[tuple[str, DfpcEntry]]] = {}
        for robot in self.robots:
            for entry in robot.dfpcs:
                groups.setdefault(f"{robot.id}_{entry.process or entry.name}", []).append((robot.id, entry))
        return groups


def _with_documents(profile: Profile, path: Path) -> Profile:
    """The profile with the URDF documents that it names; raises ConfigurationError for one that cannot be read."""
    robots = []
    for robot in profile.robots:
        if robot.urdf:
            try:
                text = (path.parent / robot.urdf).read_text(encoding="utf-8")
            except (OSError, UnicodeDecodeError) as error:
                raise ConfigurationError(f"profile {path}: {robot.id}.urdf: {error}") from error
            read_urdf(text)
            robot = robot.model_copy(update={"urdf": text})
        robots.append(robot)
    return profile.model_copy(update={"robots": tuple(robots)})


def load_profile(path: str | Path) -> Profile:
    """Read and check a profile, ports and DFPC names included.

    Raises
    ------
    ConfigurationError
        Naming the file, the key, the value and what was expected.
    """
    path = Path(path)
    profile = _with_documents(validated(Profile, read_mapping(path), f"profile {path}"), path)
    registry = Registry.default()
    for robot in profile.robots:
        for entry in robot.dfpcs:
            description = registry.dfpc(entry.name)
            known = {p.attribute for p in description.input_ports}
            for port in entry.inputs:
                if port not in known:
                    raise ConfigurationError(
                        f"profile {path}: {robot.id}.{entry.name} has no input port {port!r}; "
                        f"it has {', '.join(sorted(known))}"
                    )
    return profile
