"""Reads and judges recorded traces; nothing here needs a simulator."""
