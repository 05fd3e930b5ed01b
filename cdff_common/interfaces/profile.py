# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The mission profile: robots, sensors, frames, limits, DFPCs and processes of one mission.

It holds no host values: endpoints, keys and folders are process settings (``CDFF_*``).
"""

from __future__ import annotations

import base64
import logging
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt, ValidationInfo, model_validator

from cdff_common.contract.names import GROUND, NAME, RESERVED_SCOPES, ROBOT_ID, GatewayName
from cdff_common.contract.wiring import WIRING, Wiring, mode_names
from cdff_common.errors import ConfigurationError
from cdff_common.geometry import FrameGraph, UncertainTransform, rotation_forms, se3
from cdff_common.geometry.urdf import read_urdf
from cdff_common.interfaces.description import DfpcDescription
from cdff_common.interfaces.dfn import StrictModel
from cdff_common.interfaces.dfpc import DfpcContext
from cdff_common.interfaces.map_merging import MergingConfig
from cdff_common.interfaces.sensor_profile import Count, FrameId, ModeNeed, Name, Sensor

logger = logging.getLogger(__name__)

RobotId = Annotated[str, Field(pattern=rf"^{ROBOT_ID}$")]
WiringText = Annotated[str, Field(pattern=rf"^{WIRING}$")]
ModeNames = Annotated[str, Field(pattern=rf"^{NAME}(\|{NAME})*$")]
AngleDeg = Annotated[float, Field(ge=-360, le=360)]
Vector3 = tuple[float, float, float]

#: Key of a validation context without checks across sensors, DFPCs and robots, which
#: ``cdff_common.interfaces.profile_checks`` makes for a file.
LENIENT = "lenient"


def _is_lenient(info: ValidationInfo) -> bool:
    return bool(info.context and info.context.get(LENIENT))


class FrameEdge(StrictModel):
    """A fixed transform ``T_parent_child``.

    Attributes
    ----------
    parent, child : str
        Frames; each child has one parent.
    translation_m : 3 numbers
        Origin of the child in the parent, metres.
    quaternion_xyzw : 4 numbers or None
        Rotation of the child in the parent, a unit quaternion; only one of this and ``rpy_deg``.
    rpy_deg : 3 numbers or None
        The rotation as roll, pitch, yaw about x, y, z, applied in that order, degrees. A positive pitch
        lowers the x axis.
    sigma_m, sigma_deg : float
        Standard deviation per axis of the translation, metres, and of the rotation, degrees; both 0 means
        known exactly.
    """

    parent: FrameId
    child: FrameId
    translation_m: Vector3 = (0.0, 0.0, 0.0)
    quaternion_xyzw: tuple[float, float, float, float] | None = None
    rpy_deg: Vector3 | None = None
    sigma_m: NonNegativeFloat = 0.0
    sigma_deg: NonNegativeFloat = 0.0

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
            R = rotation_forms.matrix_from_rpy_deg(self.rpy_deg or (0.0, 0.0, 0.0))
        covariance = rotation_forms.isotropic_covariance(self.sigma_m, self.sigma_deg)
        return UncertainTransform(se3.transform(R, self.translation_m), covariance)


class DfpcEntry(StrictModel):
    """A DFPC of a robot.

    Attributes
    ----------
    name : str
        Name of an installed DFPC; see ``cdff dfpc list``.
    implementation : str or None
        Variant of the DFPC; None for its first one.
    implementations : list of str
        Variants among which a plan selects, as a fast and an accurate one; empty for ``implementation`` only.
    parameters : mapping
        Parameters of the DFPC, and of a DFN under the name of its slot; see ``cdff dfpc show NAME``.
    inputs : mapping of port to source
        ``sensor/{sensor}/{stream}`` or ``product/{dfpc}/{port}`` of the same robot, or
        ``dpm/{robot}/{product}``, a stored product of any robot, such as ``dpm/orbiter/dem``, read at
        activation and when a new one is stored. Alternatives are ``|``-separated; a plan selects one, the
        default is the first.
    required_inputs : list of str
        Ports of ``inputs`` that no plan omits: optional in the DFPC, but needed with these parameters.
    modes : mapping of sensor to mode
        Sensor modes required while active: a mode, alternatives (``nominal|fast``), or requirements
        (``ModeNeed``).
    warm_up_s : float
        Time from activation to reliable output, seconds; DFPCs that consume its products are activated then.
    activation : "on_request" or "always"
        Activated by the orchestrator for requests, or active from the start.
    linger_s : float
        Time for which it stays active after its last request, seconds.
    process : str or None
        Process that hosts it, shared by all DFPCs of the robot with this name; None for one of its own.
    seed : int
        Seed of its random numbers.
    queue : int
        Samples of each input that can wait for a step; with more the oldest is dropped and counted.
    reorder_s : float
        Time for which a sample waits for earlier ones of other inputs, seconds.
    step_timeout_s : float
        Longest step, seconds; after it the process is restarted.
    data_mb_h : float
        Expected volume of its stored products, megabytes per hour; replaced by the measured one.
    """

    name: Name
    implementation: str | None = None
    implementations: tuple[str, ...] = ()
    parameters: dict[str, Any] = {}
    inputs: dict[Name, WiringText]
    required_inputs: tuple[Name, ...] = ()
    modes: dict[Name, ModeNames | ModeNeed] = {}
    activation: Literal["on_request", "always"] = "on_request"
    linger_s: NonNegativeFloat = 30.0
    warm_up_s: NonNegativeFloat = 0.0
    process: Name | None = None
    seed: int = 0
    queue: Annotated[int, Field(ge=1, le=10_000)] = 64
    reorder_s: Annotated[float, Field(ge=0, le=5)] = 0.05
    step_timeout_s: PositiveFloat = 10.0
    data_mb_h: NonNegativeFloat = 0.0

    def choices(self, description: DfpcDescription) -> tuple[str, ...]:
        """Return the implementations among which a plan selects, the default one first."""
        default = self.implementation or (*self.implementations, description.implementations[0].name)[0]
        return tuple(dict.fromkeys((default, *self.implementations)))


#: Limits of a robot with their meaning; the unit is in the name.
ROBOT_LIMITS = {
    "max_slope_deg": "steepest slope",
    "max_step_m": "highest step",
    "max_roughness_m": "largest roughness below the robot",
    "width_m": "width",
    "length_m": "length",
    "height_m": "height, free space above the ground",
    "max_speed_m_s": "speed, for the area in reach",
    "memory_mb": "memory of all DFPCs together",
    "cpu_cores": "CPU time of all DFPCs together, seconds per second",
    "power_w": "electrical power of sensors and DFPCs, watts",
    "heat_w": "heat of sensors and DFPCs that the thermal control removes, watts",
    "data_mb_h": "stored data of sensors and DFPCs, megabytes per hour",
}


class Robot(StrictModel):
    """A robot: frames, sensors, limits, DFPCs.

    Attributes
    ----------
    id : str
        Name of the robot in keys, frames and requests.
    doc : str
        Description for operators.
    frames : list of FrameEdge
        Mounts of the sensors below ``{robot}/base``, and the start pose ``site`` to ``{robot}/odom``.
    sensors : mapping of name to Sensor
        Sensors by name.
    limits : mapping of limit to float
        Motion limits for the DFPCs and budgets for the orchestrator: ``max_slope_deg``, ``max_step_m``,
        ``max_roughness_m``, ``width_m``, ``length_m``, ``height_m``, ``max_speed_m_s`` (for the area in
        reach), ``memory_mb`` and ``cpu_cores`` (of all DFPCs together), ``power_w``, ``heat_w`` and
        ``data_mb_h`` (of sensors and DFPCs together).
    power_w_per_core : float
        Electrical power of the computer per busy core, watts.
    dfpcs : list of DfpcEntry
        DFPCs that run for the robot.
    urdf : str
        File of its joints, relative to the profile; once loaded, the document. Its fixed joints are frames
        like ``frames``.
    gateways : mapping of gateway to file
        Gateways that run for the robot, and the file of the settings of each, relative to the profile.
    """

    id: RobotId
    doc: str = ""
    frames: tuple[FrameEdge, ...] = ()
    sensors: dict[Name, Sensor] = {}
    limits: dict[Name, float] = {}
    power_w_per_core: NonNegativeFloat = 0.0
    dfpcs: tuple[DfpcEntry, ...] = ()
    urdf: str = ""
    gateways: dict[GatewayName, str] = {}

    @model_validator(mode="after")
    def _names_are_wired(self, info: ValidationInfo) -> Robot:
        """Refuse reserved ids, repeated DFPCs and names of sensors, modes or frames that do not exist."""
        if _is_lenient(info):
            return self
        if self.id in RESERVED_SCOPES:
            raise ValueError(f"robot id {self.id!r} is reserved")
        names = [d.name for d in self.dfpcs]
        if len(set(names)) != len(names):
            raise ValueError(f"robot {self.id} names a DFPC twice: {names}")
        for entry in self.dfpcs:
            for sensor, required in entry.modes.items():
                modes = self.sensors.get(sensor, _NO_SENSOR).modes
                unknown_modes = (
                    [m for m in mode_names(required) if m not in modes] if isinstance(required, str) else []
                )
                if sensor not in self.sensors or unknown_modes or not self.modes_of(entry)[sensor]:
                    raise ValueError(
                        f"{self.id}.{entry.name} needs mode {sensor}:{required}, which no sensor has"
                    )
            if unknown := [port for port in entry.required_inputs if port not in entry.inputs]:
                raise ValueError(f"{self.id}.{entry.name} requires inputs without a source: {unknown}")
            for port, wiring in entry.inputs.items():
                for source in Wiring.parse(wiring).sources:
                    streams = self.sensors.get(source.owner, _NO_SENSOR).streams
                    input_name = f"{self.id}.{entry.name}.{port}"
                    if source.kind == "sensor" and source.item not in streams:
                        raise ValueError(f"{input_name}: no sensor stream {source.owner}/{source.item}")
                    if source.kind == "product" and source.owner not in names:
                        raise ValueError(f"{input_name}: no DFPC {source.owner!r} in this robot")
        return self

    def modes_of(self, entry: DfpcEntry) -> dict[str, str]:
        """Return the sensors with a required mode and the accepted modes, ``|``-separated."""
        return {
            name: required
            if isinstance(required, str)
            else "|".join(m for m, mode in self.sensors[name].modes.items() if required.is_met_by(mode))
            for name, required in entry.modes.items()
            if name in self.sensors
        }

    def dfpc(self, name: str) -> DfpcEntry:
        """Return the entry of a DFPC; raises ConfigurationError with the known names."""
        for entry in self.dfpcs:
            if entry.name == name:
                return entry
        raise ConfigurationError(
            f"robot {self.id} has no DFPC {name!r}; it has {', '.join(d.name for d in self.dfpcs)}"
        )

    def frame_graph(self) -> FrameGraph:
        """Return the fixed frames of the robot."""
        graph = FrameGraph()
        for edge in self.frames:
            graph.set_static(edge.parent, edge.child, edge.transform)
        if self.urdf:
            model = read_urdf(self.urdf)
            for joint in (j for j in model.joints if not j.movable):
                ends = model.frame(self.id, joint.parent), model.frame(self.id, joint.child)
                graph.set_static(*ends, UncertainTransform.exact(joint.origin))
        return graph

    def context(self, entry: DfpcEntry) -> DfpcContext:
        """Return the context for the DFPC of an entry."""
        sensors = {name: sensor.model_dump() for name, sensor in self.sensors.items()}
        return DfpcContext(self.id, self.frame_graph(), dict(self.limits), sensors, entry.seed, self.urdf)


_NO_SENSOR = Sensor(kind="other", frame="none", streams={})


class SiteAnchor(StrictModel):
    """Location of a site on the body.

    Attributes
    ----------
    lon_deg, lat_deg : float
        Longitude, east positive, and latitude as defined by the CRS of the body, degrees.
    height_m : float
        Height above the surface of the body, metres.
    azimuth_deg : float
        Bearing of the site's y axis, clockwise from north, degrees.
    sigma_m, sigma_deg : float
        Standard deviation per axis of position, metres, and orientation, degrees.
    """

    lon_deg: AngleDeg
    lat_deg: Annotated[float, Field(ge=-90, le=90)]
    height_m: float = 0.0
    azimuth_deg: AngleDeg = 0.0
    sigma_m: NonNegativeFloat = 0.0
    sigma_deg: NonNegativeFloat = 0.0


class Body(StrictModel):
    """Body of the mission and location of the site; without longitude and latitude the site is not anchored.

    Attributes
    ----------
    name : str
        A body of the IAU or of the registry (``GET /api/v1/bodies``), or a custom one with ``crs`` or
        ``radii_m``.
    kind : str
        Kind of a custom body: planet, moon, asteroid, comet, …
    crs : str or None
        Geographic CRS in place of the registry's: ``authority:code``, WKT2 or PROJJSON.
    radii_m : tuple of 3 float, or None
        Semi-axes of a custom body, metres.
    site_lon_deg, site_lat_deg : float or None
        Longitude, east positive, and latitude of the frame ``site``, degrees; both or none.
    site_height_m : float
        Height of ``site`` above the surface, metres.
    site_azimuth_deg : float
        Bearing of the y axis of ``site``, clockwise from north, degrees.
    sites : mapping of frame to SiteAnchor
        Sites in addition to ``site``.
    """

    name: Name = "mars"
    kind: str = "planet"
    crs: str | None = None
    radii_m: Vector3 | None = None
    site_lon_deg: AngleDeg | None = None
    site_lat_deg: Annotated[float, Field(ge=-90, le=90)] | None = None
    site_height_m: float = 0.0
    site_azimuth_deg: AngleDeg = 0.0
    sites: dict[FrameId, SiteAnchor] = {}

    @model_validator(mode="after")
    def _both_or_none(self) -> Body:
        if (self.site_lon_deg is None) != (self.site_lat_deg is None):
            raise ValueError("expected both site_lon_deg and site_lat_deg, or neither")
        if self.site_lon_deg is not None and "site" in self.sites:
            raise ValueError("site is anchored twice: by site_lon_deg and among sites")
        return self

    @property
    def anchors(self) -> dict[str, SiteAnchor]:
        """Anchored sites by frame."""
        if self.site_lon_deg is None or self.site_lat_deg is None:
            return dict(self.sites)
        site = SiteAnchor(
            lon_deg=self.site_lon_deg,
            lat_deg=self.site_lat_deg,
            height_m=self.site_height_m,
            azimuth_deg=self.site_azimuth_deg,
        )
        return {"site": site, **self.sites}


class History(StrictModel):
    """Archiving of pre-processed sensor data in the DPM: stream, density and duration.

    Attributes
    ----------
    robot : str or None
        None selects every robot with the stream.
    sensor, stream : str
        Sensor of the robot, and its stream.
    every_n : int
        Archive each n-th sample.
    every_s : float
        Least time between archived samples, seconds of capture time.
    span_s : float
        Length of the spans in which inertial samples are stored, seconds; other types are stored one by one.
    keep_s : float or None
        Duration, seconds of mission time; None: unlimited.
    """

    robot: RobotId | None = None
    sensor: Name
    stream: Name
    every_n: Count = 1
    every_s: NonNegativeFloat = 0.0
    span_s: Annotated[float, Field(gt=0, le=3600)] = 10.0
    keep_s: PositiveFloat | None = None


class Exchange(StrictModel):
    """Exchange of products with the ground over a link with contact windows.

    Attributes
    ----------
    urgent : tuple of str
        Product types that are sent first, after alarms and other events.
    small_bytes : int
        Products up to this size follow; larger ones are last.
    budget_bit_s : float or None
        Largest rate, bit/s; None for that of the window.
    """

    urgent: tuple[str, ...] = ("pose",)
    small_bytes: Annotated[int, Field(ge=0, le=1 << 30)] = 1 << 16
    budget_bit_s: PositiveFloat | None = None


class Retention(StrictModel):
    """Retention rule for the products of a type; types without a rule are kept.

    Attributes
    ----------
    product : str
        Product type, or ``*`` for all types together.
    robot, dfpc, port : str or None
        Only products of this robot, DFPC or output port; None for all.
    max_age_s : float or None
        Greatest age, seconds of mission time.
    max_bytes, max_count : int or None
        Quotas of each robot: size of the payloads, bytes, and number of products.
    per_cell : int or None
        Density: largest number of products in a cell of ``cell_m`` and a span of ``span_s``.
    cell_m : float or None
        Cell of the density, metres.
    span_s : float or None
        Span of the density, seconds of capture time.
    prefer : str
        Products to keep: the newest, or the best by status, resolution and time.
    """

    product: str
    robot: RobotId | None = None
    dfpc: Name | None = None
    port: Name | None = None
    max_age_s: PositiveFloat | None = None
    max_bytes: PositiveInt | None = None
    max_count: PositiveInt | None = None
    per_cell: PositiveInt | None = None
    cell_m: PositiveFloat | None = None
    span_s: PositiveFloat | None = None
    prefer: Literal["newest", "best"] = "newest"

    @model_validator(mode="after")
    def _density_is_whole(self) -> Retention:
        if (self.per_cell is None) != (self.cell_m is None and self.span_s is None):
            raise ValueError(f"retention of {self.product}: per_cell and cell_m or span_s require each other")
        return self


class Orbit(StrictModel):
    """Mission in orbit: products may lie in the frame ``inertial`` (GCRF axes), in the LVLH axes of each
    robot (``{robot}/lvlh``) and in frames of the clients.

    Attributes
    ----------
    clients : list of str
        Names of the bodies that are approached; the frame of each is ``{client}/body``.
    """

    clients: Annotated[tuple[Name, ...], Field(min_length=1)]


class Profile(StrictModel):
    """Profile of a mission.

    Attributes
    ----------
    name : str
        Name of the mission.
    doc : str
        Description; its first sentence is listed by ``cdff profile list``.
    body : Body
        Body of the mission and location of the site.
    orbit : Orbit or None
        Clients of a mission in orbit; None for one on the ground.
    robots : list of Robot
        Robots, at least one.
    retention : list of Retention
        Rules for the deletion of products.
    history : list of History
        Sensor streams that the DPM archives.
    threads_per_process : int
        Threads of the numeric libraries in each process.
    merging : MergingConfig or None
        Merging of the maps of several robots (``services.map_merging``). All its fields are optional; omit
        the section to disable merging.
    exchange : Exchange
        Order and rate of the products that a robot sends to the ground in contact windows.
    clock : str
        Name of the only identity that may publish the mission clock on a secured bus.
    sign : bool
        Products carry a signature by the identity of their producer (``CDFF_IDENTITY``).
    orchestration : "ground" or "robots"
        One orchestrator for all, or one for each robot, which works without the ground, and one on the
        ground, which delegates to them.
    """

    name: Name
    doc: str = ""
    body: Body = Body()
    orbit: Orbit | None = None
    robots: Annotated[tuple[Robot, ...], Field(min_length=1)]
    retention: tuple[Retention, ...] = ()
    history: tuple[History, ...] = ()
    threads_per_process: Annotated[int, Field(ge=1, le=64)] = 1
    merging: MergingConfig | None = None
    exchange: Exchange = Exchange()
    clock: Name = "player"
    sign: bool = False
    orchestration: Literal["ground", "robots"] = "ground"

    @model_validator(mode="after")
    def _robots_are_unique(self, info: ValidationInfo) -> Profile:
        if _is_lenient(info):
            return self
        ids = [r.id for r in self.robots]
        if len(set(ids)) != len(ids):
            raise ValueError(f"a robot is named twice: {ids}")
        return self

    @model_validator(mode="after")
    def _history_streams_exist(self, info: ValidationInfo) -> Profile:
        if _is_lenient(info):
            return self
        for policy in self.history:
            robots = [r for r in self.robots if policy.robot in (None, r.id)]
            if not any(policy.stream in r.sensors.get(policy.sensor, _NO_SENSOR).streams for r in robots):
                raise ValueError(f"history of {policy.sensor}/{policy.stream}: no such stream of its robots")
        return self

    def robot(self, robot_id: str) -> Robot:
        """Return a robot; raises ConfigurationError with the known ids."""
        for robot in self.robots:
            if robot.id == robot_id:
                return robot
        raise ConfigurationError(
            f"no robot {robot_id!r} in profile {self.name}; it has {', '.join(self.robot_ids)}"
        )

    @property
    def robot_ids(self) -> tuple[str, ...]:
        """Ids of all robots."""
        return tuple(r.id for r in self.robots)

    def processes(self) -> dict[str, list[tuple[str, DfpcEntry]]]:
        """Return the DFPCs of each process: ``{robot}_{process or dfpc}`` to ``[(robot, entry), …]``."""
        groups: dict[str, list[tuple[str, DfpcEntry]]] = {}
        for robot in self.robots:
            for entry in robot.dfpcs:
                groups.setdefault(f"{robot.id}_{entry.process or entry.name}", []).append((robot.id, entry))
        return groups


def read_mask(path: Path) -> str:
    """Return the content of a mask image in base64; raises ConfigurationError if it cannot be read."""
    try:
        return base64.b64encode(path.read_bytes()).decode("ascii")
    except OSError as error:
        reason = f"cannot be read ({error.strerror}), expected an image such as a PNG"
        raise ConfigurationError(f"mask {path}: {reason}") from error


def scopes_of(robots: Iterable[str], scope: str) -> tuple[str, ...]:
    """Return the scopes that a service with ``--scope`` serves: a robot, or all robots and ``ground``."""
    return (scope,) if scope not in ("", GROUND) else (*robots, GROUND)


def profile_of_scope(profile: Profile, scope: str) -> Profile:
    """Return the part of a profile for ``--scope``; raises ConfigurationError for an unknown one."""
    if scope in ("", GROUND):
        return profile
    if scope not in profile.robot_ids:
        robots = ", ".join(profile.robot_ids)
        raise ConfigurationError(f"--scope {scope}: profile {profile.name} has ground and {robots}")
    return profile.model_copy(update={"robots": (profile.robot(scope),)})


def load_profile(path: str | Path, *, complete: bool = False) -> Profile:
    """Read and validate a profile: fields, names across sensors and DFPCs, types of the wiring, frames.

    Parameters
    ----------
    complete : bool
        Also check the body and the parameters of the DFPCs, which imports their modules, and log a warning
        for each implausible value.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, or a FaultsError with file, line, key, value and expectation of every
        fault.
    """
    from cdff_common.interfaces.profile_checks.check import check_profile

    checked = check_profile(path, complete=complete)
    profile = checked.valid_profile()
    for warning in checked.warnings if complete else ():
        logger.warning("%s", warning)
    return profile
