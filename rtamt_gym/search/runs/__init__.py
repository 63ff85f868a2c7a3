"""Runs cases of one system, one by one or in lanes, and keeps what each has become."""
