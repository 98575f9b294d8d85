"""What a trajectory is worth: independent verification, metrics, and samples for pictures."""
