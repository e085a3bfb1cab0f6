"""What becomes of wrong input: every case has a named outcome, and no NaN comes without a flag."""

from __future__ import annotations

import ast
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from localization import errors
from localization.belief import PoseBelief
from localization.calibration import calibrate_bearings
from localization.camera import Camera
from localization.consistency import nees
from localization.ekf import update_with_bearings, update_with_fix
from localization.errors import (
    BehindCamera,
    CalibrationError,
    ColumnOutsideImage,
    DegenerateGeometry,
    InvalidMeasurement,
    InvalidSensor,
    LocalizationError,
    LogFormatError,
    NotPositiveDefinite,
)
from localization.field_builder import build_field
from localization.io.mrclam import read_mrclam_mat, read_mrclam_run
from localization.io.roh import read_roh
from localization.logs import BearingLog
from localization.ranking import one_triplet, triplet_status
from localization.sensors import (
    FORWARD_CAMERA,
    LASER,
    MAS97_CAMERA,
    Mount,
    OmnidirectionalSensor,
    PinholeFixedSensor,
    PinholePanSensor,
)
from localization.simulation import simulate_fixes
from localization.triangulation import (
    FixStatus,
    locate,
    locate_columns,
    triangulate,
    triangulate_columns,
)
from localization.triplets import best_triplet, rank_triplets
from maps.errors import DuplicateLandmark, InvalidLandmark, SurepathError, TooFewLandmarks
from maps.landmarks import LandmarkSet
from tests.localization.logs_made import LANDMARKS, standing_log
from tests.worlds import world_from_ascii

CORNER = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]])
BEARINGS = np.array([0.1, 1.5, -2.0])
BELIEF = PoseBelief(np.zeros(3), np.diag([0.1, 0.1, 0.01]))
WORLD = world_from_ascii("""
    ###########
    #A.......B#
    #.........#
    #.........#
    #....C....#
    ###########
""")
WORSE = (math.nan, math.inf, -math.inf)


def circle(angles):
    return np.column_stack([np.cos(angles), np.sin(angles)])


def seen_from(landmarks, point):
    d = np.asarray(landmarks) - point
    return np.arctan2(d[:, 1], d[:, 0])


def assert_flagged(fixes):
    """Poses and covariances are numbers exactly where the status says so."""
    ok = fixes.status == FixStatus.OK
    assert (np.isfinite(fixes.pose).all(axis=1) == ok).all()
    assert np.isnan(fixes.pose[~ok]).all()
    if fixes.covariance is not None:
        assert (np.isfinite(fixes.covariance).all(axis=(1, 2)) == ok).all()
        assert np.isnan(fixes.covariance[~ok]).all()


class TestCoincidentLandmarks:
    def test_a_map_refuses_them(self):
        with pytest.raises(DuplicateLandmark, match="both stand at"):
            LandmarkSet(("A", "B"), np.array([[1.0, 2.0], [1.0, 2.0]]))

    def test_shared_by_all_fixes_they_are_an_error(self):
        with pytest.raises(DegenerateGeometry, match="three places"):
            triangulate(BEARINGS, CORNER[[0, 0, 2]])
        with pytest.raises(DegenerateGeometry, match="three places"):
            triangulate_columns([100.0, 200.0, 300.0], CORNER[[0, 1, 1]], Camera(500.0))

    def test_one_fix_among_many_is_flagged(self):
        fixes = triangulate([BEARINGS] * 3, [CORNER, CORNER[[0, 0, 2]], CORNER[[1, 1, 1]]], sigma=0.01)
        assert fixes.status.tolist() == [FixStatus.OK, FixStatus.DEGENERATE, FixStatus.DEGENERATE]
        assert fixes.reliability[1:].tolist() == [0.0, 0.0]
        assert_flagged(fixes)

    def test_least_squares_need_three_places(self):
        with pytest.raises(DegenerateGeometry, match="fewer than three places"):
            locate([0.0, 0.1, 1.0, 1.1], CORNER[[0, 0, 1, 1]], 0.01)
        assert locate([0.1, 0.1, 1.5, -2.0], CORNER[[0, 0, 1, 2]], 0.01).converged


class TestRobotAtALandmark:
    def test_closed_form(self):
        # From the landmark's own place its bearing may be anything.
        for own in (0.0, 1.0, 2.5):
            for order in ([0, 1, 2], [1, 0, 2], [1, 2, 0]):
                bearings = np.array([own, 0.0, math.pi / 2])[order]
                fixes = triangulate(bearings, CORNER[order], sigma=0.01)
                assert_flagged(fixes)
                assert fixes.status.tolist() == [FixStatus.DEGENERATE]
                assert fixes.reliability.tolist() == [0.0]

    def test_field_and_triplets_leave_it_out(self):
        at = WORLD.landmarks.positions[0]
        assert best_triplet(WORLD, LASER, at) is None
        assert rank_triplets(WORLD, LASER, at) == []
        with pytest.raises(DegenerateGeometry, match="No triplet"):
            simulate_fixes(WORLD, LASER, at, n=5, rng=np.random.default_rng(1))
        with pytest.raises(DegenerateGeometry, match="A "):
            simulate_fixes(WORLD, LASER, at, triplet=(0, 1, 2), n=5, rng=np.random.default_rng(1))
        field = build_field(WORLD, LASER, resolution=0.5)
        row, col = field.frame.cell_at(at)
        assert field.n_visible[row, col] == 2
        assert not field.has_fix[row, col]

    def test_filter_leaves_the_bearing_out(self):
        update = update_with_bearings(BELIEF, [0.3, 0.2], [[0.0, 0.0], [3.0, 1.0]], sigma=0.1)
        assert update.accepted.tolist() == [False, True]
        assert np.isnan(update.innovations[0])
        assert np.isfinite(update.posterior.mean).all()

    def test_calibration_refuses_such_a_reference(self, rng):
        log = standing_log(rng, n=20)
        reference = np.array(log.reference)
        reference[3, :2] = LANDMARKS.positions[log.landmark[3]]
        touching = BearingLog(
            "t", LANDMARKS, log.time, log.landmark, log.bearing, reference, log.outcome, log.block
        )
        with pytest.raises(CalibrationError, match="stands on a landmark"):
            calibrate_bearings(touching, rng=rng)


class TestNoPose:
    def test_bearings_that_no_pose_has(self):
        # From inside the triangle the bearings go round once in the landmarks' order, never against it.
        inside = seen_from(CORNER, (1.0, 1.0))
        assert triangulate(inside, CORNER).ok.all()
        fixes = triangulate([inside, [0.0, math.pi, math.pi / 2]], CORNER, sigma=0.01)
        assert_flagged(fixes)
        swapped = triangulate(-inside, CORNER, sigma=0.01)
        assert FixStatus(swapped.status[0]) is FixStatus.NO_POSE
        assert_flagged(swapped)
        fix = locate(-inside, CORNER, 0.01)
        assert fix.status is FixStatus.NO_POSE
        assert not fix.converged
        assert np.isnan(fix.pose).all()

    def test_equal_bearings(self):
        fixes = triangulate([0.3, 0.3, 0.3], CORNER, sigma=0.01)
        assert fixes.status.tolist() == [FixStatus.DEGENERATE]
        assert_flagged(fixes)

    @pytest.mark.parametrize("bad", [*WORSE, 1e6])
    def test_numbers_that_are_none(self, bad):
        fixes = triangulate([BEARINGS, [bad, 0.0, 1.0], BEARINGS], CORNER, sigma=0.01)
        assert fixes.status.tolist() == [FixStatus.OK, FixStatus.NOT_FINITE, FixStatus.OK]
        assert_flagged(fixes)
        own = np.array([CORNER, CORNER])
        own[1, 0, 0] = bad if not math.isfinite(bad) else 1e13
        assert triangulate([BEARINGS] * 2, own).status.tolist() == [FixStatus.OK, FixStatus.NOT_FINITE]
        with pytest.raises(InvalidMeasurement, match="finite"):
            locate([bad, 0.0, 1.0], CORNER, 0.01)
        if not math.isfinite(bad):
            pan = triangulate_columns([1.0, 2.0, 3.0], CORNER, Camera(500.0), pan=bad, sigma_px=1.0)
            assert pan.status.tolist() == [FixStatus.NOT_FINITE]
            assert_flagged(pan)

    @pytest.mark.parametrize("sigma", [-0.1, *WORSE, 1e13, 1e200])
    def test_impossible_sigmas(self, sigma):
        for call in (
            lambda: triangulate(BEARINGS, CORNER, sigma=sigma),
            lambda: triangulate_columns([1.0, 2.0, 3.0], CORNER, Camera(500.0), sigma_px=sigma),
            lambda: locate(BEARINGS, CORNER, sigma),
        ):
            with pytest.raises(InvalidMeasurement, match="sigma"):
                call()

    @pytest.mark.parametrize("sigma", [1e-12, 1e-6, 1.0, 1e12])
    def test_possible_sigmas_give_a_covariance_or_a_name(self, sigma):
        assert_flagged(triangulate(BEARINGS, CORNER, sigma=sigma))
        fix = locate(BEARINGS, CORNER, sigma)
        assert np.isfinite(fix.covariance).all() == fix.converged


class TestSingularInformation:
    def test_on_the_circle_through_the_landmarks(self):
        landmarks, robot = circle([0.3, 2.0, 4.0]), circle([5.5])[0]
        bearings = seen_from(landmarks, robot)
        fixes = triangulate(bearings, landmarks, sigma=0.01)
        assert fixes.status.tolist() == [FixStatus.DEGENERATE]
        assert fixes.reliability[0] <= 1e-9
        assert_flagged(fixes)
        four = circle([0.3, 2.0, 4.0, 1.0])
        fix = locate(seen_from(four, robot), four, 0.01)
        assert fix.status in {FixStatus.DEGENERATE, FixStatus.SINGULAR, FixStatus.NO_CONVERGENCE}
        assert np.isnan(fix.pose).all()
        assert np.isnan(fix.covariance).all()

    def test_landmarks_and_robot_on_one_line(self):
        line = np.array([[1.0, 1.0], [2.0, 2.0], [5.0, 5.0]])
        fixes = triangulate(seen_from(line, (0.0, 0.0)), line, sigma=0.01)
        assert fixes.status.tolist() == [FixStatus.DEGENERATE]

    def test_field_has_no_fix_there(self):
        # Five cell centres on one circle, landmarks on three of them.
        world = WORLD.with_landmarks(
            LandmarkSet(tuple("abc"), np.array([[1.25, 0.75], [3.25, 0.75], [1.25, 2.25]]))
        )
        point = (3.25, 2.25)
        assert best_triplet(world, LASER, point) is None
        with pytest.raises(DegenerateGeometry, match="circle"):
            simulate_fixes(world, LASER, point, triplet=(0, 1, 2), n=5, rng=np.random.default_rng(1))
        field = build_field(world, LASER, resolution=0.5)
        row, col = field.frame.cell_at(point)
        assert field.n_visible[row, col] == 3
        assert not field.has_fix[row, col]

    @pytest.mark.parametrize("sensor", [LASER, MAS97_CAMERA, replace(FORWARD_CAMERA, field_of_view=2.5)])
    def test_layers_of_a_field_are_nan_exactly_without_a_fix(self, sensor):
        field = build_field(WORLD, sensor, resolution=0.25, heading=0.4)
        assert field.has_fix.any()
        assert (~field.has_fix).any()
        for layer in (field.covariance, field.sigma_theta[..., None]):
            assert (np.isfinite(layer).all(axis=-1) == field.has_fix).all()
            assert np.isnan(layer[~field.has_fix]).all()
        assert ((field.triplet >= 0).all(axis=-1) == field.has_fix).all()

    def test_filter_and_consistency(self):
        with pytest.raises(NotPositiveDefinite, match="must be positive definite"):
            update_with_fix(BELIEF, [0.0, 0.0, 0.0], np.diag([1.0, 0.0, 1.0]))
        with pytest.raises(NotPositiveDefinite, match="finite, symmetric"):
            update_with_fix(BELIEF, [0.0, 0.0], np.full((2, 2), np.nan))
        with pytest.raises(NotPositiveDefinite):
            PoseBelief(np.zeros(3), np.diag([1.0, -1.0, 1.0]))
        values = nees([[1.0, 0.0], [1.0, 0.0], [math.nan, 0.0]], [np.zeros((2, 2)), np.eye(2), np.eye(2)])
        assert values[:2].tolist() == [math.inf, 1.0]
        assert math.isnan(values[2])

    def test_too_few_landmarks(self):
        few = WORLD.with_landmarks(WORLD.landmarks.subset([0, 1]))
        with pytest.raises(TooFewLandmarks):
            build_field(few, LASER, resolution=0.5)
        assert best_triplet(few, LASER, (1.0, 1.0)) is None


class TestColumns:
    CAMERA = Camera(512.0, 256.0, 512.0)

    def test_outside_the_image_a_fix_is_flagged(self):
        columns = [[100.0, 200.0, 300.0], [100.0, 200.0, 512.5], [-0.5, 1.0, 2.0], [math.nan, 1.0, 2.0]]
        fixes = triangulate_columns(columns, CORNER, self.CAMERA, sigma_px=1.0)
        outside = FixStatus.OUTSIDE_IMAGE
        assert fixes.status[1:].tolist() == [outside, outside, FixStatus.NOT_FINITE]
        assert_flagged(fixes)

    @pytest.mark.parametrize("column", [-0.1, 512.1, *WORSE])
    def test_no_bearing_for_them(self, column):
        with pytest.raises(ColumnOutsideImage, match="1 of 2"):
            self.CAMERA.bearings([256.0, column])
        assert self.CAMERA.inside([256.0, column]).tolist() == [True, False]

    @pytest.mark.parametrize("column", WORSE)
    def test_no_sigma_either(self, column):
        with pytest.raises(ColumnOutsideImage, match="not finite"):
            self.CAMERA.bearing_sigma([256.0, column], 1.0)
        with pytest.raises(InvalidSensor, match="column_sigma_px"):
            self.CAMERA.bearing_sigma([256.0], column)

    @pytest.mark.parametrize("bearing", [math.pi / 2, math.pi, -2.0, *WORSE])
    @pytest.mark.filterwarnings("ignore:invalid value encountered in cos")
    def test_no_column_behind_the_camera(self, bearing):
        with pytest.raises(BehindCamera, match="1 of 2"):
            self.CAMERA.columns([0.0, bearing])

    @pytest.mark.parametrize(
        "numbers", [(0.0,), (-1.0,), (math.nan,), (500.0, math.nan), (500.0, 600.0, 512.0), (500.0, 0.0, 0.0)]
    )
    def test_impossible_cameras(self, numbers):
        with pytest.raises(InvalidSensor):
            Camera(*numbers)


class TestSensors:
    @pytest.mark.parametrize(
        ("kind", "numbers"),
        [
            *((OmnidirectionalSensor, {"bearing_sigma": v}) for v in (0.0, -0.1, 4.0, *WORSE)),
            *((OmnidirectionalSensor, {"bearing_sigma": 0.1, "min_range": v}) for v in (-1.0, *WORSE)),
            *((OmnidirectionalSensor, {"bearing_sigma": 0.1, "max_range": v}) for v in (0.0, math.nan)),
            *((OmnidirectionalSensor, {"bearing_sigma": 0.1, "bearing_floor": v}) for v in (-0.1, *WORSE)),
            *(
                (OmnidirectionalSensor, {"bearing_sigma": 0.1, "muted": ((v, 1.0),)})
                for v in (1.0, 7.0, *WORSE)
            ),
            *((PinholeFixedSensor, {"field_of_view": v}) for v in (0.0, -1.0, math.pi, *WORSE)),
            *((PinholeFixedSensor, {"focal_px": v}) for v in (0.0, -1.0, *WORSE)),
            *((PinholePanSensor, {"column_sigma_px": v}) for v in (0.0, -1.0, *WORSE)),
            *((PinholePanSensor, {"pan_min": v}) for v in (-4.0, 4.0, *WORSE)),
            (PinholePanSensor, {"pan_min": 1.0, "pan_max": 0.0}),
            (PinholePanSensor, {"pan_policy": "sideways"}),
            *((Mount, {"x": v}) for v in (101.0, *WORSE)),
            *((Mount, {"theta": v}) for v in WORSE),
        ],
    )
    def test_impossible_numbers_are_named(self, kind, numbers):
        defaults = {}
        if kind in {PinholeFixedSensor, PinholePanSensor}:
            defaults = {"field_of_view": 0.9, "focal_px": 512.0, "column_sigma_px": 5.0}
        name = "arm" if numbers.get("x") == 101.0 else list(numbers)[-1]
        with pytest.raises(InvalidSensor, match=name):
            kind(**defaults | numbers)

    @pytest.mark.parametrize("field", ["positions", "facing", "half_angle", "sigma"])
    def test_impossible_landmarks_are_named(self, field):
        good = {
            "positions": np.zeros((1, 2)),
            "facing": np.zeros(1),
            "half_angle": np.ones(1),
            "sigma": np.zeros(1),
        }
        with pytest.raises(InvalidLandmark, match="'A'"):
            LandmarkSet(("A",), **good | {field: np.full_like(good[field], math.inf)})


class TestPlaces:
    @pytest.mark.parametrize("point", [(math.nan, 1.0), (1.0, math.inf), (1.0,), (1.0, 2.0, 3.0)])
    def test_points_that_are_none(self, point):
        for call in (
            lambda: best_triplet(WORLD, LASER, point),
            lambda: rank_triplets(WORLD, LASER, point),
            lambda: simulate_fixes(WORLD, LASER, point, n=5, rng=np.random.default_rng(1)),
        ):
            with pytest.raises(LocalizationError, match="finite"):
                call()

    @pytest.mark.parametrize("heading", WORSE)
    def test_headings_that_are_none(self, heading):
        for call in (
            lambda: best_triplet(WORLD, FORWARD_CAMERA, (1.0, 1.0), heading=heading),
            lambda: rank_triplets(WORLD, FORWARD_CAMERA, (1.0, 1.0), heading=heading),
            lambda: simulate_fixes(
                WORLD, FORWARD_CAMERA, (1.0, 1.0), heading=heading, n=5, rng=np.random.default_rng(1)
            ),
        ):
            with pytest.raises(LocalizationError, match="finite"):
                call()

    @pytest.mark.parametrize("point", [(0.25, 0.25), (-50.0, 2.0), (1e9, 1e9)])
    def test_walls_and_places_off_the_map_have_no_fix(self, point):
        assert best_triplet(WORLD, LASER, point) is None
        assert rank_triplets(WORLD, LASER, point) == []
        with pytest.raises(DegenerateGeometry, match="No triplet"):
            simulate_fixes(WORLD, LASER, point, n=5, rng=np.random.default_rng(1))

    @pytest.mark.parametrize("triplet", [(0, 1), (0, 0, 1), (0, 1, 9), (-1, 0, 1)])
    def test_triplets_that_are_none(self, triplet):
        with pytest.raises(LocalizationError, match="three different numbers"):
            simulate_fixes(WORLD, LASER, (1.0, 1.0), triplet=triplet, n=5, rng=np.random.default_rng(1))

    @pytest.mark.parametrize("triplet", [(0, 1), (0, 0, 1), (0, 1, 9), (-1, 0, 1), "abc", None, (0, 1, 2.5)])
    def test_one_triplet_s_status(self, triplet):
        for call in (triplet_status, one_triplet):
            with pytest.raises(LocalizationError, match="three different numbers"):
                call(WORLD, LASER, (1.0, 1.0), triplet)

    def test_failed_fixes_are_counted(self):
        # Noise of 30°: many measurements admit no pose.
        wild = OmnidirectionalSensor(bearing_sigma=math.radians(30.0))
        cloud = simulate_fixes(WORLD, wild, (1.5, 1.75), n=2000, rng=np.random.default_rng(2))
        assert 0 < cloud.failures < 2000
        assert len(cloud.errors) == 2000 - cloud.failures
        assert np.isfinite(cloud.errors).all()
        assert_flagged(cloud.fixes)
        assert not cloud.inside[~cloud.fixes.ok].any()


class TestWhatIsNoNumber:
    @pytest.mark.parametrize("bad", ["x", None, True, [1.0], 1j])
    def test_in_sensors(self, bad):
        for call in (
            lambda: OmnidirectionalSensor(bearing_sigma=bad),
            lambda: OmnidirectionalSensor(0.1, max_range=bad),
            lambda: OmnidirectionalSensor(0.1, mount=bad),
            lambda: OmnidirectionalSensor(0.1, muted=[(0.0, bad)]),
            lambda: replace(MAS97_CAMERA, field_of_view=bad),
            lambda: replace(MAS97_CAMERA, pan_min=bad),
            lambda: replace(MAS97_CAMERA, pan_policy=bad),
            lambda: replace(FORWARD_CAMERA, mount=bad),
            lambda: Mount(bad),
            lambda: Camera(bad),
            lambda: Camera(500.0, principal_px=bad),
        ):
            with pytest.raises(InvalidSensor):
                call()

    @pytest.mark.parametrize("muted", [[(0,)], [(0, 1, 2)], [0.5], 3, "ab", None])
    def test_in_muted_sectors(self, muted):
        with pytest.raises(InvalidSensor, match="muted"):
            OmnidirectionalSensor(0.1, muted=muted)

    def test_whole_numbers_are_numbers(self):
        assert OmnidirectionalSensor(1, max_range=np.int64(5)).max_range == 5
        assert OmnidirectionalSensor(np.float32(0.5)).bearing_sigma == 0.5

    @pytest.mark.parametrize("point", ["ab", None, ["a", 1], [[1, 2], [3]], object()])
    def test_in_places(self, point):
        for call in (
            lambda: best_triplet(WORLD, LASER, point),
            lambda: rank_triplets(WORLD, LASER, point),
            lambda: triplet_status(WORLD, LASER, point, (0, 1, 2)),
            lambda: simulate_fixes(WORLD, LASER, point, rng=np.random.default_rng(1)),
        ):
            with pytest.raises(LocalizationError):
                call()

    @pytest.mark.parametrize("heading", ["x", None, [1.0], True])
    def test_in_headings_and_counts(self, heading):
        for call in (
            lambda: best_triplet(WORLD, LASER, (1.0, 1.0), heading=heading),
            lambda: simulate_fixes(WORLD, LASER, (1.0, 1.0), heading=heading, rng=np.random.default_rng(1)),
            lambda: rank_triplets(WORLD, LASER, (1.0, 1.0), count=heading),
            lambda: simulate_fixes(WORLD, LASER, (1.0, 1.0), n=heading or "x", rng=np.random.default_rng(1)),
        ):
            with pytest.raises(LocalizationError):
                call()

    @pytest.mark.parametrize("bad", [["a", 1, 2], "abc", [[1, 2, 3], [4]], object()])
    def test_in_measurements(self, bad):
        camera = Camera(500.0, 320.0, 640.0)
        columns = [100.0, 200.0, 300.0]
        for call in (
            lambda: triangulate(bad, CORNER),
            lambda: triangulate(BEARINGS, bad),
            lambda: triangulate(BEARINGS, CORNER, sigma=bad),
            lambda: triangulate(BEARINGS, CORNER, min_reliability=bad),
            lambda: triangulate_columns(bad, CORNER, camera),
            lambda: triangulate_columns(columns, CORNER, camera, pan=bad),
            lambda: locate(bad, CORNER, 0.1),
            lambda: locate(BEARINGS, CORNER, bad),
            lambda: locate_columns(bad, CORNER, camera, 1.0),
            lambda: locate_columns(columns, CORNER, camera, 1.0, pan=bad),
            lambda: locate_columns(columns, CORNER, camera, bad),
            lambda: camera.bearings(bad),
            lambda: camera.columns(bad),
            lambda: camera.bearing_sigma(columns, bad),
            lambda: update_with_bearings(BELIEF, bad, CORNER, sigma=0.1),
            lambda: update_with_fix(BELIEF, bad, np.eye(3)),
            lambda: update_with_fix(BELIEF, [0.0, 0.0, 0.0], bad),
            lambda: PoseBelief(bad, np.eye(3)),
        ):
            with pytest.raises(LocalizationError):
                call()

    def test_in_names_of_files(self):
        for call in (read_mrclam_mat, read_roh, lambda name: read_mrclam_run(name, 1)):
            with pytest.raises(LogFormatError):
                call("/nowhere/at all")


def test_errors_all_stand_in_the_tree():
    """Every exception of the layer is made in errors.py and drawn there, with its parents."""
    drawn = {line.split("── ")[1].split()[0] for line in errors.__doc__.splitlines() if "── " in line}
    made = {name for name, kind in vars(errors).items() if isinstance(kind, type)} - {"SurepathError"}
    assert drawn == made
    assert all(issubclass(getattr(errors, name), SurepathError) for name in made)
    folder = Path(errors.__file__).parent
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            bases = (
                {b.id for b in node.bases if isinstance(b, ast.Name)}
                if isinstance(node, ast.ClassDef)
                else set()
            )
            if bases & (made | {"Exception", "ValueError", "SurepathError"}):
                assert path.name == "errors.py", node.name
