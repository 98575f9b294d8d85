"""Templates as pages."""

from jinja2 import Environment, PackageLoader, select_autoescape

from service.dashboard import assets

_templates = Environment(
    loader=PackageLoader("service.dashboard"),
    autoescape=select_autoescape(),
    trim_blocks=True,
    lstrip_blocks=True,
)


def page(template: str, **values: object) -> str:
    """Return a page; the names of its static files change with their content."""
    return _templates.get_template(template).render(
        static=f"/static/{assets.static_digest()}", plotly=f"/static/{assets.plotly_name()}", **values
    )
