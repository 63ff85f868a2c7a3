"""Monitors for other tools: functional mock-up units (FMUs)."""
