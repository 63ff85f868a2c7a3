"""Monitors of streams of rows, for `rtamt watch`.

`sources` reads bytes, `rows` divides them, `values` turns cells into numbers and times, `sampled`
and `events` judge the trace of one group, `watch` runs them, `lines` and `screen` show results. A
stream is read by the rules for files in `rtamt_gym.recorded`.
"""
