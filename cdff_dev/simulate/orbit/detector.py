# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The detector of a camera: from expected photoelectrons to numbers.

Source: EMVA Standard 1288, release 4.0, linear camera model.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_dev.simulate.orbit._detector_kernels import bloom
from cdff_dev.simulate.orbit.materials import Float32Array
from cdff_dev.simulate.orbit.sensors import Camera

#: Expected numbers of electrons above which photon noise is drawn from a normal distribution.
_NORMAL_E = 25.0
#: Mean length of the track of a particle, pixels, and its mean charge per pixel, electrons.
_TRACK_PX, _TRACK_E = 3.0, 1500.0


class Detector:
    """Fixed pattern of a detector, drawn once, and its noise.

    Parameters
    ----------
    model : Camera
    rng : numpy.random.Generator
        For response and hot pixels.
    """

    def __init__(self, model: Camera, rng: np.random.Generator) -> None:
        self._model = model
        shape = (model.rows, model.columns)
        response = 1.0 + model.prnu * rng.standard_normal(shape, dtype=np.float32)
        self._response: Float32Array = np.maximum(response, np.float32(0.0))
        self.dark_e_s: Float32Array = np.full(shape, model.dark_e_s, dtype=np.float32)
        hot = rng.choice(self.dark_e_s.size, min(model.hot_pixels, self.dark_e_s.size), replace=False)
        self.dark_e_s.ravel()[hot] += model.hot_e_s * np.exp(rng.standard_normal(len(hot)))

    def read(
        self, expected_e: Float32Array, exposure_s: float, rng: np.random.Generator
    ) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """Return the image (rows, columns) of expected photoelectrons (rows, columns).

        Numbers of up to 8 bits are uint8, others uint16.
        """
        model = self._model
        mean = expected_e * self._response
        mean += self.dark_e_s * np.float32(exposure_s)
        if model.cosmic_rays_hz > 0.0:
            self._add_particles(mean, exposure_s, rng)
        charge = mean + np.sqrt(mean) * rng.standard_normal(mean.shape, dtype=np.float32)
        faint = np.flatnonzero(mean < _NORMAL_E)
        charge.ravel()[faint] = rng.poisson(mean.ravel()[faint])
        if model.blooming:
            bloom(charge, model.full_well_e)
        np.minimum(charge, np.float32(model.full_well_e), out=charge)
        charge += np.float32(model.read_noise_e) * rng.standard_normal(charge.shape, dtype=np.float32)
        charge *= np.float32(1.0 / model.electrons_per_dn)
        charge += np.float32(model.offset_dn)
        np.rint(charge, out=charge)
        np.clip(charge, 0, model.largest_dn, out=charge)
        image: NDArray[np.uint8] | NDArray[np.uint16] = charge.astype(
            np.uint8 if model.bits <= 8 else np.uint16
        )
        return image

    def _add_particles(self, mean: Float32Array, exposure_s: float, rng: np.random.Generator) -> None:
        """Add the tracks of particles that cross the detector during the exposure and its readout."""
        rows, columns = mean.shape
        for _ in range(rng.poisson(self._model.cosmic_rays_hz * exposure_s)):
            length = rng.exponential(_TRACK_PX) + 1.0
            angle = rng.uniform(0.0, 2.0 * np.pi)
            start = rng.uniform(0.0, [columns, rows])
            steps = np.arange(0.0, length, 0.5)
            u = (start[0] + np.cos(angle) * steps).astype(np.int64)
            v = (start[1] + np.sin(angle) * steps).astype(np.int64)
            inside = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
            mean[v[inside], u[inside]] += np.float32(0.5 * rng.exponential(_TRACK_E))
