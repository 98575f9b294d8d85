"""Whether a whole archive is sound, and setting aside what cannot be."""
