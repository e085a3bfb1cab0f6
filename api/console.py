"""What the command line shows people: tables and progress bars."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

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


def field_table(built: UncertaintyField) -> Table:
    """Figures of a field for people."""
    table = Table(show_header=False, box=None)
    free = int(np.count_nonzero(built.free))
    fixed = int(np.count_nonzero(built.has_fix))
    ny, nx = built.frame.shape
    table.add_row("cells", f"{nx} × {ny} at {built.frame.resolution:g} m, {free} free")
    table.add_row("with a fix", f"{100 * fixed / max(free, 1):.1f} % of the free cells")
    if fixed:
        r95 = built.r95[built.has_fix]
        low, mid, high = (float(v) for v in np.percentile(r95, [5, 50, 95]))
        table.add_row("r95", f"{mid:.3f} m median, {low:.3f} … {high:.3f} m for the middle 90 %")
    return table


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
