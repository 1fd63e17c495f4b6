"""The certificate authority of a security folder, and the certificates that it issues to agents (X.509, EC P-256).

A folder holds `ca.pem` and `ca.key`, `policy.json`, and in `agents/` for each agent `<name>.pem`, `<name>.key` and
`<name>.json5`. A certificate's common name is the agent's name. Keys can be read by their owner only.
"""

from __future__ import annotations

import contextlib
import ipaddress
import re
import secrets
from collections.abc import Iterable
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import NamedTuple

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from dsr.errors import ConfigError
from dsr.files.private_files import private_folder, replacing
from dsr.network.keys import check_name

AUTHORITY_DAYS = 3650
CERTIFICATE_DAYS = 365
LOCAL_HOSTS = ("localhost", "127.0.0.1", "::1")
_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.-]{0,251}[A-Za-z0-9])?")
_CLOCK_SKEW = timedelta(minutes=5)
"""A certificate is valid from this long before it is issued: the clocks of other machines may be behind."""


class Lifetime(NamedTuple):
    """The time until an agent's certificates end."""

    serial: int
    """Serial number of the certificate."""
    file: Path
    """The certificate that ends first: the agent's own, or that of the authority."""
    ends: float
    """Time when the certificate ends, s since the Unix epoch."""


class SecurityFolder:
    """A security folder; makes and checks certificates in it."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.authority = path / "ca.pem"
        self.authority_key = path / "ca.key"
        self.policy = path / "policy.json"
        self.agents = path / "agents"

    def certificate(self, agent: str) -> Path:
        """The certificate of `agent`."""
        return self.agents / f"{check_name('agent name', agent)}.pem"

    def key(self, agent: str) -> Path:
        """The private key of `agent`."""
        return self.agents / f"{check_name('agent name', agent)}.key"

    def configuration(self, agent: str) -> Path:
        """The Zenoh configuration of `agent`."""
        return self.agents / f"{check_name('agent name', agent)}.json5"

    def create(self, now: float) -> None:
        """Make the folder with a new authority. Raises `ConfigError` if there is something already."""
        if self.path.exists() and any(self.path.iterdir()):
            raise ConfigError(f"{self.path} is not empty; name a new folder, or add agents with: dsr security add")
        private_folder(self.path)
        private_folder(self.agents)
        key = ec.generate_private_key(ec.SECP256R1())
        name = _name(f"dsr authority {secrets.token_hex(4)}")
        builder = _builder(name, name, key.public_key(), now, AUTHORITY_DAYS)
        builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        _write_key(self.authority_key, key)
        _write_certificate(self.authority, builder.sign(key, hashes.SHA256()))

    def issue(self, agent: str, now: float, *, days: float = CERTIFICATE_DAYS, hosts: Iterable[str] = ()) -> None:
        """Make a key and a certificate for `agent`, in place of those it had; raises `ConfigError`.

        Args:
            agent: becomes the common name.
            now: s since the Unix epoch.
            days: of validity.
            hosts: names and addresses at which it may be reached, besides this machine's own.
        """
        subject = _name(check_name("agent name", agent))
        names = host_names(hosts)
        authority = _read_certificate(self.authority)
        authority_key = _read_key(self.authority_key, "it is needed to issue certificates")
        key = ec.generate_private_key(ec.SECP256R1())
        builder = _builder(subject, authority.subject, key.public_key(), now, days)
        builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        usages = [ExtendedKeyUsageOID.CLIENT_AUTH, ExtendedKeyUsageOID.SERVER_AUTH]
        builder = builder.add_extension(x509.ExtendedKeyUsage(usages), critical=False)
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
        _write_key(self.key(agent), key)
        _write_certificate(self.certificate(agent), builder.sign(authority_key, hashes.SHA256()))

    def expiry(self, agent: str) -> datetime:
        """Until when the certificate of `agent` is valid. Raises `ConfigError` if there is none."""
        return _read_certificate(self.certificate(agent)).not_valid_after_utc

    def lifetime(self, agent: str) -> Lifetime:
        """Read the lifetime of this agent. Raises `ConfigError` if the agent or the authority has no certificate."""
        authority, own = _read_certificate(self.authority), _read_certificate(self.certificate(agent))
        ends = {self.authority: authority.not_valid_after_utc, self.certificate(agent): own.not_valid_after_utc}
        first = min(ends, key=lambda file: ends[file])
        return Lifetime(own.serial_number, first, ends[first].timestamp())

    def check(self, agent: str, now: float) -> None:
        """Raise `ConfigError` unless `agent` has a key and a valid certificate of this folder's authority."""
        authority, file = _read_certificate(self.authority), self.certificate(agent)
        certificate = _read_certificate(file)
        try:
            certificate.verify_directly_issued_by(authority)
        except (InvalidSignature, ValueError, TypeError) as error:
            raise ConfigError(f"{file} was issued by another authority than {self.authority}") from error
        for owner, checked in ((self.authority, authority), (file, certificate)):
            _check_validity(owner, checked, datetime.fromtimestamp(now, UTC))
        if certificate.subject != _name(agent):
            raise ConfigError(f"{file} is a certificate of {certificate.subject.rfc4514_string()}, not of CN={agent}")
        key = _read_key(self.key(agent), f"it is the key of agent {agent!r}")
        if key.public_key() != certificate.public_key():
            raise ConfigError(f"{self.key(agent)} is not the key of {file}")


def host_names(hosts: Iterable[str]) -> list[x509.GeneralName]:
    """This machine's own names and `hosts`, as a certificate holds them. Raises `ConfigError`."""
    return [_host(host) for host in (*LOCAL_HOSTS, *hosts)]


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, now: float, days: float
) -> x509.CertificateBuilder:
    begin = datetime.fromtimestamp(now, UTC)
    return x509.CertificateBuilder(
        issuer_name=issuer,
        subject_name=subject,
        public_key=key,
        serial_number=x509.random_serial_number(),
        not_valid_before=begin - _CLOCK_SKEW,
        not_valid_after=begin + timedelta(days=days),
    )


def _host(host: str) -> x509.GeneralName:
    with contextlib.suppress(ValueError):
        return x509.IPAddress(ipaddress.ip_address(host))
    if not _HOST.fullmatch(host):
        raise ConfigError(f"host {host!r}: expected an address or a name of ASCII letters, digits, '-' and '.'")
    return x509.DNSName(host)


def _write_key(file: Path, key: ec.EllipticCurvePrivateKey) -> None:
    """Write `key` to a new file that nobody else can read at any moment."""
    pem = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    with replacing(file) as target:
        target.write(pem)


def _read_key(file: Path, advice: str) -> ec.EllipticCurvePrivateKey:
    try:
        key = serialization.load_pem_private_key(file.read_bytes(), password=None)
    except (OSError, ValueError, TypeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "no private key in PEM"
        raise ConfigError(f"{file} cannot be read ({reason}); {advice}") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise ConfigError(f"{file}: expected an elliptic curve key; {advice}")
    return key


def _write_certificate(file: Path, certificate: x509.Certificate) -> None:
    file.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))


def _read_certificate(file: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(file.read_bytes())
    except (OSError, ValueError) as error:
        raise ConfigError(f"{file} cannot be used as a certificate ({error})") from error


def _check_validity(file: Path, certificate: x509.Certificate, now: datetime) -> None:
    begin, end = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if now > end:
        raise ConfigError(f"{file} expired on {end:%Y-%m-%d %H:%M} UTC; renew it: dsr security add --renew")
    if now < begin:
        raise ConfigError(f"{file} is valid only from {begin:%Y-%m-%d %H:%M} UTC on; is this machine's clock right?")
