# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Model of the scenario files in orbit: orbit, lighting, clients, path and sensors of the servicer."""

from __future__ import annotations

import hashlib
import json
from functools import cached_property
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from cdff_common.clock import parse_stamp
from cdff_common.contract.names import NAME
from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import StrictModel
from cdff_core.rigid_body.torque_free import principal_axes
from cdff_dev.simulate.fields import Mount, NotNegative, Positive, Vector3
from cdff_dev.simulate.orbit.kepler import MU_EARTH
from cdff_dev.simulate.orbit.materials import MATERIALS, Material
from cdff_dev.simulate.orbit.meshes import BUILT_IN, mesh_digest
from cdff_dev.simulate.orbit.sensors import Camera, Gnss, OrbitLidar, StarTracker
from cdff_dev.simulate.scenario import Imu

Name = Annotated[str, Field(pattern=f"^{NAME}$")]
Quaternion = tuple[float, float, float, float]


class Orbit(StrictModel):
    """Elliptic orbit of the client about the Earth at the epoch, GCRF axes."""

    semi_major_axis_m: Annotated[float, Field(gt=6.5e6, lt=1e9)]
    eccentricity: Annotated[float, Field(ge=0, lt=0.95)] = 0.0
    inclination_deg: Annotated[float, Field(ge=0, le=180)] = 0.0
    node_deg: float = 0.0
    periapsis_deg: float = 0.0
    true_anomaly_deg: float = 0.0

    @model_validator(mode="after")
    def _check_periapsis(self) -> Orbit:
        radius_m = self.semi_major_axis_m * (1.0 - self.eccentricity)
        if radius_m < 6.46e6:
            raise ValueError(
                f"the periapsis is at {radius_m:.0f} m, expected above the atmosphere, 6460000 m"
            )
        return self


class SmallBody(StrictModel):
    """The client is a small body, far from the Earth; LVLH axes are replaced by inertial ones."""

    mu_m3_s2: Annotated[float, Field(gt=0, description="gravitational parameter of the client")]
    sun_direction: Annotated[Vector3, Field(description="direction of the Sun, inertial axes")]
    sun_distance_au: Annotated[float, Field(gt=0.1, lt=100)]

    @field_validator("sun_direction")
    @classmethod
    def _check_direction(cls, value: Vector3) -> Vector3:
        if not any(value):
            raise ValueError("[0, 0, 0]: expected a direction")
        return value


class SunDirection(StrictModel):
    """Sun direction relative to the line of sight at one time; it replaces the ephemeris.

    It is constant in inertial axes, so that the phase angle holds at ``at_s``.
    """

    phase_deg: Annotated[float, Field(ge=0, le=180, description="angle at the client from servicer to Sun")]
    clock_deg: Annotated[
        float, Field(description="rotation about the line of sight, from the orbit normal")
    ] = 0.0
    at_s: NotNegative = 0.0


class Lighting(StrictModel):
    """Light sources; by default the Sun of the ephemeris with eclipses, and light reflected by the Earth."""

    sun: SunDirection | None = None
    eclipse: bool = True
    earthshine: bool = True
    earth_albedo: Annotated[float, Field(ge=0, le=1)] = 0.3
    clouds_seed: Annotated[int, Field(ge=0)] = 1


class Attitude(StrictModel):
    """Rotation without torque: orientation at the start and angular rate in body axes."""

    orientation_xyzw: Annotated[
        Quaternion | Literal["random"], Field(description="R_inertial_body as a quaternion, or from the seed")
    ] = "random"
    rate_deg_s: Vector3 = (0.0, 0.0, 0.0)

    @field_validator("orientation_xyzw")
    @classmethod
    def _check_norm(cls, value: Quaternion | Literal["random"]) -> Quaternion | Literal["random"]:
        if value != "random" and abs(sum(float(v) ** 2 for v in value) - 1.0) > 1e-3:
            raise ValueError(f"{list(value)}: expected a unit quaternion x, y, z, w")
        return value


class Body(StrictModel):
    """A rigid body with a mesh."""

    name: Name
    mesh: Annotated[str, Field(description=f"{', '.join(BUILT_IN)}, or a file (obj, ply, stl, glb)")]
    unit: Literal["m", "mm", "cm", "km"] = "m"
    material: Annotated[
        str | Material, Field(description=f"{', '.join(MATERIALS)}, or values; of a mesh without materials")
    ] = "paint_grey"
    size_m: Annotated[
        tuple[Positive, Positive],
        Field(description="plausible largest extent of the mesh, refused outside: reveals wrong units"),
    ] = (0.05, 150.0)

    @field_validator("material")
    @classmethod
    def _check_material(cls, value: str | Material) -> str | Material:
        if isinstance(value, str) and value not in MATERIALS:
            raise ValueError(f"no material {value!r}, expected one of {', '.join(MATERIALS)}, or values")
        return value


class Client(Body):
    """The target of the servicer; its centre of mass is the origin of its mesh."""

    inertia_kg_m2: Vector3 | tuple[Vector3, Vector3, Vector3] = (1.0, 1.0, 1.0)
    attitude: Attitude = Attitude()

    @field_validator("inertia_kg_m2")
    @classmethod
    def _check_inertia(
        cls, value: Vector3 | tuple[Vector3, Vector3, Vector3]
    ) -> Vector3 | tuple[Vector3, Vector3, Vector3]:
        """Refuse moments of inertia that no rigid body has."""
        try:
            principal_axes(value)
        except InputError as error:
            raise ValueError(str(error)) from error
        return value


class Companion(Client):
    """Another body near the client, with a free orbit relative to it."""

    position_m: Annotated[Vector3, Field(description="at the start, LVLH axes of the client")]
    velocity_m_s: Annotated[Vector3, Field(description="at the start, LVLH axes of the client")] = (
        0.0,
        0.0,
        0.0,
    )


class Appendage(Body):
    """A part of the servicer in its own view, such as an arm; it rotates about z of its mount."""

    mount: Mount
    rate_deg_s: float = 0.0


class Hold(StrictModel):
    """Keep the position, with a periodic deviation of ``deadband_m`` along each axis."""

    kind: Literal["hold"]
    duration_s: Positive
    deadband_m: NotNegative = 0.0
    period_s: Positive = 300.0


class Line(StrictModel):
    """Move on a straight line, from rest to rest."""

    kind: Literal["line"]
    to_m: Vector3
    duration_s: Positive


class Transfer(StrictModel):
    """Move on an orbit without thrust between the impulses at its ends."""

    kind: Literal["transfer"]
    to_m: Vector3
    duration_s: Positive


class Drift(StrictModel):
    """Move without thrust from a relative velocity."""

    kind: Literal["drift"]
    velocity_m_s: Vector3
    duration_s: Positive


class Circle(StrictModel):
    """Fly around the client at a constant distance, about an axis through it."""

    kind: Literal["circle"]
    axis: Vector3 = (0.0, 1.0, 0.0)
    period_s: Positive
    duration_s: Positive


Segment = Annotated[Hold | Line | Transfer | Drift | Circle, Field(discriminator="kind")]


class Pointing(StrictModel):
    """Attitude of the servicer: x of its base to the client, z along the orbit normal, with smooth errors."""

    mode: Literal["client", "inertial"] = "client"
    orientation_xyzw: Annotated[
        Quaternion | None, Field(description="R_inertial_base, for mode inertial")
    ] = None
    offset_deg: Annotated[Vector3, Field(description="roll, pitch and yaw off the client")] = (0.0, 0.0, 0.0)
    error_deg: Annotated[float, Field(ge=0, le=20, description="rms about each axis")] = 0.0
    period_s: Annotated[float, Field(gt=0, description="shortest period of the error")] = 60.0
    jitter_deg: Annotated[float, Field(ge=0, le=1, description="rms about each axis")] = 0.0
    jitter_hz: Positive = 5.0

    @model_validator(mode="after")
    def _check_orientation(self) -> Pointing:
        if (self.mode == "inertial") != (self.orientation_xyzw is not None):
            raise ValueError("orientation_xyzw belongs to mode inertial, which requires it")
        return self


class Thrust(StrictModel):
    """Errors of commanded displacements of a guided servicer."""

    scale_sigma: Annotated[NotNegative, Field(le=0.2, description="relative error of the length")] = 0.01
    position_sigma_m: Annotated[NotNegative, Field(description="error of the end along each axis")] = 0.01


class Servicer(StrictModel):
    """Path, attitude and sensors of the servicer; positions are in the LVLH axes of the client, metres."""

    name: Name = "servicer"
    start_m: Vector3
    path: Annotated[tuple[Segment, ...], Field(min_length=1)]
    pointing: Pointing = Pointing()
    cameras: dict[Name, Camera] = Field(default_factory=dict)
    lidars: dict[Name, OrbitLidar] = Field(default_factory=dict)
    star_tracker: StarTracker | None = None
    imu: Imu | None = None
    gnss: Gnss | None = None
    thrust: Annotated[Thrust | None, Field(description="only for missions with a guided servicer")] = None
    body: tuple[Appendage, ...] = ()


class OrbitScenario(StrictModel):
    """Contents of a scenario file in orbit."""

    kind: Literal["orbit"]
    name: str
    doc: str = ""
    seed: Annotated[int, Field(ge=0)]
    held_out_seeds: Annotated[
        tuple[int, ...], Field(description="for final figures only; nothing is developed or tuned on them")
    ] = ()
    epoch: str
    orbit: Orbit | None = None
    small_body: SmallBody | None = None
    lighting: Lighting = Lighting()
    client: Client
    companions: tuple[Companion, ...] = ()
    servicer: Servicer
    truth_rate_hz: Positive = 1.0
    truth_points: Annotated[
        int, Field(ge=0, description="visible surface points in the truth of an image")
    ] = 200

    @model_validator(mode="after")
    def _check_center(self) -> OrbitScenario:
        """Refuse a scenario without exactly one central body, or with elements that do not fit it."""
        if (self.orbit is None) == (self.small_body is None):
            raise ValueError("expected either orbit or small_body")
        names = [
            self.client.name,
            self.servicer.name,
            *(b.name for b in (*self.companions, *self.servicer.body)),
        ]
        if len(set(names)) < len(names):
            raise ValueError(f"names {names}: expected different ones")
        if self.small_body is not None:
            refused = [s.kind for s in self.servicer.path if s.kind == "transfer"]
            if refused or self.companions or self.servicer.gnss or self.lighting.sun:
                raise ValueError(
                    "small_body: transfer, companions, gnss and lighting.sun are for orbits of the Earth"
                )
        elif not any([self.servicer.cameras, self.servicer.lidars, self.servicer.star_tracker]):
            raise ValueError("servicer: no camera, lidar or star tracker")
        for group in ("cameras", "lidars"):
            for sensor, model in getattr(self.servicer, group).items():
                if model.start_s >= self.duration_s:
                    raise ValueError(
                        f"servicer.{group}.{sensor}.start_s {model.start_s:g} is not before the end of the "
                        f"path, {self.duration_s:g} s"
                    )
        return self

    @property
    def duration_s(self) -> float:
        """Duration of the path, seconds."""
        return float(sum(segment.duration_s for segment in self.servicer.path))

    @property
    def robots(self) -> list[str]:
        """Names of the robots of the log: the servicer."""
        return [self.servicer.name]

    @property
    def bodies(self) -> tuple[Client, ...]:
        """The client and its companions."""
        return (self.client, *self.companions)

    @property
    def mu_m3_s2(self) -> float:
        """Gravitational parameter of the central body."""
        return MU_EARTH if self.small_body is None else self.small_body.mu_m3_s2

    @property
    def epoch_ns(self) -> int:
        """Mission time at the start, nanoseconds."""
        return parse_stamp(self.epoch, "epoch")

    @cached_property
    def digest(self) -> str:
        """First 16 hexadecimal digits of the SHA-256 of all fields of the scenario and of its mesh files."""
        data = self.model_dump(mode="json", exclude_none=True, exclude={"doc", "held_out_seeds"})
        data["meshes"] = [mesh_digest(body.mesh) for body in (*self.bodies, *self.servicer.body)]
        return hashlib.sha256(json.dumps(data, sort_keys=True).encode()).hexdigest()[:16]
