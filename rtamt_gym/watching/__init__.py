"""Streams of rows, judged while they come: what `rtamt watch` runs.

`sources` reads bytes, `text_rows` and `json_rows` divide them into rows, `values` turns cells into
numbers and times, `sampled` and `events` judge the trace of one group, `watch` runs them, and
`lines` writes what becomes known. Rules of numbers, times and columns are those of
`rtamt_gym.recorded`, so that a stream is read as a file is.
"""
