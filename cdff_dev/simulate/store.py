# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cache of simulated logs: one per scenario, seed and simulator version, linked to the requested output."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.errors import ConflictError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs.formats.infuse.writer import chunk_files
from cdff_dev.simulate.scenario import Scenario

if TYPE_CHECKING:
    from cdff_dev.logs import LogWriter
    from cdff_dev.simulate.orbit.scenario import OrbitScenario

    AnyScenario = Scenario | OrbitScenario

#: File next to the chunks: frames and calibration of the rovers for a profile, and the scenario of the log.
SIDECAR = "scenario.json"
#: Sources of this package on which no sample depends: a change of them keeps the cached logs.
_NOT_IN_SAMPLES = ("__init__.py", "commands.py")
#: Folders of the sources on which samples depend.
_SOURCES = ("cdff_dev/simulate", "cdff_common/stars", "cdff_core/rigid_body")


def cache_folder() -> Path:
    """Return ``$XDG_CACHE_HOME/cdff/simulate``, by default below ``~/.cache``."""
    root = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(root) / "cdff" / "simulate"


def code_digest() -> str:
    """Return the first 16 hex digits of the SHA-256 of the simulator's sources and the versions of its
    libraries.
    """
    digest = hashlib.sha256()
    root = Path(__file__).resolve().parents[2]
    sources = [
        p for folder in _SOURCES for p in (root / folder).rglob("*.py") if p.name not in _NOT_IN_SAMPLES
    ]
    for path in sorted(sources):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    for library in ("numpy", "scipy", "open3d-cpu", "astronomy-engine"):
        digest.update(f"{library}={_installed_version(library)}\0".encode())
    return digest.hexdigest()[:16]


def _installed_version(library: str) -> str:
    """Return the version of a library, or none: scenarios on terrain need no ephemeris."""
    try:
        return version(library)
    except PackageNotFoundError:
        return "none"


def cached_log(scenario: AnyScenario) -> Path:
    """Return the folder of a scenario's log in the cache; it need not exist."""
    key = hashlib.sha256(f"{scenario.digest}/{code_digest()}".encode()).hexdigest()[:16]
    return cache_folder() / f"{scenario.name}-{key}"


def _edge(parent: str, child: str, T: FloatArray) -> dict[str, Any]:
    quaternion = se3.quaternion_xyzw_from_matrix(T[:3, :3])
    return {
        "parent": parent,
        "child": child,
        "translation_m": [float(v) for v in T[:3, 3]],
        "quaternion_xyzw": [float(v) for v in quaternion],
    }


def describe(scenario: Scenario, starts: dict[str, FloatArray]) -> dict[str, Any]:
    """Return the contents of the sidecar file: frames and calibration in the terms of the profile.

    Parameters
    ----------
    starts : dict of str to ndarray, shape (4, 4)
        ``T_site_odom`` of each robot.
    """
    robots = {}
    cameras = (
        {}
        if scenario.navcam is None
        else {"navcam_left": scenario.navcam.T_base_left, "navcam_right": scenario.navcam.T_base_right}
    )
    mounts = {**cameras, "lidar": scenario.lidar.mount.matrix(), "imu": scenario.imu.mount.matrix()}
    for robot, T_site_odom in starts.items():
        edges = [_edge(f"{robot}/base", f"{robot}/{sensor}", T) for sensor, T in mounts.items()]
        robots[robot] = {"frames": [_edge("site", f"{robot}/odom", T_site_odom), *edges]}
    calibration = (
        {}
        if scenario.navcam is None
        else {
            "camera_matrix": scenario.navcam.camera_matrix.tolist(),
            "baseline_m": scenario.navcam.baseline_m,
        }
    )
    return {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "scenario_digest": scenario.digest,
        "code_digest": code_digest(),
        "epoch_ns": str(scenario.epoch_ns),
        "duration_s": scenario.duration_s,
        "gravity_m_s2": scenario.gravity_m_s2,
        **calibration,
        "robots": robots,
    }


def make_log(scenario: AnyScenario, target: Path, workers: int, progress: Any = None) -> None:
    """Simulate a scenario into the folder ``target``, which is created only when the log is complete."""
    from cdff_dev.logs import LogWriter

    target.parent.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=f".{target.name}-", dir=target.parent))
    try:
        with LogWriter(part) as writer:
            if isinstance(scenario, Scenario):
                sidecar = _write_traverse(scenario, writer, workers, progress)
            else:
                sidecar = _write_rendezvous(scenario, writer, workers, progress)
        (part / SIDECAR).write_text(json.dumps(sidecar, indent=1) + "\n", encoding="utf-8")
        part.chmod(0o755)
        if target.exists():
            shutil.rmtree(target)
        part.rename(target)
        _remove_old_logs(scenario.name, keep=3)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _write_traverse(scenario: Scenario, writer: LogWriter, workers: int, progress: Any) -> dict[str, Any]:
    """Write the samples of a scenario on terrain; return the contents of the sidecar file."""
    from cdff_dev.simulate.traverse import levelled, simulate

    starts: dict[str, FloatArray] = {}
    for entry, value in simulate(scenario, workers, progress):
        writer.write(entry.stream, value, entry.stamp_ns, entry.header)
        robot = entry.stream.split("/")[1]
        if entry.stream.endswith("/truth.pose") and robot not in starts:
            starts[robot] = levelled(value.transform.matrix)
    return describe(scenario, starts)


def _write_rendezvous(
    scenario: OrbitScenario, writer: LogWriter, workers: int, progress: Any
) -> dict[str, Any]:
    """Write the samples of a scenario in orbit; return the contents of the sidecar file."""
    from cdff_dev.simulate.orbit.rendezvous import simulate_orbit

    for entry, value in simulate_orbit(scenario, workers, progress):
        writer.write(entry.stream, value, entry.stamp_ns, entry.header)
    return describe_orbit(scenario)


def describe_orbit(scenario: OrbitScenario) -> dict[str, Any]:
    """Return the contents of the sidecar file of a scenario in orbit: frames and calibration."""
    servicer = scenario.servicer
    base = f"{servicer.name}/base"
    mounts = {name: camera.T_base_camera for name, camera in servicer.cameras.items()}
    mounts |= {name: lidar.mount.matrix() for name, lidar in servicer.lidars.items()}
    if servicer.imu is not None:
        mounts["imu"] = servicer.imu.mount.matrix()
    cameras = {
        name: {
            "camera_matrix": camera.model.matrix.tolist(),
            "distortion": list(camera.distortion),
            "rows": camera.rows,
            "columns": camera.columns,
            "psf_sigma_px": camera.psf_sigma_px,
            "zero_point_e_s": camera.zero_point_e_s,
            "electrons_per_dn": camera.electrons_per_dn,
            "offset_dn": camera.offset_dn,
            "read_noise_e": camera.read_noise_e,
        }
        for name, camera in servicer.cameras.items()
    }
    frames = [_edge(base, f"{servicer.name}/{sensor}", T) for sensor, T in mounts.items()]
    clients = {
        body.name: {"mesh": body.mesh, "unit": body.unit, "frame": f"{body.name}/body"}
        for body in scenario.bodies
    }
    return {
        "scenario": scenario.name,
        "simulated": True,
        "seed": scenario.seed,
        "scenario_digest": scenario.digest,
        "code_digest": code_digest(),
        "epoch_ns": str(scenario.epoch_ns),
        "duration_s": scenario.duration_s,
        "cameras": cameras,
        "clients": clients,
        "robots": {servicer.name: {"frames": frames}},
    }


def _remove_old_logs(name: str, keep: int) -> None:
    """Remove all but the newest logs of a scenario from the cache; a log is about 200 MB."""
    logs = [p for p in cache_folder().glob(f"{name}-*") if (p / SIDECAR).is_file()]
    for old_log in sorted(logs, key=lambda p: p.stat().st_mtime, reverse=True)[keep:]:
        shutil.rmtree(old_log, ignore_errors=True)


def simulated_log(scenario: AnyScenario, workers: int = 2, progress: Any = None, fresh: bool = False) -> Path:
    """Return the folder of a scenario's log in the cache; generate it if it is missing or ``fresh``."""
    target = cached_log(scenario)
    if fresh or not (target / SIDECAR).is_file():
        make_log(scenario, target, workers, progress)
    return target


def _target_files(log: Path, out: Path) -> dict[Path, Path]:
    """Return the target of each file of a cached log: in a folder, or ``NAME_000000000.msg`` next to
    ``NAME.msg``.
    """
    if out.suffix != ".msg":
        return {path: out / path.name for path in sorted(log.iterdir())}
    chunks = sorted(log.glob("*.msg"))
    targets = {path: out.with_name(f"{out.stem}_{i:09d}.msg") for i, path in enumerate(chunks)}
    return {**targets, log / SIDECAR: out.with_name(f"{out.stem}.{SIDECAR}")}


def check_free(out: Path, force: bool) -> None:
    """Refuse an output that would replace existing files.

    Raises
    ------
    ConflictError
        If ``out`` exists and ``force`` is not set, or it is not a log.
    """
    existing = chunk_files(out.parent, out.stem) if out.suffix == ".msg" else list(out.glob("*"))
    if (existing or out.exists()) and not force:
        raise ConflictError(f"{out} exists; name another --out or add --force to replace it")
    foreign = [p for p in existing if p.suffix != ".msg" and not p.name.endswith(SIDECAR)]
    if foreign or out.is_file():
        raise ConflictError(f"{out} holds {foreign[0].name if foreign else 'no log'}; it is not replaced")


def deliver(log: Path, out: Path, force: bool = False) -> None:
    """Link the files of a cached log to ``out``, or copy them where linking is not possible.

    Parameters
    ----------
    out : Path
        A folder, or ``NAME.msg`` for the chunk files ``NAME_000000000.msg``, …

    Raises
    ------
    ConflictError
        See ``check_free``.
    """
    check_free(out, force)
    targets = _target_files(log, out)
    next(iter(targets.values())).parent.mkdir(parents=True, exist_ok=True)
    old_files = chunk_files(out.parent, out.stem) if out.suffix == ".msg" else list(out.glob("*.msg"))
    for path in old_files:
        path.unlink()
    for source, target in targets.items():
        target.unlink(missing_ok=True)
        try:
            os.link(source, target)
        except OSError:
            shutil.copy2(source, target)
