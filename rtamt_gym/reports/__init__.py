"""The report page: results of evaluations, sweeps, searches and traces for readers."""
