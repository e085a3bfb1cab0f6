"""What the command line shows people: tables and progress bars."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from localization.heading_field import HeadingField
from localization.uncertainty_field import UncertaintyField

out = Console()
err = Console(stderr=True)


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
    """Status, table of the route beside the shortest one, and what was not met."""
    color = "green" if answer["status"] in {"exact", "approximate"} else "yellow"
    out.print(f"status: [{color}]{answer['status']}[/{color}] ({answer['planner']})")
    if answer["routes"]:
        out.print(comparison_table(answer))
    for item in answer["unmet"]:
        out.print(f"[yellow]not met[/yellow] {item['message']}", highlight=False)
    for warning in answer["warnings"]:
        out.print(f"[yellow]note[/yellow] {warning}", highlight=False)


def comparison_table(answer: dict[str, Any]) -> Table:
    """Shortest path against the one asked for, from the answer of ``POST /v1/plans``."""
    table = Table()
    for name in ("", "shortest", "low uncertainty", "change"):
        table.add_column(name, justify="left" if not name else "right")
    chosen, shortest = answer["routes"][0], answer.get("shortest_baseline")
    rows: list[tuple[str, int, Callable[[dict[str, Any]], float | None]]] = [
        ("length [m]", 2, lambda r: r["length_m"]),
        ("duration [s]", 2, lambda r: r["duration_s"]),
        ("mean r95 [m]", 4, lambda r: r["uncertainty"]["mean_r95_m"]),
        ("worst r95 [m]", 4, lambda r: r["uncertainty"]["max_r95_m"]),
        ("worst ellipse area [m²]", 4, lambda r: r["uncertainty"]["max_area95_m2"]),
        ("without a fix [m]", 2, lambda r: r["uncertainty"]["blind_m"]),
        ("least clearance [m]", 3, lambda r: r["min_clearance_m"]),
    ]
    for name, digits, read in rows:
        a = read(shortest) if shortest else None
        b = read(chosen)
        change = f"{100 * (b - a) / a:+.1f} %" if a and b is not None else ""
        cells = ("–" if v is None else f"{v:.{digits}f}" for v in (a, b))
        table.add_row(name, *cells, change)
    return table
