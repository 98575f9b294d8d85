"""What is about the paper alone: its values, its figures and its motivating example."""
