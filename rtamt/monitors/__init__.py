"""The objects that users call: monitors, evaluations of traces, explanations."""
