"""The samples, events and messages that callers hand in, read as arrays of numbers."""
