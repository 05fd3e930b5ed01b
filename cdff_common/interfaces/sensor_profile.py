# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sensors of a profile: kind, frame, streams, modes, and the modes that a DFPC requires."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, PositiveFloat, model_validator

from cdff_common.contract.names import FRAME_ID, MAX_FRAME_LENGTH, NAME
from cdff_common.interfaces.dfn import StrictModel

Name = Annotated[str, Field(pattern=rf"^{NAME}$")]
FrameId = Annotated[str, Field(pattern=rf"^{FRAME_ID}$", max_length=MAX_FRAME_LENGTH)]
Count = Annotated[int, Field(ge=1)]

#: Value of ``Sensor.mask`` that selects the shapes of the robot's URDF instead of an image.
URDF_MASK = "urdf"
Exposure = Literal["short", "normal", "long", "auto"]


class AcquisitionParameter(StrictModel):
    """Parameter of a single acquisition.

    Attributes
    ----------
    least, greatest : float
        Bounds, in the unit of the name, such as ``pan_deg``.
    initial : float
        Value before the first acquisition, and of an acquisition that does not state it.
    speed_per_s : float or None
        Speed of the mechanism, units per second; None if a change takes no time.
    """

    least: float
    greatest: float
    initial: float = 0.0
    speed_per_s: PositiveFloat | None = None

    @model_validator(mode="after")
    def _initial_is_within_the_bounds(self) -> AcquisitionParameter:
        if not self.least <= self.initial <= self.greatest:
            raise ValueError(f"initial={self.initial:g}: expected {self.least:g} to {self.greatest:g}")
        return self


class SensorMode(StrictModel):
    """A mode of a sensor that the ICU can set.

    Attributes
    ----------
    on : bool
        True if the sensor streams in this mode.
    rate_hz : float or None
        Samples per second.
    width_px, height_px : int or None
        Resolution of an image, or points per ring and number of rings of a lidar scan.
    stereo : bool or None
        Stereo camera: true for both cameras, false for one.
    exposure : str or None
        Exposure class: short, normal, long or auto.
    power_w : float
        Electrical power, watts.
    heat_w : float or None
        Heat for the thermal control, watts; None for the electrical power.
    data_mb_h : float
        Volume of the data that are stored, megabytes per hour.
    acquires : int or None
        Samples of each stream that the sensor delivers in this mode before it returns to the previous mode,
        for single acquisitions; None for a mode in which it streams.
    acquire_s : float
        Duration of an acquisition, seconds, without the motion of its parameters.
    energy_j : float or None
        Energy of an acquisition, joules; None for ``power_w`` times its duration.
    parameters : mapping of name to AcquisitionParameter
        Parameters of an acquisition, such as the angles of a pan-tilt unit.
    doc : str
        Description for operators.
    """

    on: bool = True
    rate_hz: NonNegativeFloat | None = None
    width_px: Count | None = None
    height_px: Count | None = None
    stereo: bool | None = None
    exposure: Exposure | None = None
    power_w: NonNegativeFloat = 0.0
    heat_w: NonNegativeFloat | None = None
    data_mb_h: NonNegativeFloat = 0.0
    acquires: Count | None = None
    acquire_s: NonNegativeFloat = 1.0
    energy_j: NonNegativeFloat | None = None
    parameters: dict[Name, AcquisitionParameter] = {}
    doc: str = ""

    @model_validator(mode="after")
    def _only_acquisitions_have_parameters(self) -> SensorMode:
        if self.acquires is None and (self.parameters or self.energy_j is not None):
            raise ValueError("parameters and energy_j: expected with acquires only")
        if self.acquires is not None and not self.on:
            raise ValueError("acquires: expected in a mode that is on")
        return self

    @property
    def streams(self) -> bool:
        """True if the sensor streams in this mode; False if it is off or for single acquisitions."""
        return self.on and self.acquires is None

    def acquisition_fault(self, values: Mapping[str, float]) -> str:
        """Return why these parameters cannot be acquired in this mode; empty if they can."""
        if self.acquires is None:
            return "it is not for single acquisitions"
        for name, value in values.items():
            bounds = self.parameters.get(name)
            if bounds is None:
                return f"it has no parameter {name}; it has {', '.join(self.parameters) or 'none'}"
            if not bounds.least <= value <= bounds.greatest:
                return f"{name}={value:g}: expected {bounds.least:g} to {bounds.greatest:g}"
        return ""

    def acquisition_s(self, values: Mapping[str, float], current: Mapping[str, float]) -> float:
        """Return the duration of an acquisition from the current values of the parameters, seconds."""
        motions_s = [
            abs(values.get(name, p.initial) - current.get(name, p.initial)) / p.speed_per_s
            for name, p in self.parameters.items()
            if p.speed_per_s is not None
        ]
        return self.acquire_s + max(motions_s, default=0.0)

    def acquisition_j(self, duration_s: float) -> float:
        """Return the energy of an acquisition of some duration, joules."""
        return self.power_w * duration_s if self.energy_j is None else self.energy_j

    @property
    def needs(self) -> dict[str, float]:
        """Needed part of the budgets of the robot."""
        heat_w = self.power_w if self.heat_w is None else self.heat_w
        return {"power_w": self.power_w, "heat_w": heat_w, "data_mb_h": self.data_mb_h}


class ModeNeed(StrictModel):
    """Requirements of a DFPC for the mode of a sensor; any streaming mode that meets all is accepted.

    Attributes
    ----------
    min_rate_hz, max_rate_hz : float or None
        Bounds of the rate, samples per second.
    min_width_px, min_height_px : int
        Least resolution, pixels.
    stereo : bool or None
        Stereo camera: true for both cameras, false for one; None accepts both.
    exposure : list of str
        Accepted exposure classes; empty for all.
    """

    min_rate_hz: NonNegativeFloat = 0.0
    max_rate_hz: PositiveFloat | None = None
    min_width_px: Count = 1
    min_height_px: Count = 1
    stereo: bool | None = None
    exposure: tuple[Exposure, ...] = ()

    def is_met_by(self, mode: SensorMode) -> bool:
        """Return True if a mode meets the requirements; an unspecified property does not."""
        return (
            mode.streams
            and (self.min_rate_hz == 0.0 or (mode.rate_hz or 0.0) >= self.min_rate_hz)
            and (self.max_rate_hz is None or (mode.rate_hz is not None and mode.rate_hz <= self.max_rate_hz))
            and (self.min_width_px == 1 or (mode.width_px or 0) >= self.min_width_px)
            and (self.min_height_px == 1 or (mode.height_px or 0) >= self.min_height_px)
            and (self.stereo is None or mode.stereo is self.stereo)
            and (not self.exposure or mode.exposure in self.exposure)
        )


class Sensor(StrictModel):
    """A sensor of a robot: kind, frame, streams and modes.

    Attributes
    ----------
    kind : str
        Kind of the sensor; ``other`` for joints, GNSS and whatever has no kind.
    frame : str
        Frame of the samples, below ``{robot}/base``: x right, y down, z forward for a camera (the left one of
        a stereo camera), x forward, y left, z up for the others. For wheels ``{robot}/base``.
    streams : mapping
        Stream name to the type of its samples.
    modes : mapping of mode to SensorMode
        Modes by name.
    initial_mode : str
        Mode at the start and when the sensor is not used.
    switch_s : float
        Duration of a mode change, seconds.
    transitions : mapping of mode to mapping of mode to float
        Mode -> next mode -> seconds. A listed mode has only these transitions; any other can change to every
        mode in ``switch_s``. Modes without a direct transition are reached through others.
    refuses : tuple of str
        Modes that the sensor refuses at present.
    range_m : float or None
        Range, metres; None if unknown.
    max_offset_s : float
        Largest offset of its stamps to the other sensors, and lead over the mission clock, seconds; a larger
        one makes the products DEGRADED.
    max_lost_fraction : float
        Largest fraction of lost samples (gaps of their numbers); a larger one makes the products DEGRADED.
    max_rate_ratio : float
        Largest ratio of the measured rate to that of a mode, or of that of a mode to the measured one.
    mask : str
        Pixels that always show the robot, in the left image of a stereo camera. Either the path of an image
        file, relative to the profile, in which these pixels are black (0); or ``urdf``: the shapes of the
        robot's URDF are projected into both images. In a loaded profile the path is replaced by the file in
        base64.
    mask_right : str
        The same for the right image, as an image file.
    """

    kind: Literal["stereo_camera", "camera", "lidar", "imu", "wheels", "other"]
    frame: FrameId
    streams: dict[Name, str]
    modes: dict[Name, SensorMode] = {"off": SensorMode(on=False), "nominal": SensorMode()}
    initial_mode: Name = "nominal"
    switch_s: NonNegativeFloat = 0.5
    transitions: dict[Name, dict[Name, NonNegativeFloat]] = {}
    refuses: tuple[Name, ...] = ()
    range_m: PositiveFloat | None = None
    max_offset_s: PositiveFloat = 0.2
    max_lost_fraction: Annotated[float, Field(gt=0, le=1)] = 0.2
    max_rate_ratio: Annotated[float, Field(ge=1)] = 1.5
    mask: str = ""
    mask_right: str = ""

    @model_validator(mode="after")
    def _check_masks(self) -> Sensor:
        if (self.mask or self.mask_right) and self.kind != "stereo_camera":
            raise ValueError(f"mask of a sensor of kind {self.kind}: expected a stereo camera")
        if self.mask_right and URDF_MASK in (self.mask, self.mask_right):
            raise ValueError(f"mask_right: expected an image; `mask: {URDF_MASK}` applies to both images")
        return self

    @model_validator(mode="after")
    def _modes_exist(self) -> Sensor:
        """Refuse names of modes that the sensor does not have."""
        mode_names = [self.initial_mode, *self.refuses, *self.transitions]
        for mode in (
            *mode_names,
            *(name for targets in self.transitions.values() for name in targets),
        ):
            if mode not in self.modes:
                raise ValueError(f"mode {mode!r} is not among modes {sorted(self.modes)}")
        return self

    def transitions_from(self, mode: str) -> dict[str, float]:
        """Return the direct transitions of a mode with their duration, seconds."""
        if mode in self.transitions:
            return dict(self.transitions[mode])
        return {m: self.switch_s for m in self.modes if m != mode}

    @cached_property
    def needs_by_mode(self) -> dict[str, dict[str, float]]:
        """Needed part of the budgets of the robot in each mode; empty if no mode states any."""
        needs = {name: mode.needs for name, mode in self.modes.items()}
        return needs if any(value for amounts in needs.values() for value in amounts.values()) else {}

    @cached_property
    def switch_durations_s(self) -> dict[str, dict[str, float]]:
        """Durations of the fastest mode changes, seconds: mode -> reachable mode -> duration."""
        paths = {start: {mode: self.mode_path(start, mode) for mode in self.modes} for start in self.modes}
        return {
            start: {
                mode: sum(duration_s for _, duration_s in path)
                for mode, path in targets.items()
                if path is not None
            }
            for start, targets in paths.items()
        }

    def mode_path(self, start: str, target: str) -> tuple[tuple[str, float], ...] | None:
        """Return the fastest path between two modes, as modes and seconds; None if there is none."""
        best: dict[str, tuple[float, tuple[tuple[str, float], ...]]] = {start: (0.0, ())}
        open_modes = {start}
        while open_modes:
            mode = min(open_modes, key=lambda m: (best[m][0], m))
            if mode == target:
                return best[mode][1]
            open_modes.discard(mode)
            elapsed_s, steps = best[mode]
            for next_mode, duration_s in self.transitions_from(mode).items():
                if next_mode not in best or elapsed_s + duration_s < best[next_mode][0]:
                    best[next_mode] = (
                        elapsed_s + duration_s,
                        (*steps, (next_mode, duration_s)),
                    )
                    open_modes.add(next_mode)
        return None
