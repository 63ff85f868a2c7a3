"""What came of runs and traces: one model, one file format, and how it is shown."""
