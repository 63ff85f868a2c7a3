"""Programs: compiled specifications."""
