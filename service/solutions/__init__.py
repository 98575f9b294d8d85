"""What is done with a stored solution: its record in, a file, a finer or the same flight, a verdict out."""
