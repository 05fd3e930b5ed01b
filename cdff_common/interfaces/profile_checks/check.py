# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Check of a profile file, for every command and service that reads one."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from cdff_common.errors import FaultsError
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.profile_checks.faults import (
    ABSENT,
    Finding,
    ProfileFault,
    key_text,
    short,
)
from cdff_common.interfaces.profile_checks.files import with_files
from cdff_common.interfaces.profile_checks.frames import frame_findings
from cdff_common.interfaces.profile_checks.plausibility import plausibility_findings
from cdff_common.interfaces.profile_checks.reading import Reading, read
from cdff_common.interfaces.profile_checks.references import reference_findings
from cdff_common.interfaces.profile_checks.wiring import wiring_findings
from cdff_common.interfaces.yaml_file import LocatedMapping, read_located_mapping
from cdff_common.resources import resolve


@dataclass(frozen=True, slots=True)
class CheckedProfile:
    """Profile of a file and its faults, by line.

    Attributes
    ----------
    profile : Profile or None
        Valid part with the content of its files; None if there is none.
    faults : tuple of ProfileFault
        Errors and warnings.
    """

    path: Path
    profile: Profile | None
    faults: tuple[ProfileFault, ...]

    @property
    def errors(self) -> tuple[ProfileFault, ...]:
        """Faults for which the profile is refused."""
        return tuple(fault for fault in self.faults if fault.severity == "error")

    @property
    def warnings(self) -> tuple[ProfileFault, ...]:
        """Implausible values, with which the profile runs."""
        return tuple(fault for fault in self.faults if fault.severity == "warning")

    def valid_profile(self) -> Profile:
        """Return the profile; raises FaultsError with all faults if it has errors."""
        if self.errors or self.profile is None:
            raise FaultsError(self.faults)
        return self.profile


def check_profile(path: str | Path, *, complete: bool = True) -> CheckedProfile:
    """Read a profile and find its faults.

    Parameters
    ----------
    path : str or Path
        File, or name of a shipped profile.
    complete : bool
        Also check the body and the parameters of the DFPCs, which imports their modules.

    Raises
    ------
    ConfigurationError
        If there is no such file, or it is no YAML mapping.
    """
    path = resolve("profiles", path)
    mapping = read_located_mapping(path)
    reading = read(mapping.data)
    findings = [*_repetitions(mapping), *reading.findings]
    if reading.profile is not None:
        findings += _cross_findings(reading, path.parent, complete=complete)
    faults = {_fault(path, mapping, finding) for finding in findings}
    return CheckedProfile(
        path, reading.profile, tuple(sorted(faults, key=lambda f: (f.line, f.key, f.problem)))
    )


def _cross_findings(reading: Reading, folder: Path, *, complete: bool) -> list[Finding]:
    """Return the findings across the fields of the valid part, at locations in the data."""
    assert reading.profile is not None
    findings: list[Finding] = []
    reading.profile = with_files(reading.profile, folder, findings)
    reading.removed |= {reading.origin(f.location) for f in findings}  # a file that cannot be used
    findings += [*reference_findings(reading), *wiring_findings(reading)]
    of_frames = list(frame_findings(reading))
    findings += of_frames
    if not any(finding.severity == "error" for finding in of_frames):
        findings += plausibility_findings(reading)
    if complete:
        from cdff_common.interfaces.profile_checks.parameters import body_findings, parameter_findings

        findings += [*body_findings(reading), *parameter_findings(reading)]
    return [replace(finding, location=reading.origin(finding.location)) for finding in findings]


def _repetitions(located: LocatedMapping) -> Iterable[Finding]:
    for location, line in located.repeated:
        yield Finding(location, f"repeats the key of line {line}, expected it once", ABSENT)


def _fault(path: Path, located: LocatedMapping, finding: Finding) -> ProfileFault:
    """Return a finding with file, line and key."""
    return ProfileFault(
        file=str(path),
        line=located.line(finding.location),
        key=key_text(located.data, finding.location),
        value=short(finding.value),
        problem=finding.problem,
        nearest=finding.nearest,
        severity=finding.severity,
    )
