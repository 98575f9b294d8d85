"""Independent verification: a trajectory is propagated again without any code of what computed it."""
