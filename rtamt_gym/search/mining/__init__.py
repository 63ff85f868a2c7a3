"""Mining of the tightest constant with which a requirement holds on all traces."""
