"""``surepath calibrate``: the sensor model of a log of measurements with reference poses."""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import typer
from rich.table import Table

from api.cli_common import write_file
from api.console import err, out
from localization.calibration import BearingCalibration, Interval, calibrate_bearings
from localization.camera import Camera
from localization.errors import InvalidSensor, LocalizationError
from localization.io.sightings_csv import BLOCK_S, SightingsFile, read_sightings
from localization.logs import MAX_GAP_S, Sighting, residuals
from localization.residual_bins import ResidualBin
from localization.robust import GATE_SIGMAS, MAD_TO_SIGMA
from localization.sensors import Mount, Sensor
from maps.io.landmark_files import read_landmarks
from maps.landmarks import LandmarkSet

_KINDS = ("omnidirectional", "pinhole_pan", "pinhole_fixed")


def calibrate(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG.csv",
            help="Measurements: t_s, landmark, bearing_deg (or bearing_rad, column_px) and, if wanted, "
            "pan_deg, range_m; with x_m, y_m, theta_deg of the robot, unless --poses has them.",
            show_default=False,
        ),
    ],
    landmarks: Annotated[
        Path,
        typer.Option(
            "--landmarks", metavar="FILE", help="Landmarks as GeoJSON, CSV (id,x,y,…) or YAML, in m."
        ),
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="JSON", help="Sensor file for --sensor.")],
    poses: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="Reference poses of the robot: t_s, x_m, y_m, theta_deg."),
    ] = None,
    kind: Annotated[
        str, typer.Option(metavar="KIND", help=f"One of {', '.join(_KINDS)}.")
    ] = "omnidirectional",
    fov_deg: Annotated[float | None, typer.Option(metavar="DEG", help="Opening angle of a camera.")] = None,
    focal_px: Annotated[float | None, typer.Option(metavar="PX", help="Focal length of a camera.")] = None,
    principal_px: Annotated[
        float | None, typer.Option(metavar="PX", help="Column of its axis; default: the middle of the image.")
    ] = None,
    mount_x_m: Annotated[float, typer.Option(metavar="M", help="Sensor ahead of the robot's centre.")] = 0.0,
    mount_y_m: Annotated[float, typer.Option(metavar="M", help="Sensor left of the robot's centre.")] = 0.0,
    mount_theta_deg: Annotated[
        float, typer.Option(metavar="DEG", help="Its zero off the robot's heading.")
    ] = 0.0,
    block_s: Annotated[
        float, typer.Option(metavar="S", help="Stretches of this length count as independent.")
    ] = BLOCK_S,
    max_gap_s: Annotated[
        float, typer.Option(metavar="S", help="Poses further apart are not interpolated.")
    ] = MAX_GAP_S,
    landmarks_output: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="Write the landmarks with the range term in their sigma_m."),
    ] = None,
    seed: Annotated[int, typer.Option(metavar="N", min=0, help="Same seed, same intervals.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, nothing else.")] = False,
) -> None:
    """Calibrate a sensor from measurements of known landmarks at known poses, and write its sensor file.

    Prints bias, sigma and floor with 95 % intervals, and what depends on range and bearing. Outliers and
    misread landmarks are left out and counted. The bias is not part of a sensor: take it off the bearings.
    """
    mount = Mount(mount_x_m, mount_y_m, math.radians(mount_theta_deg))
    camera = _camera(kind, fov_deg, focal_px, principal_px)
    known = read_landmarks(landmarks)
    with err.status("calibrating …"):
        read = read_sightings(
            log, known, poses=poses, camera=camera, mount=mount, block_s=block_s, max_gap=max_gap_s
        )
        found = calibrate_bearings(read.log, rng=np.random.default_rng(seed), camera=camera is not None)
    sensor = _sensor(found, kind, fov_deg, focal_px, mount)
    from api.codec import sensor_to_json  # noqa: PLC0415  (pydantic loads only here)

    write_file(output, (json.dumps(sensor_to_json(sensor), indent=1, allow_nan=False) + "\n").encode())
    if landmarks_output is not None:
        write_file(landmarks_output, _landmarks_csv(found.landmarks(known)))
    if as_json:
        document = calibration_to_json(read, found) | {"sensor": sensor_to_json(sensor)}
        sys.stdout.write(json.dumps(document, indent=1, allow_nan=False) + "\n")
        return
    out.print(_figures(read, found, camera=camera is not None))
    for title, bins, unit, scale in (
        ("distance, m", found.by_range, "{:g}", 1.0),
        (
            "bearing, °" if camera is None else "off the axis, °",
            found.by_bearing,
            "{:.0f}",
            math.degrees(1.0),
        ),
    ):
        out.print(_dependence(title, bins, unit, scale))
    out.print(f"written: {output}", highlight=False)


def _camera(
    kind: str, fov_deg: float | None, focal_px: float | None, principal_px: float | None
) -> Camera | None:
    """The camera of the two kinds that have one."""
    if kind not in _KINDS:
        raise LocalizationError(f"Unknown kind '{kind}'; use one of {', '.join(_KINDS)}.")
    given = {"--fov-deg": fov_deg, "--focal-px": focal_px, "--principal-px": principal_px}
    if kind == "omnidirectional":
        extra = [name for name, value in given.items() if value is not None]
        if extra:
            raise LocalizationError(
                f"An omnidirectional sensor has no {extra[0]}; leave it out, or give --kind."
            )
        return None
    if fov_deg is None or focal_px is None:
        raise LocalizationError(f"A sensor of kind '{kind}' needs --fov-deg and --focal-px.")
    if not 0 < fov_deg < 180:
        raise InvalidSensor(f"Sensor fov_deg is {fov_deg}; it must be positive and below 180°.")
    width = 2 * focal_px * math.tan(0.5 * math.radians(fov_deg))
    return Camera(focal_px, 0.5 * width if principal_px is None else principal_px, width)


def _sensor(
    found: BearingCalibration, kind: str, fov_deg: float | None, focal_px: float | None, mount: Mount
) -> Sensor:
    if fov_deg is None or focal_px is None:
        return found.scanner(mount=mount)
    which: Literal["pinhole_pan", "pinhole_fixed"] = (
        "pinhole_pan" if kind == "pinhole_pan" else "pinhole_fixed"
    )
    return found.camera(field_of_view=math.radians(fov_deg), focal_px=focal_px, kind=which, mount=mount)


def calibration_to_json(read: SightingsFile, found: BearingCalibration) -> dict[str, Any]:
    """A calibration in figures, SI; null where a number is not defined."""
    return {
        "n_measurements": len(read.log.time),
        "n_used": found.n_used,
        "n_outliers": found.n_outliers,
        "n_misread": read.log.count(Sighting.MISREAD),
        "n_without_reference": read.log.count(Sighting.NO_REFERENCE),
        "n_blocks": _n_blocks(read),
        "bias_rad": _interval_json(found.bias),
        "sigma_rad": _interval_json(found.sigma),
        "column_sigma_rad": _interval_json(found.column_sigma),
        "floor_rad": _interval_json(found.floor),
        "range_term_m": _interval_json(found.range_sigma),
        "slope": _interval_json(found.slope),
        "by_range": [_bin_json(b, "m") for b in found.by_range],
        "by_bearing": [_bin_json(b, "rad") for b in found.by_bearing],
        "measured_ranges": _range_errors(read),
    }


def _interval_json(v: Interval) -> dict[str, float]:
    return {"value": v.value, "low": v.low, "high": v.high}


def _bin_json(b: ResidualBin, unit: str) -> dict[str, Any]:
    def triple(value: float, low: float, high: float) -> dict[str, float | None]:
        return {"value": value, "low": _or_none(low), "high": _or_none(high)}

    return {
        f"from_{unit}": b.low,
        f"to_{unit}": _or_none(b.high),
        "n": b.n,
        "bias_rad": triple(b.bias, b.bias_low, b.bias_high),
        "sigma_rad": triple(b.sigma, b.sigma_low, b.sigma_high),
    }


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _n_blocks(read: SightingsFile) -> int:
    return len(np.unique(read.log.block[read.log.usable]))


def _range_errors(read: SightingsFile) -> dict[str, float] | None:
    """Measured minus true distances: median and robust sigma, m; None without any."""
    _, true = residuals(read.log)
    e = read.ranges - true
    e = e[np.isfinite(e)]
    if len(e) == 0:
        return None
    middle = float(np.median(e))
    return {"n": len(e), "bias_m": middle, "sigma_m": MAD_TO_SIGMA * float(np.median(np.abs(e - middle)))}


def _figures(read: SightingsFile, found: BearingCalibration, *, camera: bool) -> Table:
    table = Table(box=None)
    for column in ("", "value", "95 % interval"):
        table.add_column(column, justify="left" if not column else "right")
    log = read.log
    table.add_row("measurements", f"{len(log.time)}", "")
    table.add_row("used", f"{found.n_used}", f"in {_n_blocks(read)} stretches")
    table.add_row(f"beyond {GATE_SIGMAS:g} σ", f"{found.n_outliers}", f"{100 * found.outlier_share:.1f} %")
    table.add_row("misread", f"{log.count(Sighting.MISREAD)}", "")
    table.add_row("without a reference", f"{log.count(Sighting.NO_REFERENCE)}", "")
    deg = math.degrees(1.0)
    for name, value, scale, unit in (
        ("bias", found.bias, deg, "°"),
        ("sigma, over all", found.sigma, deg, "°"),
        ("column share, on the axis", found.column_sigma, deg, "°"),
        ("floor", found.floor, deg, "°"),
        ("range term", found.range_sigma, 1e3, "mm"),
        ("slope per 10°", found.slope, 10.0, "°"),
    ):
        if value is found.column_sigma and not camera:
            continue
        low, high = scale * value.low, scale * value.high
        table.add_row(name, f"{scale * value.value:.3f} {unit}", f"{low:.3f} to {high:.3f} {unit}")
    ranges = _range_errors(read)
    if ranges is not None:
        table.add_row("measured distances", f"{ranges['bias_m']:+.3f} m", f"σ {ranges['sigma_m']:.3f} m")
    return table


def _dependence(title: str, bins: tuple[ResidualBin, ...], unit: str, scale: float) -> Table:
    table = Table(box=None)
    for column in (title, "n", "median, °", "95 % interval", "robust σ, °", "95 % interval"):
        table.add_column(column, justify="right")
    for b in bins:
        # Adding zero makes -0 a 0.
        low, high = (unit.format(round(scale * v, 9) + 0.0) for v in (b.low, b.high))
        table.add_row(
            f"{low} and more" if math.isinf(b.high) else f"{low} to {high}",
            f"{b.n}",
            f"{math.degrees(b.bias):.3f}",
            _span(b.bias_low, b.bias_high),
            f"{math.degrees(b.sigma):.3f}",
            _span(b.sigma_low, b.sigma_high),
        )
    return table


def _span(low: float, high: float) -> str:
    return "–" if math.isnan(low) else f"{math.degrees(low):.3f} to {math.degrees(high):.3f}"


def _landmarks_csv(landmarks: LandmarkSet) -> bytes:
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["id", "x_m", "y_m", "facing_rad", "half_angle_rad", "sigma_m"])
    for i, name in enumerate(landmarks.ids):
        facing, half = float(landmarks.facing[i]), float(landmarks.half_angle[i])
        sector = ["", ""] if math.isnan(facing) else [repr(facing), repr(half)]
        x, y = (float(v) for v in landmarks.positions[i])
        rows.writerow([name, repr(x), repr(y), *sector, repr(float(landmarks.sigma[i]))])
    return text.getvalue().encode()
