"""The service about itself."""

from __future__ import annotations

from api import answers_status
from api.store_records import StoreUnavailable


def test_alive_and_ready(client):
    assert client.get("/healthz").json()["status"] == "ok"
    ready = client.get("/readyz")
    assert ready.status_code == 200
    answers_status.Alive.model_validate(ready.json())


def test_not_ready_says_what_is_missing(client, monkeypatch):
    service = client.app.state.service
    monkeypatch.setattr(service.pool, "ready", False, raising=False)
    answer = client.get("/readyz")
    assert answer.status_code == 503
    assert answer.json() == {"status": "not_ready", "checks": {"store": True, "workers": False}}

    def broken():
        raise StoreUnavailable("no disk")

    monkeypatch.setattr(service.store, "check", broken)
    assert client.get("/readyz").json()["checks"]["store"] is False


def test_status_shows_every_limit_with_its_setting(client, field):
    status = client.get("/v1/status").json()
    answers_status.Status.model_validate(status)
    assert (status["maps"], status["fields"]) == (1, 1)
    assert status["limits"]["max_body_bytes"]["value"] == 100_000
    for limit in status["limits"].values():
        assert limit["setting"].startswith("SUREPATH_")


def test_colormaps(client):
    answer = client.get("/v1/colormaps").json()
    answers_status.ColorMaps.model_validate(answer)
    assert "viridis" in answer["colormaps"]
    assert answer["metrics"]["area95_m2"]["unit"] == "m²"
