"""The main job on real sites: map in, field, plans with and without bounds; every promise checked."""

from __future__ import annotations

import math

import numpy as np
import pytest

from localization.field_builder import build_field
from localization.sensors import OmnidirectionalSensor
from maps.io.load import load_world
from maps.landmarks import LandmarkSet
from planner.context import PlanningContext
from planner.plan import plan, warm_up
from planner.problem import PlanningProblem
from planner.result import PlanStatus

SENSOR = OmnidirectionalSensor(bearing_sigma=math.radians(0.1), max_range=30.0)
RADIUS = 0.3

SITES = {
    "plant": ("landmark_maps/cob/ipa-production-plant", None),
    "office": ("landmark_maps/cob/ipa-office", None),
    "depot": ("ros_maps/nav2/depot.yaml", 4.0),
    "willow": ("ros_maps/willow/willow-2010-02-18-0.10.yaml", 4.0),
}


def with_placed_landmarks(world, spacing):
    """Reflectors 5 cm in front of walls, none within ``spacing`` m of another."""
    edges = world.floor.free_edges()
    middle = 0.5 * (edges[:, :2] + edges[:, 2:])
    d = edges[:, 2:] - edges[:, :2]
    normal = np.column_stack([-d[:, 1], d[:, 0]]) / np.hypot(*d.T)[:, None]
    candidates = np.concatenate([middle + 0.05 * normal, middle - 0.05 * normal])
    candidates = candidates[world.floor.free_at(candidates)]
    kept = np.empty((0, 2))
    for p in candidates[np.lexsort(candidates.T)]:
        if len(kept) == 0 or np.hypot(*(kept - p).T).min() >= spacing:
            kept = np.vstack([kept, p])
    return world.with_landmarks(LandmarkSet(tuple(f"r{k}" for k in range(len(kept))), kept))


@pytest.fixture(scope="module", params=SITES)
def site(request, shared_data):
    path, spacing = SITES[request.param]
    world = load_world(shared_data / path)
    if spacing is not None:
        world = with_placed_landmarks(world, spacing)
    warm_up()
    return request.param, PlanningContext(build_field(world, SENSOR, resolution=0.2))


def ends_of(context, rng, count, blind_rate=None):
    """Pairs of places that a path connects, far apart."""
    graph = context.graph(radius=RADIUS, weight=4.0, blind_rate=blind_rate)
    rows, cols = np.nonzero(graph.cost_space.passable)
    found = []
    while len(found) < count:
        i, j = rng.integers(len(rows), size=2)
        start, goal = (tuple(p) for p in graph.cost_space.centre(rows[[i, j]], cols[[i, j]]))
        far = math.dist(start, goal) > 5
        if far and graph.costs_to(goal).path_from(start)[1] is not None:
            found.append((start, goal))
    return found


def check(result, problem, context):
    """What every answer promises."""
    assert result.route is not None
    assert result.shortest is not None
    field = context.field
    for route in (result.route, result.shortest):
        p = route.trajectory.points
        np.testing.assert_array_equal(p[[0, -1]], [problem.start, problem.goal])
        assert context.clearance.segment_distance(p[:-1], p[1:]).min() >= problem.radius - 2e-9
        assert np.hypot(*route.trajectory.velocity.T).max() <= problem.max_speed * 1.001
        assert np.hypot(*route.trajectory.acceleration.T).max() <= problem.max_accel * 1.01
        path = route.path
        fix = np.isfinite(path.r95)
        np.testing.assert_array_equal(fix, path.triplet[:, 0] >= 0)
        rows, cols = field.frame.cell_at(path.points).T
        # The other waypoints lie on borders of cells.
        same = np.isclose(field.r95[rows, cols], path.r95, rtol=1e-12, equal_nan=True)
        same &= (field.triplet[rows, cols] == path.triplet).all(axis=1)
        assert same.mean() > 0.9
        figures = route.summary
        assert figures.blind <= figures.length + 1e-9
        if figures.max_r95 is not None:
            assert np.nanmax(path.r95) <= figures.max_r95 + 1e-12
            assert figures.mean_r95 <= figures.max_r95
    assert result.shortest.summary.length <= result.route.summary.length + 1e-9
    assert "deadline" not in " ".join(result.warnings)
    if result.status is PlanStatus.EXACT:
        assert result.route.summary.cost <= result.grid_cost * (1 + 1e-9)


def test_field_facts(site):
    name, context = site
    field = context.field
    few = 1 - field.has_fix[field.free].mean()
    assert len(field.world.landmarks) == {"plant": 48, "office": 16}.get(name, len(field.world.landmarks))
    if name == "plant":
        # A good quarter of the free floor sees fewer than three reflectors.
        assert 0.2 < few < 0.45
    else:
        assert few < 0.8
    good = np.nanmedian(field.r95)
    assert 0.005 < good < 0.2


def test_plans_with_and_without_bounds(site, rng):
    name, context = site
    for start, goal in ends_of(context, rng, 3):
        free = PlanningProblem(start, goal, RADIUS, deadline=20.0, refine=300)
        result = plan(free, context)
        assert result.status is PlanStatus.EXACT, name
        check(result, free, context)
        figures, beside = result.route.summary, result.shortest.summary
        assert figures.blind == 0.0
        assert math.isinf(beside.cost) == (beside.blind > 0)
        assert figures.cost <= beside.cost * 1.01
        tight = PlanningProblem(start, goal, RADIUS, deadline=20.0, refine=300, max_r95=0.8 * figures.max_r95)
        bounded = plan(tight, context)
        check(bounded, tight, context)
        if bounded.status is PlanStatus.EXACT:
            assert bounded.route.summary.max_r95 <= tight.max_r95
            assert bounded.grid_cost >= result.grid_cost * (1 - 1e-9)
        else:
            assert bounded.status is PlanStatus.RISK_UNMET
            (unmet,) = bounded.unmet
            assert tight.max_r95 < unmet.smallest_possible
            assert bounded.route.summary.max_r95 <= unmet.smallest_possible
            near = context.clearance.distance([unmet.place])[0]
            assert near >= RADIUS - 1e-3


def test_the_blind_part_of_the_plant(site, rng):
    name, context = site
    if name != "plant":
        pytest.skip("only the plant has much floor without a fix")
    forced = 0
    for start, goal in ends_of(context, rng, 4, blind_rate=1.0):
        allowed = PlanningProblem(start, goal, RADIUS, deadline=20.0, refine=0, blind_r95=0.5)
        result = plan(allowed, context)
        assert result.status is PlanStatus.EXACT
        check(result, allowed, context)
        strict = plan(PlanningProblem(start, goal, RADIUS, deadline=20.0, refine=0), context)
        assert strict.route is not None
        if strict.status is PlanStatus.RISK_UNMET:
            forced += 1
            assert strict.unmet[0].bound == "blind"
            assert 0 < strict.route.summary.blind <= result.route.summary.blind + 0.5
        else:
            assert strict.route.summary.blind == 0
    assert forced > 0
