"""What the command line shows people: tables and progress bars."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from localization.heading_field import HeadingField
from localization.uncertainty_field import UncertaintyField

out = Console()
err = Console(stderr=True)

_LONGEST = "longest without a fix [m]"
_Read = Callable[[dict[str, Any]], float | None]
#: Figures of a route: name, digits, where they stand in the answer.
_ROWS: list[tuple[str, int, _Read]] = [
    ("length [m]", 2, lambda r: r["length_m"]),
    ("duration [s]", 2, lambda r: r["duration_s"]),
    ("mean r95 [m]", 4, lambda r: r["uncertainty"]["mean_r95_m"]),
    ("worst r95 [m]", 4, lambda r: r["uncertainty"]["max_r95_m"]),
    ("worst ellipse area [m²]", 4, lambda r: r["uncertainty"]["max_area95_m2"]),
    ("without a fix [m]", 2, lambda r: r["uncertainty"]["blind_m"]),
    (_LONGEST, 2, lambda r: r["uncertainty"]["longest_blind_m"]),
    ("least clearance [m]", 3, lambda r: r["min_clearance_m"]),
]
# Stretches without a fix.
_TOLD = {"turning": "turning", "blind": "none"}
#: Stretches without a fix that are shorter are in no table, s; figures count them.
SHORT_S = 0.1
# Less is nothing, m.
_SEEN_M = 0.05
_RISK = "max_collision_probability"
# Figures that are shown where they are bounded: the constraint, then as above; digits None: a probability.
_BOUNDED: list[tuple[str, str, int | None, _Read]] = [
    ("max_ellipse95_m", "worst ellipse axis [m]", 4, lambda r: r["uncertainty"]["max_ellipse95_m"]),
    ("max_blind_distance_m", _LONGEST, 2, lambda r: r["uncertainty"]["longest_blind_m"]),
    (_RISK, "collision probability", None, lambda r: r["risk"][_RISK]),
    (_RISK, "  its coarse bound", None, lambda r: r["risk"]["max_collision_bound"]),
]
# The same in the heads of columns.
_SHORT = {
    "worst ellipse axis [m]": "axis",
    _LONGEST: "longest",
    "collision probability": "risk",
}
# Collision probabilities from this on are shown in any case.
_TINY = 1e-6


def progress_bar() -> Progress:
    """Bar with count and remaining time, on stderr."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("tiles"),
        TimeRemainingColumn(),
        console=err,
    )


def print_note(text: str) -> None:
    """A remark on stderr, beside the answer."""
    err.print(f"[yellow]note[/yellow] {escape(text)}", highlight=False, soft_wrap=True)


def field_table(built: UncertaintyField | HeadingField) -> Table:
    """Figures of a field for people."""
    table = Table(show_header=False, box=None)
    slices = built.slices if isinstance(built, HeadingField) else (built,)
    free = int(np.count_nonzero(built.free))
    ny, nx = built.frame.shape
    table.add_row("cells", f"{nx} × {ny} at {built.frame.resolution:g} m, {free} free")
    if isinstance(built, HeadingField):
        table.add_row("headings", f"{len(built)}, every {360 / len(built):.4g}°")
    method = built.method
    of = (
        "all landmarks in view"
        if method.estimator == "all_visible"
        else f"best triplet by {method.criterion}"
    )
    table.add_row("fix", of)
    fixed = sum(int(np.count_nonzero(f.has_fix)) for f in slices)
    total = max(free * len(slices), 1)
    share = 100 * (total - fixed) / total
    if isinstance(built, HeadingField):
        table.add_row("without a fix", f"{share:.1f} % of free cells × headings")
        with_fix = built.share_with_fix()[built.free]
        for words, lost in (("one or more headings", with_fix < 1), ("every heading", with_fix == 0)):
            part = 100 * int(np.count_nonzero(lost)) / max(free, 1)
            table.add_row(f"  at {words}", f"{part:.1f} % of the free cells")
    else:
        table.add_row("without a fix", f"{share:.1f} % of the free cells")
    if method.estimator == "all_visible":
        table.add_row("not valid", "not known for all_visible")
    else:
        doubtful = fixed - sum(int(np.count_nonzero(f.is_valid)) for f in slices)
        table.add_row("not valid", f"{100 * doubtful / max(fixed, 1):.1f} % of the fixes")
    if isinstance(built, HeadingField):
        for which in ("best", "worst"):
            _add_r95(table, f"r95, {which} heading", built.reduced(which))
    else:
        _add_r95(table, "r95", built)
    return table


def _add_r95(table: Table, name: str, field: UncertaintyField) -> None:
    r95 = field.r95[field.has_fix]
    if not len(r95):
        table.add_row(name, "no fix anywhere")
        return
    low, mid, high = (float(v) for v in np.percentile(r95, [5, 50, 95]))
    table.add_row(name, f"{mid:.3f} m median, {low:.3f} … {high:.3f} m for the middle 90 %")


def print_plan(answer: dict[str, Any]) -> None:
    """Status, table of the route beside the shortest one or of all routes, and what was not met."""
    color = "green" if answer["status"] in {"exact", "approximate"} else "yellow"
    out.print(f"status: [{color}]{answer['status']}[/{color}] ({answer['planner']})")
    if len(answer["routes"]) > 1 or (answer["routes"] and answer["routes"][0].get("front")):
        out.print(routes_table(answer))
    elif answer["routes"]:
        out.print(comparison_table(answer))
    if answer["routes"] and answer["routes"][0].get("schedule"):
        of_first = " of route 1 (of the others: in the written answer)" if len(answer["routes"]) > 1 else ""
        out.print(schedule_table(answer["routes"][0], f"when to look where{of_first}"))
    for item in answer["unmet"]:
        out.print(f"[yellow]not met[/yellow] {escape(item['message'])}", highlight=False)
    for warning in answer["warnings"]:
        out.print(f"[yellow]note[/yellow] {escape(warning)}", highlight=False)


def comparison_table(answer: dict[str, Any]) -> Table:
    """Shortest path against the one asked for, from the answer of ``POST /v1/plans``."""
    table = Table()
    for name in ("", "shortest", "this plan", "change"):
        table.add_column(name, justify="left" if not name else "right")
    chosen, shortest = answer["routes"][0], answer.get("shortest_baseline")
    bounded = _bounded_rows(answer)
    is_bounded = any(row[0] == _LONGEST for row in bounded)
    for name, digits, read in [*_ROWS, *(row for row in bounded if row[0] != _LONGEST)]:
        a = read(shortest) if shortest else None
        b = read(chosen)
        if name == _LONGEST and not (a or b) and not is_bounded:
            continue
        change = f"{100 * (b - a) / a:+.1f} %" if a and b is not None and digits is not None else ""
        table.add_row(escape(name), *(_cell(v, digits) for v in (a, b)), change)
    return table


def _bounded_rows(answer: dict[str, Any]) -> list[tuple[str, int | None, _Read]]:
    """Rows of what the question bounds, and of the collision probability where it is not tiny."""
    constraints = answer["request"]["constraints"]
    routes = [*answer["routes"], *filter(None, [answer.get("shortest_baseline")])]
    risk = max((r["risk"][_RISK] or 0.0 for r in routes), default=0.0)
    return [
        (name, digits, read)
        for bound, name, digits, read in _BOUNDED
        if constraints[bound] is not None or (name == "collision probability" and risk >= _TINY)
    ]


def routes_table(answer: dict[str, Any]) -> Table:
    """One row for each route, the shortest one of the robot last."""
    routes, shortest = answer["routes"], answer.get("shortest_baseline")
    front = routes[0].get("front")
    last = "shared" if front is None else "max r95" if front["against"] == "worst" else "weight"
    # One space between columns: a terminal of 80 must hold all figures whole.
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    bounded = [row for row in _bounded_rows(answer) if row[0] in _SHORT]
    shown = [_SHORT[name] for name, _, _ in bounded]
    table.add_column("route", justify="right", no_wrap=True, min_width=len("shortest"))
    for name in ("m", "s", "mean r95", "worst r95", "no fix", "clear", *shown, last):
        table.add_column(name, justify="right")
    rows = [*(row for row in _ROWS if "area" not in row[0] and row[0] != _LONGEST), *bounded]
    for number, route in enumerate(routes, 1):
        cells = [_cell(read(route), digits) for _, digits, read in rows]
        table.add_row(str(number), *cells, _of_list(route))
    if shortest:
        table.add_row("shortest", *(_cell(read(shortest), digits) for _, digits, read in rows), "")
    return table


def _of_list(route: dict[str, Any]) -> str:
    """What a route shares with those before it, or the setting that a front has it from."""
    place = route.get("front")
    if place is None:
        return "–" if route["share"] is None else f"{100 * route['share']:.0f} %"
    setting = place["max_r95_m"] or place["uncertainty_weight_per_m"]
    return "–" if setting is None else f"{setting:.4g}"


def schedule_table(route: dict[str, Any], title: str) -> Table:
    """When to look where along a route."""
    table = Table(title=title, title_justify="left", caption=schedule_words(route), caption_justify="left")
    for name in ("m", "s", "landmarks", "pan", "r95", "begin by", "1 s late"):
        table.add_column(name, justify="left" if name == "landmarks" else "right", no_wrap=True)
    for part in route["schedule"]:
        if part["kind"] != "fix" and part["t_end_s"] - part["t_start_s"] < SHORT_S:
            continue
        table.add_row(
            f"{part['s_start_m']:.1f}–{part['s_end_m']:.1f}",
            _cell(part["t_start_s"], 1),
            _TOLD.get(part["kind"]) or " ".join(part["triplet"]),
            _pan(part["pan_start_rad"], part["pan_end_rad"]),
            _cell(part["max_r95_m"], 3),
            _cell(part["turn_from_s"], 1),
            late_words(part),
        )
    return table


def schedule_words(route: dict[str, Any]) -> str:
    """What a schedule comes to."""
    figures = route["schedule_figures"]
    turning = ""
    if figures["turning_s"] > 0:
        turning = f", {figures['turning_m']:.1f} m ({figures['turning_s']:.1f} s) of it turning"
    return (
        f"as scheduled: worst r95 {_cell(figures['max_r95_m'], 3)} m, mean "
        f"{_cell(figures['mean_r95_m'], 3)} m; "
        f"without a fix {figures['blind_m']:.1f} m ({figures['blind_s']:.1f} s){turning}"
    )


def _pan(start: float | None, end: float | None) -> str:
    """Angles at both ends."""
    if start is None or end is None:
        return "–"
    return f"{math.degrees(start):.0f}→{math.degrees(end):.0f}°"


def late_words(part: dict[str, Any]) -> str:
    """What it costs to leave a triplet a second late."""
    if part["late_blind_m"] is None:
        return "–"
    if part["late_blind_m"] >= _SEEN_M:
        return f"{part['late_blind_m']:.1f} m blind"
    return "nothing" if part["late_r95_m"] is None else f"r95 {part['late_r95_m']:.3f}"


def _cell(value: float | None, digits: int | None) -> str:
    """A figure; a probability, without digits, with two that count."""
    if value is None:
        return "–"
    return f"{value:.2g}" if digits is None else f"{value:.{digits}f}"
