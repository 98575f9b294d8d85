"""The web page: templates, ES modules and the plotting library, all from this origin.

`assets` serves files that never change under their name, `pictures` turns a flight into JSON, and
`service.api.pages` has the routes.
"""
