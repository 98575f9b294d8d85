"""Read models: what the store returns and the API sends; one module per noun."""
