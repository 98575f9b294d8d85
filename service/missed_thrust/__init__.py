"""What outages do to one trajectory: a solution in, a campaign that tries them, and its maps out."""
