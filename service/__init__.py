"""What users touch: specifications in, a durable archive, an API, a live page and a command line out."""
