from __future__ import annotations

import math

import numpy as np
import pytest
from shapely.geometry import box

from maps.check import check_world, free_regions
from maps.floor_plan import FloorPlan
from maps.grid import GridFrame, OccupancyGrid
from maps.io.load import load_world
from maps.landmarks import LandmarkSet
from maps.world import World
from tests.worlds import world_from_ascii

ROOM = """
##########
#A......B#
#........#
#...##...#
#........#
#C......D#
##########
"""


def codes(world, severity=None):
    return [f.code for f in check_world(world).findings if severity in {None, f.severity}]


def finding(world, code):
    (found,) = (f for f in check_world(world).findings if f.code == code)
    return found


def plan_world(xy, **options):
    plan = FloorPlan((box(0, 0, 20, 10),), (box(8, 4, 12, 6),), (True,))
    return World(
        "plan",
        plan,
        LandmarkSet(tuple(f"L{i}" for i in range(len(xy))), np.array(xy, dtype=float), **options),
    )


def test_a_sound_grid_has_figures_and_no_findings():
    world = world_from_ascii(ROOM, resolution=0.25)
    report = check_world(world)
    assert report.findings == ()
    assert report.figures == {
        "name": "ascii",
        "kind": "grid",
        "size": "10 × 7 cells, 2.50 × 1.75 m",
        "resolution": "0.25 m",
        "origin": "(0, 0) m, yaw 0°",
        "free area": f"{38 * 0.0625:.2f} m²",
        "opaque": "32 cells (45.7%)",
        "unknown": "0 cells (0.0%)",
        "bounds": "x 0 … 2.5 m, y 0 … 1.75 m",
        "landmarks": "4, 0 with a facing direction",
        "survey sigma": "0 … 0 m",
        "content": world.content_hash()[:12],
    }


def test_a_sound_plan_has_figures_and_no_findings():
    world = plan_world([(0, 0), (20, 0), (10, 10)], facing=[0.7, 2.4, -1.6], sigma=[0.01, 0.0, 0.005])
    report = check_world(world)
    assert report.findings == ()
    assert report.figures["kind"] == "polygons"
    assert report.figures["size"] == "20.00 × 10.00 m"
    assert report.figures["free area"] == "192.00 m²"
    assert report.figures["obstacles"] == "1 opaque, 0 that can be seen through"
    assert report.figures["landmarks"] == "3, 3 with a facing direction"
    assert report.figures["survey sigma"] == "0 … 0.01 m"
    assert "resolution" not in report.figures


@pytest.mark.parametrize("n", [0, 1, 2])
def test_fewer_than_three_landmarks_are_an_error(n):
    world = plan_world([(1, 1), (19, 1), (10, 9)][:n] or np.empty((0, 2)))
    found = finding(world, "too_few_landmarks")
    assert found.severity == "error"
    assert f"There are {n} landmarks" in found.message


def test_no_free_floor_is_an_error_and_comes_first():
    frame = GridFrame(0, 0, 0, 0.1, 4, 4)
    full = np.ones((4, 4), dtype=bool)
    world = World(
        "full", OccupancyGrid(frame, ~full, full), LandmarkSet(("a", "b", "c"), [[0, 0], [0.3, 0], [0, 0.3]])
    )
    assert codes(world, "error") == ["no_free_space"]
    assert check_world(world).findings[0].code == "no_free_space"


def test_buried_landmarks_are_named():
    world = plan_world([(1, 1), (19, 1), (10, 9), (10, 5)])
    assert "Landmark 'L3' " in finding(world, "buried").message
    drawing = "\n".join(["." * 20] * 3 + [".." + "#" * 16 + ".."] * 9 + ["." * 20] * 3)
    grid = world_from_ascii(drawing, resolution=0.1)
    grid = grid.with_landmarks(
        LandmarkSet(tuple("abcd"), [[0.05, 0.05], [1.95, 0.05], [0.05, 1.4], [1.0, 0.75]])
    )
    assert codes(grid) == ["buried"]
    assert "'d'" in finding(grid, "buried").message


def test_landmarks_that_face_walls_are_named():
    world = plan_world([(0, 5), (20, 5), (10, 0.5), (8, 5)], facing=[math.pi, math.pi, 1.6, 0.0])
    message = finding(world, "faces_wall").message
    assert "'L0', 'L3'" in message
    assert message.startswith("2 landmarks")
    grid = world_from_ascii(ROOM, resolution=0.25, facing=[0.0, 0.0, 0.0, math.nan])
    assert "Landmark 'B' " in finding(grid, "faces_wall").message


def test_landmarks_close_together_are_named():
    world = plan_world([(1, 1), (19, 1), (10, 9), (1.03, 1.03)])
    assert "'L0' and 'L3'" in finding(world, "close_together").message
    assert "close_together" not in codes(plan_world([(1, 1), (19, 1), (10, 9), (1.04, 1.04)]))
    crowd = plan_world([(1 + 0.001 * k, 1) for k in range(10)])
    assert "and 39 more pairs" in finding(crowd, "close_together").message


def test_landmarks_on_one_line_are_worth_a_remark():
    assert finding(plan_world([(1, 1), (3, 1.02), (15, 1), (19, 1)]), "collinear").severity == "info"
    assert "collinear" not in codes(plan_world([(1, 1), (3, 1.2), (15, 1), (19, 1)]))


def test_separate_regions_are_told_with_their_shares():
    plan = FloorPlan((box(0, 0, 6, 1), box(10, 0, 13, 1), box(20, 0, 20.5, 1)))
    world = World("parts", plan, LandmarkSet(tuple("abc"), [[0, 0], [13, 0], [1, 1]]))
    message = finding(world, "disconnected").message
    assert "2 regions" in message
    assert "6.0 m² (63.2%), 3.0 m² (31.6%)" in message
    np.testing.assert_allclose(free_regions(world), [6, 3, 0.5])
    grid = world_from_ascii("A.#..\nB##.C", resolution=2.0)
    # Cells that meet at a corner only are not connected.
    np.testing.assert_allclose(free_regions(grid), [16, 12])
    assert "2 regions" in finding(grid, "disconnected").message
    assert free_regions(world_from_ascii("A#\n#B", resolution=1.0)).tolist() == [1, 1]


def test_unknown_shares_resolutions_and_missing_walls():
    drawing = "A..???\nB.C???\n??????"
    world = world_from_ascii(drawing, resolution=0.3)
    assert codes(world) == ["odd_resolution", "no_walls", "much_unknown"]
    assert "67% of the cells" in finding(world, "much_unknown").message
    assert "0.3 m" in finding(world, "odd_resolution").message
    assert codes(world_from_ascii("A.B\n#.C", resolution=0.005)) == [
        "odd_resolution",
        "close_together",
        "collinear",
    ]


def test_real_sites(shared_data):
    cob = shared_data / "landmark_maps" / "cob"
    plant = check_world(load_world(cob / "ipa-production-plant"))
    assert {f.severity for f in plant.findings} == {"info"}
    assert plant.figures["size"] == "1985 × 1536 cells, 99.25 × 76.80 m"
    assert plant.figures["origin"] == "(-31.200001, -56.799999) m, yaw 0°"
    assert plant.figures["free area"] == "3053.16 m²"
    office = check_world(load_world(cob / "ipa-office"))
    assert [f.code for f in office.findings] == ["disconnected"]
    stata = check_world(load_world(shared_data / "ros_maps/mit_stata/stata_basement.yaml"))
    assert stata.findings[0].code == "too_few_landmarks"
