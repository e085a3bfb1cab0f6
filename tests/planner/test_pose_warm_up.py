"""After warming up no question about headings compiles anything: the first one has its whole deadline."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.compiled import signatures

COMPILED = pytest.mark.skipif(
    os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="kernels are not compiled here"
)
OUTLINE = ((0.4, 0.2), (-0.4, 0.2), (-0.4, -0.2), (0.4, -0.2))


def kernels_compiled_after_warming_up():
    """Signatures that are known, and kernels that got more of them by questions after the warm-up."""
    from localization.field_builder import build_field, build_heading_field
    from localization.sensors import LASER, PinholeFixedSensor
    from maps.io.site import bundled_site
    from planner.context import PlanningContext
    from planner.plan import plan, warm_up
    from planner.problem import PlanningProblem

    room = bundled_site("mas97_room")
    ahead = PinholeFixedSensor(1.6, 400.0, 1.0, max_range=12.0)
    contexts = [
        PlanningContext(build_field(room, LASER, resolution=0.25)),
        PlanningContext(build_heading_field(room, ahead, resolution=0.25, headings=8)),
    ]
    warm_up()
    before = signatures()
    asked = [
        {"footprint": OUTLINE, "kinematics": "differential"},
        {
            "footprint": OUTLINE,
            "kinematics": "dubins",
            "min_turn_radius": 0.5,
            "max_collision_probability": 0.05,
        },
        {"kinematics": "reeds_shepp", "min_turn_radius": 0.5, "objective": "minimax"},
        {"kinematics": "dubins", "min_turn_radius": 0.5, "max_r95": 0.001},
        {"kinematics": "differential", "start_heading": 1.0, "max_ellipse95": 0.5},
    ]
    for context in contexts:
        for values in asked:
            plan(
                PlanningProblem(
                    (2.0, 3.0), (8.0, 9.0), 0.3, blind_r95=1.0, deadline=10.0, refine=20, **values
                ),
                context,
            )
    return before, [name for name, count in signatures().items() if count > before.get(name, 0)]


@COMPILED
def test_after_warming_up_nothing_is_compiled():
    code = (
        "from tests.planner.test_pose_warm_up import kernels_compiled_after_warming_up as f\n"
        "known, late = f(); print(len(known), late)"
    )
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    count, late = done.stdout.strip().split(" ", 1)
    assert int(count) > 50
    assert late == "[]"
