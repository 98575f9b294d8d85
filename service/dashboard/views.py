"""The pages of the dashboard: address, name and title of each.

The name is that of its template below `templates/views` and of its module below `static/views`.
"""

from typing import NamedTuple


class View(NamedTuple):
    """A page with an address of its own."""

    path: str
    name: str
    title: str
    #: The place in the navigation that it belongs to.
    section: str
    #: Whether it draws with plotly.js, which it then asks for at once.
    has_plots: bool = True


VIEWS = (
    View("/", "campaigns", "Campaigns", "campaigns", has_plots=False),
    View("/campaigns/new", "submit", "New campaign", "campaigns", has_plots=False),
    View("/campaigns/{campaign_id}", "campaign", "Campaign", "campaigns"),
    View("/campaigns/{campaign_id}/searches/{search}", "search", "Search", "campaigns"),
    View("/archive", "archive", "Archive", "archive"),
    View("/compare", "compare", "Comparison", "archive"),
    View("/solutions/{solution_id}", "solution", "Solution", "archive"),
    View("/problems/{problem_hash}", "problem", "Problem", "archive"),
    View("/workers", "workers", "Workers and jobs", "workers", has_plots=False),
)
#: What the navigation shows, in order.
SECTIONS = (
    ("campaigns", "/", "Campaigns"),
    ("archive", "/archive", "Archive"),
    ("workers", "/workers", "Workers"),
)
