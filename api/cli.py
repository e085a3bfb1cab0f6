"""The ``surepath`` command."""

from __future__ import annotations

import sys

import typer
from typer.exceptions import TyperException

from api.cli_calibrate import calibrate
from api.cli_common import EXIT_MISTAKE
from api.cli_field import field, heatmap
from api.cli_fixes import fixes
from api.cli_matrix import matrix, reach
from api.cli_plan import plan
from api.cli_reproduce import reproduce_app
from api.cli_serve import demo, serve
from api.cli_simulate import simulate_command
from api.cli_triplets import triplets
from api.cli_validate import validate
from api.cli_world import world_app
from api.console import err
from maps.errors import SurepathError

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
        "3 a plan that misses its bound or finds no way, a claim that does not hold."
    ),
)
app.add_typer(world_app, name="world")
for command in (field, heatmap, plan, matrix, reach, serve, demo, validate, calibrate):
    app.command()(command)
app.command("simulate")(simulate_command)
# Negative coordinates look like options.
app.command(context_settings={"ignore_unknown_options": True})(fixes)
app.command(context_settings={"ignore_unknown_options": True})(triplets)
app.add_typer(reproduce_app, name="reproduce")


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
