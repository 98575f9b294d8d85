"""What the store returns, the API sends and its clients read: one module per noun."""
