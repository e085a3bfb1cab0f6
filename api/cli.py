"""The ``surepath`` command."""

from __future__ import annotations

import json
import math
import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table
from typer.exceptions import TyperException

from api.colormaps import COLORMAPS
from api.console import err, field_table, out, print_plan, progress_bar
from localization.sensors import PRESETS, Sensor
from localization.uncertainty_field import METRICS
from maps.errors import MapFormatError, SurepathError
from maps.io.load import load_world
from maps.io.site import bundled_site, bundled_site_names
from maps.world import World

EXIT_MISTAKE = 1
EXIT_SERVICE = 2
EXIT_UNMET = 3

app = typer.Typer(
    name="surepath",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    help=(
        "Paths for mobile robots that know how well the robot will know where it is.\n\n"
        "[bold]In three steps:[/bold]\n\n"
        "  surepath field warehouse --sensor laser -o warehouse.zarr\n\n"
        "  surepath heatmap warehouse.zarr -o heatmap.png\n\n"
        "  surepath plan warehouse.zarr --start 6.2 18 --goal 54 17 --radius 0.35 -o plan.json\n\n"
        "Exit codes: 0 done, 1 wrong input, 2 service problem, "
        "3 a plan that misses its bound or finds no way."
    ),
)
world_app = typer.Typer(no_args_is_help=True, help="Look at maps before they are used.")
app.add_typer(world_app, name="world")

WORLD_HELP = (
    "A world.geojson, a ROS map_server map.yaml, a folder of a site, or the name of a bundled site "
    "(mas97_room, warehouse)."
)
World_ = Annotated[str, typer.Argument(metavar="WORLD", help=WORLD_HELP, show_default=False)]
Landmarks_ = Annotated[
    Path | None,
    typer.Option("--landmarks", metavar="FILE", help="Landmarks as GeoJSON, CSV (id,x,y,…) or YAML, in m."),
]
UnknownFree_ = Annotated[bool, typer.Option("--unknown-is-free", help="Let robots drive on unknown cells.")]
UnknownOpaque_ = Annotated[
    bool, typer.Option("--unknown-is-opaque", help="Let unknown cells stop lines of sight.")
]
Field_ = Annotated[Path, typer.Argument(metavar="FIELD.zarr", help="A field made by 'surepath field'.")]


def read_world(
    source: str,
    landmarks: Path | None = None,
    *,
    unknown_is_free: bool = False,
    unknown_is_opaque: bool = False,
) -> World:
    """World from a path or the name of a bundled site.

    Raises
    ------
    MapFormatError
        If there is neither a file nor a site of that name.
    """
    if source in bundled_site_names() and not Path(source).exists():
        if landmarks is not None:
            raise MapFormatError(f"The bundled site '{source}' has its own landmarks; leave --landmarks out.")
        return bundled_site(source)
    if not Path(source).exists():
        raise MapFormatError(
            f"There is no map at '{source}'; give a file, a folder, or one of the bundled sites "
            f"{', '.join(bundled_site_names())}."
        )
    return load_world(
        Path(source),
        landmarks=landmarks,
        unknown_is_free=unknown_is_free,
        unknown_is_opaque=unknown_is_opaque,
    )


def read_sensor(source: str) -> Sensor:
    """Sensor from a preset's name or a JSON file.

    Raises
    ------
    InvalidSensor
        If it is neither, or a number is impossible.
    """
    from api.codec import read_json_file, sensor_from_json  # noqa: PLC0415  (pydantic loads only here)

    if source in PRESETS:
        return PRESETS[source]
    return sensor_from_json(read_json_file(source, what=f"sensor (or preset: {', '.join(PRESETS)})"))


@world_app.command("check")
def world_check(
    world: World_,
    landmarks: Landmarks_ = None,
    unknown_is_free: UnknownFree_ = False,
    unknown_is_opaque: UnknownOpaque_ = False,
    picture: Annotated[Path | None, typer.Option(metavar="PNG", help="Draw floor and landmarks.")] = None,
) -> None:
    """Load a map and say what it holds and what will cause trouble.

    Exit code 1 when the map cannot be used.
    """
    from maps.check import check_world  # noqa: PLC0415

    loaded = read_world(
        world, landmarks, unknown_is_free=unknown_is_free, unknown_is_opaque=unknown_is_opaque
    )
    report = check_world(loaded)
    table = Table(show_header=False, box=None)
    for name, value in report.figures.items():
        table.add_row(name, value)
    out.print(table)
    for finding in report.findings:
        color = {"error": "red", "warning": "yellow"}.get(finding.severity, "cyan")
        out.print(f"[{color}]{finding.severity}[/{color}] {finding.code}: {finding.message}", highlight=False)
    if picture is not None:
        from api.render import map_png  # noqa: PLC0415

        _write(picture, map_png(loaded))
    if any(f.severity == "error" for f in report.findings):
        raise typer.Exit(EXIT_MISTAKE)


@app.command()
def field(
    world: World_,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="FIELD.zarr", help="Folder to write.")],
    landmarks: Landmarks_ = None,
    sensor: Annotated[
        str,
        typer.Option(
            metavar="SENSOR",
            help="A preset (laser: 0.1°, 30 m; mas97: the paper's camera) or a JSON file such as "
            '{"kind": "omnidirectional", "bearing_sigma_deg": 0.1, "max_range_m": 25} or '
            '{"kind": "pinhole_pan", "fov_deg": 53.13, "focal_px": 512, "column_sigma_px": 5}.',
        ),
    ] = "laser",
    resolution: Annotated[float, typer.Option(metavar="M", help="Side of a cell, m.")] = 0.1,
    heading_deg: Annotated[
        float, typer.Option(metavar="DEG", help="Heading of the robot; matters for limited pan heads only.")
    ] = 0.0,
    unknown_is_free: UnknownFree_ = False,
    unknown_is_opaque: UnknownOpaque_ = False,
    threads: Annotated[int | None, typer.Option(help="Threads; default: one per core.")] = None,
) -> None:
    """Compute the sensory uncertainty field of a map.

    For every free cell: the best visible landmark triplet, the covariance of the fix that it gives and
    the area of its 95 % ellipse. The result is a zarr group that xarray opens; it carries map and
    sensor, so that plans need nothing else.
    """
    from localization.field_builder import build_field  # noqa: PLC0415
    from localization.io.field_file import check_target, save_field  # noqa: PLC0415

    chosen = read_sensor(sensor)
    loaded = read_world(
        world, landmarks, unknown_is_free=unknown_is_free, unknown_is_opaque=unknown_is_opaque
    )
    check_target(output)
    with progress_bar() as bar:
        task = bar.add_task(f"field of {loaded.name}", total=None)
        built = build_field(
            loaded,
            chosen,
            resolution=resolution,
            heading=math.radians(heading_deg),
            threads=threads,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
        )
    save_field(built, output)
    out.print(field_table(built))
    out.print(f"written: {output}", highlight=False)


@app.command()
def heatmap(
    field_path: Field_,
    output: Annotated[Path, typer.Option("-o", "--output", metavar="PNG", help="Picture to write.")],
    metric: Annotated[str, typer.Option(help=f"One of {', '.join(METRICS)}.")] = "area95_m2",
    width: Annotated[int | None, typer.Option(metavar="PX", help="Width of the picture.")] = None,
    height: Annotated[int | None, typer.Option(metavar="PX", help="Height of the picture.")] = None,
    window: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(metavar="X0 Y0 X1 Y1", help="Part of the map to show, m."),
    ] = None,
    limits: Annotated[
        tuple[float, float] | None, typer.Option("--range", metavar="MIN MAX", help="Ends of the colours.")
    ] = None,
    scale: Annotated[str, typer.Option(help="log or linear.")] = "log",
    colormap: Annotated[str, typer.Option(help=f"One of {', '.join(COLORMAPS)}.")] = "viridis",
    legend: Annotated[bool, typer.Option(help="Colour bar at the right.")] = True,
) -> None:
    """Draw a field. Hatched: free cells where fewer than three landmarks are seen together."""
    from api.render import heatmap_png  # noqa: PLC0415
    from localization.io.field_file import load_field  # noqa: PLC0415

    png = heatmap_png(
        load_field(field_path),
        metric=metric,
        width=width,
        height=height,
        bbox=window,
        vmin=limits[0] if limits else None,
        vmax=limits[1] if limits else None,
        scale=scale,
        colormap=colormap,
        legend=legend,
    )
    _write(output, png)
    out.print(f"written: {output}", highlight=False)


@app.command()
def plan(
    field_path: Field_,
    start: Annotated[tuple[float, float], typer.Option(metavar="X Y", help="Start, m.")],
    goal: Annotated[tuple[float, float], typer.Option(metavar="X Y", help="Goal, m.")],
    radius: Annotated[float, typer.Option(metavar="R", help="Radius of the robot, m.")] = 0.35,
    objective: Annotated[
        str, typer.Option(help="shortest, or weighted: cost per metre 1 + weight · r95.")
    ] = "weighted",
    weight: Annotated[
        float, typer.Option(metavar="W", help="Extra metres accepted per metre driven at r95 = 1 m.")
    ] = 4.0,
    max_r95: Annotated[
        float | None, typer.Option("--max-r95", metavar="B", help="Never less certain than this, m.")
    ] = None,
    blind_r95: Annotated[
        float | None,
        typer.Option(
            "--blind-r95",
            metavar="B",
            help="Allow cells without a fix, at the cost of a place with this r95, m. Default: forbidden.",
        ),
    ] = None,
    max_speed: Annotated[float, typer.Option("--max-speed", metavar="V", help="m/s.")] = 1.2,
    max_accel: Annotated[float, typer.Option("--max-accel", metavar="A", help="m/s².")] = 0.8,
    deadline: Annotated[float, typer.Option(metavar="S", help="Time for the whole plan, s.")] = 2.0,
    seed: Annotated[int, typer.Option(metavar="N", help="Same seed, same answer.")] = 0,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="JSON", help="Write the answer of POST /v1/plans; - prints it."
        ),
    ] = None,
    picture: Annotated[
        Path | None, typer.Option(metavar="PNG", help="Draw map, field, both routes and ellipses.")
    ] = None,
) -> None:
    """Plan a path through a field: the one on which the robot knows where it is.

    Exit code 3 when no path keeps the bound (the best effort is written all the same).
    """
    from api.codec import plan_to_json  # noqa: PLC0415
    from localization.io.field_file import load_field  # noqa: PLC0415
    from planner.context import PlanningContext  # noqa: PLC0415
    from planner.plan import plan as make_plan  # noqa: PLC0415
    from planner.plan import warm_up  # noqa: PLC0415
    from planner.problem import PlanningProblem  # noqa: PLC0415

    problem = PlanningProblem(
        start=start,
        goal=goal,
        radius=radius,
        objective=objective,  # type: ignore[arg-type]  # checked by the problem itself
        weight=weight,
        max_r95=max_r95,
        blind_r95=blind_r95,
        max_speed=max_speed,
        max_accel=max_accel,
        deadline=deadline,
        seed=seed,
    )
    loaded = load_field(field_path)
    with err.status("preparing …"):
        warm_up()  # compiling is not planning: the deadline starts afterwards
        context = PlanningContext(loaded)
    result = make_plan(problem, context)
    answer = plan_to_json(result, loaded, problem=problem)
    to_stdout = output is not None and str(output) == "-"
    if output is not None:
        text = json.dumps(answer, indent=1, allow_nan=False) + "\n"
        sys.stdout.write(text) if to_stdout else _write(output, text.encode())
    if picture is not None:
        from api.plan_picture import plan_png  # noqa: PLC0415

        _write(picture, plan_png(loaded, answer))
    if not to_stdout:
        print_plan(answer)
    if answer["status"] not in {"exact", "approximate"}:
        raise typer.Exit(EXIT_UNMET)


@app.command()
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


@app.command()
def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the results.")
    ] = Path("out"),
) -> None:
    """Show the main job on the bundled warehouse: field, service, plan, pictures. Ends by itself."""
    from api.demo import run_demo  # noqa: PLC0415

    run_demo(output, out, err)


@app.command()
def validate(
    logs: Annotated[Path, typer.Argument(metavar="FOLDER", help="With mrclam/ and roh/ as published.")],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="MD", help="Document to write.")],
) -> None:
    """Hold the model against real logs: calibration, ellipses, choice of triplets, filter."""
    from localization.io.real_logs import read_real_logs  # noqa: PLC0415
    from localization.validation_report import validation_report  # noqa: PLC0415

    with err.status("measuring …"):
        text = validation_report(read_real_logs(logs))
    _write(output, text.encode())
    out.print(f"written: {output}", highlight=False)


def _write(path: Path, data: bytes) -> None:
    """Write a file so that its path holds the old or the new content, never a part."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise MapFormatError(f"Could not write '{path}': {error.strerror or error}.") from error


def main(arguments: list[str] | None = None) -> None:
    """Entry point: runs a command and turns mistakes into one line and an exit code."""
    try:
        code = app(arguments, standalone_mode=False)
    except SurepathError as error:
        err.print(f"[red]error[/red] {error}", highlight=False, soft_wrap=True)
        code = EXIT_MISTAKE
    except TyperException as error:
        err.print(f"[red]error[/red] {error.format_message()} See 'surepath --help'.", highlight=False)
        code = EXIT_MISTAKE
    except (typer.Abort, KeyboardInterrupt):
        err.print("stopped")
        code = 130
    sys.exit(code or 0)


if __name__ == "__main__":
    main()
