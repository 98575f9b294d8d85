"""Analysis of trajectories and campaigns: samples for figures, statistics, costs, and missed thrust."""
