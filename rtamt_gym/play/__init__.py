"""Plays systems under monitors: one run, many runs, and campaigns on processes and machines."""
