"""What commands share: arguments, exit codes, worlds and sensors by name or file, files written whole."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Annotated

import typer

from localization.errors import LocalizationError
from localization.heading_field import HeadingField
from localization.sensors import CRITERIA, PRESETS, Sensor
from localization.uncertainty_field import UncertaintyField
from maps.errors import MapFormatError
from maps.io.load import load_world
from maps.io.site import bundled_site, bundled_site_names
from maps.world import World

EXIT_MISTAKE = 1
EXIT_SERVICE = 2
EXIT_UNMET = 3

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
Sensor_ = Annotated[
    str,
    typer.Option(
        metavar="SENSOR",
        help="A preset (laser: 0.1°, 30 m; mas97: the paper's camera on its pan head; forward: the same "
        'camera, fixed) or a JSON file such as {"kind": "omnidirectional", "bearing_sigma_deg": 0.1, '
        '"max_range_m": 25, "muted": [{"begin_deg": 170, "end_deg": -170}]}, {"kind": "pinhole_pan", '
        '"fov_deg": 53.13, "focal_px": 512, "column_sigma_px": 5, "pan_min_deg": -90, "pan_max_deg": 90} or '
        '{"kind": "pinhole_fixed", "fov_deg": 90, "focal_px": 500, "column_sigma_px": 1}; every kind takes '
        'min_range_m, max_range_m, bearing_floor_deg and "mount": {"x_m": 0.2, "y_m": 0, "theta_deg": 0}.',
    ),
]
HEADING_HELP = (
    "Heading of the robot, for sensors that see otherwise when it turns: fixed cameras, limited pan heads, "
    "muted sectors, mounts off the robot's centre."
)
Criterion_ = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help=f"What makes a triplet better, one of {', '.join(CRITERIA)}: area or major axis of the "
        "95 % ellipse, or the sum of the position variances.",
    ),
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


def check_on_map(world: World, x: float, y: float) -> None:
    """Raise :class:`~localization.errors.LocalizationError` unless a place lies within the map's bounds."""
    if not (math.isfinite(x) and math.isfinite(y)):
        raise LocalizationError(f"Place is ({x:g}, {y:g}) m; give finite numbers.")
    x0, y0, x1, y1 = world.bounds
    if not (x0 <= x <= x1 and y0 <= y <= y1):
        raise LocalizationError(
            f"Place ({x:g}, {y:g}) m is outside the map, "
            f"which spans x {x0:g} … {x1:g} m, y {y0:g} … {y1:g} m."
        )


def read_field(path: Path) -> UncertaintyField | HeadingField:
    """Field from a file, at one heading or over headings.

    Raises
    ------
    FieldFormatError
        If there is none.
    """
    from localization.io.field_file import load_field  # noqa: PLC0415  (zarr loads only here)

    return load_field(path)


def write_file(path: Path, data: bytes) -> None:
    """Write a file so that its path holds the old or the new content, never a part.

    Raises
    ------
    MapFormatError
        If it cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        temporary.write_bytes(data)
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise MapFormatError(f"Could not write '{path}': {error.strerror or error}.") from error


def make_folder(path: Path) -> None:
    """Make a folder with its parents; it may be there already.

    Raises
    ------
    MapFormatError
        If it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise MapFormatError(f"Could not make the folder '{path}': {error.strerror or error}.") from error


def read_triplet(world: World, text: str) -> tuple[int, int, int]:
    """Indices of three landmarks named ``A,B,C``.

    Raises
    ------
    LocalizationError
        If they are not three different ids of the map.
    """
    names = [name.strip() for name in text.split(",")]
    known = world.landmarks.ids
    if len(names) != 3 or len(set(names)) != 3:
        raise LocalizationError(f"Triplet is '{text}'; give the ids of three different landmarks: A,B,C.")
    for name in names:
        if name not in known:
            some = ", ".join(known[:8]) + (", …" if len(known) > 8 else "")
            raise LocalizationError(f"There is no landmark '{name}' in '{world.name}'; it has {some}.")
    i, j, k = (known.index(name) for name in names)
    return i, j, k
