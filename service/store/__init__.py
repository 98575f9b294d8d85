"""Every query: what may be asked of the archive, and what may be done to it."""
