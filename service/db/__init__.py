"""The tables and the connections to them."""

# Imported so that `Base.metadata` knows these tables wherever it is used.
from service.db import identity as identity
