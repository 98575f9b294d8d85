"""The queries and transactions of an archive."""
