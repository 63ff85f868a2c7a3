"""The page that people read: what evaluations, sweeps, searches and traces have found."""
