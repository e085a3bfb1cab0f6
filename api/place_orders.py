"""What the service asks of its workers about one place of a map; no field is needed for it."""

from __future__ import annotations

from dataclasses import dataclass

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


PlaceOrder = RankingOrder | SnapOrder
#: Order -> task of a worker.
PLACE_TASK_OF: dict[type[PlaceOrder], str] = {RankingOrder: "rank", SnapOrder: "snap"}
