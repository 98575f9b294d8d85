"""What measures the product itself: a developer's tools, run from a clone and never installed."""
