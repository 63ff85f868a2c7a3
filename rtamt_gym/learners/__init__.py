"""What learners call while they train: callbacks that measure satisfaction."""
