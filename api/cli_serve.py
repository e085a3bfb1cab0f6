"""``surepath serve`` and ``surepath demo``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from api.console import err, out


def serve(
    host: Annotated[
        str | None, typer.Option(help="Address to listen on; default SUREPATH_HOST or 127.0.0.1.")
    ] = None,
    port: Annotated[
        int | None, typer.Option(help="Port to listen on; default SUREPATH_PORT or 8080.")
    ] = None,
    data_dir: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where maps and fields are kept; default SUREPATH_DATA_DIR."),
    ] = None,
    preload: Annotated[
        bool | None, typer.Option("--preload/--no-preload", help="Put the warehouse into an empty store.")
    ] = None,
    insecure: Annotated[
        bool | None,
        typer.Option("--insecure", help="Allow an address that other machines reach, without keys."),
    ] = None,
) -> None:
    """Run the service: REST API, documentation page, worker processes. Stop it with Ctrl-C.

    What is not given is read from the environment (SUREPATH_…); GET /v1/status shows every setting.
    """
    from api.app import serve as run  # noqa: PLC0415
    from api.settings import Settings  # noqa: PLC0415

    given: dict[str, Any] = {
        "host": host,
        "port": port,
        "preload": preload,
        "insecure": insecure,
        "data_dir": data_dir,
    }
    run(Settings(**{name: value for name, value in given.items() if value is not None}))


def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")
    ] = Path("out"),
) -> None:
    """Show the main job on the bundled warehouse: field, service, plan, pictures. Ends by itself."""
    from api.demo import run_demo  # noqa: PLC0415

    run_demo(output, out, err)
