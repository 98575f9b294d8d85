"""Who may ask what: a request in, the same request with its identity out, or a refusal."""
