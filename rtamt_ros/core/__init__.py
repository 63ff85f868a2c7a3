"""From messages to reports: what a monitor does with topics, on any middleware or on none."""
