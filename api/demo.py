"""The demonstration: the main job on the bundled warehouse, through the REST API, start to end."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from api.console import print_plan, progress_bar
from maps.errors import SurepathError
from maps.io.site import bundled_site_text

SITE = "warehouse"
SENSOR: dict[str, Any] = {"kind": "omnidirectional", "bearing_sigma_deg": 0.1, "max_range_m": 30.0}
START = {"x_m": 6.2, "y_m": 18.0}
GOAL = {"x_m": 54.0, "y_m": 17.0}
START_TIMEOUT_S = 180.0


class DemoError(SurepathError):
    """The service of the demonstration did not do its part."""


class Client:
    """The few calls that the demonstration makes, with the standard library."""

    def __init__(self, base: str) -> None:
        self.base = base

    def call(self, method: str, path: str, body: Any = None, *, accept: str = "application/json") -> bytes:
        """Body of an answer.

        Raises
        ------
        DemoError
            If the service refuses, with its own words.
        """
        data = None if body is None else json.dumps(body).encode()
        headers = {"Accept": accept, "Content-Type": "application/json"}
        request = urllib.request.Request(self.base + path, data, headers, method=method)  # noqa: S310
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:  # noqa: S310
                return bytes(answer.read())
        except urllib.error.HTTPError as error:
            raise DemoError(f"{method} {path}: {error.code} {error.read().decode()[:500]}") from error
        except OSError as error:
            raise DemoError(f"{method} {path}: {error}") from error

    def json(self, method: str, path: str, body: Any = None) -> Any:
        """Decoded JSON answer; errors as :meth:`call`."""
        return json.loads(self.call(method, path, body))


def free_port() -> int:
    """A loopback port that nobody uses at the moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def running_service(folder: Path) -> Iterator[Client]:
    """A service of its own on a free loopback port, stopped at the end whatever happens.

    Raises
    ------
    DemoError
        If it ends or is not ready within 180 s; its last words are in the message.
    """
    port = free_port()
    command = [sys.executable, "-m", "api.cli", "serve", "--port", str(port), "--no-preload"]
    log = folder / "service.log"
    with log.open("wb") as sink:
        process = subprocess.Popen(  # noqa: S603
            [*command, "--data-dir", str(folder / "data")], stdout=sink, stderr=subprocess.STDOUT
        )
    client = Client(f"http://127.0.0.1:{port}")
    try:
        limit = time.monotonic() + START_TIMEOUT_S
        while True:
            try:
                client.call("GET", "/readyz")
                break
            except DemoError as error:
                if process.poll() is not None or time.monotonic() > limit:
                    words = log.read_text(errors="replace")[-2000:]
                    raise DemoError(f"The service did not start: {error}\n{words}") from error
            time.sleep(0.1)
        yield client
    finally:
        process.terminate()
        try:
            process.wait(timeout=30)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def run_demo(folder: Path, out: Console, err: Console) -> None:
    """Field, service, plan, pictures: written to a folder, told on the console.

    Raises
    ------
    DemoError
        If a step fails.
    """
    began = time.monotonic()
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="surepath-demo-") as scratch:
        with err.status("starting the service (the first start compiles the kernels) …"):
            service = running_service(Path(scratch))
            client = service.__enter__()
        try:
            out.print(f"service: {client.base}", highlight=False)
            _main_job(client, folder, out)
        finally:
            service.__exit__(None, None, None)
    out.print(f"done in {time.monotonic() - began:.0f} s", highlight=False)


def _main_job(client: Client, folder: Path, out: Console) -> None:
    site = client.json("POST", "/v1/maps", json.loads(bundled_site_text(SITE)))
    out.print(f"uploaded: {SITE} as map {site['map'][:14]}…", highlight=False)
    job = client.json("POST", "/v1/fields", {"map": site["map"], "resolution_m": 0.1, "sensor": SENSOR})
    field = job["field"]
    _wait(client, job)
    plan = client.json(
        "POST",
        "/v1/plans",
        {
            "field": field,
            "start": START,
            "goal": GOAL,
            "robot": {"radius_m": 0.35, "max_speed_m_s": 1.2, "max_accel_m_s2": 0.8},
            "objective": {"kind": "weighted", "uncertainty_weight_per_m": 4.0},
            "deadline_s": 5.0,
        },
    )
    print_plan(plan)
    for name, data in (
        ("heatmap.png", client.call("GET", f"/v1/fields/{field}/heatmap.png?width=1400", accept="image/png")),
        ("plan.png", client.call("GET", f"/v1/plans/{plan['plan']}/picture.png", accept="image/png")),
        ("plan.json", json.dumps(plan, indent=1).encode() + b"\n"),
    ):
        (folder / name).write_bytes(data)
        out.print(f"written: {folder / name}", highlight=False)


def _wait(client: Client, job: dict[str, Any]) -> None:
    if job.get("job") is None:
        return
    with progress_bar() as bar:
        task = bar.add_task(f"field of {SITE}", total=None)
        while True:
            state = client.json("GET", f"/v1/jobs/{job['job']}")
            tiles = state["tiles"]
            bar.update(task, completed=tiles["done"], total=tiles["total"] or None)
            if state["status"] == "successful":
                return
            if state["status"] in {"failed", "dismissed"}:
                raise DemoError(f"The field was not computed: {state.get('error') or state['status']}.")
            time.sleep(0.1)
