"""What the service asks of its workers about one place of a map; no field is needed for it."""

from __future__ import annotations

from dataclasses import dataclass

from localization.method import Estimator
from localization.sensors import Criterion, Sensor


@dataclass(frozen=True, slots=True)
class RankingOrder:
    """The triplets at a place, ranked.

    Attributes
    ----------
    place, heading
        The robot's centre (m) and heading (rad) in W.
    sensor
        What measures.
    count
        How many ranked, and how many missed triplets at most.
    criterion
        What makes a triplet better.
    triplet
        Ids of three landmarks to ask about alone; None: rank them all.
    deadline
        s.
    """

    place: tuple[float, float]
    heading: float
    sensor: Sensor
    count: int
    criterion: Criterion
    deadline: float
    triplet: tuple[str, str, str] | None = None


@dataclass(frozen=True, slots=True)
class SnapOrder:
    """The nearest place (m) at which a disc of ``radius`` (m) fits; ``heading`` (rad) comes back."""

    place: tuple[float, float]
    heading: float | None
    radius: float
    deadline: float


@dataclass(frozen=True, slots=True)
class FixesOrder:
    """Simulated fixes at a pose.

    Attributes
    ----------
    place, heading, sensor, deadline
        As of :class:`RankingOrder`.
    estimator, triplet
        What a fix is made of; ids of three landmarks, None: the best.
    count, seed
        How many measurements, and of which noise.
    points
        How many fixes of them to give one by one.
    """

    place: tuple[float, float]
    heading: float
    sensor: Sensor
    estimator: Estimator
    triplet: tuple[str, ...] | None
    count: int
    seed: int
    points: int
    deadline: float


@dataclass(frozen=True, slots=True)
class LocalizeOrder:
    """The pose of a robot that measured landmarks.

    Attributes
    ----------
    sensor
        What measured: its noise and mount.
    landmarks
        Ids.
    bearings
        One for each landmark, rad from the sensor's zero direction; None: columns were measured.
    columns, principal_px, pan
        Image columns, px; the axis's column, None: the middle; the axis from the mount's direction, rad.
    sigma
        Standard deviations of the bearings, rad; NaN: the sensor's own.
    deadline
        s.
    """

    sensor: Sensor
    landmarks: tuple[str, ...]
    bearings: tuple[float, ...] | None
    columns: tuple[float, ...] | None
    principal_px: float | None
    pan: float
    sigma: tuple[float, ...]
    deadline: float


PlaceOrder = RankingOrder | SnapOrder | FixesOrder | LocalizeOrder
#: Order -> task of a worker.
PLACE_TASK_OF: dict[type[PlaceOrder], str] = {
    RankingOrder: "rank",
    SnapOrder: "snap",
    FixesOrder: "fixes",
    LocalizeOrder: "localize",
}
