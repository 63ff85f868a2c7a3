"""Monitors of streams of rows, for `rtamt watch`.

`sources` reads bytes, `text_rows` and `json_rows` divide them into rows, `values` turns cells into
numbers and times, `sampled` and `events` judge the trace of one group, `watch` runs them, and
`lines` writes results. A stream is read by the rules for files in `rtamt_gym.recorded`.
"""
