"""Robot poses from bearings: three in closed form, one fix or a million; more by least squares."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt
from scipy.stats import chi2 as chi2_distribution

from localization.camera import Camera
from localization.errors import DegenerateGeometry, InvalidMeasurement
from localization.kernels import least_squares
from localization.kernels import triangulation as kernel
from localization.kernels.trigonometry import MAX_ANGLE
from maps.arrays import BoolArray, FloatArray, frozen

#: Below it a fix counts as lying on the danger circle: rounding would decide the result.
MIN_RELIABILITY = 1e-9
#: Starts of a least-squares fix come from the triplets among this many bearings, spread over the directions.
START_BEARINGS = 20
MAX_STEPS = 60
#: Larger sigmas (rad, px) say nothing, and their squares would leave the range of numbers.
MAX_SIGMA = 1e12
_STARTS_TRIED = 4
_NO_CAMERA = np.empty(0)
_NO_PAN = np.zeros(1)


class FixStatus(IntEnum):
    """What became of a fix; everything but ``OK`` has no pose (NaN)."""

    OK = int(kernel.OK)
    #: Robot and landmarks on one circle or line, landmarks at one place, or the robot at a landmark.
    DEGENERATE = int(kernel.DEGENERATE)
    #: No pose sees the landmarks under these bearings.
    NO_POSE = int(kernel.NO_POSE)
    #: A number is not finite, or beyond 10⁵ rad, 10¹² m or 10¹² px.
    NOT_FINITE = int(kernel.NOT_FINITE)
    #: An image column that the camera does not have.
    OUTSIDE_IMAGE = int(kernel.OUTSIDE_IMAGE)
    #: Least squares: the information has no inverse.
    SINGULAR = 5
    #: Least squares: steps ran out.
    NO_CONVERGENCE = 6


@dataclass(frozen=True, slots=True, eq=False)
class Fixes:
    """N fixes of three bearings each; read-only arrays.

    Attributes
    ----------
    pose
        Shape (N, 3): x, y (m) and heading (rad in [-π, π)) in W; NaN unless the status is ``OK``.
    covariance
        Shape (N, 3, 3): first-order covariance of the pose (m², m·rad, rad²), NaN as the pose; None when no
        sigma was given.
    status
        Shape (N,): values of :class:`FixStatus`.
    reliability
        Shape (N,): 0 on the danger circle to 1; NaN where the input is not finite or outside the image.
    """

    pose: FloatArray
    covariance: FloatArray | None
    status: npt.NDArray[np.uint8]
    reliability: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen(self.pose))
        object.__setattr__(self, "status", frozen(self.status, np.uint8))
        object.__setattr__(self, "reliability", frozen(self.reliability))
        if self.covariance is not None:
            object.__setattr__(self, "covariance", frozen(self.covariance))

    def __len__(self) -> int:
        return len(self.status)

    @property
    def ok(self) -> BoolArray:
        """Shape (N,): which fixes have a pose."""
        return np.asarray(self.status == FixStatus.OK)

    def count(self, status: FixStatus) -> int:
        """How many fixes ended so."""
        return int(np.count_nonzero(self.status == status))


@dataclass(frozen=True, slots=True, eq=False)
class PoseFix:
    """One fix of any number of bearings.

    Attributes
    ----------
    pose
        Shape (3,): x, y (m) and heading (rad in [-π, π)) in W; NaN unless the status is ``OK``.
    covariance
        Shape (3, 3): inverse of the information at the pose; NaN as the pose.
    status
        ``OK``, ``NO_POSE`` or ``DEGENERATE`` (no triplet gives a start), ``SINGULAR``, ``NO_CONVERGENCE``.
    chi2
        Weighted sum of squared residuals, with ``dof`` degrees of freedom; NaN without a start.
    steps
        Gauss-Newton steps tried.
    dof
        M - 3: bearings beyond those that a pose needs.

    Notes
    -----
    ``OK`` says that the steps ended, not that the bearings agree: see :attr:`p_value`,
    :meth:`is_consistent`. A misread landmark gives a pose too.
    """

    pose: FloatArray
    covariance: FloatArray
    status: FixStatus
    chi2: float
    steps: int
    dof: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", frozen(self.pose))
        object.__setattr__(self, "covariance", frozen(self.covariance))

    @property
    def p_value(self) -> float:
        """Probability that good bearings disagree at least so much: upper tail of χ² with ``dof`` degrees.

        1 for three bearings, which always agree; NaN without a pose.
        """
        if not self.converged:
            return math.nan
        return float(chi2_distribution.sf(self.chi2, self.dof)) if self.dof > 0 else 1.0

    def is_consistent(self, level: float = 0.999) -> bool:
        """Whether there is a pose and its bearings agree as well as ``level`` of good ones do.

        Raises
        ------
        InvalidMeasurement
            If the level is not between 0 and 1.
        """
        if not 0 < level < 1:
            raise InvalidMeasurement(f"Level is {level}; give a probability between 0 and 1, like 0.999.")
        return self.converged and self.p_value >= 1.0 - level

    @property
    def converged(self) -> bool:
        """Whether there is a pose."""
        return self.status == FixStatus.OK


def triangulate(
    bearings: npt.ArrayLike,
    landmarks: npt.ArrayLike,
    *,
    sigma: npt.ArrayLike | None = None,
    min_reliability: float = MIN_RELIABILITY,
) -> Fixes:
    """Poses from three bearings each, in closed form, for landmarks in any order and place.

    Parameters
    ----------
    bearings
        Shape (N, 3) or (3,): counter-clockwise from the robot's front, rad, any number of turns.
    landmarks
        Shape (3, 2), the same for all fixes, or (N, 3, 2): in W, m, in the order of the bearings.
    sigma
        Standard deviations of the bearings, rad: one, (3,) or (N, 3); None for no covariance.
    min_reliability
        Fixes at or below it are ``DEGENERATE``, in [1e-9, 1).

    Returns
    -------
    fixes
        One per row of bearings.

    Raises
    ------
    InvalidMeasurement
        If a shape or a sigma is impossible.
    DegenerateGeometry
        If landmarks shared by all fixes coincide. (One fix among many with landmarks of its own is flagged.)

    Notes
    -----
    Inverted about the second landmark, the circles through pairs of landmarks and the robot are lines; see
    ``localization.kernels.triangulation``. The reliability plays the part of the denominator of Pierlot and
    Van Droogenbroeck, A New Three Object Triangulation Algorithm for Mobile Robot Positioning, T-RO 2014.

    Examples
    --------
    >>> quarter = 1.5707963267948966
    >>> fix = triangulate([0.0, quarter, -quarter], [[3, 1], [1, 2], [1, 0]], sigma=0.01)
    >>> fix.pose.round(6).tolist()
    [[1.0, 1.0, 0.0]]
    """
    b = _measured(bearings, "bearings")
    return _fixes(b, landmarks, sigma, 1.0, _NO_PAN, _NO_CAMERA, min_reliability)


def triangulate_columns(
    columns: npt.ArrayLike,
    landmarks: npt.ArrayLike,
    camera: Camera,
    *,
    pan: npt.ArrayLike = 0.0,
    sigma_px: npt.ArrayLike | None = None,
    min_reliability: float = MIN_RELIABILITY,
) -> Fixes:
    """Poses from three image columns each; sine and cosine are not needed.

    Parameters
    ----------
    columns
        Shape (N, 3) or (3,), px; outside the camera's image a fix is ``OUTSIDE_IMAGE``.
    landmarks, min_reliability
        As for :func:`triangulate`.
    camera
        Which bearings the columns stand for.
    pan
        Optical axis counter-clockwise from the robot's front, rad: one, or (N,).
    sigma_px
        Standard deviations of the columns, px: one, (3,) or (N, 3); a bearing has ``σ cos²ψ / f``.

    Returns
    -------
    fixes
        Pose and covariance of the robot, not of the axis.

    Raises
    ------
    InvalidMeasurement, DegenerateGeometry
        As for :func:`triangulate`; also when ``pan`` has another length.
    """
    u = _measured(columns, "columns")
    axis = np.atleast_1d(np.asarray(pan, dtype=np.float64))
    if axis.shape not in {(1,), (len(u),)}:
        raise InvalidMeasurement(
            f"pan has shape {axis.shape} for {len(u)} fixes; give one angle or one per fix."
        )
    width = math.inf if camera.width_px is None else camera.width_px
    args = np.array([camera.focal_px, camera.principal_px, width])
    return _fixes(u, landmarks, sigma_px, 1.0 / camera.focal_px, axis, args, min_reliability)


def locate(bearings: npt.ArrayLike, landmarks: npt.ArrayLike, sigma: npt.ArrayLike) -> PoseFix:
    """Pose from three or more bearings: weighted least squares, started from the best triplet's closed form.

    Parameters
    ----------
    bearings
        Shape (M,), rad, M ≥ 3; a landmark may be measured more than once.
    landmarks
        Shape (M, 2): in W, m, at three places at least.
    sigma
        Standard deviations of the bearings, rad: one, or (M,); from 1e-12 to 1e12.

    Returns
    -------
    fix
        The start is the triplet's pose with the smallest weighted sum of squared residuals over all bearings;
        should the steps from it fail, the next ones are tried.

    Raises
    ------
    InvalidMeasurement
        If a shape or number is impossible.
    DegenerateGeometry
        If the landmarks stand at fewer than three places.
    """
    b = np.ascontiguousarray(bearings, dtype=np.float64)
    m = np.ascontiguousarray(landmarks, dtype=np.float64)
    if b.ndim != 1 or len(b) < 3 or m.shape != (len(b), 2):
        raise InvalidMeasurement(
            f"Bearings have shape {b.shape} and landmarks {m.shape}; give (M,) and (M, 2) with M ≥ 3."
        )
    if not (np.abs(b) <= MAX_ANGLE).all() or not (np.abs(m) <= kernel.MAX_COORDINATE).all():
        raise InvalidMeasurement("Bearings and landmarks must be finite, up to 1e5 rad and 1e12 m.")
    s = np.asarray(sigma, dtype=np.float64)
    if s.shape not in {(), (len(b),)} or not ((s >= 1e-12) & (s <= MAX_SIGMA)).all():
        raise InvalidMeasurement(
            f"sigma is {s.tolist()}; give one or {len(b)} numbers from 1e-12 to {MAX_SIGMA:g} rad."
        )
    if len(np.unique(m, axis=0)) < 3:
        raise DegenerateGeometry("The landmarks stand at fewer than three places; a fix needs three.")
    weights = np.ascontiguousarray(np.broadcast_to(s**-2.0, b.shape))
    b, m, weights = _read_only(b), _read_only(m), _read_only(weights)
    starts, otherwise = _starts(b, m, weights)
    failure = PoseFix(np.full(3, np.nan), np.full((3, 3), np.nan), otherwise, math.nan, 0, len(b) - 3)
    for start in starts:
        pose, covariance = start.copy(), np.empty((3, 3))
        outcome, steps, chi2 = least_squares.refine(b, m, weights, MAX_STEPS, pose, covariance)
        if outcome == least_squares.CONVERGED:
            return PoseFix(pose, covariance, FixStatus.OK, chi2, steps, len(b) - 3)
        if failure.steps == 0:
            singular = outcome == least_squares.SINGULAR
            status = FixStatus.SINGULAR if singular else FixStatus.NO_CONVERGENCE
            failure = PoseFix(failure.pose, failure.covariance, status, chi2, steps, len(b) - 3)
    return failure


def _starts(bearings: FloatArray, landmarks: FloatArray, weights: FloatArray) -> tuple[FloatArray, FixStatus]:
    """Poses (k, 3) of triplets, best first, and the status should there be none."""
    order = np.argsort(bearings % (2 * math.pi), kind="stable")
    picked = np.unique(np.linspace(0, len(order) - 1, min(len(order), START_BEARINGS)).astype(np.int64))
    triplets = np.array(list(itertools.combinations(order[picked].tolist(), 3)), dtype=np.int64)
    fixes = _fixes(bearings[triplets], landmarks[triplets], None, 1.0, _NO_PAN, _NO_CAMERA, MIN_RELIABILITY)
    if not fixes.ok.any():
        flat = fixes.count(FixStatus.DEGENERATE) == len(fixes)
        return np.empty((0, 3)), FixStatus.DEGENERATE if flat else FixStatus.NO_POSE
    poses = fixes.pose[fixes.ok]
    cost = [least_squares.chi_square(bearings, landmarks, weights, *pose) for pose in poses.tolist()]
    return poses[np.argsort(cost, kind="stable")[:_STARTS_TRIED]], FixStatus.OK


def _measured(values: npt.ArrayLike, name: str) -> FloatArray:
    out = np.atleast_2d(np.ascontiguousarray(values, dtype=np.float64))
    if out.ndim != 2 or out.shape[1] != 3:
        raise InvalidMeasurement(f"The {name} have shape {np.shape(values)}; give (N, 3) or (3,).")
    return out


def _fixes(
    measured: FloatArray,
    landmarks: npt.ArrayLike,
    sigma: npt.ArrayLike | None,
    unit: float,
    pan: FloatArray,
    camera: FloatArray,
    min_reliability: float,
) -> Fixes:
    """Call the kernel; ``unit`` turns sigma into radians on the optical axis."""
    n = len(measured)
    if not MIN_RELIABILITY <= min_reliability < 1:
        raise InvalidMeasurement(
            f"min_reliability is {min_reliability}; it must be from {MIN_RELIABILITY:g} to below 1."
        )
    places = _triplets(landmarks, n)
    variances = np.zeros((1, 3)) if sigma is None else _variances(sigma, n) * unit**2
    pose, status, reliability = np.empty((n, 3)), np.empty(n, dtype=np.uint8), np.empty(n)
    covariance = np.empty((0 if sigma is None else n, 3, 3))
    given = (_read_only(a) for a in (measured, places, variances, pan, camera))
    kernel.fixes(*given, min_reliability, pose, covariance, status, reliability)
    for array in (pose, covariance, status, reliability):
        array.flags.writeable = False
    return Fixes(pose, None if sigma is None else covariance, status, reliability)


def _read_only(array: FloatArray) -> FloatArray:
    """A view that nobody writes to: kernels are compiled for one kind of input only."""
    view = array.view()
    view.flags.writeable = False
    return view


def _triplets(landmarks: npt.ArrayLike, n: int) -> FloatArray:
    m = np.ascontiguousarray(landmarks, dtype=np.float64)
    if m.shape == (n, 3, 2):
        return m
    if m.shape != (3, 2):
        raise InvalidMeasurement(f"Landmarks have shape {m.shape}; give (3, 2), or ({n}, 3, 2).")
    if not (np.abs(m) <= kernel.MAX_COORDINATE).all():
        raise InvalidMeasurement("Landmarks must be finite and within 1e12 m.")
    size = np.ptp(m, axis=0).max()
    for i, j in itertools.combinations(range(3), 2):
        if math.dist(m[i], m[j]) <= kernel.COINCIDENT * size:
            raise DegenerateGeometry(
                f"Landmarks {i} and {j} both stand at ({m[i, 0]:g}, {m[i, 1]:g}) m; a fix needs three places."
            )
    return m[None]


def _variances(sigma: npt.ArrayLike, n: int) -> FloatArray:
    s = np.asarray(sigma, dtype=np.float64)
    if s.shape not in {(), (3,), (n, 3)}:
        raise InvalidMeasurement(f"sigma has shape {s.shape}; give one number, (3,) or ({n}, 3).")
    if not ((s >= 0) & (s <= MAX_SIGMA)).all():
        raise InvalidMeasurement(
            f"sigma must be ≥ 0 and at most {MAX_SIGMA:g}; it goes from {np.min(s)} to {np.max(s)}."
        )
    return np.ascontiguousarray(np.broadcast_to(s, (1, 3)) if s.ndim < 2 else s) ** 2
