"""Closed loop as a whole: consistency, collisions, determinism, scenarios."""

import math
from dataclasses import replace

import numpy as np
import pytest

from localization.errors import LocalizationError
from localization.field_builder import build_field, build_heading_field
from localization.madsen_1997_path import PATH
from localization.motion import OdometryModel
from localization.sensors import FORWARD_CAMERA, LASER, MAS97_CAMERA
from maps.clearance import ClearanceIndex
from maps.io.site import bundled_site
from planner.choices import choices_of
from planner.errors import InvalidProblem
from planner.kernels import simulation as kernel
from planner.madsen_1997_drive import drive_diagonal
from planner.pose_timing import MotionLimits, time_poses
from planner.reference import reference_of
from planner.risk import collision_risk
from planner.simulation import MAX_TRACKS, SimulatedRobot, simulate
from planner.steering import PoseCurve
from planner.timing import time_polyline

WAREHOUSE = bundled_site("warehouse")
ROOM = bundled_site("mas97_room")
#: A lane on which fixes are good and the reflectors surround the robot.
AISLE = time_polyline([[4.0, 12.0], [20.0, 12.0]], max_speed=1.2, max_accel=0.8)
DIAGONAL = time_polyline(PATH, max_speed=1.0, max_accel=0.5)
STILL = OdometryModel(0.0, 0.0, 0.0, 0.0)
SURE = np.diag([1e-9, 1e-9, 1e-9]) ** 2


@pytest.fixture(scope="module")
def field():
    return build_field(WAREHOUSE, LASER, resolution=0.2)


@pytest.fixture(scope="module")
def laser(field):
    return run(WAREHOUSE, LASER, AISLE, field=field, runs=600)


def run(world, sensor, trajectory, *, field=None, runs=200, seed=3, threads=None, **robot):
    return simulate(
        world, sensor, trajectory, robot=SimulatedRobot(**robot), runs=runs, field=field, threads=threads,
        rng=np.random.default_rng(seed),
    )  # fmt: skip


def same(a, b):
    for one, other in ((a.stations, b.stations), (a, b)):
        for name in one.__slots__:
            x, y = getattr(one, name), getattr(other, name)
            if isinstance(x, np.ndarray):
                np.testing.assert_array_equal(x, y)
    assert a.collision == b.collision
    assert a.coverage == b.coverage


def test_ellipses_keep_their_word_where_first_order_holds(laser):
    assert laser.coverage.allows(0.95)
    assert laser.predicted_coverage.allows(0.95)
    assert laser.nees.is_consistent
    assert laser.coverage.share == pytest.approx(0.95, abs=0.01)
    at = laser.stations
    assert (at.n == 600).all()
    assert np.abs(at.coverage - 0.95).max() < 0.045
    assert np.abs(at.nees - 3).max() < 0.6
    np.testing.assert_allclose(at.sample_r95, at.predicted_r95, rtol=0.16)


def test_a_wide_path_is_free_of_collisions(laser):
    assert laser.collisions == 0
    assert laser.collision.low == 0
    assert laser.collision.high < 0.01
    assert laser.collision_places.shape == (0, 2)
    assert np.isfinite(laser.goal_error).all()
    assert np.quantile(laser.goal_error, 0.95) < 0.05
    assert laser.worst_deviation.max() < 0.1
    assert laser.stations.displaced.max() == 0


def test_without_noise_the_robot_is_where_it_should_be(field):
    sure = replace(LASER, bearing_sigma=1e-10)
    report = run(WAREHOUSE, sure, AISLE, runs=2, odometry=STILL, start_covariance=SURE)
    assert report.worst_deviation.max() < 1e-6
    assert report.goal_error.max() < 1e-3
    assert report.collisions == 0
    np.testing.assert_allclose(report.tracks[0, :, :2], report.reference.poses[:, :2], atol=1e-3)


@pytest.mark.parametrize("steering", ["differential", "holonomic"])
def test_corners_are_driven(steering):
    turns = time_polyline([[3, 3], [5, 3], [5, 5], [4.0, 6.5]], max_speed=1.0, max_accel=1.0)
    report = run(ROOM, LASER, turns, runs=100, steering=steering, radius=0.3)
    assert report.collisions == 0
    assert report.goal_error.max() < 0.1
    assert report.worst_deviation.max() < 0.1
    assert report.coverage.allows(0.95)


def test_a_car_backs_into_its_place():
    shape = PoseCurve(np.array([2.5, 2.5, 0.0]), np.array([[2.0, 0.5, 0], [-2.0, -0.5, 0], [1.0, 0.0, 0]]))
    way = time_poses(shape, MotionLimits(1.0, 0.5)).to_trajectory()
    odometry = OdometryModel(0.01, 0.01, 0.005)
    reports = [
        run(ROOM, LASER, way, runs=300, radius=0.3, odometry=odometry, min_turn_radius=r)
        for r in (0.0, 1.7, 2.0)
    ]
    for report in reports:
        assert report.collisions == 0
        assert report.coverage.share == pytest.approx(0.95, abs=0.02)
    free, roomy, tight = (float(np.median(r.goal_error)) for r in reports)
    # Who drives the sharpest arcs that he can has nothing left for corrections.
    assert free < 0.03
    assert roomy < 1.5 * free
    assert tight > 1.1 * roomy


def test_collisions_grow_with_noise_and_lie_at_the_boundary():
    clearance = ClearanceIndex.from_world(ROOM)
    way = time_polyline([[0.5, 2.5], [0.5, 10.0]], max_speed=1.0, max_accel=1.0)
    kept = clearance.segment_distance([[0.5, 2.5]], [[0.5, 10.0]])[0]
    radius = 0.8 * kept
    rates = []
    for drift in (0.003, 0.03, 0.1, 0.3):
        odometry = OdometryModel(drift_sigma=drift)
        report = run(ROOM, LASER, way, odometry=odometry, radius=radius, runs=300, fix_rate=0.5)
        rates.append(report.collision.share)
        hit = clearance.distance(report.collision_places) if report.collisions else np.zeros(0)
        assert (hit < radius).all()
        assert (np.diff(report.stations.n) <= 0).all()
        assert report.stations.n[-1] == 300 - report.collisions
        assert np.isnan(report.goal_error).sum() == report.collisions
    assert rates == sorted(rates)
    assert rates[0] < 0.02
    assert rates[-1] > 0.3


def test_results_depend_on_the_seed_and_on_nothing_else(field):
    a = run(WAREHOUSE, LASER, AISLE, field=field, runs=150, threads=1)
    b = run(WAREHOUSE, LASER, AISLE, field=field, runs=150, threads=3)
    same(a, b)
    other = run(WAREHOUSE, LASER, AISLE, field=field, runs=150, seed=4)
    assert not np.array_equal(a.goal_error, other.goal_error)
    # A run's noise is its own: fewer runs are the first of many.
    few = run(WAREHOUSE, LASER, AISLE, field=field, runs=20)
    np.testing.assert_array_equal(few.goal_error, a.goal_error[:20])
    assert few.tracks.shape[0] == 20
    assert a.tracks.shape[0] == MAX_TRACKS


def test_single_fixes_displace_the_robot_no_more_often_than_bounds_promise(field):
    clearance = ClearanceIndex.from_world(WAREHOUSE)
    ends = [[4.0, 13.0], [20.0, 13.0]]
    along_racks = time_polyline(ends, max_speed=1.2, max_accel=0.8)
    kept = clearance.segment_distance(ends[:1], ends[1:])[0]
    coarse = replace(LASER, bearing_sigma=math.radians(0.6))
    radius = float(kept) - 0.08
    report = run(WAREHOUSE, coarse, along_racks, runs=1500, mode="fix", radius=radius, fix_rate=20.0)
    at = report.stations
    promised = collision_risk(clearance, at.poses[:, :2], at.predicted, radius)
    low, _ = at.displaced_bounds()
    checked = at.n > 500
    assert checked.sum() > 50
    assert at.displaced[checked].max() > 0.05
    # One station in forty may be off by chance at this level.
    assert (low[checked] > promised.tight[checked]).sum() <= 2
    assert report.coverage.share == pytest.approx(0.95, abs=0.02)


def test_the_robot_looks_up_the_cell_that_it_believes_to_be_in(field):
    with_field = run(WAREHOUSE, LASER, AISLE, field=field)
    without = run(WAREHOUSE, LASER, AISLE)
    assert with_field.blind_share < 0.05
    assert without.blind_share < 0.05
    np.testing.assert_allclose(with_field.stations.predicted_r95, without.stations.predicted_r95, rtol=0.5)


def test_a_fixed_camera_uses_a_field_over_headings():
    camera = replace(FORWARD_CAMERA, field_of_view=1.5)
    fields = build_heading_field(ROOM, camera, resolution=0.5, headings=24)
    report = run(ROOM, camera, DIAGONAL, field=fields, runs=100)
    assert report.blind_share < 0.6
    assert report.collisions == 0
    with pytest.raises(InvalidProblem, match="only one"):
        run(ROOM, camera, DIAGONAL, field=fields.slices[0], runs=1)


def test_without_fixes_the_belief_grows_as_the_error_does():
    near = replace(LASER, max_range=0.5)
    start = np.diag([0.01, 0.01, 0.01]) ** 2
    slow_drift = OdometryModel(drift_sigma=0.003)
    report = run(ROOM, near, DIAGONAL, runs=800, start_covariance=start, radius=0.2, odometry=slow_drift)
    assert report.blind_share == 1.0
    np.testing.assert_allclose(report.max_blind, report.max_blind[0], rtol=0.1)
    assert report.coverage.allows(0.95)
    assert report.predicted_coverage.allows(0.95)
    at = report.stations
    assert at.predicted_r95[-1] > 3 * at.predicted_r95[0]
    np.testing.assert_allclose(at.sample_r95, at.predicted_r95, rtol=0.1)


def test_short_sight_means_blind_stretches():
    short = replace(LASER, max_range=3.0)
    report = run(ROOM, short, DIAGONAL, start_covariance=np.diag([0.01, 0.01, 0.01]) ** 2)
    assert 0.1 < report.blind_share < 1.0
    assert 2.0 < report.max_blind.min() < report.reference.s[-1] - 1.0


def test_a_polygon_collides_where_its_disc_of_the_same_reach_does_or_later():
    way = time_polyline([[0.75, 2.5], [0.75, 9.0]], max_speed=1.0, max_accel=1.0)
    noisy = OdometryModel(drift_sigma=0.1)
    shape = np.array([[0.4, 0.3], [-0.4, 0.3], [-0.4, -0.3], [0.4, -0.3]])
    long = run(ROOM, LASER, way, footprint=shape, odometry=noisy, fix_rate=0.3)
    reach = SimulatedRobot(footprint=shape).reach
    disc = run(ROOM, LASER, way, radius=reach, odometry=noisy, fix_rate=0.3)
    inner = run(ROOM, LASER, way, radius=0.3, odometry=noisy, fix_rate=0.3)
    assert inner.collisions <= long.collisions < disc.collisions
    assert long.collisions > 0


def test_forced_forward_is_worse_than_free_pan():
    reports = drive_diagonal(ROOM, runs=400, rng=np.random.default_rng(7))
    best, ahead, arbitrary = reports.values()
    assert best.collision.high < ahead.collision.low
    assert best.mean_error < 0.6 * ahead.mean_error
    assert ahead.mean_error <= 1.02 * arbitrary.mean_error
    assert best.blind_share < 0.5 * ahead.blind_share
    for report in reports.values():
        assert report.coverage.share == pytest.approx(0.95, abs=0.015)


def test_a_triplet_that_fills_the_view_is_often_lost():
    start = np.diag([0.05, 0.05, 0.02]) ** 2
    filled = run(ROOM, MAS97_CAMERA, DIAGONAL, start_covariance=start, fix_rate=2.0)
    spared = run(
        ROOM, MAS97_CAMERA, DIAGONAL, start_covariance=start, fix_rate=2.0, view_margin=math.radians(2)
    )
    assert spared.blind_share < 0.6 * filled.blind_share


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"mode": "guess"}, "mode"),
        ({"steering": "legs"}, "steering"),
        ({"policy": "none"}, "policy"),
        ({"policy": "forced_forward"}, "camera"),
        ({"radius": -1.0}, "radius"),
        ({"min_turn_radius": -1.0}, "smallest turning radius"),
        ({"fix_rate": 0.0}, "fix_rate"),
        ({"step": math.nan}, "step"),
        ({"footprint": np.zeros((2, 2))}, "footprint"),
        ({"footprint": np.full((3, 2), math.inf)}, "footprint"),
        ({"start_covariance": np.zeros((3, 3))}, "start"),
    ],
)
def test_wrong_robots_are_refused(wrong, message):
    with pytest.raises((InvalidProblem, LocalizationError), match=message):
        run(ROOM, LASER, DIAGONAL, runs=1, **wrong)


def test_wrong_questions_are_refused(field):
    for runs in (0, 10**7):
        with pytest.raises(InvalidProblem, match="runs"):
            run(ROOM, LASER, DIAGONAL, runs=runs)
    with pytest.raises(InvalidProblem, match="another world"):
        run(ROOM, LASER, DIAGONAL, field=field)
    with pytest.raises(InvalidProblem, match="no fix at the start"):
        run(ROOM, replace(LASER, max_range=0.5), DIAGONAL)
    with pytest.raises(InvalidProblem, match="view_margin"):
        run(ROOM, MAS97_CAMERA, DIAGONAL, view_margin=1.0)
    all_visible = build_field(ROOM, LASER, resolution=0.5)
    all_visible = replace(all_visible, method=replace(all_visible.method, estimator="all_visible"))
    with pytest.raises(InvalidProblem, match="no triplets"):
        run(ROOM, LASER, DIAGONAL, field=all_visible)


def test_columns_have_the_width_of_the_outputs():
    assert kernel.N_RUN == kernel.DRIVEN + 1
    assert kernel.N_STATION == kernel.DISPLACED + 1
    assert kernel.draws_per_run(10, 4, 3, True) == 3 + 30 + 28 + 6


def test_arbitrary_choices_are_the_triplets_that_give_a_fix():
    reference = reference_of(DIAGONAL, step=0.5)
    is_fix = np.arange(len(reference)) % 8 == 0
    drawn = choices_of(ROOM, MAS97_CAMERA, reference=reference, is_fix=is_fix, policy="arbitrary")
    best = choices_of(ROOM, MAS97_CAMERA, reference=reference, is_fix=is_fix, policy="best_triplet")
    counts = np.diff(drawn.offsets)
    assert (counts[~is_fix] == 0).all()
    for k in np.flatnonzero(is_fix & (counts > 0)):
        np.testing.assert_array_equal(np.sort(drawn.triplets[drawn.offsets[k]]), np.sort(best.planned[k]))
        assert len(np.unique(drawn.triplets[drawn.offsets[k] : drawn.offsets[k + 1]], axis=0)) == counts[k]


def test_a_stop_leaves_the_first_runs(field):
    robot, flag = SimulatedRobot(), np.ones(1, dtype=np.uint8)
    rng = np.random.default_rng(5)
    short = simulate(WAREHOUSE, LASER, AISLE, robot=robot, runs=500, rng=rng, field=field, stop=flag)
    assert 0 < short.runs < 500
    full = run(WAREHOUSE, LASER, AISLE, field=field, runs=500, seed=5)
    np.testing.assert_array_equal(short.worst_deviation, full.worst_deviation[: short.runs])
    np.testing.assert_array_equal(short.tracks, full.tracks[: short.runs])
