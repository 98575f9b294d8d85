"""Planning: campaign and progress in, next jobs out; pure functions that the store calls."""
