"""Routes, one noun per file, and the JSON they speak; no SQL and no planning here."""
