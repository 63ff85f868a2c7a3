"""The machine that bounds the robustness of an episode."""
