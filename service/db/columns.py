"""Column types that read the same on SQLite's STRICT tables and on PostgreSQL."""

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import REAL, BigInteger, Boolean, Dialect, Double, Index, Integer, LargeBinary, Text, text
from sqlalchemy.types import TypeDecorator, TypeEngine

#: Eight bytes everywhere; SQLite's STRICT tables know the name REAL alone.
Number: TypeEngine[float] = Double().with_variant(REAL(), "sqlite")
#: Eight bytes as well: an rng_seed needs them, and SQLite counts rows in a column called INTEGER alone.
Whole: TypeEngine[int] = BigInteger().with_variant(Integer(), "sqlite")


def partial_index(name: str, *columns: str, where: str) -> Index:
    """Return an index of the rows that a condition admits."""
    return Index(name, *columns, sqlite_where=text(where), postgresql_where=text(where))


class Flag(TypeDecorator[bool]):
    """A boolean; 0 or 1 in SQLite, whose STRICT tables know no other."""

    impl = Boolean
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[Any]:
        """Choose the column's type."""
        return dialect.type_descriptor(Integer() if dialect.name == "sqlite" else Boolean())

    def process_bind_param(self, value: bool | None, dialect: Dialect) -> bool | int | None:
        """Write."""
        if value is None:
            return None
        return int(value) if dialect.name == "sqlite" else bool(value)

    def process_result_value(self, value: Any, dialect: Dialect) -> bool | None:
        """Read."""
        return None if value is None else bool(value)


class Json(TypeDecorator[Any]):
    """Plain data as JSON text."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: Any, dialect: Dialect) -> str | None:
        """Write; NaN and infinities are no JSON and are refused."""
        return None if value is None else json.dumps(value, allow_nan=False, separators=(",", ":"))

    def process_result_value(self, value: str | None, dialect: Dialect) -> Any:
        """Read."""
        return None if value is None else json.loads(value)


class Vector(TypeDecorator[NDArray[np.float64]]):
    """A vector of float64 as its little-endian bytes, which keep every bit."""

    impl = LargeBinary
    cache_ok = True

    def process_bind_param(self, value: Any, dialect: Dialect) -> bytes | None:
        """Write."""
        return None if value is None else np.ascontiguousarray(value, dtype="<f8").tobytes()

    def process_result_value(self, value: bytes | None, dialect: Dialect) -> NDArray[np.float64] | None:
        """Read."""
        return None if value is None else np.frombuffer(value, dtype="<f8").astype(np.float64)
