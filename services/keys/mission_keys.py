# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Folder with the authority of a mission, its register of certificates, and a folder for each identity.

``ca/`` holds the authority, whose key stays on the ground. ``{name}/`` is the identity folder of a machine or
person. A certificate's common name is ``{name}.{number}``, so that a revoked certificate stays revoked when a
new one is issued for the same name.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.bus.identity import ACCESS, AUTHORITY, CERTIFICATE, EXPIRY, KEY, MEMBERS
from cdff_common.contract.names import ANY_ROBOT, GROUND, NAME
from cdff_common.errors import ConfigurationError, InputError
from cdff_common.output import make_folder, replace_file, storage_errors
from services.keys.access_control import Kind, Member, ground_list, robot_list
from services.keys.authority import Authority, Issued, key_pem, pem, write_secret

if TYPE_CHECKING:
    from cdff_common.interfaces.profile import Profile

#: Validity of the authority and of the certificates of identities.
AUTHORITY_DAYS = 3650
CERTIFICATE_DAYS = 365
#: Time before its expiry at which a certificate raises an alarm, at most a fifth of its validity.
_EXPIRY_WARNING = timedelta(days=30)
_AUTHORITY_FOLDER, _AUTHORITY_KEY, _REGISTER = "ca", "ca.key", "register.json"
#: Names under which a router or HTTP server is reached on its own machine.
_LOCAL = ("localhost", "127.0.0.1", "::1")
#: Role at the DPM of kinds without a choice. Programs that ask or play change nothing in the store.
_ROLES = {Kind.GROUND: "operator", Kind.ROBOT: "robot", Kind.CLIENT: "reader", Kind.PLAYER: "reader"}


@dataclass(frozen=True, slots=True)
class Certificate:
    """Entry of the register: an issued certificate; times are RFC 3339, ``revoked`` is empty until then."""

    name: str
    kind: Kind
    role: str
    common_name: str
    issued: str
    expires: str
    revoked: str = ""

    @property
    def state(self) -> str:
        """``valid``, ``revoked`` or ``expired``."""
        if self.revoked:
            return "revoked"
        return "valid" if datetime.fromisoformat(self.expires) > datetime.now(UTC) else "expired"


@dataclass(slots=True)
class MissionKeys:
    """Identities of a mission in a folder."""

    folder: Path
    profile: str
    robots: tuple[str, ...]
    clock: str
    hosts: tuple[str, ...] = ()
    certificates: list[Certificate] = field(default_factory=list)

    @classmethod
    def create(cls, folder: Path, profile: Profile, hosts: Sequence[str]) -> MissionKeys:
        """Create an authority and the identity of the ground; an existing folder adopts the profile.

        ``hosts`` are further names or addresses of the ground's router and HTTP server.
        """
        if (folder / _REGISTER).exists():
            keys = cls.read(folder)
            keys.profile, keys.robots, keys.clock = profile.name, profile.robot_ids, profile.clock
            has_new_hosts = not set(hosts) <= set(keys.hosts)
            keys.hosts = tuple(dict.fromkeys((*keys.hosts, *hosts)))
        else:
            make_folder(folder).chmod(0o700)
            keys = cls(folder, profile.name, profile.robot_ids, profile.clock, tuple(hosts))
            authority = Authority.create(f"CDFF {profile.name}", AUTHORITY_DAYS)
            make_folder(folder / _AUTHORITY_FOLDER).chmod(0o700)
            write_secret(folder / _AUTHORITY_FOLDER / _AUTHORITY_KEY, key_pem(authority.key))
            with storage_errors(folder):
                replace_file(folder / _AUTHORITY_FOLDER / AUTHORITY, pem(authority.certificate))
            has_new_hosts = True
        if has_new_hosts:
            keys.issue(GROUND, Kind.GROUND)
        keys.write()
        return keys

    @classmethod
    def read(cls, folder: Path) -> MissionKeys:
        """Return the identities in a folder; raises ConfigurationError."""
        path = folder / _REGISTER
        try:
            content = json.loads(path.read_text())
            content["certificates"] = [
                Certificate(**{**entry, "kind": Kind(entry["kind"])}) for entry in content["certificates"]
            ]
            content |= {"robots": tuple(content["robots"]), "hosts": tuple(content["hosts"])}
            return cls(folder, **content)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigurationError(
                f"{path}: {error}; expected the register of `cdff keys init`, or --folder with its folder"
            ) from error

    def add_robots(self, profile: Profile) -> None:
        """Adopt the robots of a further profile, which join the mission."""
        self.robots = tuple(dict.fromkeys((*self.robots, *profile.robot_ids)))
        self.write()

    def issue(
        self,
        name: str,
        kind: Kind,
        *,
        role: str = "",
        hosts: Sequence[str] = (),
        days: int = CERTIFICATE_DAYS,
    ) -> Certificate:
        """Issue a certificate, write its identity folder, and admit it.

        Earlier certificates of the name stay valid until they expire or are revoked.

        Raises
        ------
        InputError
            If the name does not fit the kind.
        """
        self._check_name(name, kind)
        serves = kind in (Kind.GROUND, Kind.ROBOT)
        own_hosts = (*_LOCAL, *self.hosts, *hosts) if kind is Kind.GROUND else (*_LOCAL, *hosts)
        number = sum(c.name == name for c in self.certificates) + 1
        folder = self.folder / _AUTHORITY_FOLDER
        issued = Authority.read(folder / AUTHORITY, folder / _AUTHORITY_KEY).issue(
            f"{name}.{number}", days, tuple(dict.fromkeys(own_hosts)) if serves else ()
        )
        self._write_identity(name, issued)
        certificate = Certificate(
            name,
            kind,
            role or _ROLES.get(kind, "operator"),
            f"{name}.{number}",
            datetime.now(UTC).isoformat(timespec="seconds"),
            issued.expires.isoformat(timespec="seconds"),
        )
        self.certificates.append(certificate)
        self.write()
        return certificate

    def revoke(self, name: str, *, previous: bool = False) -> list[Certificate]:
        """Revoke the valid certificates of a name, with ``previous`` all but the newest; return them.

        Raises
        ------
        InputError
            If there is none.
        """
        valid = [c for c in self.certificates if c.name == name and c.state == "valid"]
        revoked = valid[:-1] if previous else valid
        if not revoked:
            known = sorted({c.name for c in self.certificates if c.state == "valid"})
            missing = "earlier valid certificate" if previous else "valid certificate"
            raise InputError(f"{name[:80]!r} has no {missing}; there are ones of {', '.join(known)}")
        now = datetime.now(UTC).isoformat(timespec="seconds")
        self.certificates = [replace(c, revoked=now) if c in revoked else c for c in self.certificates]
        self.write()
        return revoked

    def members(self) -> list[Member]:
        """Return the identities with valid certificates; the newest certificate decides kind and role."""
        valid: dict[str, list[Certificate]] = {}
        for certificate in self.certificates:
            if certificate.state == "valid":
                valid.setdefault(certificate.name, []).append(certificate)
        return [
            Member(
                name, certificates[-1].kind, certificates[-1].role, tuple(c.common_name for c in certificates)
            )
            for name, certificates in valid.items()
        ]

    def write(self) -> None:
        """Write the register and the configuration of routers and HTTP server, which reread it."""
        members = self.members()
        http = {common_name: [m.name, m.role] for m in members for common_name in m.common_names}
        files = {
            _REGISTER: {k: v for k, v in asdict(self).items() if k != "folder"},
            f"{GROUND}/{ACCESS}": ground_list(members, self.clock),
            f"{GROUND}/{MEMBERS}": http,
            f"{GROUND}/{EXPIRY}": self._expiry(),
        }
        for member in members:
            if member.kind is Kind.ROBOT:
                files[f"{member.name}/{ACCESS}"] = robot_list(member.name, members, self.clock)
                files[f"{member.name}/{EXPIRY}"] = self._expiry()
        for name, content in files.items():
            path, data = self.folder / name, (json.dumps(content, indent=1) + "\n").encode()
            with storage_errors(path):
                if not path.exists() or path.read_bytes() != data:  # routers close their links on a change
                    replace_file(path, data)

    def to_list(self) -> list[dict[str, Any]]:
        """Return the certificates and their states as plain data."""
        return [asdict(c) | {"kind": str(c.kind), "state": c.state} for c in self.certificates]

    def _expiry(self) -> dict[str, tuple[str, str]]:
        """Return for each identity when its newest certificate expires, and from when on that is an alarm."""
        newest = {c.name: c for c in self.certificates if not c.revoked}
        times = {}
        for name, certificate in newest.items():
            issued, expires = (datetime.fromisoformat(t) for t in (certificate.issued, certificate.expires))
            warned_from = expires - min(_EXPIRY_WARNING, (expires - issued) / 5)
            times[name] = warned_from.isoformat(timespec="seconds"), certificate.expires
        return times

    def _write_identity(self, name: str, issued: Issued) -> None:
        folder = make_folder(self.folder / name)
        write_secret(folder / KEY, issued.key)
        with storage_errors(folder):
            folder.chmod(0o700)
            replace_file(folder / CERTIFICATE, issued.certificate)
            authority = (self.folder / _AUTHORITY_FOLDER / AUTHORITY).read_bytes()
            replace_file(folder / AUTHORITY, authority)

    def _check_name(self, name: str, kind: Kind) -> None:
        if not re.fullmatch(NAME, name) or name in (_AUTHORITY_FOLDER, ANY_ROBOT):
            raise InputError(
                f"name {name[:80]!r}: expected {NAME}, and neither {_AUTHORITY_FOLDER} nor {ANY_ROBOT}"
            )
        if (kind is Kind.ROBOT) != (name in self.robots) or (kind is Kind.GROUND) != (name == GROUND):
            raise InputError(
                f"{name} cannot be a {kind}: the profile {self.profile} has the robots "
                f"{', '.join(self.robots)}, and {GROUND} is the ground; `cdff keys robot ID --profile FILE` "
                "adds a robot of another profile, and `cdff keys init` adopts a new one"
            )
        for other in self.certificates:
            if other.name == name and other.kind is not kind and other.state == "valid":
                raise InputError(f"{name} is a {other.kind}; choose another name, or revoke it first")
