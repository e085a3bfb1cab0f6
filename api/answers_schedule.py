"""What answers say of schedules of landmarks; fields as in :mod:`api.codec_schedule`."""

from __future__ import annotations

from pydantic import Field

from api.answers_base import Answer


class PanAt(Answer):
    """Where a pan head looks at a moment."""

    t_s: float = Field(description="From the start of the trajectory.")
    pan_rad: float = Field(
        description="Angle of the optical axis, counter-clockwise from the direction of the mount: in the "
        "map it looks along the robot's heading + mount.theta + pan. Without a heading of its own the robot "
        "faces its way. Within the limits of the head; of one that turns all the way round -π to π."
    )


class Stretch(Answer):
    """A part of a route on which one triplet is looked at, or none."""

    kind: str = Field(
        description="fix: the triplet is looked at. turning: the pan head turns to the next one, without a "
        "fix. blind: no triplet that it could be turned to in time gives a fix that is worth it; it waits."
    )
    s_start_m: float = Field(description="Way driven from the start of the route.")
    s_end_m: float
    t_start_s: float = Field(
        description="Of a fix: by when the head must have turned to pan_start_rad. Of turning: when it "
        "begins, as the use of the last triplet ends there."
    )
    t_end_s: float
    triplet: list[str] | None = Field(description="Ids of the landmarks; null without a fix.")
    pan_start_rad: float | None = Field(description="Where a pan head looks, as pan_rad; null without one.")
    pan_end_rad: float | None
    pan: list[PanAt] = Field(
        description="Where it looks from moment to moment, to be followed evenly (by a head that turns all "
        "the way round: the shorter way), which is no faster than its rate; empty without one."
    )
    mean_r95_m: float | None = Field(description="Of single fixes along the stretch, per metre.")
    max_r95_m: float | None
    turn_from_s: float | None = Field(
        description="The latest moment to begin turning, so that the head is there at t_start_s; null "
        "without one, without a fix, and for the first triplet, to which it is turned before the start."
    )
    usable_after_m: float = Field(description="How much further than the end the triplet gives a fix.")
    late_r95_m: float | None = Field(
        description="Worst r95 if this triplet is looked at for one second more than to t_end_s; null: no "
        "fix for a part of it, or no triplet after it."
    )
    late_blind_m: float | None = Field(
        description="What it costs to leave this triplet a second later than at t_end_s: how many metres "
        "more are driven without a fix until the next one is in view. null: no triplet after it."
    )


class ScheduleFigures(Answer):
    """What a schedule comes to; of what is really looked at."""

    switches: int = Field(description="How often the triplet changes.")
    mean_r95_m: float | None = Field(description="Of single fixes, per metre with one; null without any.")
    max_r95_m: float | None
    blind_m: float = Field(description="Without a fix, for whatever reason.")
    blind_s: float
    turning_m: float = Field(description="Of it: because the pan head turns.")
    turning_s: float
    longest_blind_m: float = Field(description="The longest part without a fix.")
    pan_rate_rad_s: float | None = Field(description="null: the head turns at once, or there is none.")
