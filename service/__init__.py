"""The service: specifications, a durable archive, a REST API, a live web page and a command line."""
