"""Programs: what a specification is compiled to."""
