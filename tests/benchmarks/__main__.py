"""``make bench``: runs every section, prints tables; ``--write`` puts them into docs/benchmarks.md.

``python -m tests.benchmarks field plan`` runs only these sections.
"""

from __future__ import annotations

import argparse
import importlib
import os
import platform
import sys
import time
from importlib.metadata import version
from pathlib import Path

from rich.console import Console
from rich.table import Table

SECTIONS = {
    "triplets": "bench_triplets",
    "triangulation": "bench_triangulation",
    "visibility": "bench_visibility",
    "field": "bench_field",
    "large": "bench_large",
    "scaling": "bench_scaling",
    "search": "bench_search",
    "plan": "bench_planner",
    "smoothing": "bench_smoothing",
    "ompl": "bench_ompl",
    "labels": "bench_labels",
    "matrix": "bench_matrix",
    "kinematics": "bench_kinematics",
    "simulation": "bench_simulation",
    "heatmap": "bench_heatmap",
}
DOCUMENT = Path(__file__).parents[2] / "docs" / "benchmarks.md"


def hardware() -> str:
    """Processor, cores and versions in one line."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [
            line.split(":", 1)[1].strip() for line in cpuinfo.read_text().splitlines() if "model name" in line
        ]
        model = names[0] if names else model
    packages = ", ".join(
        f"{p} {version(p)}" for p in ("numpy", "numba", "ompl", "casadi", "zarr", "scikit-image")
    )
    return f"{model}, {os.cpu_count()} cores; Python {platform.python_version()}, {packages}"


def main() -> int:
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("sections", nargs="*", choices=[*SECTIONS, []], help="default: all")
    parser.add_argument("--write", action="store_true", help="write docs/benchmarks.md")
    options = parser.parse_args()
    console = Console(width=150)
    console.print(hardware(), highlight=False)
    text = [
        "# Benchmarks",
        "",
        "Made by `make bench ARGS=--write`. Times depend on the machine; ratios come from one run on one machine.",
        "",
        hardware(),
    ]
    for name in options.sections or SECTIONS:
        module = importlib.import_module(f"tests.benchmarks.{SECTIONS[name]}")
        began = time.perf_counter()
        rows = module.run()
        if isinstance(rows, str):  # a reason why it could not run
            console.print(f"[yellow]{name}: skipped, {rows}[/yellow]")
            text += ["", f"## {module.TITLE}", "", f"Skipped: {rows}"]
            continue
        table = Table(title=module.TITLE)
        for column in rows[0]:
            table.add_column(column, justify="right")
        for row in rows:
            table.add_row(*(str(v) for v in row.values()))
        console.print(table)
        console.print(f"{name}: {time.perf_counter() - began:.0f} s\n", highlight=False)
        text += ["", f"## {module.TITLE}", ""]
        text += ["| " + " | ".join(rows[0]) + " |", "|" + "---|" * len(rows[0])]
        text += ["| " + " | ".join(str(v) for v in row.values()) + " |" for row in rows]
        if options.write and hasattr(module, "draw"):
            text += [""]
            for picture, caption in module.draw(rows, DOCUMENT.parent / "pictures"):
                text += [f"![{caption}](pictures/{picture})"]
    if options.write:
        DOCUMENT.write_text("\n".join(text) + "\n")
        console.print(f"written: {DOCUMENT.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
