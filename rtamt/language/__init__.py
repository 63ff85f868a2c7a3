"""The language: operators, formulas, specifications and their text."""
