"""What users call: monitors, evaluation of traces, explanations."""
