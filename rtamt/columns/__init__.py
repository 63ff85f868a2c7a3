"""Roles of the columns of a table: times with their unit, and ids of objects or episodes."""

from rtamt.columns.names import (
    NANOSECONDS,
    calendar_unit,
    has_plain_time_name,
    hinted_unit,
    name_words,
    own_times,
    split_times,
    unit_of_times,
)
from rtamt.columns.objects import (
    Objects,
    are_flags,
    count_restart,
    flagged_row,
    may_tell_objects,
    names_objects,
    next_episode,
    objects_in,
    tells_objects,
)
from rtamt.columns.times import (
    are_clock_numbers,
    are_days,
    dates_of_numbers,
    is_date,
    looks_like_times,
    median,
    plausible_units,
    stated_period,
)
from rtamt.columns.turns import objects_by_turns, turns_in

__all__ = [
    "NANOSECONDS",
    "Objects",
    "are_clock_numbers",
    "are_days",
    "are_flags",
    "calendar_unit",
    "count_restart",
    "dates_of_numbers",
    "flagged_row",
    "has_plain_time_name",
    "hinted_unit",
    "is_date",
    "looks_like_times",
    "may_tell_objects",
    "median",
    "name_words",
    "names_objects",
    "next_episode",
    "objects_by_turns",
    "objects_in",
    "own_times",
    "plausible_units",
    "split_times",
    "stated_period",
    "tells_objects",
    "turns_in",
    "unit_of_times",
]
