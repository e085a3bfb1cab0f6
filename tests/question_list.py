"""The questions of docs/questions.md: who asks what, the commands that answer, and which figures are shown."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

#: Commands that make the fields, by the name of the file.
FIELDS = {
    "laser.zarr": "surepath field warehouse --sensor laser -o laser.zarr",
    "camera.zarr": "surepath field warehouse --sensor mas97 -o camera.zarr",
    "room.zarr": "surepath field mas97_room --sensor laser -o room.zarr",
    "room_camera.zarr": "surepath field mas97_room --sensor mas97 -o room_camera.zarr",
    "room_forward.zarr": "surepath field mas97_room --sensor forward --headings 36 -o room_forward.zarr",
}


def _u(name: str):
    return lambda route: route["uncertainty"][name]


def _r(name: str):
    return lambda route: route["risk"][name]


#: Columns of the tables: title, digits (None: as ``1.2e-5``), and where the figure stands in a route.
COLUMNS: dict[str, tuple[str, int | None, Any]] = {
    "length": ("length [m]", 2, lambda route: route["length_m"]),
    "duration": ("duration [s]", 1, lambda route: route["duration_s"]),
    "mean": ("mean r95 [m]", 3, _u("mean_r95_m")),
    "worst": ("worst r95 [m]", 3, _u("max_r95_m")),
    "ellipse": ("worst semi-major axis [m]", 3, _u("max_ellipse95_m")),
    "blind": ("without a fix [m]", 1, _u("blind_m")),
    "clearance": ("least clearance [m]", 3, lambda route: route["min_clearance_m"]),
    "p": ("collision probability", None, _r("max_collision_probability")),
    "bound": ("rigorous bound", None, _r("max_collision_bound")),
    "shared": ("shared", 2, lambda route: route.get("share")),
}
USUAL = ("length", "duration", "mean", "worst", "blind")


@dataclass(frozen=True, slots=True)
class Command:
    """One command and what is shown of its answer.

    Attributes
    ----------
    line
        As typed, without output and picture.
    row
        What its route is called in the table.
    has_picture
        Whether its picture is shown.
    expected
        Exit code.
    """

    line: str
    row: str = "this plan"
    has_picture: bool = True
    expected: int = 0


@dataclass(frozen=True, slots=True)
class Question:
    """One question.

    Attributes
    ----------
    name
        Of its pictures.
    title
        In words of this project.
    asks
        In the words of the person who asks.
    commands
        What answers it.
    see
        What to see in the picture; ``{length}`` and others are figures of the first answer.
    columns
        Of the table.
    files
        What the commands read, by name.
    """

    name: str
    title: str
    asks: str
    commands: tuple[Command, ...]
    see: str
    columns: tuple[str, ...] = USUAL
    files: dict[str, str] = field(default_factory=dict)


_HALL = "surepath plan laser.zarr --start 6.2 18 --goal 54 17"
_CAR = "surepath plan room.zarr --start 7.5 7 --goal 14.2 6 --start-heading-deg 0 --goal-heading-deg 90"
_CAR_ROBOT = '--footprint "1.1,0.4 1.1,-0.4 -0.5,-0.4 -0.5,0.4" --min-turn-radius 1.5'
_BUSY = (
    '{"type": "Feature", "properties": {"factor": 3}, "geometry": {"type": "Polygon", "coordinates": '
    "[[[12, 10], [44, 10], [44, 14.5], [12, 14.5], [12, 10]]]}}"
)
_CLOSED = '{"type": "Polygon", "coordinates": [[[20, 20], [24, 20], [24, 24], [20, 24], [20, 20]]]}'
_STATIONS = "id,x,y\ngate,4,36\npacking,6.2,18\naisle,30,27\ndock,30,3\nstore,54,17\n"
_BACK_AND_FORTH = "surepath plan room_forward.zarr --blind-r95 2 --deadline 10"

QUESTIONS = (
    Question(
        "shortest",
        "Shortest",
        "What is the shortest way, whatever the robot sees on it?",
        (Command(f"{_HALL} --objective shortest --blind-r95 1"),),
        "Straight through the aisle of the yellow and hatched cells: {blind:.0f} m of it without any fix, and fixes of up to "
        "{worst:.2f} m (r95) on the rest.",
    ),
    Question(
        "weighted",
        "Weighted",
        "I accept some extra metres for a surer robot: which way is worth it?",
        (Command(f"{_HALL} --weight 4 --deadline 10"),),
        "With up to four extra metres per metre driven at r95 = 1 m the next aisle is the better one: {extra:.1f} m more than the "
        "shortest way, never without a fix.",
    ),
    Question(
        "minimax",
        "Smallest worst uncertainty",
        "How sure can the robot be at the worst place of its way, at any price?",
        (Command(f"{_HALL} --objective minimax --deadline 10"),),
        "The worst r95 falls to {worst_mm:.1f} mm, for {extra:.0f} m of detour: by an aisle in the north and, from the cross aisle on, by the hall in the south.",
    ),
    Question(
        "pareto",
        "The front",
        "What does certainty cost? Show me all sensible compromises.",
        (Command(f"{_HALL} --objective pareto --count 8 --deadline 20"),),
        "From 1 (shortest with a fix everywhere) to {count} (surest): a few decimetres halve the worst r95, the last "
        "millimetres cost many metres.",
    ),
    Question(
        "max_r95",
        "A bound on r95",
        "Never less certain than 2.5 cm: is there a way, and how much longer is it?",
        (Command(f"{_HALL} --objective shortest --max-r95 0.025 --deadline 10"),),
        "The aisle of the weighted plan is not sure enough any more: {extra_percent:.1f} % longer than the shortest way, along the "
        "hall in the south.",
    ),
    Question(
        "max_ellipse",
        "A bound on the ellipse",
        "My doors care for the error in its worst direction: can it stay below 3.5 cm?",
        (Command(f"{_HALL} --objective shortest --max-ellipse95 0.035 --deadline 10"),),
        "r95 is the radius of the circle with the ellipse's area, the semi-major axis the reach of the 95 % ellipse in its worst direction: places with long, thin "
        "ellipses are left out, and the way is {extra:.0f} m longer.",
        ("length", "duration", "worst", "ellipse", "blind"),
    ),
    Question(
        "unmet",
        "A bound that cannot be kept",
        "I want 1 cm everywhere. If that is impossible: what is possible?",
        (Command(f"{_HALL} --objective shortest --max-r95 0.01 --deadline 10", expected=3),),
        "The answer is `risk_unmet` (exit code 3) with the way that has the smallest bound possible; the red ring is where it is "
        "least certain.",
    ),
    Question(
        "collision",
        "Collision probability",
        "Can it pass these corners without touching them, as uncertain as it is there?",
        (
            Command(
                "surepath plan room_camera.zarr --start 5 1 --goal 11 14 --objective shortest --blind-r95 1 "
                "--max-collision-probability 0.01 --deadline 10"
            ),
        ),
        "The ellipses are to scale: the shortest way cuts corners where they reach into the obstacles. The probability of every pose "
        "is bounded by a measure that knows the direction of the error ({p:.2g} at worst); the rigorous bound by the largest axis "
        "alone ({bound:.2g}) stands beside it. [Simulation](simulation.md) backs the former.",
        ("length", "duration", "worst", "blind", "clearance", "p", "bound"),
    ),
    Question(
        "blind",
        "Metres without a fix",
        "It may lose its landmarks for three metres at a time, not for longer: which way?",
        (
            Command(
                "surepath plan camera.zarr --start 6.2 18 --goal 54 17 --objective shortest --max-blind-distance 3 "
                "--deadline 10"
            ),
        ),
        "Hatched cells fill most of every aisle: the way goes around by the hall in the south, {blind:.1f} m without a fix in all instead of "
        "{shortest_blind:.0f} m, no stretch longer than 3 m.",
    ),
    Question(
        "fused",
        "The filter's belief",
        "It has odometry and a filter. Where should it get a good fix before it goes where there are none?",
        (
            Command(
                "surepath plan camera.zarr --start 9 22.6 --goal 27.8 27.8 --objective shortest --covariance fused "
                "--max-r95 0.3 --deadline 10"
            ),
        ),
        "The direct way (orange) has no fix for one long stretch at whose end the belief exceeds the bound; the blue one, {blind:.0f} m "
        "of it without a fix, fetches fixes between its blind stretches and arrives from the other side.",
    ),
    Question(
        "alternatives",
        "Alternatives",
        "If that aisle is blocked: what else is there?",
        (Command(f"{_HALL} --alternatives 4 --deadline 20"),),
        "Routes by cost that differ from each other; `shared` is the part of a route's length within the robot's width of those "
        "before it.",
        ("length", "duration", "mean", "worst", "blind", "shared"),
    ),
    Question(
        "areas",
        "Areas to avoid, areas that cost",
        "The aisle is closed today, and in front of the racks people are picking: go there only if it pays.",
        (Command(f"{_HALL} --avoid closed.geojson --areas busy.geojson --deadline 10"),),
        "The striped area is forbidden to the robot's body; metres in the area marked with factor 3 count threefold, so that the route passes "
        "south of it.",
        files={"closed.geojson": _CLOSED, "busy.geojson": _BUSY},
    ),
    Question(
        "via",
        "Places on the way",
        "Pick up something at two places first.",
        (Command(f"{_HALL} --via 30,33 --via 44,8.5 --deadline 10"),),
        "The numbered squares are passed in order; the robot stops there, and every leg is a plan of its own.",
    ),
    Question(
        "differential",
        "A robot that turns in place",
        "It stands facing the wall and shall arrive facing the other one.",
        (
            Command(
                "surepath plan room.zarr --start 2 3.5 --goal 12.5 4.5 --radius 0.4 --kinematics differential "
                "--start-heading-deg 90 --goal-heading-deg -90 --objective shortest --deadline 10"
            ),
        ),
        "It drives where a robot without a heading would, and turns on the spot at both ends (arrows): the same length, more seconds.",
        ("length", "duration", "worst", "clearance"),
    ),
    Question(
        "cars",
        "Cars: forwards only, or both ways",
        "It cannot turn in less than 1.5 m. How does it get in there, facing the right way?",
        (
            Command(
                f"{_CAR} --kinematics reeds_shepp {_CAR_ROBOT} --objective shortest --deadline 10",
                "Reeds–Shepp",
            ),
            Command(f"{_CAR} --kinematics dubins {_CAR_ROBOT} --objective shortest --deadline 10", "Dubins"),
        ),
        "With a reverse gear it passes its goal's side and backs in (magenta); without one it has to turn a loop first. The orange "
        "line is the shortest way of a disc that needs no heading.",
        ("length", "duration", "worst", "clearance"),
    ),
    Question(
        "footprint",
        "An outline through a narrow place",
        "It is 1.6 m long and 0.8 m wide. Can it pass this gap?",
        (
            Command(
                'surepath plan room.zarr --start 2.2 5.8 --goal 2.4 10.8 --footprint "0.8,0.4 0.8,-0.4 -0.8,-0.4 -0.8,0.4" '
                "--kinematics differential --objective shortest --deadline 10",
                "the outline",
            ),
            Command(
                "surepath plan room.zarr --start 2.2 5.8 --goal 2.4 10.8 --radius 0.894 --objective shortest --deadline 10",
                "a disc around it",
                has_picture=False,
                expected=3,
            ),
        ),
        "A disc that holds the outline (radius 0.894 m) fits through none of the gaps: proven, `no_path`. The outline itself fits, "
        "turned the right way.",
        ("length", "duration", "worst", "clearance"),
    ),
    Question(
        "forward",
        "A camera that looks ahead",
        "The camera cannot turn. Does it see enough on the way there, and on the way back?",
        (
            Command(f"{_BACK_AND_FORTH} --start 2 3 --goal 8 9", "there"),
            Command(f"{_BACK_AND_FORTH} --start 8 9 --goal 2 3", "back"),
        ),
        "Cost depends on the direction of travel, so that there and back are different ways: there it bends towards the landmarks "
        "ahead; on the way back it sees fewer than three almost everywhere and drives {last_blind:.1f} m without a fix.",
    ),
    Question(
        "schedule",
        "When to look where",
        "The camera sees 53° and pans at 120° a second. Which landmarks should it look at, and when should it turn?",
        (
            Command(
                "surepath plan room_camera.zarr --start 2 3 --goal 12 11 --blind-r95 1 --schedule --pan-rate-deg 120 --deadline 10"
            ),
        ),
        "One colour per triplet, with lines from the middle of its stretch to the three landmarks; grey where the pan head turns and "
        "there is no fix. The table says by when it must begin to turn, and what it costs to leave a triplet a second late; in the "
        "profile a dot has r95 meanwhile, and a cross means that more of the way is without a fix.",
    ),
    Question(
        "matrix",
        "A matrix",
        "How far is it between all my stations, and how uncertain does the robot get?",
        (Command("surepath matrix laser.zarr --points stations.csv"),),
        "One search per station, not one plan per pair.",
        files={"stations.csv": _STATIONS},
    ),
    Question(
        "reach",
        "Within reach",
        "Where can it be within 30 m without ever being less certain than 3 cm?",
        (Command("surepath reach laser.zarr --from 6.2 18 --max-length 30 --max-r95 0.03"),),
        "The outlined region; pale is what lies too far, or behind cells that are too uncertain, such as two of the aisles.",
    ),
    Question(
        "simulation",
        "In closed loop",
        "Will it really work?",
        (
            Command(
                "surepath plan room_camera.zarr --start 5 1 --goal 11 14 --objective shortest --blind-r95 1 "
                "--max-collision-probability 0.01 --deadline 10",
                has_picture=False,
            ),
            Command("surepath simulate room_camera.zarr --plan plan.json --runs 1000"),
        ),
        "The plan promises at most 1 % per pose. Green: true tracks; below, true errors beside predicted ones. More, on all bundled sites and on three real "
        "maps: [Plans in simulation](simulation.md).",
    ),
)  # fmt: skip
