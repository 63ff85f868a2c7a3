"""Recorded traces under specifications, read from files; nothing here needs a simulator."""
