"""``docs/validation.md``: the tables of :mod:`localization.validation` and what they say, from numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from statistics import NormalDist
from textwrap import fill

from localization.calibration import Interval
from localization.fix_study import FixSummary
from localization.log_filter import Recovery
from localization.logs import MAX_ODOMETRY_GAP_S, Sighting
from localization.residual_bins import ResidualBin
from localization.robust import GATE_SIGMAS
from localization.validation import GATE, ODOMETRY_WINDOW_S, WINDOWS_S, FilterStudy, LogCase, LogStudy, study

COMMAND = "surepath validate ../shared/data/bearing --output docs/validation.md"

_INTRODUCTION = f"""# The model against real logs

Made by `{COMMAND}`; every number is measured by that command, none typed.

Four robots' runs of the UTIAS multi-robot data set (Leung, Halpern, Barfoot and Liu, IJRR 30(8), 2011), its
pooled standstills (`mrclam1.mat`), and a rotating infrared detector at five places (Roh). Bearings and
reference poses are as logged. Sightings of misread ids and of other robots, and those without a reference
pose within 0.1 s, are set aside and counted. Fixes are judged with the calibration of the other four fifths
of their log (Roh: of the other places); the filter runs over one half of a run with the models learnt on
the other half.
"""


def validation_report(cases: Sequence[LogCase], *, progress: Callable[[int, int], None] | None = None) -> str:
    """Markdown document about some logs.

    Parameters
    ----------
    cases
        What to measure.
    progress
        Called with the number of logs done and of all.
    """
    studies = []
    for k, case in enumerate(cases):
        studies.append(study(case))
        if progress is not None:
            progress(k + 1, len(cases))
    parts = [_INTRODUCTION, _departures(studies), _logs(studies), _sensors(studies), _dependence(studies)]
    parts += [_coverage(studies), _choices(studies), _filters(studies)]
    return "\n".join(part.rstrip() + "\n" for part in parts)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _number(value: float, digits: int = 2) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _degrees(value: float) -> str:
    return _number(math.degrees(value))


def _interval(v: Interval, scale: float, digits: int = 2) -> str:
    return f"{scale * v.value:.{digits}f} ({scale * v.low:.{digits}f} to {scale * v.high:.{digits}f})"


def _percent(share: float) -> str:
    return _number(100 * share, 1)


def _distance(value: float) -> str:
    return _number(value, 3)


def _logs(studies: Sequence[LogStudy]) -> str:
    rows = []
    for s in studies:
        n = sum(s.counts.values())
        counts = [str(s.counts[k]) for k in Sighting]
        rows.append([s.case.log.name, s.case.source, str(n), *counts])
    head = ["log", "source", "sightings", "usable", "misread id", "other robot", "no reference"]
    return "## Logs\n\n" + _table(head, rows)


def _sensors(studies: Sequence[LogStudy]) -> str:
    deg = math.degrees(1.0)
    rows = []
    for s in studies:
        c = s.calibration
        rows.append(
            [
                s.case.log.name,
                str(c.n_used),
                f"{c.n_outliers} ({_percent(c.outlier_share)} %)",
                _interval(c.bias, deg),
                _interval(c.sigma, deg),
                _interval(c.floor, deg),
                _interval(c.range_sigma, 1e3, 0),
                _interval(c.slope, deg * math.radians(10.0)),
                _number(1e3 * s.lag, 0),
            ]
        )
    head = [
        "log",
        "used",
        f"beyond {GATE_SIGMAS:g} σ",
        "bias, °",
        "σ, °",
        "floor, °",
        "range term, mm",
        "slope, ° per 10°",
        "lag, ms",
    ]
    text = f"""## Calibrated sensors

Bias and sigma of a bearing, with 95 % intervals by bootstrap over stretches of the log. The variance is
floor² + (range term / distance)²; slope is the change of the residual over the bearing; lag is how late the
time stamps are, by the residuals over the turn rate. The field takes the floor as `bearing_floor` and the
range term as the survey's sigma. Residuals beyond {GATE_SIGMAS:g} σ count as outliers.

"""
    return text + _table(head, rows)


def _dependence(studies: Sequence[LogStudy]) -> str:
    edges = sorted({(b.low, b.high) for s in studies for b in s.calibration.by_range})
    head = [
        "log",
        *(f"{low:g} m and more" if math.isinf(high) else f"{low:g}-{high:g} m" for low, high in edges),
    ]
    rows = []
    for s in studies:
        found = {(b.low, b.high): b for b in s.calibration.by_range}
        rows.append([s.case.log.name, *(_sigma(found[e]) if e in found else "-" for e in edges)])
    text = """## Dependence on range and bearing

Robust sigma of a bearing by distance, °, with 95 % intervals by bootstrap over stretches of the log.

"""
    text += _table(head, rows)
    rows = []
    for s in studies:
        bins = s.calibration.by_bearing
        low, high = min(bins, key=lambda b: b.bias), max(bins, key=lambda b: b.bias)
        rows.append(
            [
                s.case.log.name,
                str(len(bins)),
                f"{_bias(low)} at {_middle(low.low, low.high)}°",
                f"{_bias(high)} at {_middle(high.low, high.high)}°",
                f"{_degrees(min(b.sigma for b in bins))} to {_degrees(max(b.sigma for b in bins))}",
            ]
        )
    head = ["log", "bins of 10°", "smallest median, °", "largest median, °", "robust sigma, °"]
    return (
        text
        + "\nResiduals without the global bias, by the bearing itself (for a camera: its column).\n\n"
        + _table(head, rows)
    )


def _with_bounds(value: float, low: float, high: float) -> str:
    return _degrees(value) + ("" if math.isnan(low) else f" ({_degrees(low)} to {_degrees(high)})")


def _sigma(b: ResidualBin) -> str:
    return _with_bounds(b.sigma, b.sigma_low, b.sigma_high)


def _bias(b: ResidualBin) -> str:
    return _with_bounds(b.bias, b.bias_low, b.bias_high)


def _middle(low: float, high: float) -> str:
    return f"{math.degrees(0.5 * (low + high)):.0f}"


def _summary(f: FixSummary) -> list[str]:
    return [
        f"{f.n}" + (f" ({f.n_failed} failed)" if f.n_failed else ""),
        f"{_percent(f.share)} ({_percent(f.share_low)} to {_percent(f.share_high)})",
        _distance(f.predicted_median),
        _distance(f.actual_median),
        _distance(f.predicted_p95),
        _distance(f.actual_p95),
    ]


_FIX_HEAD = [
    "fixes",
    "inside 95 %, %",
    "median predicted, m",
    "median actual, m",
    "95th percentile predicted, m",
    "95th percentile actual, m",
]


def _coverage(studies: Sequence[LogStudy]) -> str:
    rows = []
    for s in studies:
        views = (
            ("as logged", s.fixes.raw),
            ("common bias removed", s.fixes.common),
            ("bias of each landmark removed", s.fixes.own),
            ("outliers left out", s.fixes.gated),
            ("σ of the scatter within scans", s.fixes.scatter),
        )
        rows += [[s.case.log.name if k == 0 else "", name, *_summary(f)] for k, (name, f) in enumerate(views)]
    text = """## Fixes inside their predicted ellipses

Best triplet at the reference pose of every scan of three or more landmarks (one time stamp, or half a
second of standing still). Bounds of the share by bootstrap over stretches of the log. Outliers are left out
after taking off the bias of each landmark for Roh, the common one for MRCLAM. The last line of a log uses
the part of σ that differs within a scan: what all its bearings have in common turns the heading, not the
position.

"""
    return text + _table(["log", "bearings", *_FIX_HEAD], rows)


def _choices(studies: Sequence[LogStudy]) -> str:
    rows = []
    for s in studies:
        views = (
            ("best triplet", s.fixes.best),
            ("random triplet", s.fixes.random),
            ("all landmarks", s.fixes.every),
        )
        rows += [[s.case.log.name if k == 0 else "", name, *_summary(f)] for k, (name, f) in enumerate(views)]
    text = """## Best triplet, random triplet, all landmarks

Scans of four or more landmarks, biases and outliers removed, sigma of the scatter within scans.

"""
    return text + _table(["log", "landmarks", *_FIX_HEAD], rows)


def _filters(studies: Sequence[LogStudy]) -> str:
    rows = []
    odometry = []
    for s in studies:
        for k, o in enumerate(s.odometry):
            sigmas = (o.model.distance_sigma, o.model.turn_sigma, o.model.drift_sigma, o.model.slip_sigma)
            scales = [_number(o.distance_scale, 3), _number(o.turn_scale, 3)]
            name = s.case.log.name if k == 0 else ""
            odometry.append([name, f"{o.window:g}", str(o.n), *scales, *(_number(v, 3) for v in sigmas)])
        for half, views in s.filters:
            for k, f in enumerate(views):
                name = f"{s.case.log.name}, {half}" if k == 0 else ""
                rows.append([name, *_filter_row(f)])
    text = f"""## Filter along the runs

Odometry against the reference over stretches of different lengths (whole run), then the extended Kalman
filter with the models of {ODOMETRY_WINDOW_S:g} s and the bearings of all landmarks, started at the reference
with 2 cm and 0.02 rad; a gate passes {100 * GATE:.1f} % of good bearings. Where the odometry is silent
for more than {MAX_ODOMETRY_GAP_S:g} s, or {Recovery().lost_after} scans in a row are rejected, the filter
starts again from the fix of a scan, where there is one. A consistent filter has a mean NEES of 3 (bounds for
independent errors; those of a filter are not) and a median of 2.37.

"""
    text += _table(
        [
            "log",
            "window, s",
            "stretches",
            "distance scale",
            "turn scale",
            "distance σ, m/√m",
            "turn σ, rad/√rad",
            "drift σ, rad/√m",
            "slip σ, m/√m",
        ],
        odometry,
    )
    head = ["run", "bearings", "scans", "NEES mean (bounds)", "NEES median", "inside 95 %, %"]
    head += [
        "median predicted, m",
        "median actual, m",
        "95th percentile actual, m",
        "rejected, %",
        "restarts",
    ]
    return text + "\n" + _table(head, rows)


def _filter_row(f: FilterStudy) -> list[str]:
    return [
        f.view,
        str(f.n),
        f"{f.nees.value:.2f} ({f.nees.low:.2f} to {f.nees.high:.2f})",
        _number(f.nees_median),
        _percent(f.share),
        _distance(f.predicted_median),
        _distance(f.actual_median),
        _distance(f.actual_p95),
        _percent(f.rejected),
        str(f.restarted),
    ]


def _range(values: Sequence[float], digits: int = 1) -> str:
    low, high = (f"{v:.{digits}f}" for v in (min(values), max(values)))
    return low if low == high else f"{low} to {high}"


def _item(name: str, *parts: str) -> str:
    return fill(f"- **{name}.** " + " ".join(parts), 115, subsequent_indent="  ", break_on_hyphens=False)


def _departures(studies: Sequence[LogStudy]) -> str:
    """Where reality departs from the model, in sentences filled with the numbers of the tables."""
    lines = [*_of_bearings(studies), *_of_fixes(studies), *_of_filters(studies)]
    return "## Where reality departs from the model\n\n" + "\n".join(lines) + "\n"


def _of_bearings(studies: Sequence[LogStudy]) -> list[str]:
    calibrations = [s.calibration for s in studies]
    biased = sum(not c.bias.low <= 0 <= c.bias.high for c in calibrations)
    biases = _range([math.degrees(c.bias.value) for c in calibrations], 2)
    spreads = [max(b.bias for b in c.by_bearing) - min(b.bias for b in c.by_bearing) for c in calibrations]
    outliers = _range([100 * c.outlier_share for c in calibrations])
    gaussian = 200 * (1 - NormalDist().cdf(GATE_SIGMAS))
    lines = [
        _item(
            "Bias",
            f"In {biased} of {len(studies)} logs the interval of the bias leaves out zero ({biases}°),",
            f"and the median residual varies by {_range([math.degrees(v) for v in spreads], 2)}°",
            "over the bearing. A bias common to all landmarks turns a fix and does not move it.",
        ),
        _item(
            "Outliers",
            f"{outliers} % of the residuals lie beyond {GATE_SIGMAS:g} σ,",
            f"where a Gaussian has {gaussian:.1f} %.",
        ),
    ]
    lags = [1e3 * s.lag for s in studies if not math.isnan(s.lag)]
    if lags:
        late = f"Stamps come {_range(lags, 0)} ms after the exposure, by the residuals over the turn rate."
        lines.append(_item("Time", late))
    return lines


def _of_fixes(studies: Sequence[LogStudy]) -> list[str]:
    fixes = [s.fixes for s in studies]
    own = _range([100 * math.sqrt(f.own_share) for f in fixes], 0)
    whole = _range([f.gated.predicted_median / f.gated.actual_median for f in fixes])
    part = _range([f.scatter.predicted_median / f.scatter.actual_median for f in fixes])
    lines = [
        _item(
            "Errors in common",
            f"What differs within a scan is {own} % of σ; the rest is common and does not move the fix.",
            f"The predicted median error is {whole} times the actual one with the whole σ,",
            f"{part} times with the scatter within scans.",
        ),
        _item(
            "Ellipses",
            f"Inside the predicted 95 % ellipse lie, by log, {_range([100 * f.raw.share for f in fixes])} %",
            f"of the fixes as logged, {_range([100 * f.gated.share for f in fixes])} % without outliers,",
            f"and with the scatter within scans {_range([100 * f.scatter.share for f in fixes])} %.",
        ),
    ]
    for name, of_each in (("MRCLAM", False), ("Roh", True)):
        some = [s.fixes for s in studies if s.case.per_landmark == of_each]
        if some:
            ratio = _range([f.own.actual_median / f.raw.actual_median for f in some], 2)
            learnt = (
                "Taking off the bias of each landmark, learnt elsewhere in the log, multiplies the median"
            )
            lines.append(_item(f"Bias of each landmark, {name}", f"{learnt} error by {ratio}."))
    for s in studies:
        n, distinct = s.fixes.raw.n + s.fixes.raw.n_failed, s.fixes.distinct_scans
        if distinct < 0.5 * n:
            lines.append(
                _item(
                    "Copies",
                    f"Of the {n} scans of {s.case.log.name} only {distinct} have other readings than the",
                    "scan before: its fixes are far from independent.",
                )
            )
    many = [f for f in fixes if f.best.n]
    if many:
        gain = _range([f.random.actual_median / f.best.actual_median for f in many])
        lost = _range([f.best.actual_median / f.every.actual_median for f in many], 2)
        lines.append(
            _item(
                "Choice of landmarks",
                f"A random triplet has {gain} times the median error of the best one;",
                f"the best triplet has {lost} times that of all landmarks together.",
            )
        )
    return lines


def _of_filters(studies: Sequence[LogStudy]) -> list[str]:
    views = [view for s in studies for _, half in s.filters for view in half]
    alone = [v.nees.value for v in views if v.view == "odometry alone"]
    gated = [v for v in views if v.view == "gated"]
    if not gated:
        return []
    ratio = _range([v.actual_median / v.predicted_median for v in gated])
    short = _range([s.odometry[0].model.distance_sigma for s in studies if s.odometry], 3)
    long = _range([s.odometry[-1].model.distance_sigma for s in studies if s.odometry], 3)
    return [
        _item(
            "Filter",
            f"With gated bearings the mean NEES is {_range([v.nees.value for v in gated])} instead of 3,",
            f"{_range([100 * v.share for v in gated])} % of the positions lie inside the 95 % ellipse,",
            f"and the actual median error is {ratio} times the predicted one.",
            f"With odometry alone the mean NEES is {_range(alone)}.",
            "Its errors are not white: the sigma of the distance after 1 m is",
            f"{short} m over stretches of {WINDOWS_S[0]:g} s and {long} m over {WINDOWS_S[-1]:g} s.",
        )
    ]
