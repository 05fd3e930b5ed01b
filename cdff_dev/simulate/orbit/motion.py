# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion of client, companions and servicer, and the light on them, at any time of a scenario.

Positions relative to the client are computed without those relative to the Earth, whose rounding errors would
be a thousand times larger.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from cdff_common.clock import NS_PER_S
from cdff_common.errors import ConfigurationError, InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.stars.aberration import ASTRONOMICAL_UNIT_M
from cdff_core.rigid_body.torque_free import TorqueFreeBody
from cdff_dev.simulate.orbit.eclipse import sunlit_fraction
from cdff_dev.simulate.orbit.environment import sun_positions_m
from cdff_dev.simulate.orbit.kepler import EllipticOrbit, lvlh_axes, relative_orbit, relative_states
from cdff_dev.simulate.orbit.path import RelativePath
from cdff_dev.simulate.orbit.random_streams import generator
from cdff_dev.simulate.orbit.scenario import Client, Companion, Line, OrbitScenario, Pointing

#: Half step of numerical derivatives of attitudes and of positions, seconds.
_RATE_STEP_S, _ACCELERATION_STEP_S = 1e-3, 0.05
#: Times at which the path is checked, smallest distance from the client, and sine of the smallest angle
#: between line of sight and upward axis.
_PATH_CHECKS, _APART_M, _AXIS_SINE = 2000, 0.01, 0.05
#: Positions at which a commanded line is checked.
_LINE_CHECKS = 200


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """Sunlight at one time, inertial axes.

    Attributes
    ----------
    to_sun : ndarray (3,)
        Unit vector.
    irradiance : float
        Relative to that at 1 au, without eclipse.
    sunlit : float
        Visible fraction of the Sun's disc.
    earth_m : ndarray (3,) or None
        Position of the client relative to the centre of the Earth; None far from it.
    """

    to_sun: FloatArray
    irradiance: float
    sunlit: float
    earth_m: FloatArray | None


class OrbitMotion:
    """Positions and attitudes of all bodies at times since the epoch.

    Raises
    ------
    ConfigurationError
        If the path is impossible.
    """

    def __init__(self, scenario: OrbitScenario) -> None:
        self._scenario = scenario
        self.reference: EllipticOrbit | None = None
        if scenario.orbit is not None:
            self.reference = EllipticOrbit.from_elements(**scenario.orbit.model_dump())
        self._path = RelativePath(scenario, self.reference)
        self._companions: dict[str, EllipticOrbit] = {}
        for companion in scenario.companions:
            assert self.reference is not None  # checked by the scenario
            self._companions[companion.name] = relative_orbit(
                self.reference, companion.position_m, companion.velocity_m_s, 0.0
            )
        self._rotations = {
            body.name: _rotation(body, generator(scenario, "attitude", i))
            for i, body in enumerate(scenario.bodies)
        }
        pointing = scenario.servicer.pointing
        rng = generator(scenario, "pointing")
        self._errors = [
            _SmoothError(pointing.error_deg, 1.0 / pointing.period_s, rng),
            _SmoothError(pointing.jitter_deg, pointing.jitter_hz, rng),
        ]
        self._upward = self._upward_axis()
        self._fixed_sun = self._fixed_sun_direction()

    # -- positions

    def client_positions_m(self, t_s: FloatArray) -> FloatArray:
        """Return the positions (n, 3) of the client relative to the central body, inertial axes."""
        if self.reference is None:
            return np.zeros((len(t_s), 3))
        return self.reference.states(t_s)[0]

    def path_axes(self, t_s: FloatArray) -> FloatArray:
        """Return ``R_inertial_lvlh`` (n, 3, 3) of the client; identity if it is a small body."""
        if self.reference is None:
            return np.tile(np.eye(3), (len(t_s), 1, 1))
        return lvlh_axes(*self.reference.states(t_s))[0]

    def servicer_offsets_m(self, t_s: FloatArray) -> FloatArray:
        """Return the positions (n, 3) of the servicer's base relative to the client, inertial axes."""
        return np.asarray(np.einsum("nij,nj->ni", self.path_axes(t_s), self._path.positions_m(t_s)))

    def body_offsets_m(self, name: str, t_s: FloatArray) -> FloatArray:
        """Return the positions (n, 3) of the client or a companion relative to the client, inertial axes."""
        if name not in self._companions or self.reference is None:
            return np.zeros((len(t_s), 3))
        relative = relative_states(self.reference, self._companions[name], t_s)[0]
        return np.asarray(np.einsum("nij,nj->ni", self.path_axes(t_s), relative))

    def servicer_states(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions (n, 3), m, and velocities (n, 3), m/s, of the servicer about the central body."""
        half_step_s = _ACCELERATION_STEP_S
        ahead, behind = self.servicer_offsets_m(t_s + half_step_s), self.servicer_offsets_m(t_s - half_step_s)
        velocity = (ahead - behind) / (2.0 * half_step_s)
        position = self.servicer_offsets_m(t_s)
        if self.reference is None:
            return position, velocity
        centre, centre_velocity = self.reference.states(t_s)
        return centre + position, centre_velocity + velocity

    def specific_forces(self, t_s: FloatArray) -> FloatArray:
        """Return the accelerations (n, 3) of the servicer by thrust, m/s², inertial axes."""
        half_step_s, mu = _ACCELERATION_STEP_S, self._scenario.mu_m3_s2
        offset = self.servicer_offsets_m(t_s)
        total = (
            self.servicer_offsets_m(t_s + half_step_s)
            - 2.0 * offset
            + self.servicer_offsets_m(t_s - half_step_s)
        ) / half_step_s**2
        client = self.client_positions_m(t_s)
        servicer = client + offset
        gravity = -mu * servicer / np.linalg.norm(servicer, axis=1, keepdims=True) ** 3
        if self.reference is not None:
            gravity += mu * client / np.linalg.norm(client, axis=1, keepdims=True) ** 3
        return np.asarray(total - gravity)

    @contextmanager
    def tentative_move(self, displacement_m: FloatArray, start_s: float, duration_s: float) -> Iterator[None]:
        """Continue the path of the servicer with a motion on a straight line, from rest to rest.

        If the block raises an error, the motion is removed again.

        Parameters
        ----------
        displacement_m : ndarray (3,)
            Inertial axes at ``start_s``.

        Raises
        ------
        InputError
            If the line comes so close to the client or to the axis near which z of the servicer is kept that
            no attitude towards the client is continuous.
        """
        R_inertial_path = self.path_axes(np.array([start_s]))[0]
        start_m = self._path.positions_m(np.array([start_s]))[0]
        end_m = start_m + R_inertial_path.T @ displacement_m
        line_m = start_m + np.linspace(0.0, 1.0, _LINE_CHECKS)[:, None] * (end_m - start_m)
        distances_m = np.linalg.norm(line_m, axis=1)
        sines = np.linalg.norm(np.cross(line_m, self._upward), axis=1) / np.maximum(distances_m, _APART_M)
        if distances_m.min() < _APART_M or sines.min() < _AXIS_SINE:
            raise InputError(
                f"displacement {np.round(displacement_m, 2).tolist()} m: passes the client or its upward "
                "axis; expected a line around them"
            )
        to_m = (float(end_m[0]), float(end_m[1]), float(end_m[2]))
        self._path.append(Line(kind="line", to_m=to_m, duration_s=duration_s), start_s)
        try:
            yield
        except BaseException:
            self._path.remove_last()
            raise

    # -- attitudes

    def body_attitudes(self, name: str, t_s: FloatArray) -> FloatArray:
        """Return ``R_inertial_body`` (n, 3, 3) of the client or a companion."""
        return self._rotations[name].orientations(t_s)

    def body_rates(self, name: str, t_s: FloatArray) -> FloatArray:
        """Return the angular rates (n, 3) of the client or a companion, body axes, rad/s."""
        return self._rotations[name].rates(t_s)

    def base_attitudes(self, t_s: FloatArray) -> FloatArray:
        """Return ``R_inertial_base`` (n, 3, 3) of the servicer."""
        pointing = self._scenario.servicer.pointing
        error = sum(source.at(t_s) for source in self._errors)
        R_error = se3.exp_so3(error)
        if pointing.orientation_xyzw is not None:
            R = se3.matrix_from_quaternion_xyzw(_unit(np.array(pointing.orientation_xyzw)))
            return np.asarray(R @ R_error)
        return np.asarray(self._point_to_client(t_s) @ _offset(pointing) @ R_error)

    def base_rates(self, t_s: FloatArray) -> FloatArray:
        """Return the angular rates (n, 3) of the servicer, base axes, rad/s."""
        half_step_s = _RATE_STEP_S
        behind, ahead = self.base_attitudes(t_s - half_step_s), self.base_attitudes(t_s + half_step_s)
        return np.asarray(se3.log_so3(np.swapaxes(behind, 1, 2) @ ahead) / (2.0 * half_step_s))

    def poses_in_base(self, name: str, t_s: FloatArray) -> FloatArray:
        """Return ``T_base_body`` (n, 4, 4) of the client or a companion."""
        R_base_inertial = np.swapaxes(self.base_attitudes(t_s), 1, 2)
        offset = self.body_offsets_m(name, t_s) - self.servicer_offsets_m(t_s)
        T = np.tile(np.eye(4), (len(t_s), 1, 1))
        T[:, :3, :3] = R_base_inertial @ self.body_attitudes(name, t_s)
        T[:, :3, 3] = np.einsum("nij,nj->ni", R_base_inertial, offset)
        return T

    def _point_to_client(self, t_s: FloatArray) -> FloatArray:
        """Return attitudes (n, 3, 3) with x to the client and z near the upward axis."""
        x = -_unit(self.servicer_offsets_m(t_s))
        y = _unit(np.cross(self.path_axes(t_s) @ self._upward, x))
        return np.stack([x, y, np.cross(x, y)], axis=2)

    def _upward_axis(self) -> FloatArray:
        """Return the axis (3,) of the path near which z of the servicer is.

        It is the orbit normal, or z for a small body; if the path comes close to that axis, the first axis.

        Raises
        ------
        ConfigurationError
            If the servicer is at the position of the client, or passes both axes.
        """
        t_s = np.linspace(0.0, self._scenario.duration_s, _PATH_CHECKS)
        positions = self._path.positions_m(t_s)
        distances = np.linalg.norm(positions, axis=1)
        nearest = int(distances.argmin())
        if distances[nearest] < _APART_M:
            raise ConfigurationError(
                f"servicer.path: the servicer is {distances[nearest]:.3g} m from the centre of the client at "
                f"{t_s[nearest]:g} s, expected at least {_APART_M:g} m"
            )
        axes = [np.array([0.0, -1.0, 0.0] if self.reference else [0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])]
        for axis in axes:
            sine = np.linalg.norm(np.cross(positions, axis), axis=1) / distances
            if sine.min() > _AXIS_SINE:
                return axis
        raise ConfigurationError(
            "servicer.path: it passes both the orbit normal and V-bar of the client (z and x of a small "
            "body), so that no attitude towards the client is continuous; use pointing.mode inertial or change it"
        )

    # -- light

    def light(self, t_s: float) -> Light:
        """Return the sunlight at the client."""
        scenario = self._scenario
        if scenario.small_body is not None:
            body = scenario.small_body
            return Light(_unit(np.array(body.sun_direction)), body.sun_distance_au**-2, 1.0, None)
        times = np.array([t_s])
        position = self.client_positions_m(times)[0]
        sun = sun_positions_m([scenario.epoch_ns + round(t_s * NS_PER_S)])[0]
        if self._fixed_sun is not None:
            sun = self._fixed_sun * float(np.linalg.norm(sun))
        to_sun = sun - position
        distance = float(np.linalg.norm(to_sun))
        sunlit = float(sunlit_fraction(position, sun)[0]) if scenario.lighting.eclipse else 1.0
        return Light(to_sun / distance, (ASTRONOMICAL_UNIT_M / distance) ** 2, sunlit, position)

    def _fixed_sun_direction(self) -> FloatArray | None:
        """Return the direction (3,) of a Sun with a given phase angle, None with the ephemeris."""
        sun = self._scenario.lighting.sun
        if sun is None:
            return None
        t_s = np.array([sun.at_s])
        to_servicer = _unit(self.servicer_offsets_m(t_s))[0]
        upward = self.path_axes(t_s)[0] @ self._upward
        across = upward - (upward @ to_servicer) * to_servicer
        across = np.asarray(
            se3.exp_so3(to_servicer * np.radians(sun.clock_deg)) @ (across / np.linalg.norm(across))
        )
        phase = np.radians(sun.phase_deg)
        return np.asarray(np.cos(phase) * to_servicer + np.sin(phase) * across)


class _SmoothError:
    """Rotation vectors that vary smoothly: sums of sines with random periods and phases about each axis."""

    def __init__(self, rms_deg: float, highest_hz: float, rng: np.random.Generator, terms: int = 6) -> None:
        self._rms_rad = np.radians(rms_deg)
        self._frequency = 2.0 * np.pi * highest_hz * rng.uniform(0.2, 1.0, (3, terms))
        self._phase = rng.uniform(0.0, 2.0 * np.pi, (3, terms))

    def at(self, t_s: FloatArray) -> FloatArray:
        """Return the errors (n, 3), rad."""
        waves = np.sin(t_s[:, None, None] * self._frequency + self._phase)
        return np.asarray(self._rms_rad * np.sqrt(2.0 / waves.shape[2]) * waves.sum(axis=2))


def _rotation(body: Client | Companion, rng: np.random.Generator) -> TorqueFreeBody:
    random = rng.normal(size=4)
    chosen = body.attitude.orientation_xyzw
    quaternion = random if chosen == "random" else np.array(chosen, dtype=float)
    R = se3.matrix_from_quaternion_xyzw(_unit(quaternion))
    return TorqueFreeBody(body.inertia_kg_m2, np.radians(body.attitude.rate_deg_s), R)


def _offset(pointing: Pointing) -> FloatArray:
    roll, pitch, yaw = np.radians(pointing.offset_deg)
    R = se3.exp_so3([0.0, 0.0, yaw]) @ se3.exp_so3([0.0, pitch, 0.0]) @ se3.exp_so3([roll, 0.0, 0.0])
    return np.asarray(R)


def _unit(vectors: FloatArray) -> FloatArray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
