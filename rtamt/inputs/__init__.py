"""From what a caller hands over to arrays of numbers."""
