"""What trajectories and campaigns are worth: samples for figures, statistics, costs, and what outages do."""
