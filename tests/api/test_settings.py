from __future__ import annotations

from pathlib import Path

import pytest

from api.settings import InvalidSettings, Settings
from maps.errors import SurepathError


def test_defaults_are_safe():
    settings = Settings()
    assert settings.host == "127.0.0.1"
    assert settings.port == 8080
    assert settings.data_dir == Path.home() / ".surepath"
    assert settings.workers >= 1
    assert not settings.insecure


@pytest.mark.parametrize("host", ["127.0.0.1", "127.8.8.8", "localhost", "::1", "[::1]"])
def test_loopback_addresses_are_allowed(host):
    assert Settings(host=host).host == host


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "example.org", ""])
def test_other_addresses_need_a_word(host):
    with pytest.raises(InvalidSettings, match="--insecure"):
        Settings(host=host)
    assert Settings(host=host, insecure=True).host == host


def test_environment_sets_and_arguments_win(monkeypatch):
    monkeypatch.setenv("SUREPATH_PORT", "9000")
    monkeypatch.setenv("SUREPATH_MAX_LANDMARKS", "12")
    assert Settings().port == 9000
    assert Settings(port=1).port == 1
    assert Settings().limits["max_landmarks"]["value"] == 12


@pytest.mark.parametrize(
    ("name", "value"),
    [("port", "many"), ("port", 70000), ("workers", 0), ("max_deadline_s", -1), ("max_deadline_s", 90)],
)
def test_impossible_values_name_the_variable(name, value):
    with pytest.raises(InvalidSettings, match=f"SUREPATH_{name.upper()}"):
        Settings(**{name: value})
    assert issubclass(InvalidSettings, SurepathError)


def test_deadlines_must_fit_together():
    with pytest.raises(InvalidSettings, match="lower it"):
        Settings(default_deadline_s=5.0, max_deadline_s=1.0)


def test_every_field_is_described_and_limits_name_their_variable():
    assert all(info.description for info in Settings.model_fields.values())
    limits = Settings().limits
    assert limits["max_storage_bytes"] == {
        "value": 50 * 2**30,
        "setting": "SUREPATH_MAX_STORAGE_BYTES",
        "description": "Bytes of all maps, fields and plans on disk.",
    }
    assert "host" not in limits
