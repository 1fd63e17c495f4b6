"""Certificates: who issued them, for whom, until when; keys that nobody else can read."""

from __future__ import annotations

import shutil
import stat
from pathlib import Path

import pytest
from cryptography import x509

from dsr.clock import WALL_CLOCK
from dsr.errors import ConfigError
from dsr.security.authority import SecurityFolder
from tests.dsr.security.conftest import DAY, make_folder


def test_a_certificate_names_its_agent_and_its_hosts(own_keys: SecurityFolder) -> None:
    own_keys.issue("arm", WALL_CLOCK.now(), hosts=["robot.local", "10.0.0.7"])
    certificate = x509.load_pem_x509_certificate(own_keys.certificate("arm").read_bytes())
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert certificate.subject.rfc4514_string() == "CN=arm"
    assert {"robot.local", "localhost"} <= set(names.get_values_for_type(x509.DNSName))
    assert {"10.0.0.7", "127.0.0.1"} <= {str(ip) for ip in names.get_values_for_type(x509.IPAddress)}
    own_keys.check("arm", WALL_CLOCK.now())


def test_only_the_owner_can_read_keys(keys: SecurityFolder) -> None:
    for file in keys.path.rglob("*.key"):
        assert stat.S_IMODE(file.stat().st_mode) == 0o600, file
    assert stat.S_IMODE(keys.path.stat().st_mode) == stat.S_IMODE(keys.agents.stat().st_mode) == 0o700


def test_a_certificate_expires(keys: SecurityFolder) -> None:
    keys.check("arm", WALL_CLOCK.now() + 364 * DAY)
    with pytest.raises(ConfigError, match=r"arm\.pem expired on 20.*--renew"):
        keys.check("arm", WALL_CLOCK.now() + 366 * DAY)
    with pytest.raises(ConfigError, match="clock"):
        keys.check("arm", WALL_CLOCK.now() - DAY)


def test_an_authority_expires(own_keys: SecurityFolder) -> None:
    own_keys.issue("arm", WALL_CLOCK.now(), days=5000)
    with pytest.raises(ConfigError, match=r"ca\.pem expired"):
        own_keys.check("arm", WALL_CLOCK.now() + 4000 * DAY)


def test_a_certificate_of_another_authority_is_told_apart(own_keys: SecurityFolder, tmp_path: Path) -> None:
    """Also if the other one has the same name."""
    other = make_folder(tmp_path / "elsewhere" / "own_keys")
    shutil.copy(other.certificate("arm"), own_keys.certificate("arm"))
    with pytest.raises(ConfigError, match="another authority"):
        own_keys.check("arm", WALL_CLOCK.now())


def test_a_key_that_does_not_go_with_its_certificate_is_told(own_keys: SecurityFolder) -> None:
    shutil.copy(own_keys.key("scene"), own_keys.key("arm"))
    with pytest.raises(ConfigError, match=r"arm\.key is not the key of .*arm\.pem"):
        own_keys.check("arm", WALL_CLOCK.now())
    own_keys.key("arm").write_text("no key")
    with pytest.raises(ConfigError, match=r"arm\.key cannot be read \(no private key in PEM\)"):
        own_keys.check("arm", WALL_CLOCK.now())


def test_a_certificate_of_another_agent_is_told_apart(own_keys: SecurityFolder) -> None:
    shutil.copy(own_keys.certificate("scene"), own_keys.certificate("arm"))
    with pytest.raises(ConfigError, match="CN=scene, not of CN=arm"):
        own_keys.check("arm", WALL_CLOCK.now())


def test_files_that_are_missing_or_broken_are_named(own_keys: SecurityFolder) -> None:
    own_keys.key("arm").unlink()
    with pytest.raises(ConfigError, match=r"arm\.key cannot be read"):
        own_keys.check("arm", WALL_CLOCK.now())
    own_keys.certificate("arm").write_text("no certificate")
    with pytest.raises(ConfigError, match=r"arm\.pem cannot be used"):
        own_keys.check("arm", WALL_CLOCK.now())
    own_keys.authority_key.unlink()
    with pytest.raises(ConfigError, match=r"ca\.key cannot be read"):
        own_keys.issue("arm", WALL_CLOCK.now())


def test_an_existing_folder_is_left_alone(keys: SecurityFolder) -> None:
    before = keys.authority.read_bytes()
    with pytest.raises(ConfigError, match="not empty"):
        keys.create(WALL_CLOCK.now())
    assert keys.authority.read_bytes() == before


@pytest.mark.parametrize("name", ["../evil", "a/b", "", "..", "a*"])
def test_names_never_leave_the_folder(own_keys: SecurityFolder, name: str) -> None:
    with pytest.raises(ConfigError, match="agent name"):
        own_keys.issue(name, WALL_CLOCK.now())


@pytest.mark.parametrize("host", ["bäd.example", "", "a b"])
def test_hosts_that_cannot_be_in_a_certificate_are_refused(own_keys: SecurityFolder, host: str) -> None:
    with pytest.raises(ConfigError, match="host"):
        own_keys.issue("arm", WALL_CLOCK.now(), hosts=[host])
