"""The variables of an exported monitor: names, value references, start values.

=================  ================================================================  =============
value reference    variable                                                          type
=================  ================================================================  =============
0                  ``time``, the independent variable (FMI 3.0 alone)                Float64
1, 2, 3            ``robustness``, ``lower``, ``upper``                              Real, Float64
4                  ``verdict``: -1 violated, 0 undecided, 1 satisfied                Integer, Int32
5                  ``stop_on_violation``                                             Boolean
8 and on           the inputs, the parameters, the constants that are fixed,         Real, Float64
                   the named formulas: in this order, without gaps
=================  ================================================================  =============

A monitor of samples takes in one sample at each step, whose size is the period. The sample of a step
from t to t + h are the values that the inputs have at its begin, t; the outputs at t + h are those of
`EpisodeMonitor`, and of `Monitor.values`, after this sample. At the begin of a simulation no sample
was seen: robustness and named formulas are nan, bounds and verdict those of a fresh monitor.

A monitor over dense time takes steps of any size. A step from t to t + h hands over one event of
every variable at t with the values that the inputs have there.

Parameters may be set until initialization ends. From them follow the values of the program's
constants, by functions of `rtamt.program.algebra` that are applied once, when initialization ends:
one that is not a number ends it with an error. A parameter of -0.0 is 0.0, as a text has it.
"""

from __future__ import annotations

__all__ = ["FIRST", "RESERVED"]

RESERVED = ("time", "robustness", "lower", "upper", "verdict", "stop_on_violation")
"""The names of a monitor's own variables; their value references are their places here."""

FIRST = 8
"""The value reference of the first input."""
