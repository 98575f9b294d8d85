"""The tables and the connections to them."""
