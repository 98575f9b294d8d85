"""States of campaigns, searches and jobs, and every change of state that there is.

The database refuses all others by triggers made from this table, so that no code path can make one.
"""

from collections.abc import Iterable, Mapping

#: From each state those that may follow it.
Transitions = Mapping[str, tuple[str, ...]]

#: A paused campaign drains: running jobs finish, and the last of them may end it.  Done ones open again
#: when a job that failed is tried once more; cancelled is for good.
CAMPAIGN: Transitions = {
    "active": ("paused", "done", "cancelled"),
    "paused": ("active", "done", "cancelled"),
    "done": ("active",),
    "cancelled": (),
}
#: Waiting ones have no jobs now and may get seeds, or belong to a large campaign that is still being planned.
SEARCH: Transitions = {
    "waiting": ("active", "paused", "done", "cancelled"),
    "active": ("waiting", "paused", "done", "cancelled"),
    "paused": ("waiting", "active", "done", "cancelled"),
    "done": ("waiting", "active"),
    "cancelled": (),
}
#: A running job goes back to the queue when its worker is lost or gives it up; dead and cancelled ones
#: when an operator says so.
JOB: Transitions = {
    "queued": ("running", "cancelled"),
    "running": ("done", "queued", "dead", "cancelled"),
    "done": (),
    "dead": ("queued",),
    "cancelled": ("queued",),
}
TRANSITIONS: Mapping[str, Transitions] = {"campaign": CAMPAIGN, "search": SEARCH, "job": JOB}

#: States in which a campaign or a search does nothing more by itself.
ENDED = ("done", "cancelled")


def may_change(noun: str, old: str, new: str) -> bool:
    """Return whether a campaign, search or job may go from one state to another."""
    return new in TRANSITIONS[noun][old]


def sources(noun: str, new: str) -> list[str]:
    """Return the states from which one can be reached."""
    return [old for old, following in TRANSITIONS[noun].items() if new in following]


def pairs(transitions: Transitions) -> Iterable[tuple[str, str]]:
    """Return every change (old, new)."""
    return [(old, new) for old, following in transitions.items() for new in following]
